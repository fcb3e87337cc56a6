"""Control of the hull: station keeping, allocation and lead compensation, as one kernel."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import mujoco
import numpy as np

from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.hull.allocation import (
    Allocation,
    AllocationRecord,
    allocate,
    allocation_record,
    take_allocation,
)
from uuv.controllers.hull.priorities import PRIORITIES, PRIORITIES_AFTER_LOSS
from uuv.controllers.hull.station_keeping import (
    HullTarget,
    MeasuredMotion,
    StationGains,
    StationKeeping,
    StationKeepingState,
    keep_station,
    through_water,
)
from uuv.controllers.hull.thruster_lead import (
    Propellers,
    ThrusterLead,
    ThrusterLeadState,
    lead_commands,
    static_commands,
)
from uuv.models.vehicle import Vehicle
from uuv.models.water.thruster_curves import thrust_at
from uuv.models.water.thrusters import curves
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.kernels.control import BoundFields, Unsaved
from uuv.sim.interfaces.kernels.record_box import as_annotated, new_box
from uuv.sim.interfaces.kernels.slots import gives_kernel
from uuv.sim.interfaces.messages import Reference, StateEstimate
from uuv.sim.interfaces.spatial import Array

_TILTS = 0.15  # [m] lever in roll and pitch, from which on a stuck thruster can turn the hull over
# [-] share of full thrust, above which a stuck thruster can turn the vehicle over
_PUSHES = 0.3


@dataclass(slots=True, eq=False)
class HullControlState:
    """State of the loop; the arrays are bound at the first step, so write into them but do not
    replace them.
    """

    station: StationKeepingState
    propellers: ThrusterLeadState
    wanted_B: Array  # (6,) [N, N m] last demand on the thrusters, hull axes
    current_W: Array  # (3,) [m/s] estimated current
    thrusters: Array  # (m,) last command, normalised
    stuck_B: Array  # (6,) [N, N m] wrench of lost thrusters that still give thrust
    allocation: AllocationRecord  # allocation to the remaining thrusters
    # indices of lost thrusters and their thrust [N], for which `allocation` was made
    lost: tuple[tuple[int, ...], tuple[float, ...]] = ((), ())
    alone: Unsaved["HullTick"] = field(default_factory=Unsaved)  # tick of `HullControl.step`


class HullRecord(NamedTuple):
    """Control of the hull, as arrays that are changed in place."""

    gains: StationGains
    model: Propellers
    period: float  # [s]
    allocation: AllocationRecord
    stuck_B: Array  # (6,) [N, N m]
    station: StationKeepingState
    propellers: ThrusterLeadState
    wanted_B: Array  # (6,) [N, N m]
    current_W: Array  # (3,) [m/s]
    thrusters: Array  # (m,)


@kernel
def control_hull(hull, motion, target, arm_B):
    """Compute thruster commands for one period; they are stored in `hull`, with current and wrench.

    Args:
        hull: `HullRecord`; updated.
        motion: present `MeasuredMotion`.
        target: `HullTarget`.
        arm_B: (6,) [N, N m] wrench of the arm on the hull to be cancelled, hull axes.
    """
    hull.wanted_B[:] = keep_station(hull.gains, hull.station, motion, target, arm_B, hull.period)
    hull.current_W[:] = hull.station.observer.current_W

    # Thrusters.
    nu_r_B = through_water(hull.station, motion)
    thrust = allocate(hull.allocation, hull.wanted_B - hull.stuck_B)
    static = static_commands(hull.model, thrust, nu_r_B)
    lead_commands(hull.model, hull.propellers, static, nu_r_B, hull.period, hull.thrusters)
    for k in range(6):
        hull.station.given_B[k] = hull.propellers.given_B[k] + hull.stuck_B[k]


class HullWork(NamedTuple):
    """Control of the hull by itself, for a controller that has no tick of its own."""

    hull: HullRecord
    motion: MeasuredMotion
    target: HullTarget
    arm_B: Array  # (6,) [N, N m]


@kernel
def hull_box(work):
    """`RecordBox` of a `HullWork`."""
    return new_box(work)


@kernel
def hull_tick(box):
    """Run `control_hull` on the box of a `HullWork`."""
    work = box.record
    control_hull(work.hull, work.motion, work.target, work.arm_B)


class HullControl:
    """Control from hull pose to thruster commands, with feedforward of the arm's wrench."""

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
        """Set up from the controller's model of the vehicle.

        Args:
            model: model of the controller, compiled.
            arm: modelled dynamics of the arm; None: read from `model`.
            period: [s] of a step.
            water_error: [-] share by which added mass and drag of the hull are deliberately wrong.
            allocation: allocation of the healthy vehicle; None: the default one.
            lead: compensation of the thrusters' lag; None: the default one.

        Raises:
            ConfigurationError: `allocation` or `lead` overrides a method that runs compiled.
        """
        vehicle = Vehicle.of(model)
        self.station = StationKeeping(model, arm, water_error=water_error)
        self._period = period
        self._thrusters = len(vehicle.thruster_names)
        self._columns = np.array(vehicle.thruster_wrench)
        self._full = np.array([thrust_at(curve, 1.0) for curve in curves(vehicle.thruster_table)])
        self._lead = lead or ThrusterLead(vehicle)
        self._sound = allocation or Allocation(vehicle)
        for part, name in ((self._lead, "propellers"), (self._sound, "record")):
            if not gives_kernel(part, name):
                raise ConfigurationError(
                    f"control of the hull: {type(part).__name__} overrides a method of its base, "
                    "which the compiled loop would not call"
                )
        # allocations, by the lost thrusters and whether these still give thrust
        self._allocations: dict[tuple[tuple[int, ...], bool], Allocation] = {}

    def init(self) -> HullControlState:
        """Initial state, with thrusters off and no estimate of the current."""
        allocation = allocation_record(self._thrusters)
        take_allocation(allocation, self._sound.record)
        return HullControlState(
            station=self.station.init(),
            propellers=self._lead.init(),
            wanted_B=np.zeros(6),
            current_W=np.zeros(3),
            thrusters=np.zeros(self._thrusters),
            stuck_B=np.zeros(6),
            allocation=allocation,
        )

    def allocation(self, lost: tuple[int, ...], *, pushing: bool = False) -> Allocation:
        """Allocation to the thrusters that remain without the `lost` ones, which are given by
        index.

        If a lost thruster still gives thrust (`pushing`), roll and pitch come first as for a
        healthy vehicle, since it may turn the vehicle over.
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
            estimate: present estimate of the vehicle.
            reference: hull pose and its velocities, and the thrusters that are lost.
            arm_wrench_B: (6,) [N, N m] wrench of the arm on the hull to be cancelled, hull axes.

        Returns:
            The commands.

        Raises:
            ConfigurationError: an array of the state was replaced.
        """
        self.refer(state, reference)
        tick = state.alone.get(lambda: HullTick(self.record(state), state))
        tick.bound.check()
        tick.run(estimate, reference, arm_wrench_B)
        return state.thrusters.copy()

    def refer(self, state: HullControlState, reference: Reference) -> None:
        """Store the lost thrusters, their remaining thrust, and the allocation to the other
        thrusters.

        Args:
            state: of `init`; changed in place.
            reference: the thrusters that are lost.
        """
        r = reference
        if (r.lost_thrusters, r.lost_thrust) == state.lost:
            return
        state.lost = r.lost_thrusters, r.lost_thrust
        lost = list(r.lost_thrusters)
        state.stuck_B[:] = self._columns[:, lost] @ r.lost_thrust if r.lost_thrust else 0.0
        pushing = bool(np.any(np.abs(r.lost_thrust) > _PUSHES * self._full[lost]))

        # If it is kept level under a thruster that pushes down, the hull sinks onto the object;
        # then depth comes first.
        pushing = pushing and bool(state.stuck_B[2] > -1.0)

        # With another thruster lost, keeping level may cost depth, so it comes first only if the
        # stuck thruster can turn the hull over.
        pushing = pushing and (len(lost) == 1 or _tilts(state.stuck_B))
        take_allocation(state.allocation, self.allocation(r.lost_thrusters, pushing=pushing).record)

    def record(self, state: HullControlState) -> HullRecord:
        """The state in the form of the kernel."""
        return HullRecord(
            gains=self.station.gains,
            model=self._lead.propellers,
            period=self._period,
            allocation=state.allocation,
            stuck_B=state.stuck_B,
            station=state.station,
            propellers=state.propellers,
            wanted_B=state.wanted_B,
            current_W=state.current_W,
            thrusters=state.thrusters,
        )


class HullTick:
    """Tick of hull control alone, bound to the arrays of a state."""

    def __init__(self, hull: HullRecord, state: HullControlState) -> None:
        self.bound = BoundFields(state)
        motion = MeasuredMotion(np.eye(4), np.zeros(3), np.zeros(3))
        target = HullTarget(np.eye(4), np.zeros(3), np.zeros(3))
        self._work = HullWork(hull, motion, target, np.zeros(6))
        self._box: Any = hull_box(as_annotated(self._work))

    def run(self, estimate: StateEstimate, reference: Reference, arm_wrench_B: Array) -> None:
        """Run `control_hull` on copies of the arguments."""
        e = estimate
        r = reference
        work = self._work
        for mine, value in zip(work.motion, (e.X_WB, e.v_WB_B, e.w_WB_B), strict=True):
            mine[...] = value
        for mine, value in zip(work.target, (r.X_WB, r.v_WB_W, r.w_WB_W), strict=True):
            mine[...] = value
        work.arm_B[:] = arm_wrench_B
        hull_tick(self._box)


def _tilts(stuck_B: Array) -> bool:
    """True if the wrench (6,) [N, N m] of stuck thrusters mainly tilts the hull."""
    return float(np.hypot(*stuck_B[3:5])) > _TILTS * float(np.linalg.norm(stuck_B[:3]))
