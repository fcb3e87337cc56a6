"""Gripper: parallel jaws with soft pads, driven by one motor through a spindle.

    attachment.attach(spec, TOOLS.load("gripper"))
    model = hydrodynamics.compile(spec)
    data.actuator("gripper").ctrl = -40.0  # [N] closes; the length of this actuator is the opening

The motor's force is that on each finger at standstill. It falls with speed by the same damper that
limits the speed; the friction of spindle and slides is lost on the way to the pads.
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from uuv.models.hydrodynamics import BodyHydrodynamics, cylinder
from uuv.models.naming import GRIPPER, OTHER_PAD, PAD_BODY, TOOL_GEOM
from uuv.models.tools.contact import ToolContact, touching
from uuv.models.tools.heads import add_mount
from uuv.models.tools.sampler import DAMPING, GIVE, STIFFNESS
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, finite_number

MOTOR = GRIPPER  # tendon whose length is the opening [m], and the motor that pulls it
FINGERS = "gripper_left", "gripper_right"  # bodies, and their slides
PADS = (
    TOOL_GEOM,
    TOOL_GEOM + OTHER_PAD,
)  # geoms that grip; what the first one feels is the grip force
_POSITIVE = (
    *("opening", "speed", "force", "friction", "breadth", "length", "mass"),
    *("time_constant", "stiffness"),
)
_FINGER_STEP = 0.004  # [s] time constant of the spindle that couples the fingers


@dataclass(frozen=True, slots=True, kw_only=True)
class Gripper:
    """Parallel jaws with fingers that move symmetrically along x of the tool, between end stops."""

    opening: float = 0.1  # [m] most between the pads; the least is 0
    speed: float = 0.05  # [m/s] of the opening, at the motor's full force without load
    force: float = 100.0  # [N] most of the motor on each finger, at standstill
    loss: float = 4.0  # [N] dry friction of spindle and slide, each finger
    friction: float = 0.6  # coefficient of the pads
    breadth: float = 0.03  # [m] of a finger, across opening and tool
    length: float = 0.16  # [m] from the mount to the fingers' ends
    mass: float = 0.8  # [kg] of all
    time_constant: float = 0.02  # [s] in which the motor gets up to speed
    stiffness: float = STIFFNESS  # [N/m] of the mount's spring, along the tool
    mount_damping: float = DAMPING  # [N s/m] of it

    def __post_init__(self) -> None:
        """Raise ConfigurationError for a gripper that cannot be built or cannot close."""
        for name in _POSITIVE:
            finite_number(getattr(self, name), f"gripper: {name}", above=0.0)
        for name in ("loss", "mount_damping"):
            finite_number(getattr(self, name), f"gripper: {name}", least=0.0)
        if not self.loss < self.force:
            raise ConfigurationError(
                f"gripper: its loss must be less than its force {self.force:g} N, got "
                f"{self.loss:g} N"
            )

    @property
    def thickness(self) -> float:
        """Thickness [m] of a finger."""
        return 0.4 * self.breadth

    @property
    def palm(self) -> float:
        """Length [m] of the housing."""
        return 0.45 * self.length

    @property
    def finger_mass(self) -> float:
        """Mass [kg] of one finger."""
        return 0.15 * self.mass

    @property
    def damping(self) -> float:
        """Damping [N s/m] of a finger at which the motor's full force leads to `speed`."""
        return (self.force - self.loss) / (0.5 * self.speed)

    @property
    def rotor(self) -> float:
        """Inertia [kg] of motor and spindle, referred to each finger; much larger than the finger's
        mass.
        """
        return self.damping * self.time_constant

    @property
    def contact(self) -> ToolContact:
        """Pad of the left finger, and mount."""
        return ToolContact(
            shape=f"driven jaws, 0 to {1e3 * self.opening:.0f} mm",
            radius=0.5 * self.breadth,
            length=self.length,
            mass=self.mass,
            stiffness=self.stiffness,
            give=GIVE,
            friction=self.friction,
        )


def add_gripper(
    spec: mujoco.MjSpec,
    link: mujoco.MjsBody,
    position: Array,
    turn: Array,
    tip: mujoco.MjsSite,
    gripper: Gripper,
) -> dict[str, BodyHydrodynamics]:
    """Add a closed gripper to a link, with z along the tool, and move `tip` to the fingers' ends.

    Args:
        spec: of the link.
        link: that carries the tool.
        position: (3,) [m] of the mount in the link.
        turn: orientation wxyz of the mount in the link; z out of the tool.
        tip: site of the arm's tip.
        gripper: the gripper.

    Returns:
        Hydrodynamics by body name.
    """
    palm = gripper.palm
    mass = gripper.mass - 2.0 * gripper.finger_mass
    spring = gripper.stiffness, gripper.mount_damping
    held = add_mount(link, position, turn, tip, gripper.length, mass, *spring)

    # Housing: its breadth is that of the open fingers.
    half = 0.5 * gripper.opening + gripper.thickness
    held.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[half, 0.5 * gripper.breadth, 0.5 * palm],
        pos=[0.0, 0.0, 0.5 * palm],
        mass=0.0,
        contype=0,
        conaffinity=0,
        rgba=[0.25, 0.28, 0.33, 1.0],
    )

    # As much water as the housing's box.
    radius = float(np.sqrt(2.0 * half * gripper.breadth / np.pi))
    bodies = {PAD_BODY: cylinder(radius, np.zeros(3), [0.0, 0.0, palm])}
    for name, pad, side in zip(FINGERS, PADS, (1.0, -1.0), strict=True):
        bodies[name] = _add_finger(held, name, pad, side, gripper)

    _add_drive(spec, gripper)
    return bodies


def _add_drive(spec: mujoco.MjSpec, gripper: Gripper) -> None:
    """Couple the fingers by a spindle, which one motor drives."""
    spindle = spec.add_equality(name=MOTOR, type=mujoco.mjtEq.mjEQ_JOINT)
    spindle.name1, spindle.name2 = FINGERS
    spindle.objtype = mujoco.mjtObj.mjOBJ_JOINT
    spindle.data[:5] = [0.0, 1.0, 0.0, 0.0, 0.0]  # equal travel
    spindle.solref = [_FINGER_STEP, 1.0]
    spindle.solimp = [0.99, 0.999, 0.001, 0.5, 2.0]

    # The opening is the sum of both travels, so that the motor's force acts on each finger.
    opening = spec.add_tendon(name=MOTOR)
    for name in FINGERS:
        opening.wrap_joint(name, 1.0)

    motor = spec.add_actuator(name=MOTOR, trntype=mujoco.mjtTrn.mjTRN_TENDON, target=MOTOR)
    motor.ctrlrange = [-gripper.force, gripper.force]
    motor.ctrllimited = mujoco.mjtLimited.mjLIMITED_TRUE


def _add_finger(
    held: mujoco.MjsBody, name: str, pad: str, side: float, gripper: Gripper
) -> BodyHydrodynamics:
    """Add a finger on its slide, on the `side` (1 or -1) of the axis; returns its hydrodynamics."""
    palm = gripper.palm
    long = gripper.length - palm
    thick = gripper.thickness
    mass = gripper.finger_mass

    finger = held.add_body(
        name=name,
        pos=[0.0, 0.0, palm],
        mass=mass,
        ipos=[0.5 * side * thick, 0.0, 0.5 * long],
        inertia=[mass * long**2 / 12.0] * 3,
        explicitinertial=True,
    )
    # Its slide: speed, friction and inertia are those of the motor, by the spindle.
    finger.add_joint(
        name=name,
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=[side, 0.0, 0.0],
        range=[0.0, 0.5 * gripper.opening],
        limited=True,
        damping=gripper.damping,
        frictionloss=gripper.loss,
        armature=gripper.rotor,
    )

    # The pad is the inner face, as long as the finger.
    finger.add_geom(
        name=pad,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[0.5 * thick, 0.5 * gripper.breadth, 0.5 * long],
        pos=[0.5 * side * thick, 0.0, 0.5 * long],
        **touching(gripper.friction),
        rgba=[0.15, 0.15, 0.15, 1.0],
    )

    # It displaces as much water as its box.
    middle = np.array([0.5 * side * thick, 0.0, 0.0])
    radius = float(np.sqrt(thick * gripper.breadth / np.pi))
    return cylinder(radius, middle, [*middle[:2], long])
