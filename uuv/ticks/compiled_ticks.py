"""Compiled ticks of the loop: all that happens at the rate of the drives, several in one call.

    ticks = CompiledTicks(plant, recorder)
    rollout(plant, parts, compiled=ticks.bind, ...)

Only this room may wire plant, sensors, navigation and controller. Each of them gives a record of
its arrays, and the compiled functions that its own step in Python calls too; the two ways therefore
give the same bits. The controller is a slot, called by its address: a kernel, or plain Python
through a trampoline, which takes its time at every tick (`slow_parts`). The planner is called
between two compiled stretches. Ticks at which something else is due run part by part: fixes,
frames. So does a whole run with a plant, sensor or estimator without a kernel; `reason` names it.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from uuv.perception.navigation.filter_kernel import put_out, take_sample
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.kernels.control import (
    REFUSED,
    UNSOUND,
    Commanded,
    ControlTick,
    Inputs,
    PythonControl,
    call_control,
    commanded,
    has_tick,
)
from uuv.sim.interfaces.kernels.record_box import as_annotated, new_box
from uuv.sim.interfaces.kernels.slots import FINE, call_at, gives_kernel
from uuv.sim.interfaces.messages import Command, Reference, StateEstimate, WorkState
from uuv.sim.interfaces.records import EstimateRecord, ImuRecord, JointRecord, estimate_record
from uuv.sim.interfaces.spatial import Array
from uuv.sim.loop.recording import Recorder, RecorderRecord, write_row
from uuv.sim.loop.rollout import Parts, Rollout, Stage
from uuv.sim.plant.compiled_step import PlantRecord, advance, observe
from uuv.sim.plant.plant import Plant, parts_in_python
from uuv.sim.plant.readout import COLLISION, LEAST, MOST, NORMAL
from uuv.sim.sensors.proprioception import encode, sense_motion, transmit

_NEW, _PLANNED, _COMMANDED = int(Stage.NEW), int(Stage.PLANNED), int(Stage.COMMANDED)
# Called by kernels only: entries from Python would add a third to compiling `run_ticks`.
_WITHIN: Any = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
_CHANNELS = ("encoders", "torques", "imu")  # of the sensors of every tick, in the order of `Sensed`


class Sensed(NamedTuple):
    """Memories of the sensors, and the truth that they read; views."""

    encoders: Array  # (1,) of their kind, likewise below
    torques: Array
    imu: Array
    R_WB: Array  # (3, 3)
    acceleration: Array  # (6,)
    w_WB_B: Array  # (3,)
    q: Array  # (n,)
    qd: Array  # (n,)
    qdd: Array  # (n,)
    tau_drive: Array  # (n,)
    tau_friction: Array  # (n,)
    armature: Array  # (n,)
    damping: Array  # (n,)


class World(NamedTuple):
    """Everything that changes at the rate of the drives."""

    plant: PlantRecord
    sensed: Sensed
    filter: Array  # (1,) of `filter_kernel.FILTER`
    sample: ImuRecord
    joints: JointRecord
    estimate: EstimateRecord
    sound: EstimateRecord  # that of the last tick completed
    control: np.ndarray  # (3,) addresses: of the controller's tick, its memory, the estimate's box
    command: Commanded
    rows: RecorderRecord
    referred: np.ndarray  # (1,) index of the present reference in the recording
    every: int  # ticks in a period of the controller
    observers: int  # address of the slot of observers that see every tick; 0: there are none
    present: np.ndarray  # (1,) number of the present tick, for them


@kernel
def box_of(world):
    """`RecordBox` of a `World`, or of another tuple of records."""
    return new_box(world)


@kernel(nogil=True)
def run_ticks(box, first, ticks, begun, onward):
    """Run ticks, from any `Stage` of the first one to any stage of the tick after the last one.

    Args:
        box: `RecordBox` of a `World`.
        first: number of the first one in the run.
        ticks: number of ticks to be completed.
        begun: stage that the first one has reached; _PLANNED: its estimate is made, and the planner
            has seen it.
        onward: stage that the tick after the last one shall reach.

    Returns:
        Number of ticks completed; stage that the next one has reached; answer of the controller.
    """
    world = box.record
    plant, command, control, estimate = world.plant, world.command, world.control, world.estimate
    stage = begun
    for done in range(ticks + 1):
        wanted = onward if done == ticks else _COMMANDED

        # Sensors and navigation.
        if stage < _PLANNED and wanted > _NEW:
            if observe(plant):
                return done, _NEW, FINE
            perceive(world)
            stage = _PLANNED

        # Controller.
        if stage < _COMMANDED and wanted == _COMMANDED:
            if (first + done) % world.every == 0:
                answer = call_control(control[0], control[1], control[2])
                if answer == UNSOUND:
                    return done, _PLANNED, answer
                if answer != FINE:
                    return done, _COMMANDED, answer
                if not (np.isfinite(command.tau).all() and np.isfinite(command.thrusters).all()):
                    return done, _COMMANDED, REFUSED
            stage = _COMMANDED
        if done == ticks:
            break

        # Recording, observers of every tick, and plant.
        record_row(world)
        if world.observers:
            world.present[0] = first + done
            answer = call_at(world.observers, 0, 0)
            if answer != FINE:
                return done, _COMMANDED, answer
        _copy(estimate, world.sound)
        advance(plant, command.tau, command.thrusters)
        stage = _NEW
    return ticks, stage, FINE


@kernel(**_WITHIN)
def perceive(world):
    """Samples of the sensors into the filter, and its estimate."""
    s, joints, sample = world.sensed, world.joints, world.sample
    encode(s.encoders, s.q, s.qd, joints.q, joints.qd)
    transmit(s.torques, s.tau_drive, s.tau_friction, s.armature, s.qdd, s.damping, s.qd, joints.tau)
    sense_motion(
        s.imu, s.R_WB, s.acceleration, s.w_WB_B, sample.specific_force_B, sample.w_WB_B, sample.R_WB
    )
    sample.time[0] = world.plant.watch.time[0]
    take_sample(world.filter, sample)
    put_out(world.filter, joints, world.estimate)


@kernel(**_WITHIN)
def record_row(world):
    """Write one row of the recording."""
    contacts, command = world.plant.readout.contacts, world.command
    scalars = (
        contacts[NORMAL],
        contacts[LEAST],
        contacts[MOST],
        world.plant.drive.saturated[0],
        contacts[COLLISION] != 0.0,
    )
    time = world.plant.watch.time[0]
    write_row(world.rows, time, scalars, world.referred[0], command.f_W, command.felt[0])


@kernel(**_WITHIN)
def _copy(one, other):
    """Copy one EstimateRecord into another, by loops: numba compiles them in a tenth of the time of
    slices.
    """
    other.time[0], other.attitude_sigma[0] = one.time[0], one.attitude_sigma[0]
    for i in range(4):
        for j in range(4):
            other.X_WB[i, j] = one.X_WB[i, j]
    for i in range(3):
        other.v_WB_B[i], other.w_WB_B[i] = one.v_WB_B[i], one.w_WB_B[i]
        other.a_WB_B[i] = one.a_WB_B[i]
        other.position_sigma[i], other.ages[i] = one.position_sigma[i], one.ages[i]
        other.object_moved_W[i] = one.object_moved_W[i]
        other.gyro_off_B[i], other.attitude_off_B[i] = one.gyro_off_B[i], one.attitude_off_B[i]
    for j in range(one.q.shape[0]):
        other.q[j], other.qd[j], other.tau[j] = one.q[j], one.qd[j], one.tau[j]


def reason(plant: Any, parts: Parts) -> str:
    """Why a run is taken part by part at every tick; empty if its ticks can be compiled.

    Args:
        plant: plant of the loop, or a wrapper of one.
        parts: parts of the loop.

    Returns:
        The part that has no kernel.
    """
    if without := _without_kernel(plant, "record", "plant"):
        return f"plant {without}"
    if plant.spans():
        return plant.spans()
    channels = [_channel(sensor) for sensor in parts.sensors]
    for channel in _CHANNELS:
        if channels.count(channel) != 1:
            return f"{channels.count(channel)} sensors that sample {channel} at every tick"
    for sensor, channel in zip(parts.sensors, channels, strict=True):
        fast = sensor.period > 0.0 and sensor.period < 1.5 * plant.timestep
        if fast != bool(channel) or (fast and sensor.delay > 0.0):
            return f"rate or delay of sensor {type(sensor).__name__}"
    if without := _without_kernel(parts.estimator, "records", "estimator"):
        return f"estimator {without}"
    if parts.estimator.period != plant.timestep:
        return f"period of {type(parts.estimator).__name__}"
    return ""


def _without_kernel(part: Any, method: str, wraps: str) -> str:
    """First of a part and those that it wraps which has no kernel; empty: all have.

    Args:
        part: a plant or an estimator.
        method: by which it gives its kernel.
        wraps: attribute of a wrapper that holds what it wraps.
    """
    while gives_kernel(part, method):
        if not hasattr(part, wraps):
            return ""
        part = getattr(part, wraps)
    return type(part).__name__


def _channel(sensor: Any) -> str:
    """Channel that a sensor samples in the compiled ticks; empty: none."""
    return sensor.channel() if gives_kernel(sensor, "channel") else ""


def sensed_by(plant: Plant, states: Sequence[Any]) -> Sensed:
    """Memories of the sensors of every tick, and the truth of `plant` that they read.

    Args:
        plant: of the run.
        states: of the sensors of _CHANNELS.
    """
    truth = plant.truth
    return Sensed(
        *(each.record for each in states),
        R_WB=truth.R_WB,
        acceleration=truth.acceleration,
        w_WB_B=truth.w_WB_B,
        q=truth.q,
        qd=truth.qd,
        qdd=truth.qdd,
        tau_drive=truth.tau_drive,
        tau_friction=truth.tau_friction,
        armature=truth.armature,
        damping=truth.joint_damping,
    )


class CompiledTicks:
    """Compiled ticks (`uuv.sim.loop.rollout.Ticks`) of a run that `reason` has none against."""

    def __init__(self, plant: Plant, recorder: Recorder) -> None:
        """Take what the ticks change beside the parts.

        Args:
            plant: the plant of the run, not wrapped.
            recorder: the only observer that needs every tick.
        """
        self._plant, self._recorder, self._slow_ticks = plant, recorder, frozenset[int]()
        self.slow_parts: tuple[str, ...] = ()  # in plain Python, called at every tick

    def bind(self, run: Rollout) -> "CompiledTicks":
        """The ticks of `run`, which has taken its first step."""
        rates = [getattr(observer, "slow_ticks", ()) for observer in run.observers]
        self._slow_ticks = frozenset(ticks for rate in rates for ticks in rate)
        self._in_plant = parts_in_python(run.plant)
        self._watching = [each for each in run.observers if not hasattr(each, "slow_ticks")]
        self._present = np.zeros(1, dtype=np.int64)
        states = dict(zip(map(_channel, run.parts.sensors), run.sensor_states, strict=True))
        self._noise = [states[channel] for channel in _CHANNELS]
        estimator: Any = run.parts.estimator
        self._navigation: Any = estimator.records(run.estimator_state)
        completed = getattr(estimator, "completed", None)
        complete = (
            None if completed is None else lambda estimate: completed(run.estimator_state, estimate)
        )
        self._inputs = Inputs(self._navigation.estimate, complete)
        self._sound = estimate_record(len(self._plant.truth.q))
        self._compiled: ControlTick | None = None
        self._python = self._called(run)
        self._name_slow_parts(self._python)
        self._worlds: dict[int, tuple[World, Any]] = {}  # by the address of the controller's tick
        self._rows = self._recorder.ready(0)
        return self

    def close(self) -> None:
        """Give back the callbacks, which hold the run as the run holds them."""
        self._worlds.clear()
        self._plant.hooks.clear()

        # Those of the controller; a run that goes on makes its ticks anew.
        for control in (self._python, self._compiled):
            if control is not None:
                control.slots.clear()

    def _called(self, run: Rollout) -> PythonControl:
        """The whole controller as a slot in Python."""
        controller, truth = run.parts.controller, self._plant.truth

        def step(estimate: StateEstimate, reference: Reference) -> Command:
            state = run.controller_state
            run.controller_state, command = controller.step(state, estimate, reference)
            return command

        command = commanded(len(truth.q), len(truth.thrust))
        return PythonControl(step, self._inputs, command, type(controller).__name__)

    def _name_slow_parts(self, control: ControlTick) -> None:
        watching = (type(each).__name__ for each in self._watching)
        self.slow_parts = (*self._in_plant, *control.slow, *watching)

    def _watch(self, run: Rollout, control: ControlTick) -> int:
        """Address of the slot of observers that see every tick; 0 without one."""
        if not self._watching:
            return 0

        def watch() -> None:
            assert run.reference is not None
            self._plant.publish()
            estimate = self._inputs.seen()
            command = control.done(estimate, run.reference, FINE)
            moment = run.moment(int(self._present[0]), estimate, command)
            for each in self._watching:
                each.observe(moment)

        return control.slots.add(watch)

    def _control(self, run: Rollout, reference: Reference) -> ControlTick:
        """The controller's tick: its kernel where that is ready, else all of it in Python."""
        controller = run.parts.controller
        if self._compiled is None and has_tick(controller):
            self._compiled = controller.tick_on(run.controller_state, self._inputs)
            self._name_slow_parts(self._compiled or self._python)
        if self._compiled is None or not self._compiled.ready(reference):
            return self._python
        return self._compiled

    def _world(self, control: ControlTick, run: Rollout) -> tuple[World, Any]:
        """The arrays of all parts, and their box."""
        if control.address not in self._worlds:
            navigation, inputs = self._navigation, self._inputs
            plant: Any = run.plant
            world = World(
                plant=plant.record(),
                sensed=sensed_by(self._plant, self._noise),
                filter=navigation.memory,
                sample=navigation.sample,
                joints=navigation.joints,
                estimate=navigation.estimate,
                sound=self._sound,
                control=np.array([control.address, control.memory, inputs.address]),
                command=control.command,
                rows=self._recorder.record(self._plant.truth),
                referred=np.zeros(1, dtype=np.int64),
                every=run.controller_ticks,
                observers=self._watch(run, control),
                present=self._present,
            )
            self._worlds[control.address] = world, box_of(as_annotated(world))
        return self._worlds[control.address]

    def advance(self, run: Rollout, tick: int, end: int) -> int:
        """Run ticks from `tick` up to `end` as far as possible: up to a frame, a fault, or the end
        of the work.

        Args:
            run: its states and messages change as if its own step had run these ticks.
            tick: first one.
            end: one after the last one.

        Returns:
            The next tick for the run; its stage says how far that has come.
        """
        while tick < end and not run.looking:
            if tick == run.next_due(tick):
                run.begin(tick)
                if run.frame is not None:
                    break
            if tick % run.planner_ticks == 0 and not self._plan(run, tick):
                break
            assert run.reference is not None
            if run.reference.scan:
                break
            samples = min(each.ready() for each in self._noise)
            if samples <= 0:  # the sensors' own step draws the next block of their noise
                break
            begun = _PLANNED if run.stage else _NEW
            ticks, onward = self._stretch(run, tick, min(end, tick + samples))
            done = self._run(run, tick, ticks, begun, onward)
            tick += done
            if run.stage > Stage.ESTIMATED or not done:
                break
        return tick

    def _stretch(self, run: Rollout, tick: int, end: int) -> tuple[int, int]:
        """Number of ticks from `tick` on that may run at once, and the stage of the one after
        them.
        """
        observed = (-tick % every for every in self._slow_ticks)
        planned = run.planner_ticks - tick % run.planner_ticks
        most = min(min(run.next_due(tick + 1), end) - tick, self._plant.ready())
        ticks = min(most, planned, *observed)
        if ticks == 0:  # `run` completes the tick after its command, with plant and observers
            return 0, _COMMANDED
        # Where the planner comes next, its estimate is made in the same call.
        return ticks, _PLANNED if planned == ticks < most else _NEW

    def _plan(self, run: Rollout, tick: int) -> bool:
        """Estimate and planner of a tick; True if its rest may run compiled."""
        if run.stage == Stage.NEW:
            _, box = self._world(self._compiled or self._python, run)
            _, stage, _ = run_ticks(box, tick, 0, _NEW, _PLANNED)
            if stage == _NEW:
                return False
            self._plant.publish()
            run.estimate = self._inputs.message_of(self._navigation.estimate)
        before, reference = run.reference, run.plan()
        run.stage = Stage.PLANNED
        if reference.state in (WorkState.DONE, WorkState.ABORT):  # the run may end at this tick
            return False
        return before is not None and reference.state is before.state

    def _run(self, run: Rollout, tick: int, ticks: int, begun: int, onward: int) -> int:
        """Run `ticks`, as `run_ticks` does; returns how many were completed."""
        reference = run.reference
        assert reference is not None
        rows = self._recorder.ready(ticks)
        if rows is not self._rows:
            self._rows = rows
            self._worlds.clear()
        control = self._control(run, reference)
        if control is self._python and run.command is not None:
            self._python.load(run.command)
        world, box = self._world(control, run)
        control.refer(reference)
        world.referred[0] = self._recorder.refer(reference)
        done, stage, answer = run_ticks(box, tick, ticks, begun, onward)
        self._plant.publish()
        control.slots.check(answer)
        if stage == _COMMANDED:
            if done or begun == _NEW:
                run.estimate = self._inputs.message_of(world.estimate)
            run.stage = Stage.COMMANDED
            run.take(tick + done, control.done(run.estimate, reference, answer))
            return done

        # The command of the last tick completed, and the estimate of the next one.
        run.stage = Stage.NEW
        if done:
            run.estimate = self._inputs.message_of(world.estimate if stage == _NEW else world.sound)
            run.take(tick + done - 1, control.done(run.estimate, reference, FINE))
        if stage == _PLANNED:
            run.estimate = self._inputs.message_of(world.estimate)
            run.stage = Stage.ESTIMATED if answer == FINE else Stage.PLANNED
        return done
