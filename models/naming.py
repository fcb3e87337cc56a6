"""Contract for a vehicle's MJCF: names of bodies, sites, geoms, joints and keyframes, and their
look-up.

A vehicle is any MJCF with a free body `hull` and thruster actuators with a table of
`uuv.models.water.thrusters`. If it has an arm: a body `arm_base` fixed to the hull, a serial arm
whose driven joints each have an actuator (found by its transmission), and a site `tip` (z out of
the tool). Jobs also need a site `camera` (OpenCV axes). Optionally there is a sliding joint `pad`
behind the face of the pad.
"""

from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError

if TYPE_CHECKING:
    import mujoco

HULL_BODY = "hull"  # floating; also the name of its joint
ARM_BASE_BODY = "arm_base"  # fixed to the hull, base of the arm
TIP_SITE = "tip"  # of the tool, z pointing out
CAMERA_SITE = "camera"  # OpenCV axes
HOME_KEY = "home"  # arm folded; the vehicle is trimmed in this posture
TOOL_FACE_SITE = "pad_face"  # of a tool on a slide; without this site the tip is used
READY_KEY = "ready"  # arm bent; initial posture of inverse kinematics
# contacts of this geom count as work, all others as collisions
TOOL_GEOM = PAD_BODY = PAD_JOINT = "pad"
HANDLE = "handle"  # hinge of a valve's handle, and the sensor of the moment on it
RECEPTACLE = "receptacle_"  # before the name: body, site and force sensor of a panel's receptacle
GRIPPER = "gripper"  # motor of driven jaws, and the tendon of their opening
# Suffixes of the tool's name, for geoms of a gripper or socket whose contacts count as work too.
OTHER_PAD = "_right"
SLOT_BOTTOM = "_bottom"
# Parts that a job of the arm needs besides thrusters, with a short description of each. All of them
# fit into one message.
_PARTS = (
    ("body", HULL_BODY, "free"),
    ("body", ARM_BASE_BODY, "carries the arm"),
    ("site", TIP_SITE, "of the tool, z pointing out"),
    ("site", CAMERA_SITE, "sees the object"),
    ("geom", TOOL_GEOM, "may be in contact"),
    ("keyframe", HOME_KEY, "arm folded"),
    ("keyframe", READY_KEY, "arm bent, IK starts there"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PartNames:
    """Names of the parts of a vehicle in a model; scenes that attach several vehicles add
    prefixes.
    """

    hull: str = HULL_BODY
    arm_base: str = ARM_BASE_BODY
    tip: str = TIP_SITE
    tool: str = TOOL_GEOM
    tool_face: str = TOOL_FACE_SITE
    gripper: str = GRIPPER


USUAL_NAMES = PartNames()


def find(model: "mujoco.MjModel", kind: "mujoco.mjtObj", name: str) -> int:
    """Index of the named object; if it does not exist, a ConfigurationError lists those that do."""
    import mujoco

    index = mujoco.mj_name2id(model, kind, name)
    if index < 0:
        word = kind.name.removeprefix("mjOBJ_").lower()
        count = {
            mujoco.mjtObj.mjOBJ_BODY: model.nbody,
            mujoco.mjtObj.mjOBJ_SITE: model.nsite,
            mujoco.mjtObj.mjOBJ_JOINT: model.njnt,
            mujoco.mjtObj.mjOBJ_KEY: model.nkey,
            mujoco.mjtObj.mjOBJ_GEOM: model.ngeom,
        }[kind]
        names = [mujoco.mj_id2name(model, kind, i) for i in range(count)]
        raise ConfigurationError(
            f"the model has no {word} named {name!r}; the names are {[n for n in names if n]}"
        )
    return index


def of_geom(model: "mujoco.MjModel", geom: int) -> str:
    """Description of a geom for messages: its name, if it has one, and its body."""
    name = model.geom(geom).name
    body = model.body(int(model.geom_bodyid[geom])).name
    return repr(name or body) if name in ("", body) or body == "world" else f"{name!r} of {body!r}"


def parts(model: "mujoco.MjModel") -> list[tuple[str, str, str, bool]]:
    """Kind, name and use of each part that a job of the arm needs, and True if `model` has it.

    Thrusters come first.
    """
    import mujoco

    from uuv.models.water import thrusters

    driven = any(thrusters.carries(row) for row in np.asarray(model.actuator_user))
    kinds = mujoco.mjtObj
    enums = {
        "body": kinds.mjOBJ_BODY,
        "site": kinds.mjOBJ_SITE,
        "geom": kinds.mjOBJ_GEOM,
        "keyframe": kinds.mjOBJ_KEY,
    }

    named = [
        (word, name, use, mujoco.mj_name2id(model, enums[word], name) >= 0)
        for word, name, use in _PARTS
    ]
    return [("actuators", "thrusters", "station keeping of the hull", driven), *named]


def lacks(model: "mujoco.MjModel", but: Collection[str] = ()) -> list[str]:
    """Parts that a job of the arm needs and `model` lacks, with their use, except those in
    `but`.
    """
    return [
        name if name == "thrusters" else f"{word} {name!r} ({use})"
        for word, name, use, present in parts(model)
        if not present and name not in but
    ]


def check_parts(model: "mujoco.MjModel", but: Collection[str] = ()) -> None:
    """Raise ConfigurationError that names, with their use, the parts that `model` lacks for a job.

    `but` names parts that this job does not need.
    """
    if lacking := lacks(model, but):
        raise ConfigurationError(
            f"the vehicle lacks parts that this work needs: {', '.join(lacking)}"
        )


def has_gripper(model: "mujoco.MjModel", name: str = GRIPPER) -> bool:
    """Whether a compiled model has driven jaws: a motor of that name on a tendon."""
    import mujoco

    motor = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, name)
    return motor >= 0 and model.actuator_trntype[motor] == mujoco.mjtTrn.mjTRN_TENDON


def body_label(model: "mujoco.MjModel", body: int) -> str:
    """Name of a body in records and in files of other tools: its own or, without one, its number.

    Such files know parts by their names alone.
    """
    return model.body(body).name or f"body_{body}"
