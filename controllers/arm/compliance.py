"""Lateral compliance: an admittance with which the tool yields sideways and centres itself in a
hole.

It acts in addition to the displacement k of [Konoplin 2022]. The displacement controls the force
along the tool axis to its set value; the admittance controls the force across the axis to zero. The
tool's reference moves at

    d/dt o = A (1 - min(1, b / |f|)) f,    f = F - (F . z) z.

F is the measured force of the world on the tip, z the tool axis, A the admittance and b a dead
band. A bias of the measured force within the dead band causes no motion while the tool is free.

Against a wall of stiffness K the loop is an integrator of crossover K A [rad/s] in series with
three lags. These are the filter of the measured force (12 ms), the joint servo (critically damped,
60 rad/s: 33 ms) and half a task period (2 ms). The phase margin is 90 deg - K A 47 ms. The default
and K = 3e4 N/m of the tool's mount give 12 rad/s and 58 deg. The stability limit is K = 8e4 N/m,
which cannot occur, because the spring of the mount is in series. The offset is the integral itself
and is limited, so there is no windup.

A tool that stops on a stiff surface yields gently. Its lateral force then falls from that of
sliding friction to a small value, which disturbs the normal force. On surfaces of 6e5 to 1e6 N/m
the peaks of this disturbance were 8 to 12 N at full speed, and 7 to 10 N at `gentle_speed`.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from uuv.controllers.tuning import ComplianceTuning
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.kernels.slots import Slot, empty_slot
from uuv.sim.interfaces.messages import Reference
from uuv.sim.interfaces.spatial import Array

# Entry of `ComplianceState.numbers` after the offset (3,) [m], W: not 0 if that is the offset of a
# tool that stands on a surface
GENTLE = 3
# Number of entries
NUMBERS = 4

# Entries of the values of a slot for a displacement perpendicular to the tool axis: force (3,) [N]
# and axis (3,), W, time [s] since the last step, flags of `Reference`; the result is the offset
# (3,) [m], W
FORCE, AXIS, DT = 0, 3, 6
CONTROLLED, COMPLIANT, STANDING = range(7, 10)
# The result
OFFSET = 10
# Number of entries
VALUES = 13


@dataclass(slots=True, eq=False)
class ComplianceState:
    """Present lateral offset of the tool."""

    numbers: Array = field(default_factory=lambda: np.zeros(NUMBERS))  # changed in place

    @property
    def offset_W(self) -> Array:
        """Offset (3,) [m], W; a view."""
        return self.numbers[:3]

    @offset_W.setter
    def offset_W(self, offset_W: Array) -> None:
        """Set the offset (3,) [m], W."""
        self.numbers[:3] = offset_W


class ComplianceGains(NamedTuple):
    """Fields of `ComplianceTuning`, in the form of the kernels."""

    admittance: float
    dead_band: float
    limit: float
    speed: float
    release_speed: float
    gentle_speed: float


@dataclass(frozen=True, slots=True, kw_only=True)
class LateralCompliance(ComplianceTuning):
    """Admittance from the lateral contact force to the tool's position."""

    @property
    def gains(self) -> ComplianceGains:
        """The gains, in the form of the kernels."""
        return ComplianceGains(*(getattr(self, name) for name in ComplianceGains._fields))

    def slot(self, state: ComplianceState) -> Slot:
        """The law is contained in the tick, which works on the numbers of `state`."""
        return empty_slot(state.numbers, VALUES)

    def init(self) -> ComplianceState:
        """Initial state: no offset."""
        return ComplianceState()

    def acts(self, reference: Reference) -> bool:
        """True if the tool is to yield to lateral forces."""
        return reference.compliant

    def step(
        self,
        state: ComplianceState,
        f_tip_W: Array,
        z_WG: Array,
        dt: float,
        *,
        gently: bool = False,
    ) -> Array:
        """Offset of the tool for the measured contact force.

        Args:
            state: the present offset; changed in place.
            f_tip_W: (3,) [N] force of the world on the tip, W.
            z_WG: (3,) unit tool axis, W.
            dt: [s] since the last step.
            gently: True: yield, and later return, no faster than `gentle_speed`.

        Returns:
            The offset (3,) [m], W.
        """
        give_way(self.gains, state.numbers, np.array(f_tip_W), np.array(z_WG), dt, gently)
        return state.offset_W.copy()

    def release(self, state: ComplianceState, dt: float) -> Array:
        """Bring the offset (3,) [m] back to zero, in open loop; `dt` [s] since the last step."""
        come_back(self.gains, state.numbers, dt)
        return state.offset_W.copy()


@kernel
def give_way(gains, numbers, f_W, z_WG, dt, gently):
    """Step of `LateralCompliance`.

    Args:
        gains: `ComplianceGains`.
        numbers: (NUMBERS,) state; updated.
        f_W: (3,) [N] force of the world on the tip, W.
        z_WG: (3,) unit tool axis, W.
        dt: [s] since the last step.
        gently: as in `LateralCompliance.step`.
    """
    numbers[GENTLE] = gently
    side = f_W - np.dot(f_W, z_WG) * z_WG
    size = np.sqrt(np.dot(side, side))

    if size > gains.dead_band:
        most = min(gains.gentle_speed, gains.speed) if gently else gains.speed
        rate = min(gains.admittance * (size - gains.dead_band), most)
        offset = numbers[:3] + side * (rate * dt / size)

        length = np.sqrt(np.dot(offset, offset))
        numbers[:3] = offset * min(1.0, gains.limit / max(length, gains.limit))


@kernel
def come_back(gains, numbers, dt):
    """Step of `LateralCompliance.release`; the arguments are those of `give_way`."""
    offset = numbers[:3]
    length = np.sqrt(np.dot(offset, offset))

    if length > 0.0:
        gentle = numbers[GENTLE] != 0.0
        speed = min(gains.gentle_speed, gains.release_speed) if gentle else gains.release_speed
        numbers[:3] = offset * max(0.0, 1.0 - speed * dt / length)
