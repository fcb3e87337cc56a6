"""Position-force control: displacement k of the tool from the force error [Konoplin 2022, section 3].

The original displaces the tool along the error vector G_f = G_F*_imp - G_F_imp by k, from a PID on its length. Friction
makes the tangential part of that vector non-zero while the tool moves; a displacement against friction would take the
tool off its path. Therefore the displacement here acts along the tool axis, from the normal part of the error.

    k = I + K T_p (e + T_d de/dt),    dI = K e dt + C_surface dF_set,    K = bandwidth (C_servo + C_surface)

e is the expected less the felt force; the expected one follows the set force F_set with the lag `response`. T_p and T_d
are `proportional_time` and `derivative_time`. Then k is limited in speed and size.

One tuning covers soft rubber and steel. The gains are stated as a loop bandwidth and multiplied by the displacement per
newton. This is the compliance of the arm's servo, which is known, plus that of the surface under the pad. The latter is
identified while the force grows, as the slope of k over the measured force. A change of the set force displaces the
tool at once by the surface's share; the loop corrects only the unknown rest.
"""

from dataclasses import dataclass, field

import numpy as np

from controllers.tuning import ForceLoopTuning, tuned
from sim.interfaces.spatial import Array


@dataclass(slots=True, eq=False)
class ForceDisplacementState:
    """Displacement of the tool, memory of the PID, and the identified surface compliance."""

    k: float = 0.0  # [m] along the tool axis, into the surface
    integral: float = 0.0  # [m]
    error: float = 0.0  # [N] of the last step
    wanted: float | None = None  # [N] set force of the last step; None: the loop was open
    expected: float = 0.0  # [N] force expected by now from the response of the drives
    felt: float = 0.0  # [N] measured normal force, smoothed, for the slope
    displaced: float = 0.0  # [m] displacement, smoothed likewise
    compliance: float = 0.0  # [m/N] of the surface, as identified
    # (5,) weight [s], means of F [N] and k [m], central moments FF [N^2] and Fk [N m]
    sums: Array = field(default_factory=lambda: np.zeros(5))


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceDisplacement(ForceLoopTuning):
    """PID from the normal force error to the displacement, with anti-windup and a speed limit."""

    @property
    def closed_loop(self) -> bool:
        """True: the estimated force is controlled."""
        return True

    def init(self) -> ForceDisplacementState:
        """Initial state: no displacement, a rigid surface."""
        return ForceDisplacementState()

    def step(
        self, state: ForceDisplacementState, wanted: float, felt: float, servo_compliance: float, dt: float
    ) -> float:
        """Displacement k for a set and a measured normal force.

        Args:
            state: of the loop; changed in place.
            wanted: [N] set normal force.
            felt: [N] measured normal force.
            servo_compliance: [m/N] of the arm's servo along the tool axis.
            dt: [s] since the last step.

        Returns:
            The displacement k [m] along the tool axis, positive into the surface.
        """
        if state.wanted is None:
            state.wanted, state.expected, state.error = wanted, wanted, wanted - felt
            state.felt, state.displaced = felt, state.k
        state.expected += min(1.0, dt / self.response) * (wanted - state.expected)
        error = state.expected - felt
        change = wanted - state.wanted
        self._learn(state, felt, change, dt)
        integral = self.bandwidth * (servo_compliance + state.compliance)  # [m/(N s)] gain
        proportional = integral * self.proportional_time  # [m/N] gain
        rate = (error - state.error) / dt
        state.wanted, state.error = wanted, error
        state.integral += integral * error * dt + state.compliance * change
        k_wanted = state.integral + proportional * (error + self.derivative_time * rate)
        most = self.speed * dt
        k = min(max(k_wanted, state.k - most), state.k + most)
        k = min(max(k, -self.limit), self.limit)
        state.integral += k - k_wanted  # anti-windup: back-calculation from the limited output
        state.k = k
        return k

    def _learn(self, state: ForceDisplacementState, felt: float, change: float, dt: float) -> None:
        """Update the surface compliance: least-squares slope of k over the measured force while the set force changes.

        At a constant set force k follows the surface's shape and the drift of the estimated hull pose, which are not
        informative.
        """
        smooth = dt / self.smoothing
        state.felt += smooth * (felt - state.felt)
        state.displaced += smooth * (state.k - state.displaced)
        if change == 0.0 and abs(state.felt - felt) < 1.0:
            return
        sums = state.sums
        sums[0] = sums[0] * (1.0 - dt / self.memory) + dt
        gain = dt / sums[0]
        dF, dk = state.felt - sums[1], state.displaced - sums[2]
        sums[1] += gain * dF
        sums[2] += gain * dk
        sums[3] += gain * ((1.0 - gain) * dF * dF - sums[3])
        sums[4] += gain * ((1.0 - gain) * dF * dk - sums[4])
        # The prior is a rigid surface: its loop is the slowest, and stable on any surface.
        slope = sums[4] / (sums[3] + self.prior**2)
        state.compliance = min(max(slope, 0.0), self.softest)

    def release(self, state: ForceDisplacementState, dt: float, *, inwards: bool = True) -> float:
        """Return the displacement to zero at the limited speed, with the force loop open.

        Args:
            state: of the loop; changed in place.
            dt: [s] since the last step.
            inwards: False keeps a negative displacement: the surface is not where it was expected.

        Returns:
            The displacement k [m].
        """
        most = self.speed * dt
        state.k -= min(max(state.k, -most if inwards else 0.0), most)
        state.integral, state.error, state.wanted = state.k, 0.0, None
        return state.k


@dataclass(frozen=True, slots=True, kw_only=True)
class NominalStiffness(ForceDisplacement):
    """Pressing without force control: a depth computed from the nominal stiffness of the pad."""

    stiffness: float = tuned(3e4, "[N/m] assumed of the pad")

    @property
    def closed_loop(self) -> bool:
        """False: the estimated force is not used."""
        return False

    def step(
        self, state: ForceDisplacementState, wanted: float, felt: float, servo_compliance: float, dt: float
    ) -> float:
        """Displacement k for a set normal force.

        Args:
            state: of the law; changed in place.
            wanted: [N] set normal force.
            felt: [N] not used.
            servo_compliance: [m/N] not used.
            dt: [s] not used.

        Returns:
            The displacement k [m] along the tool axis.
        """
        state.k = wanted / self.stiffness
        return state.k
