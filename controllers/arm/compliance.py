"""Lateral compliance: the tool gives way to what pushes it aside, and so finds the middle of what it goes into.

An admittance law beside the displacement k of paper 002: where the displacement brings the force along the tool axis to
its set value, this one brings the force across the axis to zero. The tool's reference moves at

    d/dt o = A (1 - min(1, b / |f|)) f,    f = F - (F . z) z

with F the felt force of the world on the tip, z the tool axis, A the admittance and b a dead band, so that a bias of
the felt force within the band moves nothing while the tool is free.

Against a wall of stiffness K the loop is an integrator of crossover K A [rad/s] behind the filter of the felt force
(12 ms), the joint servo (critically damped, 60 rad/s: 33 ms) and half a task period (2 ms): a phase of
90 deg - K A 47 ms. The default and K = 3e4 N/m of the tool's mount give 12 rad/s and 58 deg; the loop would be at the
edge of stability at K = 8e4 N/m, which the mount's spring in series excludes. The offset is the integral itself and is
limited as such, so nothing winds up.
"""

from dataclasses import dataclass, field

import numpy as np

from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array


@dataclass(slots=True, eq=False)
class ComplianceState:
    """By how much the tool has given way."""

    offset_W: Array = field(default_factory=lambda: np.zeros(3))  # (3,) [m]


@dataclass(frozen=True, slots=True, kw_only=True)
class LateralCompliance:
    """Admittance from the felt force across the tool axis to the tool's place."""

    admittance: float = 4e-4  # [m]/[N s]
    dead_band: float = 1.5  # [N]
    limit: float = 0.012  # [m] largest offset
    speed: float = 0.02  # [m/s] largest speed of the offset
    release_speed: float = 0.01  # [m/s] at which it goes back

    def __post_init__(self) -> None:
        for name in ("admittance", "limit", "speed", "release_speed"):
            if not getattr(self, name) > 0.0:
                raise ConfigurationError(f"compliance {name}: must be > 0, got {getattr(self, name)}")
        if not self.dead_band >= 0.0:
            raise ConfigurationError(f"compliance dead_band: must be >= 0 N, got {self.dead_band}")

    def step(self, state: ComplianceState, f_tip_W: Array, z_WG: Array, dt: float) -> Array:
        """Offset (3,) [m] of the tool, world axes, for the felt force of the world on the tip `f_tip_W` (3,) [N].

        `z_WG` (3,) is the unit tool axis; `dt` [s] has passed since the last step.
        """
        side = f_tip_W - (f_tip_W @ z_WG) * z_WG
        size = float(np.linalg.norm(side))
        if size > self.dead_band:
            rate = min(self.admittance * (size - self.dead_band), self.speed)
            offset = state.offset_W + side * (rate * dt / size)
            length = float(np.linalg.norm(offset))
            state.offset_W = offset * min(1.0, self.limit / max(length, self.limit))
        return state.offset_W

    def release(self, state: ComplianceState, dt: float) -> Array:
        """Let the offset (3,) [m] go back to zero at the limited speed, with the loop open."""
        length = float(np.linalg.norm(state.offset_W))
        if length > 0.0:
            state.offset_W = state.offset_W * max(0.0, 1.0 - self.release_speed * dt / length)
        return state.offset_W
