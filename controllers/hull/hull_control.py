"""Control of the hull: station keeping, allocation to the thrusters and lead compensation of their
lag, in one loop.

**Feedforward.** [Konoplin 2022] feeds C_F = C_D + A f_e forward to the thrusters: the wrench of the
arm's motion in water, and that of the contact. `WithoutTerms` and `WithoutCompensation` leave parts
of it out, for a study.

**Lead.** A propeller follows its command with a first-order lag T (`uuv.models.water.thrusters`).
Its present speed n is predicted from past commands. The command u that brings it towards the wanted
speed c with a lag T_r < T is

    u = n + (c - n) (1 - exp(-dt / T_r)) / (1 - exp(-dt / T)),    within full speed.

This is the inverse of the lag, filtered by `response` T_r. In the steady state u = c, whatever T
is. The price of a
smaller T_r is command activity: noise is amplified by about T / T_r.
"""

from collections.abc import Set
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol

import mujoco
import numpy as np

from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.arm.wrench_terms import WrenchTerms
from uuv.controllers.estimation.tip_force_estimator import ContactState
from uuv.controllers.hull.allocation import Allocation
from uuv.controllers.hull.priorities import PRIORITIES, PRIORITIES_AFTER_LOSS
from uuv.controllers.hull.station_keeping import StationKeeping, StationKeepingState
from uuv.controllers.tuning import HULL
from uuv.models.vehicle import Vehicle
from uuv.models.water.thruster_curves import command_in_flow, thrust_at, thrust_in_flow
from uuv.models.water.thrusters import INFLOW_LOSS, SLEW_RATE, TIME_CONSTANT, curves, inflow_levers
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.messages import Reference, StateEstimate
from uuv.sim.interfaces.spatial import Array, fitting, number

_TILTS = 0.15  # [m] lever in roll and pitch, from which on a stuck thruster turns the hull over
# [-] share of full thrust, above which a thruster that is stuck may turn the vehicle over
_PUSHES = 0.3
_PARTS = 4  # number of instants in a period over which the thrust is averaged

Term = Literal["hydrodynamic", "dynamic", "contact"]


@dataclass(slots=True, eq=False)
class ThrusterLeadState:
    """Believed state of the propellers."""

    passed: Array  # (m,) [-] normalised command after the slew limit of the drives
    speed: Array  # (m,) [-] normalised speed
    # (6,) [N, N m] mean wrench on the hull from the last step to the next, hull axes
    given_B: Array


class _Propellers(NamedTuple):
    """Model of the thrusters, as the kernel takes it."""

    curves: Array  # of thrust over speed
    figures: Array  # (m, 3) lag [s], slew rate [1/s], loss by inflow
    B: Array  # (6, m) wrench of unit thrusts
    advance: Array  # (6, m) levers of the inflow: `B` without the propellers' reaction torques
    response: float  # [s] lag with compensation


class ThrusterLead:
    """Thruster model of one vehicle, run in parallel and inverted."""

    def __init__(
        self, vehicle: Vehicle, *, response: float = HULL.response, lag_error: float = 0.0
    ) -> None:
        """Set up the model for the thrusters of `vehicle`.

        Args:
            vehicle: the vehicle, with a table of its thrusters.
            response: [s] lag with compensation. At or above a thruster's own lag its command stays
                unchanged.
            lag_error: [-] share by which the believed lag is deliberately wrong.

        Raises:
            ConfigurationError: `response` is not finite or not > 0, or `lag_error` leaves no lag.
        """
        if not 0.0 < number(response, "response of the thrusters [s]") < np.inf:
            raise ConfigurationError(
                f"response of the thrusters: must be finite and > 0 s, got {response}"
            )
        if not -1.0 < number(lag_error, "lag_error") < np.inf:
            raise ConfigurationError(f"lag_error: must be finite and above -1, got {lag_error}")
        table = vehicle.thruster_table
        B = np.array(vehicle.thruster_wrench)
        figures = np.column_stack(
            [
                (1.0 + lag_error) * table[:, TIME_CONSTANT],
                table[:, SLEW_RATE],
                table[:, INFLOW_LOSS],
            ]
        )
        self._model = tuple(
            _Propellers(curves(table), figures, B, inflow_levers(table, B), float(response))
        )
        self._thrusters = len(figures)

    def init(self) -> ThrusterLeadState:
        """Initial state: all propellers at rest."""
        m = self._thrusters
        return ThrusterLeadState(np.zeros(m), np.zeros(m), np.zeros(6))

    def static(self, thrust: Array, nu_r_B: Array) -> Array:
        """Static commands (m,) [-] that give `thrust` (m,) [N] in the inflow of the hull's motion
        through the water.

        Args:
            thrust: (m,) [N] wanted.
            nu_r_B: (6,) [m/s, rad/s] velocity of the hull relative to the water, hull axes.

        Returns:
            The commands, in [-1, 1]; the nearest where a thrust is out of reach.

        Raises:
            ConfigurationError: another shape, or a number that is not finite.
        """
        thrust = fitting(thrust, (self._thrusters,), "thrusts wanted [N]")
        nu_r_B = fitting(nu_r_B, (6,), "motion through the water")
        return _static(self._model, thrust, nu_r_B)

    def step(self, state: ThrusterLeadState, wanted: Array, nu_r_B: Array, dt: float) -> Array:
        """Commands (m,) for the next `dt` that replace the static ones `wanted`.

        The predicted mean wrench of the thrusters over `dt` is left in `state.given_B`.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            wanted: (m,) [-] static commands, normalised.
            nu_r_B: (6,) [m/s, rad/s] velocity of the hull relative to the water, hull axes; its
                inflow reduces thrust.
            dt: [s] duration of the commands.

        Returns:
            Normalised commands (m,) [-] in [-1, 1].

        Raises:
            ConfigurationError: another shape, or a number that is not finite.
        """
        wanted = fitting(wanted, state.speed.shape, "thruster commands wanted")
        nu_r_B = fitting(nu_r_B, (6,), "motion through the water")
        command = np.empty_like(wanted)
        _lead(self._model, wanted, nu_r_B, dt, (state.passed, state.speed, state.given_B), command)
        return command


@kernel
def _inflow(advance, i, nu_r_B):
    """Speed of advance [m/s] of thruster `i` through the water, along its thrust."""
    total = 0.0
    for k in range(6):
        total += advance[k, i] * nu_r_B[k]
    return total


@kernel
def _static(model, thrust, nu_r_B):
    curve, figures, _, advance, _ = model
    command = np.empty(thrust.shape[0])
    for i in range(thrust.shape[0]):
        command[i] = command_in_flow(
            curve[i], figures[i, 2], _inflow(advance, i, nu_r_B), thrust[i]
        )
    return command


@kernel
def _lead(model, wanted, nu_r_B, dt, state, command):
    """Commands for the next `dt`; `model` is `_Propellers`, `state` is passed, speed and given_B of
    the state.
    """
    curve, figures, B, advance, response = model
    passed, speed, given_B = state
    given_B[:] = 0.0
    for i in range(wanted.shape[0]):
        lag, slew, loss = figures[i]
        u = wanted[i]
        if lag > response:
            u = speed[i] + (u - speed[i]) * np.expm1(-dt / response) / np.expm1(-dt / lag)
        command[i] = min(max(u, -1.0), 1.0)
        most = slew * dt if slew > 0.0 else np.inf
        passed[i] += min(max(command[i] - passed[i], -most), most)
        inflow, mean = _inflow(advance, i, nu_r_B), 0.0
        for part in range(_PARTS):
            n = passed[i]
            if lag > 0.0:
                n += (speed[i] - n) * np.exp(-(part + 0.5) / _PARTS * dt / lag)
            mean += thrust_in_flow(curve[i], loss, inflow, n) / _PARTS
        speed[i] = (
            passed[i] + (speed[i] - passed[i]) * np.exp(-dt / lag) if lag > 0.0 else passed[i]
        )
        for k in range(6):
            given_B[k] += B[k, i] * mean


@dataclass(slots=True, eq=False)
class HullControlState:
    """State of the loop."""

    station: StationKeepingState
    propellers: ThrusterLeadState
    wanted_B: Array  # (6,) [N, N m] last asked of the thrusters, hull axes
    current_W: Array  # (3,) [m/s] estimated current
    thrusters: Array  # (m,) last command, normalised


class HullControl:
    """Hull pose to thruster commands, beside the fed-forward wrench of the arm."""

    def __init__(
        self,
        model: mujoco.MjModel,
        arm: ArmDynamics | None = None,
        *,
        period: float = 0.02,
        water_error: float = 0.0,
        allocation: Allocation | None = None,
        lead: ThrusterLead | None = None,
    ) -> None:
        """Set up from the believed model of the vehicle.

        Args:
            model: believed model, compiled.
            arm: believed dynamics of its arm; None reads them from `model`.
            period: [s] of a step.
            water_error: [-] share by which added mass and drag of the hull are deliberately wrong.
            allocation: of the sound vehicle; None: the default one.
            lead: compensation of the thrusters' lag; None: the default one.
        """
        vehicle = Vehicle.of(model)
        self.station = StationKeeping(model, arm, water_error=water_error)
        self._period, self._thrusters = period, len(vehicle.thruster_names)
        self._columns = np.array(vehicle.thruster_wrench)
        self._full = np.array([thrust_at(curve, 1.0) for curve in curves(vehicle.thruster_table)])
        self._lead = lead or ThrusterLead(vehicle)
        self._sound = allocation or Allocation(vehicle)
        # by those lost, and whether they push
        self._allocations: dict[tuple[tuple[int, ...], bool], Allocation] = {}

    def init(self) -> HullControlState:
        """Initial state: thrusters off, no current known."""
        off = np.zeros(self._thrusters)
        return HullControlState(
            self.station.init(), self._lead.init(), np.zeros(6), np.zeros(3), off
        )

    def allocation(self, lost: tuple[int, ...], *, pushing: bool = False) -> Allocation:
        """Allocation to the thrusters that are left without those `lost`, by index.

        Where a lost one is still `pushing`, roll and pitch come first as for a sound vehicle: it
        may turn over.
        """
        if not lost:
            return self._sound
        if (lost, pushing) not in self._allocations:
            levels = PRIORITIES if pushing else PRIORITIES_AFTER_LOSS
            self._allocations[lost, pushing] = self._sound.without(*lost, priorities=levels)
        return self._allocations[lost, pushing]

    def step(
        self,
        state: HullControlState,
        estimate: StateEstimate,
        reference: Reference,
        arm_wrench_B: Array,
    ) -> Array:
        """Thruster commands (m,), normalised, for one period.

        Args:
            state: of `init`, or as the last step left it; changed in place.
            estimate: of the vehicle now.
            reference: hull pose and its velocities, and the thrusters that are lost.
            arm_wrench_B: (6,) [N, N m] wrench of the arm on the hull to be cancelled, hull axes.

        Returns:
            The commands.
        """
        r, dt = reference, self._period
        state.wanted_B = self.station.step(
            state.station, estimate, r.X_WB, r.v_WB_W, arm_wrench_B, dt, r.w_WB_W
        )
        state.current_W = self.station.current(state.station)
        stuck_B = (
            self._columns[:, list(r.lost_thrusters)] @ r.lost_thrust
            if r.lost_thrust
            else np.zeros(6)
        )
        pushing = bool(np.any(np.abs(r.lost_thrust) > _PUSHES * self._full[list(r.lost_thrusters)]))
        # Kept level under a thruster that pushes down, the hull sinks onto the object: there depth
        # comes first.
        pushing = pushing and stuck_B[2] > -1.0
        # With another one lost, to keep level may cost the depth: only against one that itself
        # turns the hull over.
        pushing = pushing and (len(r.lost_thrusters) == 1 or _tilts(stuck_B))
        allocation = self.allocation(r.lost_thrusters, pushing=pushing)
        through_water = self.station.through_water(state.station, estimate)
        command = self._lead.static(allocation.thrust(state.wanted_B - stuck_B), through_water)
        state.thrusters = self._lead.step(state.propellers, command, through_water, dt)
        state.station.given_B = state.propellers.given_B + stuck_B
        return state.thrusters


def _tilts(stuck_B: Array) -> bool:
    """True if the wrench (6,) [N, N m] of stuck thrusters turns the hull over, rather than push it
    along.
    """
    return float(np.hypot(*stuck_B[3:5])) > _TILTS * float(np.linalg.norm(stuck_B[:3]))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ArmLoad:
    """Wrench (6,) [N, N m] of the arm on the hull, at the hull's origin in hull axes."""

    contact_B: Array  # part of the contact; zero while free of contact
    wrench_B: Array  # all of it


class Feedforward(Protocol):
    """Choice of what is fed forward."""

    def left_out(
        self, load: ArmLoad, contact: ContactState, estimate: StateEstimate
    ) -> Array | None:
        """Part (6,) [N, N m] of the arm's wrench that is not fed forward, hull axes; None: nothing.

        Args:
            load: the arm's wrench on the hull.
            contact: motion of arm and hull.
            estimate: of the vehicle now.
        """
        ...


class ArmWrench:
    """Feed all of the arm's wrench forward."""

    def left_out(self, load: ArmLoad, contact: ContactState, estimate: StateEstimate) -> None:
        """Nothing is left out."""


class WithoutCompensation:
    """Feed only the weight of the arm at home forward, whatever it does."""

    def __init__(self, arm: ArmDynamics, q_home: Array) -> None:
        self._home_wrench = arm.wrench_at_rest(np.array(q_home))

    def left_out(self, load: ArmLoad, contact: ContactState, estimate: StateEstimate) -> Array:
        """Everything but the wrench at home."""
        return load.wrench_B - self._home_wrench


class WithoutTerms:
    """Feed the arm's wrench forward without some of its terms."""

    def __init__(
        self, arm: ArmDynamics, terms: Set[Term], *, acceleration_filter: float, period: float
    ) -> None:
        """Choose the terms.

        Args:
            arm: believed dynamics of the arm.
            terms: those to leave out.
            acceleration_filter: [s] of the joint acceleration in the contact estimator.
            period: [s] of its steps.
        """
        self._terms, self._without = WrenchTerms(arm), frozenset(terms)
        self._lag = max(acceleration_filter - period, period)

    def left_out(self, load: ArmLoad, contact: ContactState, estimate: StateEstimate) -> Array:
        """Sum of the terms."""
        left_out = load.contact_B.copy() if "contact" in self._without else np.zeros(6)
        q, qd, sensed = estimate.q, estimate.qd, contact.sensed
        qdd = (qd - sensed.qd_slow) / self._lag  # the estimator has moved qd_slow on by one period
        if "hydrodynamic" in self._without:
            left_out += self._terms.hydrodynamic(sensed.hull, q, qd, qdd)
        if "dynamic" in self._without:
            left_out += self._terms.dynamic(sensed.hull, q, qd, qdd)
        return left_out
