"""Quarter-turn valve whose handle turns: a lever, or a T-bar on the stem.

The body is that of `uuv.models.objects.valve`. The handle is a flat bar on the stem that a socket
(`uuv.models.tools.handle_socket`) takes from above. The sizes are chosen for this project.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from uuv.models.meshes.closed_shells import box, joined, revolve
from uuv.models.objects.solid import Solid
from uuv.models.objects.target_model import Symmetry, TargetModel
from uuv.models.objects.valve import BONNET, FLANGE, PIPE, STEM
from uuv.sim.interfaces.spatial import (
    Array,
    exp_so3,
    finite_number,
    one_of,
    pose,
    readonly,
    rotation_from_z,
)

HandleKind = Literal["lever", "bar"]
QUARTER = 0.5 * np.pi  # [rad] from stop to stop
TOP = 0.19  # [m] height of the handle's upper side over the pipe's axis
BAR = (0.015, 0.035)  # [m] thickness and height of the handle's bar
_BEYOND = 0.05  # [m] by which a lever extends beyond the place where it is turned, and behind
_HALF_BAR = 0.075  # [m] half of the T-bar's length
_LEVERS = (0.15, 0.8)  # [m] shortest and longest
_SIDES = 96  # number of sides of surfaces of revolution in the mesh


@dataclass(frozen=True, kw_only=True)
class TurnedValve:
    """Shape of the valve, with its handle at the first stop, along y_T.

    Frame T has its origin in the middle of the pipe, x along the pipe and z up the stem. The
    handle turns right-handed about z, by a quarter.
    """

    handle: HandleKind = "lever"
    radius: float = 0.285  # [m] from the stem to where a lever is turned

    def __post_init__(self) -> None:
        """Refuse a handle that there is not."""
        one_of(self.handle, ("lever", "bar"), "valve: handle")
        low, high = _LEVERS
        finite_number(self.radius, "valve: radius of the lever [m]", least=low, most=high)

    @property
    def lever(self) -> float:
        """Distance [m] from the axis at which the tool works: 0 on a T-bar."""
        return self.radius if self.handle == "lever" else 0.0

    @property
    def span(self) -> tuple[float, float]:
        """Ends [m] of the bar along y_T."""
        return (-_BEYOND, self.radius + _BEYOND) if self.lever else (-_HALF_BAR, _HALF_BAR)

    def grip(self, depth: float) -> Array:
        """Point (3,) [m] in T of the tip in the handle, `depth` [m] below its upper side."""
        return np.array([0.0, self.lever, TOP - depth])

    @cached_property
    def target(self) -> TargetModel:
        """The valve as the vehicle knows it.

        Raises:
            ConfigurationError: the handle is out of range.
        """
        shells = [*self._shells(), box(*self._bar())]
        vertices, triangles = joined(shells)

        # A bar looks the same after half a turn.
        turns = [np.eye(3)] if self.lever else [np.eye(3), exp_so3([0.0, 0.0, np.pi])]
        return TargetModel(
            name=f"valve_with_{self.handle}",
            vertices=vertices,
            triangles=triangles,
            symmetry=Symmetry(rotations=readonly(np.stack(turns))),
            solids=(*self.fixed, *self.turned),
        )

    @cached_property
    def fixed(self) -> tuple[Solid, ...]:
        """Collision shapes of the body."""
        r, long = PIPE
        wide, thick = FLANGE
        along = rotation_from_z([1.0, 0.0, 0.0], [0.0, 0.0, 1.0])
        away = 0.5 * (long - thick)
        pipe = Solid(name="valve_pipe", kind="cylinder", size=(r, 0.5 * long), X_TS=pose(along))

        flanges = [
            Solid(
                name=f"valve_flange_{end}",
                kind="cylinder",
                size=(wide, 0.5 * thick),
                X_TS=pose(along, [x, 0.0, 0.0]),
            )
            for end, x in (("aft", -away), ("fore", away))
        ]

        bonnet = Solid(
            name="valve_bonnet",
            kind="cylinder",
            size=(BONNET[0], 0.5 * BONNET[1]),
            X_TS=pose(p=[0.0, 0.0, 0.5 * BONNET[1]]),
        )
        return (pipe, *flanges, bonnet)

    @cached_property
    def turned(self) -> tuple[Solid, ...]:
        """Collision shapes of the handle, with its stem."""
        size, middle = self._bar()

        # The stem, from the bonnet to the bar.
        stem = 0.5 * (TOP - BAR[1] - BONNET[1])
        return (
            Solid(
                name="target",
                kind="box",
                size=tuple((0.5 * np.array(size)).tolist()),
                X_TS=pose(p=middle),
            ),
            Solid(
                name="target_stem",
                kind="cylinder",
                size=(STEM[0], stem),
                X_TS=pose(p=[0.0, 0.0, BONNET[1] + stem]),
            ),
        )

    def _bar(self) -> tuple[list[float], list[float]]:
        """Size and middle of the handle's bar."""
        first, last = self.span
        size = [BAR[0], last - first, BAR[1]]
        return size, [0.0, 0.5 * (first + last), TOP - 0.5 * BAR[1]]

    def _shells(self) -> list[tuple[Array, np.ndarray]]:
        """Closed shells of body and stem."""
        r, long = PIPE
        wide, thick = FLANGE
        half = 0.5 * long
        profile = [(-half, 0.0), (-half, wide), (thick - half, wide), (thick - half, r)]
        profile += [(-x, radius) for x, radius in reversed(profile)]

        # Bonnet and stem, up to the middle of the bar.
        high = TOP - 0.5 * BAR[1]
        upper = [(0.0, 0.0), (0.0, BONNET[0]), (BONNET[1], BONNET[0]), (BONNET[1], STEM[0])]
        upper += [(high, STEM[0]), (high, 0.0)]
        along_z, faces = revolve(np.array(upper), _SIDES)
        return [revolve(np.array(profile), _SIDES), (along_z[:, [1, 2, 0]], faces)]
