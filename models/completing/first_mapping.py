"""A first mapping of a user's vehicle, inferred from its file, and the questions that remain open.

text, questions = first_mapping(read("rov.urdf"))
"""

import re
from collections.abc import Iterator

import mujoco
import numpy as np

from uuv.models.files.gazebo.thruster_limits import prior_thrust
from uuv.models.files.holding import TURNING, followed, massless
from uuv.models.files.vehicle_file import VehicleFile
from uuv.models.naming import HULL_BODY
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import GRAVITY

_LEAST = 2  # number of joints in a chain from which on the chain is taken for an arm
_PROPELLER = re.compile(r"thruster|propeller|prop(?![a-z])|\bthr", re.IGNORECASE)
_CAMERA = re.compile(r"cam", re.IGNORECASE)


def first_mapping(file: VehicleFile) -> tuple[str, list[str]]:
    """Text of an inferred mapping, in which guesses are marked, and the questions that remain open.

    Args:
        file: description of the vehicle, as read, without a mapping.

    Raises:
        ConfigurationError: it has no body.
    """
    spec = file.spec
    roots = list(spec.worldbody.bodies)
    if not roots:
        raise ConfigurationError(f"{file.name}: the file has no body that could be the hull")
    root = next((body for body in roots if body.name == HULL_BODY), roots[0])
    questions: list[str] = []

    lines = [f"hull: {_name(root.name)}"]
    lines += _masses(spec, root, questions)
    arms = _arms(spec, root, file)
    lines += _arm(root, arms, questions)
    lines += _camera(spec, questions)
    lines += _thrusters(spec, root, file, questions)
    lines += [
        "# trim: 0.05                 # [m] ballast the hull to this metacentric height, at home",
        "# up: -z                     # if z points down in the file",
        "# home: [...]                # [rad] folded posture, base to tip; searched for if it is "
        "not stated here",
    ]

    asked = [f"# ? {question}" for question in questions]
    title = f"# Mapping of {spec.modelname or root.name}."

    return "\n".join([title, *asked, *lines, ""]), questions


def _masses(spec: mujoco.MjSpec, root: mujoco.MjsBody, questions: list[str]) -> Iterator[str]:
    """Lines with a guessed mass for a hull without one, since such a hull cannot float."""
    del spec
    weighs = root.explicitinertial and root.mass > 0.0
    shapes = any(geom.density > 0.0 or geom.mass > 0.0 for geom in root.geoms)
    fixed = any(child.mass > 0.0 and not child.joints for child in root.bodies)

    if not (weighs or shapes or fixed):
        questions.append(f"mass of {root.name} [kg]: the file states none")
        yield f"masses: {{{_name(root.name)}: 30}}   # guessed"


def _arms(
    spec: mujoco.MjSpec, root: mujoco.MjsBody, file: VehicleFile
) -> list[list[mujoco.MjsJoint]]:
    """Chains of joints of the vehicle, longest first, without propellers and joints that follow
    others.
    """
    pushing = {thruster.body for thruster in file.thrusters}
    follows = followed(spec)
    light = {joint.name for joint in massless(spec)}

    def chain(body: mujoco.MjsBody) -> list[mujoco.MjsJoint]:
        mine = [
            joint
            for joint in body.joints
            if joint.type in TURNING and joint.name not in follows and joint.name not in light
        ]

        below = max((chain(child) for child in body.bodies), key=len, default=[])
        if body.name in pushing or (mine and not below and _PROPELLER.search(body.name)):
            return []

        return mine + below

    chains = [chain(child) for child in root.bodies]
    arms = sorted((joints for joints in chains if len(joints) >= _LEAST), key=len, reverse=True)
    return [_without_gripper(joints) for joints in arms]


def _without_gripper(joints: list[mujoco.MjsJoint]) -> list[mujoco.MjsJoint]:
    """Joints of an arm up to the body at which its chain branches, for instance into a gripper's
    fingers.
    """
    for i, joint in enumerate(joints[:-1]):
        moving = [child for child in joint.parent.bodies if _moves(child)]
        if len(moving) > 1:
            return joints[: i + 1]

    return joints


def _moves(body: mujoco.MjsBody) -> bool:
    return bool(body.joints) or any(_moves(child) for child in body.bodies)


def _arm(
    root: mujoco.MjsBody, arms: list[list[mujoco.MjsJoint]], questions: list[str]
) -> Iterator[str]:
    """Lines about the longest chain as the arm, and remarks about the other chains."""
    if not arms:
        yield "# no arm was identified: arm_base, tip, joints"
        return

    joints = arms[0]
    base = joints[0].parent.parent

    if base.name == root.name:
        questions.append(
            "arm_base: the arm is attached to the hull directly; insert a link that is fixed to "
            "the hull"
        )
        yield "# arm_base: NAME            # a separate link that is fixed to the hull"
    else:
        yield f"arm_base: {_name(base.name)}"

    last = joints[-1].parent
    questions.append(f"tip: where on {last.name} does the tool end, and which axis points out?")
    yield f"tip: {{body: {_name(last.name)}, pos: [0, 0, 0.1], z: [0, 0, 1]}}   # guessed"
    limits = ", ".join(f"{_name(joint.name)}: {_effort(joint, questions)}" for joint in joints)
    yield f"joints: {{{limits}}}   # torque limits [N m], base to tip; all other joints are held"
    for other in arms[1:]:
        yield (
            f"# joints of a second arm, which are held: {', '.join(joint.name for joint in other)}"
        )


def _effort(joint: mujoco.MjsJoint, questions: list[str]) -> str:
    most = float(np.abs(joint.actfrcrange).min()) if np.ptp(joint.actfrcrange) > 0.0 else 0.0
    if most > 0.0:
        return f"{most:g}"
    questions.append(f"torque limit of joint {joint.name} [N m]: the file states none")
    return "10"


def _camera(spec: mujoco.MjSpec, questions: list[str]) -> Iterator[str]:
    """A line about a link whose name is that of a camera; an optical frame is preferred."""
    named = [body.name for body in spec.bodies if _CAMERA.search(body.name)]
    named.sort(key=lambda name: ("optical" not in name.lower(), name))

    if not named:
        yield "# camera: {body: ..., pos: [x, y, z], z: [1, 0, -0.5]}   # default: ahead of the bow"
        return

    view = "[0, 0, 1]" if "optical" in named[0].lower() else "[1, 0, 0]"
    if len(named) > 1:
        questions.append(f"camera: which of {', '.join(named)}?")
    yield f"camera: {{body: {_name(named[0])}, z: {view}}}"


def _thrusters(
    spec: mujoco.MjSpec, root: mujoco.MjsBody, file: VehicleFile, questions: list[str]
) -> Iterator[str]:
    """Thrusters of the file, or guesses by the names of links."""
    if file.thrusters:
        guessed = [
            entry.part.removeprefix("thruster ")
            for entry in file.entries
            if entry.way == "guessed" and entry.quantity == "thrust"
        ]

        if guessed:
            questions.append(
                f"thrust [N] of the thrusters {', '.join(guessed)}: guessed, please state it"
            )
        yield f"# thrusters: {len(file.thrusters)} in the file; thrusters stated here replace them"

        return

    prior = prior_thrust(GRAVITY * max(_mass_of(root), 1.0))
    guesses = [body for body in spec.bodies if _PROPELLER.search(body.name)]
    if not guesses:
        questions.append(
            "thrusters: positions, directions and thrust; no link has the name of a thruster"
        )
        yield "thrusters: []   # - {name: ahead, pos: [x, y, z], direction: [1, 0, 0], kind: t200}"
        return

    questions.append("thrusters: inferred from the names of links; check directions and thrust [N]")
    yield "thrusters:   # guessed"

    for body in guesses:
        turning = [joint for joint in body.joints if joint.type in TURNING]
        axis = np.array(turning[0].axis) if turning else np.array([1.0, 0.0, 0.0])
        along = ", ".join(f"{entry:g}" for entry in axis)
        kind = f"{{forward: {prior:.3g}, reverse: {prior:.3g}}}"
        yield (
            f"  - {{name: {_name(body.name.rpartition('/')[2])}, body: {_name(body.name)}, "
            f"pos: [0, 0, 0], direction: [{along}], kind: {kind}}}"
        )


def _mass_of(body: mujoco.MjsBody) -> float:
    """Mass [kg] of a body and of the bodies that it carries, as far as their masses are stated."""
    mass = float(body.mass) if body.explicitinertial else 0.0
    return mass + sum(_mass_of(child) for child in body.bodies)


def _name(name: str) -> str:
    """A name as YAML text, quoted where YAML needs quotes."""
    plain = re.fullmatch(r"[A-Za-z_][\w./-]*", name) and name.lower() not in (
        "yes",
        "no",
        "on",
        "off",
    )

    return name if plain else f'"{name}"'
