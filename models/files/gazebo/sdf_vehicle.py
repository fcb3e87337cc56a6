"""The spec of a vehicle from an SDF, and the facts that the readers of its plugins need."""

from pathlib import Path
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from uuv.models.files.gazebo.content import FileContent, ModelFacts
from uuv.models.files.gazebo.plugins import content_of
from uuv.models.files.gazebo.sdf import WORLD, SdfJoint, SdfModel, tree_order
from uuv.models.files.holding import follow
from uuv.models.files.mesh_shapes import MESHES, OTHERS, LinkMesh, add_meshes
from uuv.models.files.ros_packages import look_anew, mesh_file
from uuv.models.files.urdf_joints import limits_of, listed, taken_mimics
from uuv.models.files.urdf_places import INERTIA_ENTRIES, LONGEST, figure, origin_of
from uuv.models.files.urdf_vehicle import as_vehicle, mended_tensor
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import (
    Array,
    checked,
    checked_place,
    finite_number,
    inverse,
    quat_wxyz_from_rotation,
)

_LENGTHS = {  # tag of each size of a shape, and how many numbers it has
    "box": (("size", 3),),
    "cylinder": (("radius", 1), ("length", 1)),
    "capsule": (("radius", 1), ("length", 1)),
    "sphere": (("radius", 1),),
    "ellipsoid": (("radii", 3),),
}
_GEOMS = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "ellipsoid": mujoco.mjtGeom.mjGEOM_ELLIPSOID,
}


def spec_of_sdf(model: SdfModel, folder: Path) -> tuple[mujoco.MjSpec, list[str], FileContent]:
    """Spec of a vehicle, notes about what was left out, and the water and thrusters of its plugins.

    Args:
        model: the parsed SDF.
        folder: folder of the file; paths of meshes are relative to it.

    Raises:
        ConfigurationError: an entry must be a number and is not, or an inertia is not that of any
            body.
    """
    look_anew()
    spec = mujoco.MjSpec()
    spec.modelname = model.xml.get("name", "")
    spec.compiler.degree = False

    masses: dict[str, float] = {}
    volumes: dict[str, tuple[float, Array]] = {}
    meshes: list[LinkMesh] = []
    missing: set[str] = set()
    others: list[str] = []
    dry: list[str] = []
    bodies: dict[str, mujoco.MjsBody] = {WORLD: spec.worldbody}

    for link, joint in tree_order(model):
        body = _add_body(model, bodies, link, joint)
        element = model.links[link]
        bodies[link] = body
        masses[link] = _give_inertia(body, element, model)
        if not masses[link]:
            dry.append(link)
        volumes[link] = _give_shapes(body, element, model, folder, meshes, missing, others)

    notes = [*model.notes]
    if dry:
        notes.append(f"links without mass (SDF itself would take 1 kg): {listed(dry)}")

    if others:
        notes.append(
            f"shapes left out, since they are none of {', '.join((*_GEOMS, 'mesh'))}: "
            f"{listed(others)}"
        )

    if missing:
        endings = ", ".join((*MESHES, *OTHERS))
        notes.append(
            f"meshes left out, since they were not found or are none of {endings}: "
            f"{listed(sorted(missing))}"
        )

    coupled = taken_mimics(_as_robot(model), model.name)
    follow(spec, coupled)
    notes += add_meshes(spec, meshes)
    as_vehicle(spec)

    facts = ModelFacts.of(
        model.name, masses, _carriers(model), joints=model.driven, volumes=volumes
    )
    return spec, notes, content_of(model.xml.iter("plugin"), facts)


def _as_robot(model: SdfModel) -> Element:
    """The joints as elements of a URDF."""
    robot = Element("robot")
    robot.extend(joint.element for joint in model.joints.values())
    return robot


def _carriers(model: SdfModel) -> dict[str, str]:
    """For each link that is fixed to another, that other link."""
    return {
        link: joint.parent
        for link, joint in tree_order(model)
        if joint is not None and joint.element.get("type") == "fixed"
    }


def _add_body(
    model: SdfModel, bodies: dict[str, mujoco.MjsBody], link: str, joint: SdfJoint | None
) -> mujoco.MjsBody:
    """Add the body of a link with its joint."""
    if joint is None:
        return bodies[WORLD].add_body(name=link)
    X_PC = inverse(model.X_MF(joint.parent)) @ model.X_MF(link)
    # If the joint was fixed elsewhere than at zero, this is its motion, in the joint's frame.
    X_PC = X_PC @ _about(joint, origin_of(joint.element, model.name))
    body = bodies[joint.parent].add_body(
        name=link, pos=X_PC[:3, 3], quat=quat_wxyz_from_rotation(X_PC[:3, :3])
    )
    kind = joint.element.get("type")
    if kind == "fixed":
        return body

    added = body.add_joint(name=joint.name, pos=joint.X_CJ[:3, 3], axis=joint.axis)
    if kind == "prismatic":
        added.type = mujoco.mjtJoint.mjJNT_SLIDE
    lower, upper = limits_of(joint.element, model.name)

    if np.isfinite([lower, upper]).all():
        added.range = [lower, upper]
        added.limited = mujoco.mjtLimited.mjLIMITED_TRUE
    else:
        added.limited = mujoco.mjtLimited.mjLIMITED_FALSE

    added.damping = [joint.damping, *np.array(added.damping)[1:]]
    added.frictionloss = joint.friction
    limit = joint.element.find("limit")
    effort = 0.0 if limit is None else figure(limit.get("effort", "0"), f"joint {joint.name}")

    if 0.0 < effort < LONGEST * LONGEST:
        added.actfrcrange = [-effort, effort]
        added.actfrclimited = mujoco.mjtLimited.mjLIMITED_TRUE

    return body


def _about(joint: SdfJoint, motion: Array) -> Array:
    """A motion (4, 4) about the child's axes at the position of a joint, in the child's frame."""
    shift = np.eye(4)
    shift[:3, 3] = joint.X_CJ[:3, 3]
    return shift @ motion @ inverse(shift)


def _give_inertia(body: mujoco.MjsBody, link: Element, model: SdfModel) -> float:
    """Give a body the inertia of its link; returns its mass [kg].

    Raises:
        ConfigurationError: the mass is below zero, or the inertia is not that of any body.
    """
    subject = f"{model.name}: link {body.name!r}"
    inertial = link.find("inertial")
    mass = 0.0 if inertial is None else float(_of(inertial, "mass", 1, subject, "1")[0])
    if inertial is None or mass == 0.0:
        return 0.0
    finite_number(mass, f"{subject}: <mass> [kg]", above=0.0)
    X = model.X_LP(body.name, inertial)
    tensor = np.zeros((3, 3))
    stated = inertial.find("inertia")

    for i, j, tag in INERTIA_ENTRIES:
        default = "1" if i == j else "0"
        entry = default if stated is None else stated.findtext(tag) or default
        tensor[i, j] = tensor[j, i] = figure(entry, f"{subject}: {tag}")

    tensor, _ = mended_tensor(tensor, f"{subject}: inertia", "correct it in the file")
    tensor = X[:3, :3] @ tensor @ X[:3, :3].T
    body.mass = mass
    body.ipos = X[:3, 3]
    body.fullinertia = tensor[(0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)]
    body.explicitinertial = True

    return mass


def _give_shapes(
    body: mujoco.MjsBody,
    link: Element,
    model: SdfModel,
    folder: Path,
    meshes: list[LinkMesh],
    missing: set[str],
    others: list[str],
) -> tuple[float, Array]:
    """Add the shapes of a link; returns volume [m^3] and centre (3,) of its collision shapes.

    Meshes are appended to `meshes`, the names of absent meshes to `missing`, and the names of
    shapes of other kinds to `others`.
    """
    name = model.name
    total = 0.0
    moment = np.zeros(3)

    for shape in [*link.findall("visual"), *link.findall("collision")]:
        collides = shape.tag == "collision"
        X = model.X_LP(body.name, shape)
        geometry = shape.find("geometry")
        kinds = [] if geometry is None else [kind for kind in geometry if kind.tag != "empty"]
        kind = next(iter(kinds), None)
        if kind is None:
            continue

        if kind.tag == "mesh":
            uri = (kind.findtext("uri") or "").strip()
            known = Path(uri).suffix.lower() in (*MESHES, *OTHERS)
            file = mesh_file(uri, folder) if known else None

            if file is None:
                missing.add(Path(uri).name)
                continue

            x, y, z = _of(kind, "scale", 3, name, "1 1 1").tolist()
            meshes.append(
                LinkMesh(
                    link=body.name,
                    file=file,
                    X_LG=X,
                    scale=(x, y, z),
                    collides=collides,
                    weighs=False,
                )
            )
        elif kind.tag in _GEOMS:
            size, volume = _size_of(kind, f"{name}: {shape.get('name') or shape.tag}")
            _add_geom(body, _GEOMS[kind.tag], size, X, collides)
            if collides:
                total += volume
                moment += volume * X[:3, 3]
        else:
            others.append(f"{kind.tag} of {body.name}")

    return total, moment / total if total > 0.0 else np.zeros(3)


def _add_geom(
    body: mujoco.MjsBody, kind: mujoco.mjtGeom, size: list[float], X: Array, collides: bool
) -> None:
    geom = body.add_geom(
        type=kind, size=size, pos=X[:3, 3], quat=quat_wxyz_from_rotation(X[:3, :3]), density=0.0
    )

    if not collides:
        geom.contype = geom.conaffinity = 0
        geom.group = 1


def _size_of(kind: Element, subject: str) -> tuple[list[float], float]:
    """Sizes of a geom [m] in MuJoCo's order, and the volume [m^3] of the shape."""
    numbers = np.concatenate(
        [_of(kind, tag, count, subject, None) for tag, count in _LENGTHS[kind.tag]]
    )
    checked_place(numbers, numbers.shape, f"{subject}: {kind.tag}", LONGEST)
    if not np.all(numbers > 0.0):
        raise ConfigurationError(f"{subject}: lengths of a {kind.tag} must be positive")
    if kind.tag == "box":
        return (0.5 * numbers).tolist(), float(np.prod(numbers))
    if kind.tag == "sphere":
        return [float(numbers[0])] * 3, 4.0 / 3.0 * np.pi * float(numbers[0]) ** 3
    if kind.tag == "ellipsoid":
        return numbers.tolist(), 4.0 / 3.0 * np.pi * float(np.prod(numbers))
    radius, length = numbers.tolist()
    volume = np.pi * radius**2 * length
    if kind.tag == "capsule":
        volume += 4.0 / 3.0 * np.pi * radius**3

    return [radius, 0.5 * length, 0.0], volume


def _of(element: Element, tag: str, count: int, subject: str, default: str | None) -> Array:
    """Numbers (count,) of a child element."""
    text = element.findtext(tag) or default
    if text is None:
        raise ConfigurationError(f"{subject}: <{element.tag}> lacks <{tag}>")
    numbers = [figure(word, f"{subject}: <{tag}>") for word in text.split()]

    return checked(numbers, (count,), f"{subject}: <{tag}>")
