"""Position-force control: displacement k from the force error [Konoplin 2022, section 3].

The paper displaces the tool along the error vector G_f = G_F*_imp - G_F_imp by k, which is the
output of a PID on the length of G_f. Friction makes the tangential part of that vector non-zero
while the tool moves; a displacement against friction would move the tool off its path. Therefore
the displacement here acts along the tool axis, from the normal part of the error.

    k = I + K T_p (e + T_d de/dt)
    dI = K e dt + C_surface dF_set
    K = bandwidth (C_servo + C_surface)

e is the expected force minus the measured force; the expected force follows the set force F_set
with the lag `response`. T_p and T_d are `proportional_time` and `derivative_time`. They are zero by
default, which gives an integral law with a feedforward by the identified compliance. Then k is
limited in speed and magnitude. The law as published is in `published_force_law`.

One tuning covers soft rubber and steel. The gains are stated as a loop bandwidth and multiplied by
the displacement per newton. The displacement per newton is the compliance of the arm's servo, which
is known, plus that of the surface under the pad. The compliance of the surface is identified while
the force grows, as the slope of k over the measured force. A change of the set force immediately
displaces the tool by the part of the surface; the loop corrects only the unknown rest.
"""

from dataclasses import dataclass, field
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba.np.numpy_support import carray

from uuv.controllers.tuning import ForceLoopTuning, tuned
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.kernels.slots import FINE, Slot, empty_slot, slot_function
from uuv.sim.interfaces.spatial import Array

# Entries of `ForceDisplacementState.numbers`: [m] displacement along the tool axis, into the
# surface; the part of it from the error
K, INTEGRAL = 0, 1
ERROR, SET_FORCE, EXPECTED = 2, 3, 4  # [N] at the last step; NaN set force: the loop was open
FELT, DISPLACED = 5, 6  # measured normal force [N] and displacement [m], smoothed for the slope
COMPLIANCE = 7  # [m/N] identified compliance of the surface
SUMS = 8  # (5,) weight [s], means of F [N] and k [m], central moments FF [N^2] and Fk [N m]
NUMBERS = 13  # number of entries

# Entries of the values of a slot for a force law: set force [N], measured force [N], compliance
# [m/N] of the arm's servo, time [s] since the last step, whether the LOOP is CLOSED or the
# displacement returns to zero, INWARDS too or only OUTWARDS; the answer is the displacement k [m];
# and WHOLE (3,) [N], the measured force of the world on the tip, W
ASKED, MEASURED, SOFT, LASTING, LOOP, ANSWER, WHOLE = range(7)
VALUES = WHOLE + 3
CLOSED, INWARDS, OUTWARDS = range(3)


def _open_loop() -> Array:
    numbers = np.zeros(NUMBERS)
    numbers[SET_FORCE] = np.nan
    return numbers


@dataclass(slots=True, eq=False)
class ForceDisplacementState:
    """Displacement of the tool, memory of the loop, and the identified surface compliance."""

    numbers: Array = field(default_factory=_open_loop)  # (NUMBERS,), changed in place

    @property
    def k(self) -> float:
        """Displacement [m] along the tool axis, into the surface."""
        return float(self.numbers[K])

    @k.setter
    def k(self, displacement: float) -> None:
        """Set the displacement [m]."""
        self.numbers[K] = displacement

    @property
    def compliance(self) -> float:
        """Identified compliance [m/N] of the surface."""
        return float(self.numbers[COMPLIANCE])


class ForceLoopGains(NamedTuple):
    """Fields of `ForceLoopTuning`, in the form of the kernels."""

    bandwidth: float
    proportional_time: float
    derivative_time: float
    response: float
    limit: float
    speed: float
    softest: float
    smoothing: float
    memory: float
    prior: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceDisplacement(ForceLoopTuning):
    """Integral law from normal force error to displacement, with anti-windup, limits, P and D."""

    @property
    def closed_loop(self) -> bool:
        """True: the estimated force is controlled."""
        return True

    @property
    def gains(self) -> ForceLoopGains:
        """The gains, in the form of the kernels."""
        return ForceLoopGains(*(getattr(self, name) for name in ForceLoopGains._fields))

    def init(self) -> ForceDisplacementState:
        """Initial state: no displacement, a rigid surface."""
        return ForceDisplacementState()

    def slot(self, state: ForceDisplacementState) -> Slot:
        """The law is contained in the tick, which works on the numbers of `state`."""
        return empty_slot(state.numbers, VALUES)

    def step(
        self,
        state: ForceDisplacementState,
        set_force: float,
        felt: float,
        servo_compliance: float,
        dt: float,
    ) -> float:
        """Displacement k for a set and a measured normal force.

        Args:
            state: of the loop; changed in place.
            set_force: [N] normal force to press with.
            felt: [N] measured normal force.
            servo_compliance: [m/N] of the arm's servo along the tool axis.
            dt: [s] since the last step.

        Returns:
            The displacement k [m] along the tool axis, positive into the surface.
        """
        return displace(self.gains, state.numbers, set_force, felt, servo_compliance, dt)

    def release(self, state: ForceDisplacementState, dt: float, *, inwards: bool = True) -> float:
        """Bring the displacement back to zero at the limited speed, with the force loop open.

        Args:
            state: of the loop; changed in place.
            dt: [s] since the last step.
            inwards: False keeps a negative displacement, for a surface that is not where it was
                expected.

        Returns:
            The displacement k [m].
        """
        return let_go(state.numbers, self.speed * dt, inwards)


@kernel
def displace(gains, numbers, set_force, felt, servo_compliance, dt):
    """Step of `ForceDisplacement`.

    Args:
        gains: `ForceLoopGains`.
        numbers: (NUMBERS,) state; updated.
        set_force: [N] normal force to press with.
        felt: [N] measured normal force.
        servo_compliance: [m/N] of the arm's servo along the tool axis.
        dt: [s] since the last step.

    Returns:
        The displacement k [m].
    """
    if np.isnan(numbers[SET_FORCE]):
        numbers[SET_FORCE] = set_force
        numbers[EXPECTED] = set_force
        numbers[ERROR] = set_force - felt
        numbers[FELT] = felt
        numbers[DISPLACED] = numbers[K]

    # Error relative to the expected force, and the identification of the surface
    numbers[EXPECTED] += min(1.0, dt / gains.response) * (set_force - numbers[EXPECTED])
    error = numbers[EXPECTED] - felt
    change = set_force - numbers[SET_FORCE]
    _learn(gains, numbers, felt, change, dt)

    # Integral law, with optional P and D
    integral = gains.bandwidth * (servo_compliance + numbers[COMPLIANCE])  # [m/(N s)] gain
    proportional = integral * gains.proportional_time  # [m/N] gain
    rate = (error - numbers[ERROR]) / dt
    numbers[SET_FORCE] = set_force
    numbers[ERROR] = error
    numbers[INTEGRAL] += integral * error * dt + numbers[COMPLIANCE] * change
    k_wanted = numbers[INTEGRAL] + proportional * (error + gains.derivative_time * rate)

    # Limits of speed and magnitude
    most = gains.speed * dt
    k = min(max(k_wanted, numbers[K] - most), numbers[K] + most)
    k = min(max(k, -gains.limit), gains.limit)
    numbers[INTEGRAL] += k - k_wanted  # anti-windup: back-calculation from the limited output
    numbers[K] = k
    return k


@kernel
def _learn(gains, numbers, felt, change, dt):
    """Update the surface compliance: slope of k over the measured force while the set force
    changes.

    At a constant set force k follows the surface's shape and the drift of the estimated hull pose,
    which are not informative.
    """
    smooth = dt / gains.smoothing
    numbers[FELT] += smooth * (felt - numbers[FELT])
    numbers[DISPLACED] += smooth * (numbers[K] - numbers[DISPLACED])
    if change == 0.0 and abs(numbers[FELT] - felt) < 1.0:
        return

    sums = numbers[SUMS:]
    sums[0] = sums[0] * (1.0 - dt / gains.memory) + dt
    gain = dt / sums[0]
    dF = numbers[FELT] - sums[1]
    dk = numbers[DISPLACED] - sums[2]
    sums[1] += gain * dF
    sums[2] += gain * dk
    sums[3] += gain * ((1.0 - gain) * dF * dF - sums[3])
    sums[4] += gain * ((1.0 - gain) * dF * dk - sums[4])

    # The prior is a rigid surface, for which the loop is slowest and stable on any surface.
    slope = sums[4] / (sums[3] + gains.prior * gains.prior)
    numbers[COMPLIANCE] = min(max(slope, 0.0), gains.softest)


@kernel
def let_go(numbers, most, inwards):
    """Step of `ForceDisplacement.release`, by at most `most` [m]; returns the displacement [m]."""
    numbers[K] -= min(max(numbers[K], -most if inwards else 0.0), most)
    numbers[INTEGRAL] = numbers[K]
    numbers[ERROR] = 0.0
    numbers[SET_FORCE] = np.nan
    return numbers[K]


@dataclass(frozen=True, slots=True, kw_only=True)
class NominalStiffness(ForceDisplacement):
    """Pressing without force control, to a depth computed from the nominal stiffness of the pad."""

    stiffness: float = tuned(3e4, "[N/m] assumed stiffness of the pad")

    @property
    def closed_loop(self) -> bool:
        """False: the estimated force is not used."""
        return False

    def step(
        self,
        state: ForceDisplacementState,
        set_force: float,
        felt: float,
        servo_compliance: float,
        dt: float,
    ) -> float:
        """Displacement k for a set normal force.

        Args:
            state: of the law; changed in place.
            set_force: [N] normal force to press with.
            felt: [N] not used.
            servo_compliance: [m/N] not used.
            dt: [s] not used.

        Returns:
            The displacement k [m] along the tool axis.
        """
        state.k = set_force / self.stiffness
        return state.k

    def slot(self, state: ForceDisplacementState) -> Slot:
        """The law as a kernel."""
        return Slot(_nominal(self.stiffness, self.speed).address, state.numbers, np.zeros(VALUES))


@cache
def _nominal(stiffness: float, speed: float) -> Any:
    def law(memory: Any, values: Any) -> int:
        numbers = carray(memory, NUMBERS)
        packed = carray(values, VALUES)
        if packed[LOOP] == CLOSED:
            numbers[K] = packed[ASKED] / stiffness
        else:
            let_go(numbers, speed * packed[LASTING], packed[LOOP] == INWARDS)

        packed[ANSWER] = numbers[K]
        return FINE

    return slot_function(law)
