"""Probe of a thruster: a small doublet that distinguishes its loss from a disturbance that looks
the same.

A wave along a single sway thruster, and that thruster's loss, leave the same wrench unexplained.
They are distinguished by the response of the hull to thrust that is added on purpose. If the
thruster works, its predicted thrust explains the response, and the missing thrust does not change.
If it is lost, the added thrust is missing too.

The missing thrust is fitted by a polynomial of time, for the disturbance, and by the added thrust
after the lags of propeller and filter. The factor of the added thrust is the share that is lost.
"""

from dataclasses import dataclass, field

import numpy as np

from uuv.controllers.tuning import FaultLimits
from uuv.models.water.thruster_curves import command_for, thrust_at, thrust_in_flow
from uuv.sim.interfaces.spatial import Array

# degree of the polynomial, for each doublet's duration: a disturbance of up to 0.3 Hz
_DEGREE = 1.5
_LOST = 0.5  # [-] share of the added thrust that is missing, above which the thruster is lost
_SURE = 2.5  # [sigma] by which the share must differ from _LOST for a verdict
# number of doublets after which a verdict is possible, and after which the probe ends without one
_DOUBLETS = (2, 6)


@dataclass(slots=True, eq=False)
class ProbeState:
    """State of a running probe."""

    thruster: int
    began: float  # [s] start of the probe
    added: float = 0.0  # [N] thrust added at present
    # [-] command that the propeller would have without the probe, after the slew limit
    passed: float = 0.0
    speed: float = 0.0  # [-] speed of the propeller without it
    answer: float = 0.0  # [N] added thrust, filtered like the missing thrust
    # time [s], missing and added thrust [N]
    rows: list[tuple[float, float, float]] = field(default_factory=list)


class ThrusterProbe:
    """Probes of the thrusters of one vehicle."""

    def __init__(self, curves: Array, lags: Array, loss: Array, limits: FaultLimits) -> None:
        """Set up from the modelled thrusters.

        Args:
            curves: static curves of the m thrusters, one per row.
            lags: (m, 2) time constant [s] and slew rate [1/s].
            loss: (m,) [N s/m] of thrust by inflow.
            limits: size and time of the doublet.
        """
        self._curves = curves
        self._lags = lags
        self._loss = loss
        self._limits = limits
        self._least, self._most = (
            np.array([thrust_at(curve, end) for curve in curves]) for end in (-1.0, 1.0)
        )

    def begin(self, thruster: int, time: float, passed: Array, speed: Array) -> ProbeState:
        """Probe of one `thruster` from `time` [s] on; with predicted commands and speeds of the
        propellers, (m,) each.
        """
        return ProbeState(
            thruster, time, passed=float(passed[thruster]), speed=float(speed[thruster])
        )

    def sent(self, state: ProbeState, thrusters: Array) -> Array:
        """Commands (m,) with the doublet, for `thrusters` (m,) of the controller."""
        i = state.thruster
        sent = np.array(thrusters)
        curve = self._curves[i]
        sent[i] = np.clip(command_for(curve, thrust_at(curve, sent[i]) + state.added), -1.0, 1.0)
        return sent

    def step(
        self,
        state: ProbeState,
        time: float,
        dt: float,
        wanted: float,
        inflow: float,
        thrust: float,
        missing: float,
    ) -> float | None:
        """Add one balance of the hull's momentum, and choose the next added thrust.

        Args:
            state: of the probe; changed in place.
            time: [s] of the balance.
            dt: [s] since the last balance.
            wanted: [-] command of the controller since then, without the doublet.
            inflow: [m/s] speed of advance through the water along the thrust.
            thrust: [N] predicted thrust in this inflow, with the doublet.
            missing: [N] unexplained force along the thruster.

        Returns:
            The missing share of the added thrust, once it is known accurately enough; NaN if it
                cannot be determined, None to continue.
        """
        limits = self._limits
        i = state.thruster

        # The propeller without the doublet, and what the doublet adds to its thrust.
        lag, slew = self._lags[i]
        most = slew * dt if slew > 0.0 else np.inf
        state.passed += min(max(wanted - state.passed, -most), most)
        state.speed = state.passed + (state.speed - state.passed) * (
            np.exp(-dt / lag) if lag > 0.0 else 0.0
        )
        added = thrust - thrust_in_flow(self._curves[i], self._loss[i], inflow, state.speed)
        state.answer += min(1.0, dt / limits.hull_time) * (added - state.answer)
        state.rows.append((time, missing, state.answer))

        # Size of the next doublet, which is larger if the first ones gave no verdict.
        doublets = (time - state.began) / limits.probe_time
        larger = 1.0 if doublets < _DOUBLETS[0] else 2.0
        size = larger * limits.probe_share * self._most[i]

        # If full thrust is commanded already, the doublet is one-sided.
        base = thrust_at(self._curves[i], wanted)
        ahead = min(size, max(0.0, self._most[i] - base))
        ahead = max(ahead, size - (base - self._least[i]))
        state.added = ahead if doublets % 1.0 < 0.5 else ahead - 2.0 * size

        # Verdict, once the share is known accurately enough.
        if doublets < _DOUBLETS[0]:
            return None
        share, sigma = self._share(np.array(state.rows), dt)
        if abs(share - _LOST) > _SURE * sigma:
            return share

        return np.nan if doublets > _DOUBLETS[1] else None

    def _share(self, rows: Array, dt: float) -> tuple[float, float]:
        """Share of the added thrust that is missing, and its standard deviation."""
        # Disturbance as a polynomial of time, and the share of the added thrust.
        degree = round(_DEGREE * (rows[-1, 0] - rows[0, 0]) / self._limits.probe_time)
        smooth = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, len(rows)), degree)
        A = np.column_stack([smooth, -rows[:, 2]])
        found, *_ = np.linalg.lstsq(A, rows[:, 1], rcond=None)
        left = rows[:, 1] - A @ found

        # Variance of the share, from the residuals.
        # number of samples that the filter combines into one reading
        alike = 2.0 * self._limits.hull_time / dt
        variance = float(left @ left) / max(1.0, len(rows) / alike - A.shape[1]) / alike

        across = A[:, -1] - A[:, :-1] @ np.linalg.lstsq(A[:, :-1], A[:, -1], rcond=None)[0]
        return float(found[-1]), float(
            np.sqrt(variance * alike / max(float(across @ across), 1e-12))
        )


def is_lost(share: float) -> bool:
    """Verdict on the share of the added thrust that is missing."""
    return share > _LOST
