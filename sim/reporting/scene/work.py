"""Work of the tool in a run as drawn in pictures: path, forces, current."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from uuv.sim.evaluation.surface.force_levels import ForceSteps
from uuv.sim.interfaces.messages import TOUCHING, WORKING, WorkState
from uuv.sim.interfaces.palette import rgb
from uuv.sim.interfaces.spatial import Array
from uuv.sim.loop.recording import STATES, RecordedSeries
from uuv.sim.reporting.scene.captions import CURRENT, FELT, SET, PictureText, error_colours
from uuv.sim.reporting.scene.marks import Mark, line
from uuv.sim.reporting.scene.view import CameraView

_SPACING = 0.01  # [m] between the points of a drawn path
_PART = 60  # points of a path that are seen from near together
_LIFT = 0.006  # [m] off the surface, which would hide it
_THICK = 0.009  # [m] radius of the path that is worked
_THIN = 0.004  # [m] that of the rest
_DONE = (0.10, 0.78, 0.45)  # colour of a path without force
_AHEAD = (0.93, 0.95, 0.85)
_UNJUDGED = (0.62, 0.68, 0.70)  # where the force is being changed

_LONGEST_FORCE = 0.42  # [m] of the arrow of the largest force of a run
_BESIDE = 0.11  # [m] from the tool at which the arrows of forces stand
_ROD = 0.013  # [m] radius of their shafts

_USUAL_DISTANCE = 5.0  # [m] of a view, in which the arrows of the current have the sizes below
_SECONDS = 3.0  # an arrow of the current is as long as the water moves in that time
_LEAST_CURRENT = 0.01  # [m/s] below which none is drawn
# Their places across and down, in shares of the view's distance.
_BESIDE_VIEW = ((-0.42, -0.12), (-0.36, 0.0), (-0.42, 0.12), (0.40, -0.20), (0.44, -0.10))


@dataclass(frozen=True, slots=True, eq=False)
class Work:
    """Path of the tool while it works, thinned, and its forces; all in W."""

    recorded: RecordedSeries
    time: Array  # (N,) [s]
    p_W: Array  # (N, 3) [m] commanded places of the tip
    axis_W: Array  # (N, 3) direction in which the tool presses
    error: Array  # (N,) [N] true normal force less the set one; NaN: not judged
    most_force: float  # [N] largest set force; 0: none

    @classmethod
    def of(cls, recorded: RecordedSeries) -> Self:
        """The work of a run; empty if there was none."""
        rows = np.flatnonzero(
            recorded.within(*WORKING) & np.isfinite(recorded["p_command"].value[:, 0])
        )
        points = recorded["p_command"].value[rows]
        way = np.cumsum(np.linalg.norm(np.diff(points, axis=0, prepend=points[:1]), axis=1))
        # Points at even distances.
        kept = rows[np.unique(np.searchsorted(way, np.arange(0.0, way.max(initial=0.0), _SPACING)))]

        steps = ForceSteps.of(recorded)
        wrong = recorded["contact_normal"].scalar - steps.force
        error = np.where(steps.settled & (steps.force > 0.0), wrong, np.nan)
        return cls(
            recorded,
            recorded["p_command"].time[kept],
            recorded["p_command"].value[kept],
            recorded["tool_axis"].value[kept],
            error[kept],
            float(recorded["set_force"].scalar.max(initial=0.0)),
        )

    @property
    def judged(self) -> bool:
        """True if the error of the force is known anywhere on the path."""
        return bool(np.isfinite(self.error).any())

    def path(self, time: float, scale: float) -> list[Mark]:
        """The path: the part worked until a time [s], coloured by the error over `scale` [N], and
        the rest.
        """
        lifted = self.p_W - _LIFT * self.axis_W
        count = int(np.searchsorted(self.time, time))

        # By the error, where it is judged.
        colours = np.tile(_DONE, (len(self.time), 1))
        if self.judged:
            colours = error_colours(np.abs(np.nan_to_num(self.error)) / scale)
            colours[np.isnan(self.error)] = _UNJUDGED

        done = line(lifted[:count], _THICK, colours[: max(count - 1, 0)])
        rest = lifted[max(count - 1, 0) :]
        return done + line(rest, _THIN, np.tile(_AHEAD, (max(len(rest) - 1, 0), 1)))

    def forces(self, time: float, view: CameraView) -> list[Mark]:
        """Arrows of the set and the estimated force at a time [s], on both sides of the tool."""
        row = self._row(time)
        recorded = self.recorded
        set_force = float(recorded["set_force"].scalar[row])
        if not set_force or not self.most_force or self._state(row) not in TOUCHING:
            return []

        scale = _LONGEST_FORCE / self.most_force
        tip_W = recorded["p_pad"].value[row]
        axis_W = recorded["tool_axis"].value[row]
        across_W = np.cross(axis_W, view.axes_W[2])
        across_W *= _BESIDE / max(float(np.linalg.norm(across_W)), 1e-3)
        felt_W = -recorded["felt_force"].value[row]  # of the tool on the object

        marks = []
        for side, force_W, colour in ((1.0, set_force * axis_W, SET), (-1.0, felt_W, FELT)):
            if np.isfinite(force_W).all():
                end_W = tip_W + side * across_W - _LIFT * axis_W
                start_W = end_W - scale * force_W
                marks.append(Mark(start_W, end_W, _ROD, _unit(colour), arrow=True))
        return marks

    def current(self, time: float, view: CameraView) -> list[Mark]:
        """Arrows of the water's velocity at the hull at a time [s], at the sides of a view."""
        v_W = self._water(time)
        if not float(np.linalg.norm(v_W)) > _LEAST_CURRENT:
            return []

        across_W, down_W, _ = view.axes_W
        size = view.distance / _USUAL_DISTANCE
        half_W = 0.5 * size * _SECONDS * v_W
        middles_W = [
            view.lookat_W + view.distance * (x * across_W + y * down_W) for x, y in _BESIDE_VIEW
        ]
        return [
            Mark(middle_W - half_W, middle_W + half_W, size * _ROD, _unit(CURRENT), arrow=True)
            for middle_W in middles_W
        ]

    def readout(self, time: float) -> PictureText:
        """Text for a time [s]."""
        row = self._row(time)
        state = self._state(row)
        return PictureText(
            time=time,
            phase=state.value,
            touching=state in TOUCHING and len(self.time) > 0,
            set_force=float(self.recorded["set_force"].scalar[row]) if state in TOUCHING else 0.0,
            felt=float(self.recorded["felt_normal"].scalar[row]),
            current=float(np.linalg.norm(self._water(time))),
        )

    def near(self, time: float) -> tuple[Array, float]:
        """Middle (3,) [m] and half extent [m] of the part of the path around the tool at a time
        [s].
        """
        if not len(self.time):
            return self.recorded["p_pad"].value[self._row(time)], 0.0

        # The part that holds the point of this time.
        parts = np.array_split(self.p_W, -(-len(self.p_W) // _PART))
        ends = np.cumsum([len(part) for part in parts])
        at = min(int(np.searchsorted(self.time, time)), len(self.time) - 1)
        part = parts[int(np.searchsorted(ends, at, side="right"))]

        low = part.min(axis=0)
        high = part.max(axis=0)
        return 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))

    def _row(self, time: float) -> int:
        """Index of the row, at the loop's rate, at a time [s]."""
        times = self.recorded["state"].time
        return int(np.clip(np.searchsorted(times, time), 0, len(times) - 1))

    def _state(self, row: int) -> WorkState:
        return STATES[int(self.recorded["state"].scalar[row])]

    def _water(self, time: float) -> Array:
        """Velocity (3,) [m/s] of the water at the hull; NaN if it was not recorded."""
        if "current" not in self.recorded:
            return np.full(3, np.nan)
        series = self.recorded["current"]
        row = int(np.clip(np.searchsorted(series.time, time), 0, len(series.time) - 1))
        return series.value[row]


def _unit(colour: str) -> tuple[float, float, float]:
    """Red, green and blue in [0, 1] of #RRGGBB."""
    red, green, blue = rgb(colour)
    return red / 255.0, green / 255.0, blue / 255.0
