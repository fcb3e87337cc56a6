"""Position-force control: the displacement k of the tool along the force error (paper 002, third section).

The paper displaces the tool along G_f = G_F*_imp - G_F_imp by k, from a PID on its length. Friction makes the
tangential part of that vector non-zero for as long as the tool moves, and displacing the tool against friction would
take it off its path; so the displacement here goes along the tool axis, from the normal part of the error.

One tuning for soft rubber and for steel: the gains are stated as the bandwidth of the loop, and divided by how far the
tool must be displaced for a newton. That is the compliance of the arm's servo, which the controller knows, plus that of
the surface under the pad, which is found as the force grows: the slope of k over the felt force. The surface's part of
a change of the set force is displaced at once; the loop has only what is unknown left to do.
"""

from dataclasses import dataclass, field

import numpy as np

from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array


@dataclass(slots=True, eq=False)
class DisplacementState:
    """Displacement of the tool, the PID's memory, and what is known of the surface."""

    k: float = 0.0  # [m] along the tool axis, into the surface
    integral: float = 0.0  # [m]
    error: float = 0.0  # [N] of the last step
    wanted: float | None = None  # [N] set force of the last step; None: the loop was open
    expected: float = 0.0  # [N] what the drives should have made of the set force by now
    felt: float = 0.0  # [N] smoothed, for the slope
    displaced: float = 0.0  # [m] smoothed alike
    compliance: float = 0.0  # [m]/[N] of the surface, as believed
    sums: Array = field(default_factory=lambda: np.zeros(5))  # weight, mean F, mean k, and the second moments FF, Fk


@dataclass(frozen=True, slots=True, kw_only=True)
class Displacement:
    """PID from normal force error to displacement, with anti-windup and a limit on its speed."""

    bandwidth: float = 24.0  # [rad/s] of the closed loop on whatever surface
    proportional_time: float = 0.0  # [s] proportional gain over integral gain
    derivative_time: float = 0.0  # [s] derivative gain over proportional gain
    response: float = 0.08  # [s] in which the set force that the drives bear comes to be felt: no error meanwhile
    limit: float = 0.04  # [m] largest displacement either way
    speed: float = 0.03  # [m/s] largest speed of the displacement
    softest: float = 2e-4  # [m]/[N] of a surface that is believed, 5e3 N/m
    smoothing: float = 0.05  # [s] of force and displacement before their slope is taken
    memory: float = 3.0  # [s] that the slope remembers, counted while the set force changes
    prior: float = 4.0  # [N] spread of the force that the slope must have seen to be believed by half

    def __post_init__(self) -> None:
        for name in ("proportional_time", "derivative_time"):
            if not getattr(self, name) >= 0.0:
                raise ConfigurationError(f"displacement {name}: must be >= 0, got {getattr(self, name)}")
        for name in ("bandwidth", "limit", "speed", "softest", "smoothing", "memory", "prior"):
            if not getattr(self, name) > 0.0:
                raise ConfigurationError(f"displacement {name}: must be > 0, got {getattr(self, name)}")

    def step(self, state: DisplacementState, wanted: float, felt: float, servo_compliance: float, dt: float) -> float:
        """Displacement k [m] for a set and a felt normal force [N], `dt` [s] after the last step.

        `servo_compliance` [m]/[N]: how far the arm's servo yields to a force along the tool axis.
        """
        if state.wanted is None:
            state.wanted, state.expected, state.error = wanted, wanted, wanted - felt
            state.felt, state.displaced = felt, state.k
        state.expected += min(1.0, dt / self.response) * (wanted - state.expected)
        error = state.expected - felt
        change = wanted - state.wanted
        self._learn(state, felt, change, dt)
        integral = self.bandwidth * (servo_compliance + state.compliance)
        proportional = integral * self.proportional_time
        rate = (error - state.error) / dt
        state.wanted, state.error = wanted, error
        state.integral += integral * error * dt + state.compliance * change
        k_wanted = state.integral + proportional * (error + self.derivative_time * rate)
        most = self.speed * dt
        k = min(max(k_wanted, state.k - most), state.k + most)
        k = min(max(k, -self.limit), self.limit)
        state.integral += k - k_wanted  # anti-windup: the integral is what the output could follow
        state.k = k
        return k

    def _learn(self, state: DisplacementState, felt: float, change: float, dt: float) -> None:
        """Slope of k over the felt force, by least squares over the time in which the force was being changed.

        At rest k follows the surface's own shape and the drift of what is believed of the hull, which tell nothing.
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
        # The prior is a rigid surface: its loop is the slowest, and stable on any.
        slope = sums[4] / (sums[3] + self.prior**2)
        state.compliance = min(max(slope, 0.0), self.softest)

    def release(self, state: DisplacementState, dt: float, *, inwards: bool = True) -> float:
        """Let the displacement go back to zero at the limited speed, with the force loop open.

        `inwards` False: one that holds the tool off stays, for the surface is not where it was expected.
        """
        most = self.speed * dt
        state.k -= min(max(state.k, -most if inwards else 0.0), most)
        state.integral, state.error, state.wanted = state.k, 0.0, None
        return state.k
