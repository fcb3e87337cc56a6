"""Sampling tools in a compliant mount that replace the pad: sampler with a domed nose, corer, box.

The mount has three slides, each with a spring and a damper in N/m and N s/m. The stiffness of a
contact is therefore known along the tool and across it. MuJoCo's own contact softness has no fixed
stiffness, since `solref` scales with the masses.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from uuv.models.files.keyframes import keyframes_kept
from uuv.models.hydrodynamics import BodyHydrodynamics, cylinder
from uuv.models.naming import PAD_BODY, PAD_JOINT, TIP_SITE, TOOL_FACE_SITE, TOOL_GEOM
from uuv.models.tools.contact import ToolContact, touching
from uuv.sim.interfaces.errors import ConfigurationError


@dataclass(frozen=True, slots=True, kw_only=True)
class Tube:
    """Round steel tube, half full of water."""

    radius: float  # [m] outer radius
    length: float  # [m] from the mount to the tip
    mass: float  # [kg]
    domed: bool  # hemispherical tip of the same radius
    wall: float = 0.002  # [m]

    @property
    def contact(self) -> ToolContact:
        """Nose and mount."""
        shape = "dome" if self.domed else "open tube"
        return ToolContact(
            shape=shape,
            radius=self.radius,
            length=self.length,
            mass=self.mass,
            stiffness=STIFFNESS,
            give=GIVE,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """Steel box, open below, dragged along x of the tip with its cutting edge ahead."""

    width: float  # [m] across the direction of motion
    breadth: float  # [m] along the direction of motion
    length: float  # [m] from the mount to its edges
    mass: float  # [kg]
    wall: float = 0.0015  # [m]
    # [rad] of its cutting edge, from the horizontal: 90 deg minus the friction of steel on sand, so
    # that the sand neither draws it in nor lifts it out
    rake: float = float(np.radians(69.0))

    @property
    def contact(self) -> ToolContact:
        """Cutting edges and mount."""
        across = 0.5 * max(self.width, self.breadth)
        return ToolContact(
            shape="open box",
            radius=across,
            length=self.length,
            mass=self.mass,
            stiffness=STIFFNESS,
            give=GIVE,
        )


SAMPLER = Tube(radius=0.018, length=0.14, mass=0.6, domed=True)
CORER = Tube(radius=0.03, length=0.25, mass=1.0, domed=False)
BOX = Box(width=0.08, breadth=0.06, length=0.16, mass=0.9)
STIFFNESS = 3e4  # [N/m] of the mount, in each direction; that of the pad
DAMPING = 150.0  # [N s/m] of the mount; >= k dt / 2 = 30 keeps it stable at 2 ms
GIVE = 0.02  # [m] axial travel of the mount
SIDE_GIVE = 0.005  # [m] lateral travel of the mount, each way
FRICTION = 0.3  # friction coefficient of the tool
_MOUNT = 0.05  # [kg] of each of the mount's two intermediate plates


def fit(spec: mujoco.MjSpec, tool: Tube | Box = SAMPLER) -> dict[str, BodyHydrodynamics]:
    """Replace the pad on the arm of `spec` by the tool in its mount; returns its hydrodynamics.

    The tool is mounted on the pad's body, along its slide. The tip site moves to its end, and the
    keyframes gain the mount's joints, at rest.

    Raises:
        ConfigurationError: `spec` has no pad on a slide, or no tip.
    """
    pad = next((body for body in spec.bodies if body.name == PAD_BODY), None)
    tip = next((site for site in spec.sites if site.name == TIP_SITE), None)

    if (
        pad is None
        or tip is None
        or len(pad.joints) != 1
        or pad.joints[0].type != mujoco.mjtJoint.mjJNT_SLIDE
    ):
        raise ConfigurationError(
            f"a sampler replaces a body {PAD_BODY!r} on one slide, at a site {TIP_SITE!r}"
        )

    with keyframes_kept(spec):
        link = pad.parent
        mount = np.array(pad.pos)
        turn = np.array(pad.quat)
        along = np.array(pad.joints[0].axis)
        spec.delete(pad)
        return add(link, mount, turn, along, tip, tool)


def add(
    link: mujoco.MjsBody,
    position: np.ndarray,
    turn: np.ndarray,
    along: np.ndarray,
    tip: mujoco.MjsSite,
    tool: Tube | Box,
    face: np.ndarray | None = None,
) -> dict[str, BodyHydrodynamics]:
    """Add the tool in its mount to a link, and move `tip` to its end.

    Args:
        link: that carries the tool.
        position: (3,) [m] of the mount in the link.
        turn: orientation wxyz of the mount in the link.
        along: (3,) direction of the tool in the mount.
        tip: site of the arm's tip.
        tool: the tool.
        face: orientation wxyz of the tip in the mount; None: as in the link.

    Returns:
        The tool's hydrodynamics by body name.
    """
    R = np.empty(9)
    mujoco.mju_quat2Mat(R, turn)
    tip.pos = position + R.reshape(3, 3) @ along * tool.length
    face = np.array(tip.quat) if face is None else face

    # Slides across the tool, on plates of their own, and along it.
    side = np.eye(3)[int(np.argmin(np.abs(along)))]
    side -= (side @ along) * along
    side /= np.linalg.norm(side)

    parent = link
    for name, axis in (("mount_x", side), ("mount_y", np.cross(along, side))):
        parent = parent.add_body(
            name=name, mass=_MOUNT, ipos=[0.0] * 3, inertia=[1e-5] * 3, explicitinertial=True
        )
        if name == "mount_x":
            parent.pos = position
            parent.quat = turn
        add_slide(parent, name, axis, (-SIDE_GIVE, SIDE_GIVE))

    held = parent.add_body(
        name=PAD_BODY,
        mass=tool.mass,
        ipos=0.5 * tool.length * along,
        inertia=[tool.mass * tool.length**2 / 12.0] * 3,
        explicitinertial=True,
    )
    add_slide(held, PAD_JOINT, along, (-GIVE, 0.25 * GIVE))

    water = _add_shape(held, tool, along, face)
    held.add_site(name=TOOL_FACE_SITE, pos=tool.length * along, quat=face, group=4)
    return {PAD_BODY: water}


def _add_shape(
    held: mujoco.MjsBody, tool: Tube | Box, along: np.ndarray, face: np.ndarray
) -> BodyHydrodynamics:
    """Add the geom that may touch, along `along` (3,); `face` is the orientation wxyz of a box."""
    geom = held.add_geom(name=TOOL_GEOM, **touching(FRICTION), rgba=[0.75, 0.78, 0.82, 1.0])
    if isinstance(tool, Box):
        geom.type = mujoco.mjtGeom.mjGEOM_BOX
        geom.size = [0.5 * tool.breadth, 0.5 * tool.width, 0.5 * tool.length]
        geom.pos = 0.5 * tool.length * along
        geom.quat = face
        water = cylinder(
            float(np.sqrt(tool.width * tool.breadth / np.pi)), np.zeros(3), tool.length * along
        )
    else:
        # A capsule's length is between the centres of its ends.
        dome = tool.radius if tool.domed else 0.0
        geom.type = mujoco.mjtGeom.mjGEOM_CAPSULE if tool.domed else mujoco.mjtGeom.mjGEOM_CYLINDER
        geom.size = [tool.radius, 0, 0]
        geom.fromto = np.concatenate([dome * along, (tool.length - dome) * along])
        water = cylinder(tool.radius, dome * along, tool.length * along)

    return water


def add_slide(
    body: mujoco.MjsBody,
    name: str,
    axis: np.ndarray,
    limits: tuple[float, float],
    stiffness: float = STIFFNESS,
    damping: float = DAMPING,
) -> None:
    """Add a slide [m] with a spring [N/m] and a damper [N s/m] to a body."""
    body.add_joint(
        name=name,
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=axis,
        stiffness=stiffness,
        damping=damping,
        range=limits,
        limited=True,
    )
