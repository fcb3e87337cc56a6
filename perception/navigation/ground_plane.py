"""The plane of the ground under the vehicle from the ranges of its Doppler log, always of the last second or so.

The coarse approach of paper 004 (its reference 11): the seabed as a plane through the places where the beams meet it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from sim.interfaces.errors import ConfigurationError
from sim.interfaces.messages import DvlRangesMeasurement, GroundPlane, Measurement, StateEstimate
from sim.interfaces.protocols import Estimator
from sim.interfaces.spatial import Array, readonly

_HEARD = 0.5  # share of the pings that a beam must have heard to count
_LEAST = 3  # beams that make a plane
_FLAT = 0.02  # ratio of the sides of the beams' places on the ground below which they are in a line


def plane_through(echoes_W: Array) -> tuple[Array, Array, float]:
    """Point (3,) [m], unit normal (3,), upwards, and scatter [m] of the plane through `echoes_W` (k, 3), k >= 3.

    Least squares of the distances; the scatter of three points is 0. Raises ConfigurationError for points that are in
    a line, or too few.
    """
    points = np.asarray(echoes_W, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < _LEAST or not np.all(np.isfinite(points)):
        raise ConfigurationError(f"plane: expected {_LEAST} finite points (k, 3) or more, got shape {points.shape}")
    middle = points.mean(axis=0)
    _, size, axes = np.linalg.svd(points - middle)
    if not size[1] > _FLAT * size[0]:
        raise ConfigurationError(f"plane: the {len(points)} points are in a line")
    normal = axes[2] if axes[2, 2] >= 0.0 else -axes[2]
    off = (points - middle) @ normal
    return middle, normal, float(np.sqrt(np.mean(off**2)))


@dataclass(slots=True, eq=False)
class GroundState:
    """Memory of `GroundBelow`; `inner` is the estimator's own."""

    inner: Any
    echoes_W: list[Array] = field(default_factory=list)  # (k, 3) [m] of the last pings, NaN where none came
    ground: GroundPlane | None = None


@dataclass(frozen=True, slots=True)
class GroundBelow:
    """An estimator (`sim.interfaces.protocols.Estimator`) that says as well how the ground lies under the hull."""

    estimator: Estimator
    pings: int = 10  # of which each beam's median is taken

    @property
    def period(self) -> float:
        return self.estimator.period

    def init(self, first: Sequence[Measurement]) -> GroundState:
        return GroundState(inner=self.estimator.init(first))

    def step(self, state: GroundState, measurements: Sequence[Measurement]) -> tuple[GroundState, StateEstimate]:
        state.inner, estimate = self.estimator.step(state.inner, measurements)
        for m in measurements:
            if isinstance(m, DvlRangesMeasurement):
                echoes_B = m.p_BD + m.ranges[:, None] * m.axes_B
                state.echoes_W.append(echoes_B @ estimate.X_WB[:3, :3].T + estimate.X_WB[:3, 3])
                del state.echoes_W[: -self.pings]
                state.ground = _ground(m.time, np.array(state.echoes_W))
        return state, replace(estimate, ground=state.ground)


def _ground(time: float, echoes_W: Array) -> GroundPlane:
    """The plane through the medians of the beams, of `echoes_W` (pings, k, 3) [m], that were heard often enough."""
    heard = np.isfinite(echoes_W).all(axis=2).mean(axis=0) >= _HEARD
    unknown = readonly(np.full(3, np.nan))
    try:
        p, normal, scatter = plane_through(np.nanmedian(echoes_W[:, heard], axis=0))
    except ConfigurationError:
        p, normal, scatter = unknown, unknown, float("nan")
    silent = tuple(int(beam) + 1 for beam in np.flatnonzero(~heard))
    return GroundPlane(
        time=time, p_W=readonly(p), normal_W=readonly(normal), scatter=scatter, beams=int(heard.sum()), silent=silent
    )
