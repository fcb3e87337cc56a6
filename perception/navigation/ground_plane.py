"""Plane of the seabed under the vehicle, from the ranges of the DVL's last pings.

The coarse approach to the seabed uses a plane through the points where the beams meet the seabed
[Konoplin 2019].
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import (
    DvlRangesMeasurement,
    GroundPlane,
    Measurement,
    StateEstimate,
)
from uuv.sim.interfaces.protocols import Estimator
from uuv.sim.interfaces.spatial import Array, readonly

_HEARD = 0.5  # [-] share of the pings in which a beam must have an echo to be used
_LEAST = 3  # least number of beams that determine a plane
_FLAT = 0.02  # [-] ratio of the sides of the echoes' pattern, below which the echoes are on a line


def plane_through(echoes_W: Array) -> tuple[Array, Array, float]:
    """Least-squares plane through three or more points.

    Args:
        echoes_W: (k, 3) [m] points in W, k >= 3.

    Returns:
        A point (3,) [m] of the plane, its upward unit normal (3,) and the rms distance [m] of the
        points from it. For three points this distance is 0.

    Raises:
        ConfigurationError: The points are on a line, or there are too few.
    """
    points = np.asarray(echoes_W, dtype=np.float64)
    if (
        points.ndim != 2
        or points.shape[1] != 3
        or len(points) < _LEAST
        or not np.all(np.isfinite(points))
    ):
        raise ConfigurationError(
            f"plane: expected at least {_LEAST} finite points (k, 3), got shape {points.shape}"
        )

    middle = points.mean(axis=0)
    _, size, axes = np.linalg.svd(points - middle)
    if not size[1] > _FLAT * size[0]:
        raise ConfigurationError(f"plane: the {len(points)} points must not be on a line")

    normal = axes[2] if axes[2, 2] >= 0.0 else -axes[2]
    off = (points - middle) @ normal
    return middle, normal, float(np.sqrt(np.mean(off**2)))


@dataclass(slots=True, eq=False)
class GroundState:
    """State of GroundBelow; `inner` is that of the wrapped estimator."""

    inner: Any
    # (k, 3) [m] of the last pings, NaN without echo
    echoes_W: list[Array] = field(default_factory=list)
    ground: GroundPlane | None = None


@dataclass(frozen=True, slots=True)
class GroundPlaneEstimator:
    """Estimator wrapper that adds the plane of the ground to the state estimate.

    Implements `uuv.sim.interfaces.protocols.Estimator`.
    """

    estimator: Estimator
    pings: int = 10  # number of pings over which the median of each beam is taken

    @property
    def period(self) -> float:
        """Sampling period [s] of the wrapped estimator."""
        return self.estimator.period

    def init(self, first: Sequence[Measurement]) -> GroundState:
        """Initial state from the first measurements of every sensor."""
        return GroundState(inner=self.estimator.init(first))

    def step(
        self, state: GroundState, measurements: Sequence[Measurement]
    ) -> tuple[GroundState, StateEstimate]:
        """Update the wrapped estimator, and the plane from all DVL ranges among `measurements`."""
        state.inner, estimate = self.estimator.step(state.inner, measurements)
        for m in measurements:
            if isinstance(m, DvlRangesMeasurement):
                echoes_B = m.p_BD + m.ranges[:, None] * m.axes_B
                state.echoes_W.append(echoes_B @ estimate.X_WB[:3, :3].T + estimate.X_WB[:3, 3])
                del state.echoes_W[: -self.pings]
                state.ground = _ground(m.time, np.array(state.echoes_W))
        return state, self.completed(state, estimate)

    def records(self, state: GroundState) -> Any:
        """Arrays of the wrapped estimator, if it has a kernel."""
        inner: Any = self.estimator
        return inner.records(state.inner)

    def completed(self, state: GroundState, estimate: StateEstimate) -> StateEstimate:
        """An estimate of the wrapped estimator, with the plane of the ground added."""
        return replace(estimate, ground=state.ground)


def _ground(time: float, echoes_W: Array) -> GroundPlane:
    """Plane through the median echoes of the beams that have enough echoes.

    `echoes_W`: (pings, k, 3) [m], NaN without echo.
    """
    heard = np.isfinite(echoes_W).all(axis=2).mean(axis=0) >= _HEARD
    unknown = readonly(np.full(3, np.nan))
    try:
        p, normal, scatter = plane_through(np.nanmedian(echoes_W[:, heard], axis=0))
    except ConfigurationError:
        p = unknown
        normal = unknown
        scatter = float("nan")

    silent = tuple(int(beam) + 1 for beam in np.flatnonzero(~heard))
    return GroundPlane(
        time=time,
        p_W=readonly(p),
        normal_W=readonly(normal),
        scatter=scatter,
        beams=int(heard.sum()),
        silent=silent,
    )
