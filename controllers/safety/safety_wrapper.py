"""Safety wrapper of a controller: rejects invalid estimates and commands, replaces failed sensors.

It wraps any `uuv.sim.interfaces.protocols.Controller`:

- Fault detection (`uuv.controllers.safety.fault_detection`) runs every step; its faults are sent
  with the command.
- A torque sensor that is faulty or not finite is replaced by its motor: commanded torque minus
  rotor inertia and friction, plus the sensor's offset while it was healthy.
- Once the work is aborted the arm yields: in addition to its weight it exerts only a small force at
  its tip.
- A drive with a faulty encoder cannot be servoed. It only compensates the arm's weight, so that it
  yields to contact and is held by the friction of its gear.
- An estimate with numbers that are not finite, or with IMU data that are too old, never reaches the
  controller. An estimate whose time does not advance reaches the controller for `patience` only.
- Without a valid estimate the last command is repeated for `patience`. After that the arm is
  braked. The hull departs blindly (`uuv.controllers.safety.blind_departure`). Then the thrusters
  are stopped for good. The same holds for a controller with commands that are not finite.
"""

import math
from dataclasses import dataclass, field, replace
from typing import Any

import mujoco
import numpy as np

from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.safety.blind_departure import BlindDeparture, DepartureStage, HeldHull
from uuv.controllers.safety.fault_detection import FaultDetection, FaultDetectionState
from uuv.controllers.safety.guard_tick import (
    ACCUSED,
    BALANCE_DT,
    BEGAN,
    FAULTY,
    FRESH,
    NUMBERS,
    PROBING,
    SUSPECT,
    GuardLimits,
    GuardRecord,
    finite,
    guard_box,
    guard_tick,
)
from uuv.controllers.safety.hull_residuals import HullBalance
from uuv.controllers.safety.sensor_checks import checked_entries
from uuv.controllers.tuning import SAFETY, FaultLimits
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.kernels.control import (
    BROKEN,
    REFUSED,
    STOPPED,
    UNSOUND,
    BoundFields,
    Commanded,
    ControlTick,
    Inputs,
    PythonControl,
    Unsaved,
    commanded,
    has_tick,
)
from uuv.sim.interfaces.kernels.record_box import as_annotated
from uuv.sim.interfaces.kernels.slots import FINE, address_of_box, address_of_kernel, empty_slot
from uuv.sim.interfaces.messages import (
    Command,
    ContactEstimate,
    Fault,
    FaultKind,
    HeldLoad,
    JawReference,
    Reference,
    StateEstimate,
)
from uuv.sim.interfaces.protocols import Controller
from uuv.sim.interfaces.records import estimate_record
from uuv.sim.interfaces.spatial import Array

# [m] least distance of the tip from a joint's axis; closer joints, in the wrist, only turn the tool
_LEAST_LEVER = 0.1
# [N m] sigma of a replaced torque sensor, which excludes its joint from the force estimate
_LEFT_OUT = 1e3


@dataclass(slots=True, eq=False)
class SafetyWrapperState:
    """State of the wrapper; `inner` is the state of the wrapped controller."""

    inner: Any  # state of the wrapped controller
    health: FaultDetectionState | None  # fault detection, from the first valid estimate on
    time: float  # [s] time of the last estimate
    sound: StateEstimate  # last valid estimate
    command: Command  # last finite command
    thrusters: Array  # (m,) commands sent, with the doublet of a probe
    commanded: Commanded  # command of a wrapped controller in Python
    held: HeldHull  # means that a blind departure would need
    blind_for: float = 0.0  # [s] time without a valid estimate, or command
    stopped: Fault | None = None  # reason for a stop; None: not stopped
    lost: tuple[int, ...] = ()  # indices of thrusters not to be used
    arm: ArmDynamics | None = None  # the arm, with what its jaws hold
    holds: HeldLoad | None = None  # that load
    departure: tuple[DepartureStage, ...] = ()  # stages of the departure, from the stop on
    numbers: Array = field(default_factory=lambda: np.zeros(NUMBERS))  # numbers of `GuardRecord`
    alone: Unsaved["GuardTick"] = field(default_factory=Unsaved)  # tick of `SafetyWrapper.step`


class SafetyWrapper:
    """Controller with fault handling around another `uuv.sim.interfaces.protocols.Controller`."""

    def __init__(
        self,
        controller: Controller,
        model: mujoco.MjModel,
        *,
        patience: float = 0.03,
        limits: FaultLimits | None = None,
    ) -> None:
        """Wrap `controller`.

        Args:
            controller: the controller to be wrapped.
            model: compiled model of the controller.
            patience: [s] for which the last command is repeated without a valid estimate or
                command.
            limits: thresholds of fault detection; None: the defaults.
        """
        self.period = controller.period
        self.controller = controller
        self._patience = patience

        vehicle = Vehicle.of(model)
        self._limits = np.array(vehicle.torque_limits)
        self._armed = vehicle.joints.size > 0
        self._arm = ArmDynamics(model) if self._armed else None
        self._departure = _departure(model, vehicle, self._arm)

        self._armature = np.array(vehicle.armature)
        self._damping = np.array(vehicle.joint_damping)
        self.health = FaultDetection(model, period=controller.period, limits=limits)
        self._thrusters = len(vehicle.thruster_names)

    @property
    def tunings(self) -> tuple[Any, ...]:
        """Gains in use, first those of the wrapped controller, for
        `uuv.controllers.tuning.table`.
        """
        return *getattr(self.controller, "tunings", ()), self.health.limits, SAFETY

    def init(self, estimate: StateEstimate) -> SafetyWrapperState:
        """Initial state at the first `estimate`, with a command of zero torque and thrust."""
        n = len(self._limits)
        still = Command(
            time=estimate.time,
            joint_torque=np.zeros(n),
            thrusters=np.zeros(self._thrusters),
            scan=False,
            contact=ContactEstimate(normal=0.0),
        )
        return SafetyWrapperState(
            inner=self.controller.init(estimate),
            health=None,
            time=-np.inf,
            sound=estimate,
            command=still,
            thrusters=np.zeros(self._thrusters),
            commanded=commanded(n, self._thrusters),
            held=HeldHull.start(self._thrusters),
            arm=self._arm,
        )

    def step(
        self, state: SafetyWrapperState, estimate: StateEstimate, reference: Reference
    ) -> tuple[SafetyWrapperState, Command]:
        """Guarded step of the wrapped controller; neither raises nor passes on non-finite input.

        Args:
            state: of `init`, or as the last step left it.
            estimate: the vehicle's state now, possibly invalid.
            reference: reference of the planner.

        Returns:
            The state and a command with finite numbers, and with all faults found so far.
        """
        e = estimate
        if state.stopped is not None or not finite(
            e.X_WB, e.v_WB_B, e.w_WB_B, e.a_WB_B, e.q, e.qd, e.time
        ):
            return state, self.without(state, estimate, FaultKind.ESTIMATE)

        if e.imu_age > SAFETY.old_imu:
            return state, self.without(state, estimate, FaultKind.ESTIMATE)

        # An estimate whose time does not advance is accepted for `patience` only.
        fresh = e.time > state.time
        if not fresh and state.blind_for + self.period > self._patience:
            return state, self.without(state, estimate, FaultKind.ESTIMATE)
        state.time = e.time

        # The first valid estimate starts fault detection.
        if state.health is None:
            state.health = self.health.init(
                replace(estimate, tau=np.nan_to_num(e.tau, posinf=0.0, neginf=0.0))
            )

        estimate = self._replaced(state.health, estimate)
        state.numbers[FAULTY] = bool(state.health.faults)

        # The tick; a controller in Python gets the messages themselves.
        tick = state.alone.get(lambda: GuardTick(self, state, Inputs(estimate_record(len(e.q)))))
        tick.refer(reference)
        tick.inputs.take(estimate)
        state.numbers[FRESH] = fresh
        answer = tick.slots.check(guard_tick(tick.box, tick.inputs.box))
        return state, tick.done(estimate, reference, answer)

    def tick_on(self, state: SafetyWrapperState, inputs: Inputs) -> "GuardTick | None":
        """The tick of `state`, with the inputs `inputs`; None before the first valid estimate."""
        return None if state.health is None else GuardTick(self, state, inputs)

    def passed(
        self,
        state: SafetyWrapperState,
        estimate: StateEstimate,
        command: Command,
        reference: Reference,
    ) -> Command:
        """Command to be sent for a command of the wrapped controller, if estimate and command are
        valid.

        Args:
            state: of the wrapper; changed in place.
            estimate: present estimate of the vehicle.
            command: command of the wrapped controller, finite.
            reference: reference of the planner.

        Returns:
            The command with the faults; drives with a faulty encoder only compensate the arm's
                weight.
        """
        health = state.health
        fresh = bool(state.numbers[FRESH])
        assert health is not None

        # Once the work is aborted the arm yields.
        if reference.abort is not None:
            gentle = self._gentle(state, command.joint_torque, estimate)
            command = replace(command, joint_torque=gentle)
            if fresh:
                health.joints.tau_motor[:] = command.joint_torque

        if health.probe is not None:
            command = replace(command, thrusters=self.health.sent(health, command.thrusters))

        state.sound, state.command, state.blind_for = (
            estimate,
            command,
            0.0 if fresh else state.blind_for + self.period,
        )

        faults = tuple(health.faults)
        if not faults:
            return command
        return replace(
            command,
            joint_torque=self._servoed(state, command.joint_torque, estimate),
            faults=faults,
        )

    def _replaced(self, health: FaultDetectionState, estimate: StateEstimate) -> StateEstimate:
        """Estimate in which motor torques, with a large uncertainty, replace faulty torque sensors.

        Motor torque and gear output differ by the gear's stiction, tens of newtons at the tool.
        Therefore the force is estimated from the other joints only.
        """
        missing = not _numbers(estimate.tau)
        if not missing and not health.faults:
            return estimate

        if missing:
            self.health.blame_torque_sensors(health, ~np.isfinite(estimate.tau), estimate.time)
        wrong = [fault.index for fault in health.faults if fault.kind is FaultKind.TORQUE_SENSOR]
        if not wrong:
            return estimate

        # Torque of the motor, with the usual offset of the sensor.
        tau, doubt = np.array(estimate.tau), np.zeros(len(estimate.tau))
        for j in wrong:
            doubt[j] = _LEFT_OUT
            acceleration = (
                estimate.qd[j] - health.joints.qd_slow[j]
            ) / self.health.limits.torque_time
            motor = (
                health.joints.tau_motor[j]
                - self._armature[j] * acceleration
                - self._damping[j] * estimate.qd[j]
            )
            tau[j] = motor + health.joints.usual[j]
        return replace(estimate, tau=tau, tau_doubt=doubt)

    def _servoed(self, state: SafetyWrapperState, torque: Array, estimate: StateEstimate) -> Array:
        """`torque` (n,) [N m], reduced to compensation of the arm's weight for drives with a faulty
        encoder.
        """
        assert state.health is not None
        faults = state.health.faults
        wrong = [fault.index for fault in faults if fault.kind is FaultKind.ENCODER]
        if not wrong:
            return torque
        torque = np.array(torque)
        torque[wrong] = self._borne(state, estimate.q, estimate.X_WB[:3, :3])[wrong]
        return torque

    def _gentle(self, state: SafetyWrapperState, torque: Array, estimate: StateEstimate) -> Array:
        """`torque` (n,) [N m], bounded to the arm's weight and SAFETY.gentle_force at the tip.

        A hull that is out of control then pushes the arm aside instead of pressing the arm into the
        object.
        """
        if self._arm is None:
            return torque

        borne = self._borne(state, estimate.q, estimate.X_WB[:3, :3])
        lever = np.linalg.norm(self._arm.tip(estimate.q)[1][:3], axis=0)
        most = SAFETY.gentle_force * np.maximum(lever, _LEAST_LEVER)
        return borne + np.clip(torque - borne, -most, most)

    def without(
        self, state: SafetyWrapperState, estimate: StateEstimate, kind: FaultKind
    ) -> Command:
        """Command without a controller: the last one repeated, then brakes and a blind departure.

        Args:
            state: of the wrapper; changed in place.
            estimate: present estimate of the vehicle, possibly invalid.
            kind: the missing input.

        Returns:
            The command, with the faults.
        """
        state.blind_for += self.period
        faults = tuple(state.health.faults) if state.health is not None else ()

        # After `patience`: stop for good, and plan the departure.
        if state.stopped is None and state.blind_for > self._patience:
            state.stopped = Fault(
                kind=kind, part="", index=-1, time=state.sound.time + state.blind_for
            )
            if self._departure is not None:
                state.departure = self._departure.stages(state.held, state.sound, state.lost)

        if state.stopped is None:
            return replace(state.command, faults=faults)
        return replace(
            state.command,
            joint_torque=self._brake(state, estimate),
            thrusters=self._departing(state),
            scan=False,
            contact=replace(state.command.contact, normal=0.0),
            faults=(*faults, state.stopped),
        )

    def _departing(self, state: SafetyWrapperState) -> Array:
        """Commands (m,) of the departure's present stage, zero after the last one."""
        since = state.blind_for - self._patience
        return next(
            (stage.thrusters for stage in state.departure if since <= stage.until),
            np.zeros(self._thrusters),
        )

    def _brake(self, state: SafetyWrapperState, estimate: StateEstimate) -> Array:
        """Torques (n,) [N m] that brake the arm and compensate its weight, at the last valid
        attitude.
        """
        q, qd = estimate.q, estimate.qd
        if not (np.isfinite(q).all() and np.isfinite(qd).all()):
            q, qd = state.sound.q, np.zeros(len(self._limits))

        borne = self._borne(state, q, state.sound.X_WB[:3, :3])
        braked = borne - self._limits * np.clip(
            SAFETY.braking_share * qd / SAFETY.braking_speed,
            -SAFETY.braking_share,
            SAFETY.braking_share,
        )
        return np.clip(braked, -self._limits, self._limits)

    def refer(self, state: SafetyWrapperState, reference: Reference) -> None:
        """Take what the vehicle is to do without, and what its jaws hold, from set points."""
        state.lost = reference.lost_thrusters
        if self._arm is None or not isinstance(reference, JawReference):
            return
        load = reference.jaws.holds
        if load is not state.holds:
            state.holds = load
            state.arm = self._arm if load is None else self._arm.bearing(load)

    def _borne(self, state: SafetyWrapperState, q: Array, R_WB: Array) -> Array:
        """Torques (n,) [N m] that compensate the weight of the arm and of what it holds at rest, in
        still water.
        """
        if state.arm is None:
            return np.zeros(0)
        rest = np.zeros(len(q))
        return state.arm.inverse(
            q,
            rest,
            rest,
            R_WB=R_WB,
            nu_B=np.zeros(6),
            a_B=np.zeros(6),
            v_current_W=np.zeros(3),
            wrench_tip_G=np.zeros(6),
        )[0]


class GuardTick:
    """Tick of a `SafetyWrapper`, bound to the arrays of a state (`ControlTick`)."""

    def __init__(self, wrapper: SafetyWrapper, state: SafetyWrapperState, inputs: Inputs) -> None:
        self._wrapper = wrapper
        self._state = state
        self.inputs = inputs

        # Components in Python are those of the wrapped controller.
        self._inner = inner = self._wrapped(inputs)
        self.slots = inner.slots
        self.slow = inner.slow

        # The record, and how a kernel finds it.
        self.command = inner.command._replace(thrusters=state.thrusters)
        self.reference = inner.reference
        self.box = guard_box(as_annotated(self._record()))
        self.memory: int = address_of_box(self.box)
        self.address = address_of_kernel(guard_tick, self.box, inputs.box)
        self._bound = BoundFields(state, state.health)

    def refer(self, reference: Reference) -> None:
        """Set the set points of the following ticks, each at a new time.

        Raises:
            ConfigurationError: an array of the state was replaced.
        """
        self._bound.check()
        state = self._state
        state.numbers[FRESH] = 1.0
        self._wrapper.refer(state, reference)
        self._inner.refer(reference)

    def ready(self, reference: Reference) -> bool:
        """False after a stop, a fault or an abort, and while the estimate is not valid."""
        state = self._state
        faulty = state.stopped is not None or state.blind_for or state.numbers[FAULTY]
        return not faulty and reference.abort is None and self._inner.ready(reference)

    def done(self, estimate: StateEstimate, reference: Reference, answer: int) -> Command:
        """Command of the last tick."""
        wrapper = self._wrapper
        state = self._state
        state.time = estimate.time
        if answer in (UNSOUND, BROKEN):
            kind = FaultKind.ESTIMATE if answer == UNSOUND else FaultKind.CONTROLLER
            return wrapper.without(state, estimate, kind)

        command = self._inner.done(estimate, reference, answer)
        return command if answer == REFUSED else wrapper.passed(state, estimate, command, reference)

    def _wrapped(self, inputs: Inputs) -> ControlTick:
        controller = self._wrapper.controller
        state = self._state
        tick = controller.tick_on(state.inner, inputs) if has_tick(controller) else None
        if tick is not None:
            return tick

        def step(estimate: StateEstimate, reference: Reference) -> Command:
            inner = self._wrapper.controller
            state.inner, command = inner.step(state.inner, estimate, reference)
            return command

        return PythonControl(step, inputs, state.commanded, type(controller).__name__)

    def _record(self) -> GuardRecord:
        """The state in the form of the kernel."""
        state, inner = self._state, self._inner
        assert state.health is not None
        state.numbers[BEGAN] = state.health.began

        health = self._wrapper.health
        limits = health.limits
        checks, quiet = checked_entries(self.inputs.record)
        return GuardRecord(
            limits=GuardLimits(
                old_imu=SAFETY.old_imu,
                vision_age=limits.vision_age,
                warm_up=limits.warm_up,
                balance_time=SAFETY.balance_time,
            ),
            model=health.joints,
            hull_model=health.hull,
            inner=inner.address,
            memory=inner.memory,
            estimate=self.inputs.address,
            command=inner.command,
            reference=inner.reference,
            thrusters=state.thrusters,
            # Slot of the verdicts.
            residuals=state.health.joints,
            hull=state.health.hull,
            checks=checks,
            quiet=quiet,
            asked=state.health.asked,
            held=state.held,
            judge=empty_slot()._replace(address=self.slots.add(self._judge)),
            numbers=state.numbers,
        )

    def _judge(self) -> int:
        """Verdicts on a tick, if any are needed."""
        wrapper = self._wrapper
        state = self._state
        health = state.health
        assert health is not None

        estimate = self.inputs.seen()
        command = self._inner.done(estimate, self.inputs.reference, FINE)

        # Sensors and hull.
        numbers = state.numbers
        dt, suspect = float(numbers[BALANCE_DT]), int(numbers[ACCUSED])
        faults = wrapper.health.judge(
            health,
            estimate,
            command.thrusters,
            suspect=bool(numbers[SUSPECT]),
            balance=None if math.isnan(dt) else HullBalance(dt, suspect),
        )
        numbers[FAULTY], numbers[PROBING] = bool(faults), health.probe is not None

        # The doublet of a probe.
        state.thrusters[:] = wrapper.health.sent(health, command.thrusters)
        return STOPPED if faults else FINE


def _departure(
    model: mujoco.MjModel, vehicle: Vehicle, arm: ArmDynamics | None
) -> BlindDeparture | None:
    """Departure of a vehicle whose thrusters can hold it; None for other vehicles, such as a
    torpedo.
    """
    try:
        return BlindDeparture(model, vehicle, arm)
    except ConfigurationError:
        return None


def _numbers(values: Array) -> bool:
    """True if all of `values` (n,) are finite; without numpy in the usual case, for speed."""
    return math.isfinite(sum(values.tolist())) or bool(np.isfinite(values).all())
