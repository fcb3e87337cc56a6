"""Camera of a clip, which stays in place until the work leaves its view; then the view changes."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import mujoco
import numpy as np

from uuv.sim.interfaces.spatial import Array
from uuv.sim.reporting.scene.poses import Poses
from uuv.sim.reporting.scene.view import CameraView
from uuv.sim.reporting.scene.work import Work

_WIDEST = 1.6  # times the smallest view of a run, beyond which a view is divided in time
_SHORTEST = 2.0  # [s] of a part of a phase that has a view of its own
_SAMPLES = 5  # rows of a phase at which its view is made
_ALIKE = 0.2  # share of the distance by which views differ that are not worth a change

# Directions tried, from the usual one on: turn [deg] from the hull's heading, elevation [deg].
_TURNS = (120.0, -120.0, 60.0, -60.0, 150.0, -150.0, 90.0, -90.0, 30.0, -30.0)
_ELEVATIONS = (-22.0, -38.0)
_LOOKS = 6  # times of the work at which it must be visible
_CLEAR = 0.08  # [m] off the surface, and towards the camera, at which a ray begins
_WORSE = 0.02  # visible share by which a later direction must be better


@dataclass(frozen=True, slots=True, eq=False)
class Shots:
    """Views of a run, each with the time from which it is used."""

    begins: Array  # (K,) [s]
    views: Sequence[CameraView]

    def at(self, time: float) -> CameraView:
        """View at a time [s]."""
        return self.views[max(int(np.searchsorted(self.begins, time, side="right")) - 1, 0)]

    @property
    def reach(self) -> float:
        """Largest distance [m] of a view."""
        return max(view.distance for view in self.views)


def shots(
    model: mujoco.MjModel,
    poses: Poses,
    work: Work,
    changes: Sequence[float],
    span: tuple[float, float],
    aspect: float,
) -> Shots:
    """Views of a run: one for each phase, fewer if they are similar, more if the vehicle goes far.

    Args:
        model: The plant's.
        poses: Of its bodies.
        work: What the tool does.
        changes: [s] of phase.
        span: [s] first and last time to be seen.
        aspect: Width over height of the pictures.
    """
    begin, end = span
    azimuth, elevation = _direction(model, poses, work, span)

    def view(first: float, last: float) -> CameraView:
        rows = np.unique([poses.row(t) for t in np.linspace(first, last, _SAMPLES)])
        return CameraView.framing(poses.extent(rows, work.p_W), azimuth, elevation, aspect)

    def parts(first: float, last: float) -> list[tuple[float, CameraView]]:
        whole = view(first, last)
        if whole.distance < widest or last - first < 2.0 * _SHORTEST:
            return [(first, whole)]
        middle = 0.5 * (first + last)
        return parts(first, middle) + parts(middle, last)

    widest = _WIDEST * min(view(t, t).distance for t in np.linspace(begin, end, _SAMPLES))
    edges = [begin, *(time for time in changes if begin < time < end), end]
    chosen: list[tuple[float, CameraView]] = []
    for first, last in pairwise(edges):
        for start, framed in parts(first, last):
            if not chosen or _unlike(chosen[-1][1], framed):
                chosen.append((start, framed))

    starts = np.array([start for start, _ in chosen])
    return Shots(starts, [framed for _, framed in chosen])


def _unlike(view: CameraView, other: CameraView) -> bool:
    """True if a change from one view to the other is worth it."""
    shift = float(np.linalg.norm(other.lookat_W - view.lookat_W))
    return shift + abs(other.distance - view.distance) > _ALIKE * view.distance


def _direction(
    model: mujoco.MjModel, poses: Poses, work: Work, span: tuple[float, float]
) -> tuple[float, float]:
    """Azimuth and elevation [deg] from which the working tool is occluded least."""
    poses.put(poses.row(0.5 * (span[0] + span[1])))
    ahead = poses.data.xmat[poses.vehicle.hull].reshape(3, 3)[:, 0]
    heading = float(np.degrees(np.arctan2(ahead[1], ahead[0])))
    if not len(work.time):
        return heading + _TURNS[0], _ELEVATIONS[0]

    # Rays from the tool at sampled times of the work.
    directions = [(heading + turn, steep) for steep in _ELEVATIONS for turn in _TURNS]
    ways_W = [-CameraView(np.zeros(3), 1.0, *direction).axes_W[2] for direction in directions]
    free = np.zeros(len(directions))
    for k in np.linspace(0, len(work.time) - 1, _LOOKS).astype(int):
        poses.put(poses.row(float(work.time[k])))
        clear_W = work.p_W[k] - _CLEAR * work.axis_W[k]
        free += [_leaves(model, poses.data, clear_W + _CLEAR * way_W, way_W) for way_W in ways_W]

    best = 0
    for k, share in enumerate(free / _LOOKS):
        if share > free[best] / _LOOKS + _WORSE:
            best = k
    return directions[best]


def _leaves(model: mujoco.MjModel, data: mujoco.MjData, start_W: Array, way_W: Array) -> bool:
    """True if a ray from a point (3,) [m] along a unit vector (3,) meets nothing."""
    geom = np.zeros(1, dtype=np.int32)
    return mujoco.mj_ray(model, data, start_W, way_W, None, 1, -1, geom) < 0.0
