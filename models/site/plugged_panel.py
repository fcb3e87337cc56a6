"""Panel with two receptacles, and a plug with a handle that sits in one of them.

The panel is the block of `uuv.models.objects.manifold` with its pipes; its holes "a" and "b" are
the receptacles. The plug is a pin with a domed nose, a collar that rests on the panel when the plug
is seated, and a bar as a handle, which parallel jaws grip. The sizes are chosen for this project.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, get_args

import numpy as np

from uuv.models.meshes.closed_shells import box, joined, revolve
from uuv.models.objects.manifold import Hole, Manifold, manifold
from uuv.models.objects.solid import Solid
from uuv.models.objects.target_model import TargetModel
from uuv.sim.interfaces.spatial import Array, finite_number, one_of, pose

ReceptacleName = Literal["a", "b"]
RECEPTACLES: tuple[ReceptacleName, ...] = get_args(ReceptacleName)
PIN = (0.018, 0.06)  # [m] radius, and length below the collar
COLLAR = (0.032, 0.012)  # [m] radius and thickness
HANDLE = (0.03, 0.06, 0.05)  # [m] along x, which the jaws close on, along y, and height
COVER = 0.038  # [m] of the handle that the jaws cover, from its upper side
BOTTOM = 0.02  # [m] by which a receptacle is deeper than the pin is long
CHAMFER = 0.003  # [m] of its mouth
DEBRIS = 0.022  # [m] below the mouth, up to which debris fills a receptacle
_MOST_FRICTION = 200.0  # [N] of a seal
_SIDES = 96  # of surfaces of revolution in the mesh
_OUT = np.array([0.0, 0.0, 1.0])  # of the face
_NOSE = 9  # points of the nose's profile


@dataclass(frozen=True, slots=True, kw_only=True)
class Seat:
    """What the vehicle does not know of the receptacles."""

    friction: float  # [N] at which the seal breaks away
    stuck: bool = False  # it does not come out at all
    debris: bool = False  # the other receptacle is filled to DEBRIS below its mouth

    def __post_init__(self) -> None:
        """Refuse numbers out of range."""
        finite_number(self.friction, "panel: friction [N]", above=0.0, most=_MOST_FRICTION)


@dataclass(frozen=True, kw_only=True)
class PluggedPanel:
    """Shape of the panel, with the plug seated in one receptacle.

    Frame T is that of the panel, z out of its face. The plug's frame is T when it is seated at the
    start.
    """

    start: ReceptacleName = "a"
    clearance: float = 2e-3  # [m] radial, between pin and receptacle
    mass: float = 0.8  # [kg] of the plug

    def __post_init__(self) -> None:
        """Refuse a receptacle that there is not."""
        one_of(self.start, RECEPTACLES, "panel: start")
        finite_number(self.clearance, "panel: clearance [m]", least=5e-4, most=5e-3)
        finite_number(self.mass, "panel: mass of the plug [kg]", least=0.05, most=20.0)

    @property
    def end(self) -> ReceptacleName:
        """The other receptacle."""
        return "b" if self.start == "a" else "a"

    @cached_property
    def panel(self) -> Manifold:
        """The panel without the plug."""
        radius, length = PIN
        return manifold(radius + self.clearance, length + BOTTOM, CHAMFER)

    def hole(self, name: str) -> Hole:
        """A receptacle.

        Raises:
            ConfigurationError: there is none of that name.
        """
        return self.panel.hole(name)

    def grip(self, name: str) -> Array:
        """Pose (4, 4) in T of the tool that grips the plug seated in the receptacle `name`.

        The jaws close along x_T.
        """
        # z_G into the panel, x_G along x_T
        X_TG = np.diag([1.0, -1.0, -1.0, 1.0])
        X_TG[:3, 3] = self.hole(name).p_T + (COLLAR[1] + HANDLE[2] - COVER) * _OUT
        return X_TG

    @property
    def way(self) -> Array:
        """From start to end (3,) [m], in T."""
        return self.hole(self.end).p_T - self.hole(self.start).p_T

    @cached_property
    def target(self) -> TargetModel:
        """Panel and plug as the vehicle knows them."""
        block = self.panel.target

        shells = [(block.vertices, block.triangles), *self._shells()]
        vertices, triangles = joined(shells)
        return TargetModel(
            name="plugged_panel",
            vertices=vertices,
            triangles=triangles,
            solids=(*self.fixed, *self.plug),
        )

    @cached_property
    def fixed(self) -> tuple[Solid, ...]:
        """Collision shapes of the panel; those of a receptacle are named "panel_a_..." alike."""
        return tuple(
            replace(solid, name=solid.name.replace("target", "panel", 1))
            for solid in self.panel.target.solids
        )

    @cached_property
    def plug(self) -> tuple[Solid, ...]:
        """Collision shapes of the plug at its start: handle, collar, pin."""
        middle = self.hole(self.start).p_T
        radius, length = PIN
        wide, thick = COLLAR

        # The pin's upper dome is inside the collar, below the jaws.
        top = thick
        half = 0.5 * (length + top) - radius
        return (
            Solid(
                name="target",
                kind="box",
                size=tuple(0.5 * side for side in HANDLE),
                X_TS=pose(p=middle + (thick + 0.5 * HANDLE[2]) * _OUT),
            ),
            Solid(
                name="target_collar",
                kind="cylinder",
                size=(wide, 0.5 * thick),
                X_TS=pose(p=middle + 0.5 * thick * _OUT),
            ),
            Solid(
                name="target_pin",
                kind="capsule",
                size=(radius, half),
                X_TS=pose(p=middle + 0.5 * (top - length) * _OUT),
            ),
        )

    @cached_property
    def _parts(self) -> Array:
        """Volumes [m^3] of pin, collar and handle, and heights [m] of their middles: (3, 2)."""
        radius, length = PIN
        wide, thick = COLLAR

        # The pin is a cylinder whose end is half a ball; one of `even` has its volume.
        even = length - radius / 3.0

        pin = (np.pi * radius**2 * even, -0.5 * even)
        collar = (np.pi * wide**2 * thick, 0.5 * thick)
        handle = (np.prod(HANDLE), thick + 0.5 * HANDLE[2])
        return np.array([pin, collar, handle])

    @property
    def volume(self) -> float:
        """Volume [m^3] of the plug."""
        return float(self._parts[:, 0].sum())

    @cached_property
    def center(self) -> Array:
        """Centre (3,) [m] of the plug's volume at its start, in T."""
        volumes, heights = self._parts.T
        height = float(volumes @ heights) / self.volume
        return self.hole(self.start).p_T + height * _OUT

    def _shells(self) -> list[tuple[Array, np.ndarray]]:
        """Closed shells of the plug at its start."""
        radius, length = PIN
        wide, thick = COLLAR
        middle = self.hole(self.start).p_T

        # Nose, pin and collar, from below, revolved about z; the nose ends on the axis.
        angles = np.linspace(0.0, 0.5 * np.pi, _NOSE)
        nose = [
            (-length + radius * (1.0 - np.cos(angle)), radius * np.sin(angle)) for angle in angles
        ]
        profile = [(-length, 0.0), *nose[1:], (0.0, radius), (0.0, wide), (thick, wide)]
        along_x, faces = revolve([*profile, (thick, 0.0)], _SIDES)
        round_parts = along_x[:, [1, 2, 0]] + middle

        high = thick + 0.5 * HANDLE[2]
        return [(round_parts, faces), box(HANDLE, middle + high * _OUT)]
