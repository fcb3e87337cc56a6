"""Tools with a round head on one spring along the tool: pad, brush, jaws at a fixed opening."""

from dataclasses import dataclass

import mujoco
import numpy as np

from uuv.models.hydrodynamics import BodyHydrodynamics, cylinder
from uuv.models.naming import PAD_BODY, PAD_JOINT, TOOL_FACE_SITE, TOOL_GEOM
from uuv.models.tools.contact import ToolContact, touching
from uuv.models.tools.sampler import DAMPING, GIVE, STIFFNESS, add_slide
from uuv.sim.interfaces.spatial import Array

_FINGERS = "jaw_left", "jaw_right"
_CLOSING = 2e3  # [N/m] spring of each finger
_FINGER_DAMPING = 20.0  # [N s/m]


@dataclass(frozen=True, slots=True, kw_only=True)
class Head:
    """Domed head, which has one contact point near its summit at any tilt."""

    radius: float  # [m] of the dome
    length: float  # [m] from the mount to the summit
    mass: float  # [kg]
    stiffness: float = STIFFNESS  # [N/m] of its spring
    damping: float = DAMPING  # [N s/m]
    friction: float = 0.3
    shape: str = "dome"

    @property
    def contact(self) -> ToolContact:
        """Dome and spring."""
        return ToolContact(
            shape=self.shape,
            radius=self.radius,
            length=self.length,
            mass=self.mass,
            stiffness=self.stiffness,
            give=GIVE,
            friction=self.friction,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Jaws:
    """Parallel jaws: fingers on slides with springs; an actuator `jaws` on a tendon moves both.

    What may touch is the rounded end between the fingers' tips, a dome of half a finger's breadth.
    """

    opening: float = 0.03  # [m] between the fingers
    breadth: float = 0.024  # [m] of a finger
    length: float = 0.09  # [m] from the mount to the fingers' ends
    mass: float = 0.25  # [kg]
    force: float = 40.0  # [N] most of the actuator on each finger

    @property
    def palm(self) -> float:
        """Length [m] of the housing of the fingers' slides."""
        return 0.4 * self.length

    @property
    def finger_mass(self) -> float:
        """Mass [kg] of one finger."""
        return 0.15 * self.mass

    @property
    def contact(self) -> ToolContact:
        """Rounded end and mount."""
        return ToolContact(
            shape=f"jaws, {1e3 * self.opening:.0f} mm open",
            radius=0.5 * self.breadth,
            length=self.length,
            mass=self.mass,
            stiffness=STIFFNESS,
            give=GIVE,
        )


def add_head(
    link: mujoco.MjsBody, position: Array, turn: Array, tip: mujoco.MjsSite, head: Head
) -> dict[str, BodyHydrodynamics]:
    """Add a head to a link, with z along the tool, and move `tip` to the head's summit.

    Args:
        link: that carries the tool.
        position: (3,) [m] of the mount in the link.
        turn: orientation wxyz of the mount in the link; z out of the tool.
        tip: site of the arm's tip.
        head: the head.

    Returns:
        Hydrodynamics by body name.
    """
    held = add_mount(
        link, position, turn, tip, head.length, head.mass, head.stiffness, head.damping
    )
    _dome(held, head.radius, head.length, head.friction)
    return {PAD_BODY: cylinder(0.5 * head.radius, np.zeros(3), [0.0, 0.0, head.length])}


def add_jaws(
    spec: mujoco.MjSpec,
    link: mujoco.MjsBody,
    position: Array,
    turn: Array,
    tip: mujoco.MjsSite,
    jaws: Jaws,
) -> dict[str, BodyHydrodynamics]:
    """Add jaws to a link, in the way in which `add_head` adds a head."""
    palm = jaws.palm
    held = add_mount(
        link,
        position,
        turn,
        tip,
        jaws.length,
        jaws.mass - 2.0 * jaws.finger_mass,
        STIFFNESS,
        DAMPING,
    )
    _dome(held, 0.5 * jaws.breadth, jaws.length, 0.3)

    # Housing.
    held.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[0.5 * jaws.opening + jaws.breadth, 0.5 * palm, 0.0],
        pos=[0.0, 0.0, 0.5 * palm],
        mass=0.0,
        contype=0,
        conaffinity=0,
        rgba=[0.25, 0.28, 0.33, 1.0],
    )

    bodies = {
        PAD_BODY: cylinder(0.5 * jaws.breadth + 0.5 * jaws.opening, np.zeros(3), [0.0, 0.0, palm])
    }
    for name, side in zip(_FINGERS, (1.0, -1.0), strict=True):
        bodies[name] = _add_finger(held, name, side, jaws)

    # One drive for both.
    both = spec.add_tendon(name="jaws")
    for name in _FINGERS:
        both.wrap_joint(name, 1.0)
    motor = spec.add_actuator(name="jaws", trntype=mujoco.mjtTrn.mjTRN_TENDON, target="jaws")
    motor.ctrlrange = [-jaws.force, jaws.force]
    motor.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE
    return bodies


def _add_finger(held: mujoco.MjsBody, name: str, side: float, jaws: Jaws) -> BodyHydrodynamics:
    """Add a finger on its slide, on one `side` (1, -1) of the housing; return its hydrodynamics."""
    palm = jaws.palm
    long = jaws.length - palm
    thin = 0.25 * jaws.breadth
    finger_mass = jaws.finger_mass
    finger = held.add_body(
        name=name,
        pos=[side * (0.5 * jaws.opening + thin), 0.0, palm],
        mass=finger_mass,
        ipos=[0.0, 0.0, 0.5 * long],
        inertia=[finger_mass * long**2 / 12.0] * 3,
        explicitinertial=True,
    )

    travel = 0.5 * jaws.opening
    add_slide(
        finger, name, np.array([side, 0.0, 0.0]), (-travel, travel), _CLOSING, _FINGER_DAMPING
    )

    finger.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[thin, 0.5 * jaws.breadth, 0.5 * long - thin],
        pos=[0.0, 0.0, 0.5 * long - thin],
        mass=0.0,
        contype=0,
        conaffinity=0,
        rgba=[0.7, 0.72, 0.75, 1.0],
    )

    return cylinder(thin, np.zeros(3), [0.0, 0.0, long])


def add_mount(
    link: mujoco.MjsBody,
    position: Array,
    turn: Array,
    tip: mujoco.MjsSite,
    length: float,
    mass: float,
    stiffness: float,
    damping: float,
) -> mujoco.MjsBody:
    """Add the tool's body on its spring, with the face at its end, and move the tip there."""
    R = np.empty(9)
    mujoco.mju_quat2Mat(R, turn)
    tip.pos = position + R.reshape(3, 3)[:, 2] * length

    held = link.add_body(
        name=PAD_BODY,
        pos=position,
        quat=turn,
        mass=mass,
        ipos=[0.0, 0.0, 0.5 * length],
        inertia=[mass * length**2 / 12.0] * 3,
        explicitinertial=True,
    )

    add_slide(held, PAD_JOINT, np.array([0.0, 0.0, 1.0]), (-GIVE, 0.25 * GIVE), stiffness, damping)
    held.add_site(name=TOOL_FACE_SITE, pos=[0.0, 0.0, length], group=4)
    return held


def _dome(held: mujoco.MjsBody, radius: float, length: float, friction: float) -> None:
    """Add the geom that may touch, with its summit at the tool's end."""
    held.add_geom(
        name=TOOL_GEOM,
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[radius, 0.0, 0.0],
        pos=[0.0, 0.0, length - radius],
        **touching(friction),
        rgba=[0.1, 0.45, 0.75, 1.0],
    )
