"""Socket for turning T-bars and paddles about the tool's axis: a slot between two walls."""

from dataclasses import dataclass

import mujoco
import numpy as np

from uuv.models.hydrodynamics import BodyHydrodynamics, cylinder
from uuv.models.naming import OTHER_PAD, PAD_BODY, SLOT_BOTTOM, TOOL_GEOM
from uuv.models.tools.contact import ToolContact, touching
from uuv.models.tools.heads import add_mount
from uuv.models.tools.sampler import DAMPING, GIVE, STIFFNESS
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, finite_number

_POSITIVE = "slot", "breadth", "depth", "wall", "length", "mass", "friction"


@dataclass(frozen=True, slots=True, kw_only=True)
class HandleSocket:
    """Two parallel walls across x of the tool; the slot between them runs along y, open at both
    ends.
    """

    slot: float = 0.025  # [m] between the walls
    breadth: float = 0.08  # [m] of the walls, along the slot
    depth: float = 0.04  # [m] of the slot
    wall: float = 0.008  # [m] thickness
    length: float = 0.1  # [m] from the mount to the walls' ends
    mass: float = 0.5  # [kg]
    friction: float = 0.3  # coefficient

    def __post_init__(self) -> None:
        """Raise ConfigurationError for a socket that cannot be built."""
        for name in _POSITIVE:
            finite_number(getattr(self, name), f"socket: {name}", above=0.0)
        if not self.depth < self.length:
            raise ConfigurationError(
                f"socket: its depth must be less than its length {self.length:g} m, got "
                f"{self.depth:g} m"
            )

    @property
    def contact(self) -> ToolContact:
        """Walls and bottom of the slot, and mount."""
        return ToolContact(
            shape=f"slot of {1e3 * self.slot:.0f} mm",
            radius=float(np.hypot(0.5 * self.slot + self.wall, 0.5 * self.breadth)),
            length=self.length,
            mass=self.mass,
            stiffness=STIFFNESS,
            give=GIVE,
            friction=self.friction,
        )

    def backlash(self, thickness: float) -> float:
        """Angle [rad] by which a long bar can turn in each direction until it meets both walls.

        Args:
            thickness: [m] of the bar.

        Raises:
            ConfigurationError: the bar does not fit into the slot.
        """
        finite_number(thickness, "socket: thickness of the bar [m]", above=0.0)
        if thickness > self.slot:
            raise ConfigurationError(
                f"socket: a bar must be at most {self.slot:g} m thick, got {thickness:g} m"
            )

        # The edges of the walls, at (slot, breadth) / 2, meet the bar's faces, at thickness / 2.
        reach = float(np.hypot(self.slot, self.breadth))
        return float(np.arctan2(self.slot, self.breadth) - np.arcsin(thickness / reach))


def add_handle_socket(
    link: mujoco.MjsBody, position: Array, turn: Array, tip: mujoco.MjsSite, socket: HandleSocket
) -> dict[str, BodyHydrodynamics]:
    """Add a socket to a link, in the way in which `heads.add_head` adds a head."""
    held = add_mount(link, position, turn, tip, socket.length, socket.mass, STIFFNESS, DAMPING)
    half = 0.5 * socket.slot + socket.wall
    palm = socket.length - socket.depth

    # The body below the slot.
    held.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[half, 0.5 * socket.breadth, 0.5 * palm],
        pos=[0.0, 0.0, 0.5 * palm],
        mass=0.0,
        contype=0,
        conaffinity=0,
        rgba=[0.25, 0.28, 0.33, 1.0],
    )

    # The bottom of the slot, a plate at the end of that body, and the walls, each of which touches.
    thick = min(socket.wall, palm)
    held.add_geom(
        name=TOOL_GEOM + SLOT_BOTTOM,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[half, 0.5 * socket.breadth, 0.5 * thick],
        pos=[0.0, 0.0, palm - 0.5 * thick],
        **touching(socket.friction),
        rgba=[0.7, 0.72, 0.75, 1.0],
    )

    # From the bottom to the end of the tool.
    for name, side in ((TOOL_GEOM, 1.0), (TOOL_GEOM + OTHER_PAD, -1.0)):
        held.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[0.5 * socket.wall, 0.5 * socket.breadth, 0.5 * socket.depth],
            pos=[side * 0.5 * (socket.slot + socket.wall), 0.0, socket.length - 0.5 * socket.depth],
            **touching(socket.friction),
            rgba=[0.7, 0.72, 0.75, 1.0],
        )

    # As much water as the body below the slot; the slot is open to it.
    radius = float(np.sqrt(2.0 * half * socket.breadth / np.pi))
    return {PAD_BODY: cylinder(radius, np.zeros(3), [0.0, 0.0, palm])}
