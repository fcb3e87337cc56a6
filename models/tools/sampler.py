"""Sampling tools in a compliant mount that replace the pad: sampler with a domed nose, corer, box.

The mount has three slides, each with a spring and a damper in N/m and N s/m. The stiffness of a contact is therefore
known along the tool and across it. MuJoCo's own contact softness has no fixed stiffness, since `solref` scales with the
masses.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from models.hydrodynamics import BodyHydrodynamics, cylinder
from models.keyframes import keyframes_kept
from models.naming import PAD_BODY, PAD_JOINT, TIP_SITE, TOOL_FACE_SITE, TOOL_GEOM
from models.registry import Registry
from sim.interfaces.errors import ConfigurationError


@dataclass(frozen=True, slots=True, kw_only=True)
class Tube:
    """Round steel tube, half full of water."""

    radius: float  # [m] outer radius
    length: float  # [m] from the mount to the tip
    mass: float  # [kg]
    domed: bool  # hemispherical tip of the same radius
    wall: float = 0.002  # [m]


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """Steel box, open below, dragged along x of the tip with its cutting edge ahead."""

    width: float  # [m] across the direction of motion
    breadth: float  # [m] along the direction of motion
    length: float  # [m] from the mount to its edges
    mass: float  # [kg]
    wall: float = 0.0015  # [m]
    rake: float = float(np.radians(69.0))  # [rad] of its cutting edge, from the horizontal: 90 deg minus the friction
    # of steel on sand, so that the sand neither draws it in nor lifts it out


SAMPLER = Tube(radius=0.018, length=0.14, mass=0.6, domed=True)
CORER = Tube(radius=0.03, length=0.25, mass=1.0, domed=False)
BOX = Box(width=0.08, breadth=0.06, length=0.16, mass=0.9)
TOOLS: Registry[Tube | Box] = Registry("tool", {"sampler": lambda: SAMPLER, "corer": lambda: CORER, "box": lambda: BOX})
STIFFNESS = 3e4  # [N/m] of the mount, in each direction; that of the pad
DAMPING = 150.0  # [N s/m] of the mount; >= k dt / 2 = 30 keeps it stable at 2 ms
GIVE = 0.02  # [m] axial travel of the mount
SIDE_GIVE = 0.005  # [m] lateral travel of the mount, each way
FRICTION = 0.3  # friction coefficient of the tool
_MOUNT = 0.05  # [kg] of each of the mount's two intermediate plates


def fit(spec: mujoco.MjSpec, tool: Tube | Box = SAMPLER) -> dict[str, BodyHydrodynamics]:
    """Replace the pad on the arm of `spec` by the tool in its mount; return the tool's hydrodynamics by body name.

    The tool is mounted on the pad's body, along its slide. The tip site moves to its end, and the keyframes gain the
    mount's joints, at rest.

    Raises:
        ConfigurationError: `spec` has no pad on a slide, or no tip.
    """
    pad = next((body for body in spec.bodies if body.name == PAD_BODY), None)
    tip = next((site for site in spec.sites if site.name == TIP_SITE), None)
    if pad is None or tip is None or len(pad.joints) != 1 or pad.joints[0].type != mujoco.mjtJoint.mjJNT_SLIDE:
        raise ConfigurationError(
            f"a sampler takes the place of a body {PAD_BODY!r} on one slide, at a site {TIP_SITE!r}"
        )
    with keyframes_kept(spec):
        return _exchange(spec, pad, tip, tool)


def _exchange(
    spec: mujoco.MjSpec, pad: mujoco.MjsBody, tip: mujoco.MjsSite, tool: Tube | Box
) -> dict[str, BodyHydrodynamics]:
    """Delete `pad`, add the tool in its mount, move `tip` to its end, and return the tool's hydrodynamics."""
    link, place, turn = pad.parent, np.array(pad.pos), np.array(pad.quat)
    along = np.array(pad.joints[0].axis)
    R = np.empty(9)
    mujoco.mju_quat2Mat(R, turn)
    spec.delete(pad)
    tip.pos = place + R.reshape(3, 3) @ along * tool.length
    side = np.eye(3)[int(np.argmin(np.abs(along)))]
    side -= (side @ along) * along
    side /= np.linalg.norm(side)
    parent = link
    for name, axis in (("mount_x", side), ("mount_y", np.cross(along, side))):
        parent = parent.add_body(name=name, mass=_MOUNT, ipos=[0.0] * 3, inertia=[1e-5] * 3, explicitinertial=True)
        if name == "mount_x":
            parent.pos, parent.quat = place, turn
        _slide(parent, name, axis, (-SIDE_GIVE, SIDE_GIVE))
    held = parent.add_body(
        name=PAD_BODY,
        mass=tool.mass,
        ipos=0.5 * tool.length * along,
        inertia=[tool.mass * tool.length**2 / 12.0] * 3,
        explicitinertial=True,
    )
    _slide(held, PAD_JOINT, along, (-GIVE, 0.25 * GIVE))
    geom = held.add_geom(
        name=TOOL_GEOM,
        mass=0.0,
        contype=1,
        conaffinity=2,
        priority=1,
        friction=[FRICTION, 0.005, 0.0001],
        solref=[0.006, 1.0],
        solimp=[0.95, 0.99, 0.0005, 0.5, 2.0],
        rgba=[0.75, 0.78, 0.82, 1.0],
    )
    if isinstance(tool, Box):
        geom.type, geom.size = mujoco.mjtGeom.mjGEOM_BOX, [0.5 * tool.breadth, 0.5 * tool.width, 0.5 * tool.length]
        geom.pos, geom.quat = 0.5 * tool.length * along, tip.quat
        water = cylinder(float(np.sqrt(tool.width * tool.breadth / np.pi)), np.zeros(3), tool.length * along)
    else:
        dome = tool.radius if tool.domed else 0.0
        geom.type = mujoco.mjtGeom.mjGEOM_CAPSULE if tool.domed else mujoco.mjtGeom.mjGEOM_CYLINDER
        geom.size = [tool.radius, 0, 0]
        geom.fromto = np.concatenate([dome * along, (tool.length - dome) * along])
        water = cylinder(tool.radius, dome * along, tool.length * along)
    held.add_site(name=TOOL_FACE_SITE, pos=tool.length * along, quat=tip.quat, group=4)
    return {PAD_BODY: water}


def _slide(body: mujoco.MjsBody, name: str, axis: np.ndarray, limits: tuple[float, float]) -> None:
    body.add_joint(
        name=name,
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=axis,
        stiffness=STIFFNESS,
        damping=DAMPING,
        range=limits,
        limited=True,
    )
