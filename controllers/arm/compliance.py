"""Lateral compliance: an admittance that lets the tool yield to lateral forces and centre itself in a hole.

It acts beside the displacement k of [Konoplin 2022]. The displacement controls the force along the tool axis to its set
value; the admittance controls the force across the axis to zero. The tool's reference moves at

    d/dt o = A (1 - min(1, b / |f|)) f,    f = F - (F . z) z.

F is the measured force of the world on the tip, z the tool axis, A the admittance and b a dead band. A bias of the
measured force within the band moves nothing while the tool is free.

Against a wall of stiffness K the loop is an integrator of crossover K A [rad/s] in series with three lags. These are
the filter of the measured force (12 ms), the joint servo (critically damped, 60 rad/s: 33 ms) and half a task period (2
ms). The phase margin is 90 deg - K A 47 ms. The default and K = 3e4 N/m of the tool's mount give 12 rad/s and 58 deg.
The stability limit is K = 8e4 N/m, which the mount's spring in series excludes. The offset is the integral itself and
is limited as such, so there is no windup.

A tool that stands on a stiff surface yields gently: its lateral force falls from that of sliding friction to little,
and disturbs the normal force meanwhile. On 6e5 to 1e6 N/m the peaks were 8 to 12 N at full speed, 7 to 10 N gently.
"""

from dataclasses import dataclass, field

import numpy as np

from uuv.controllers.tuning import ComplianceTuning
from uuv.sim.interfaces.messages import Reference
from uuv.sim.interfaces.spatial import Array


@dataclass(slots=True, eq=False)
class ComplianceState:
    """Present lateral offset of the tool."""

    offset_W: Array = field(default_factory=lambda: np.zeros(3))  # (3,) [m]
    gentle: bool = False  # it is that of a tool which stands on a surface


@dataclass(frozen=True, slots=True, kw_only=True)
class LateralCompliance(ComplianceTuning):
    """Admittance from the lateral contact force to the tool's position."""

    def init(self) -> ComplianceState:
        """Initial state: no offset."""
        return ComplianceState()

    def acts(self, reference: Reference) -> bool:
        """True where the tool is to yield to lateral forces."""
        return reference.compliant

    def step(self, state: ComplianceState, f_tip_W: Array, z_WG: Array, dt: float, *, gently: bool = False) -> Array:
        """Offset of the tool for the measured contact force.

        Args:
            state: the present offset; changed in place.
            f_tip_W: (3,) [N] force of the world on the tip, W.
            z_WG: (3,) unit tool axis, W.
            dt: [s] since the last step.
            gently: yield, and later return, no faster than `gentle_speed`.

        Returns:
            The offset (3,) [m], W.
        """
        state.gentle = gently
        side = f_tip_W - (f_tip_W @ z_WG) * z_WG
        size = float(np.linalg.norm(side))
        if size > self.dead_band:
            rate = min(
                self.admittance * (size - self.dead_band), min(self.gentle_speed, self.speed) if gently else self.speed
            )
            offset = state.offset_W + side * (rate * dt / size)
            length = float(np.linalg.norm(offset))
            state.offset_W = offset * min(1.0, self.limit / max(length, self.limit))
        return state.offset_W

    def release(self, state: ComplianceState, dt: float) -> Array:
        """Return the offset (3,) [m] to zero, with the loop open; `dt` [s] since the last step."""
        length = float(np.linalg.norm(state.offset_W))
        if length > 0.0:
            speed = min(self.gentle_speed, self.release_speed) if state.gentle else self.release_speed
            state.offset_W = state.offset_W * max(0.0, 1.0 - speed * dt / length)
        return state.offset_W
