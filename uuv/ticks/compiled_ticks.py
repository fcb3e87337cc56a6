"""Compiled ticks of the loop: everything that happens at the rate of the drives, several ticks in one call.

    ticks = CompiledTicks(recorder)
    rollout(plant, parts, compiled=ticks.bind, ...)

Only this room may wire plant, sensors, navigation and controller. Each of them gives a record of its arrays, and the
compiled functions that its own step in Python calls too; the two ways therefore give the same bits. Planner and
station keeping are called in Python between two compiled stretches. Ticks at which something else is due run part by
part: fixes, frames. So does every tick after a fault, and a whole run with a part without a kernel; `reason` names it.
Around a controller without a kernel the rest is compiled all the same (`uuv.ticks.ticks_around`).
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from uuv.controllers.safety.safety_wrapper import SafetyWrapper
from uuv.controllers.whole_body.drive_span import DriveSpan
from uuv.controllers.whole_body.drive_tick import FINE, HULL, NO_POSE, UNSOUND, DriveRecord, ReferenceRecord, drive_tick
from uuv.controllers.whole_body.drive_tick import NORMAL as FELT
from uuv.perception.navigation.filter_kernel import put_out, take_sample
from uuv.perception.navigation.strapdown_filter import Navigation
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.messages import Reference, WorkState
from uuv.sim.interfaces.records import EstimateRecord, ImuRecord, JointRecord, estimate_record, state_estimate
from uuv.sim.interfaces.spatial import Array
from uuv.sim.loop.record_box import as_annotated, new_box
from uuv.sim.loop.recording import Recorder, RecorderRecord, write_row
from uuv.sim.loop.rollout import Observer, Parts, Rollout, Stage
from uuv.sim.plant.compiled_step import PlantRecord, advance, observe
from uuv.sim.plant.plant import Plant
from uuv.sim.plant.readout import COLLISION, LEAST, MOST, NORMAL
from uuv.sim.sensors.proprioception import Encoders, Imu, JointTorqueSensors, encode, sense_motion, transmit

_NEW, _PLANNED, _COMMANDED = int(Stage.NEW), int(Stage.PLANNED), int(Stage.COMMANDED)
# Called by other kernels only: entries from Python would take a third of the time of compiling `run_ticks`.
_WITHIN: Any = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
_DRIVES = (Encoders, JointTorqueSensors, Imu)  # sensors of every tick, in their order


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
    drive: DriveRecord
    reference: ReferenceRecord
    thrusters: Array  # (m,) command, normalised
    rows: RecorderRecord
    referred: np.ndarray  # (1,) index of the present reference in the recording


@kernel
def box_of(world):
    """`RecordBox` of a `World`, or of another tuple of records."""
    return new_box(world)


@kernel(nogil=True)
def run_ticks(box, ticks, begun, onward):
    """Run ticks, from any `Stage` of the first one to any stage of the tick after the last one.

    Args:
        box: `RecordBox` of a `World`.
        ticks: number of ticks to be completed.
        begun: stage that the first one has reached; _PLANNED: its estimate is made, and the planner has seen it.
        onward: stage that the tick after the last one shall reach.

    Returns:
        Number of ticks completed; stage that the next one has reached; outcome of its `drive_tick`.
    """
    world = box.record
    plant, drive, estimate = world.plant, world.drive, world.estimate
    stage = begun
    for done in range(ticks + 1):
        wanted = onward if done == ticks else _COMMANDED
        if stage < _PLANNED and wanted > _NEW:
            if observe(plant):
                return done, _NEW, FINE
            perceive(world)
            stage = _PLANNED
        if stage < _COMMANDED and wanted == _COMMANDED:
            outcome = drive_tick(drive, estimate, world.reference)
            if outcome in (UNSOUND, NO_POSE):
                return done, _PLANNED, outcome
            stage = _COMMANDED
            if outcome != FINE:
                return done, stage, outcome
        if done == ticks:
            break
        record_row(world)
        _copy(estimate, world.sound)
        advance(plant, drive.tau, world.thrusters)
        stage = _NEW
    return ticks, stage, FINE


@kernel(**_WITHIN)
def perceive(world):
    """Samples of the sensors into the filter, and its estimate; of a `World` or a `Surround`."""
    s, joints, sample = world.sensed, world.joints, world.sample
    encode(s.encoders, s.q, s.qd, joints.q, joints.qd)
    transmit(s.torques, s.tau_drive, s.tau_friction, s.armature, s.qdd, s.damping, s.qd, joints.tau)
    sense_motion(s.imu, s.R_WB, s.acceleration, s.w_WB_B, sample.specific_force_B, sample.w_WB_B, sample.R_WB)
    sample.time[0] = world.plant.watch.time[0]
    take_sample(world.filter, sample)
    put_out(world.filter, joints, world.estimate)


@kernel(**_WITHIN)
def record_row(world):
    """Write one row of the recording; of a `World` or a `Surround`."""
    contacts, drive = world.plant.readout.contacts, world.drive
    scalars = (
        contacts[NORMAL],
        contacts[LEAST],
        contacts[MOST],
        world.plant.drive.saturated[0],
        contacts[COLLISION] != 0.0,
    )
    time, felt = world.plant.watch.time[0], drive.numbers[FELT]
    write_row(world.rows, time, scalars, world.referred[0], drive.f_W, felt)


@kernel(**_WITHIN)
def _copy(one, other):
    """Copy one EstimateRecord into another, by loops: numba compiles them in a tenth of the time of slices."""
    other.time[0], other.attitude_sigma[0] = one.time[0], one.attitude_sigma[0]
    for i in range(4):
        for j in range(4):
            other.X_WB[i, j] = one.X_WB[i, j]
    for i in range(3):
        other.v_WB_B[i], other.w_WB_B[i], other.a_WB_B[i] = one.v_WB_B[i], one.w_WB_B[i], one.a_WB_B[i]
        other.position_sigma[i], other.ages[i] = one.position_sigma[i], one.ages[i]
        other.object_moved_W[i] = one.object_moved_W[i]
        other.gyro_off_B[i], other.attitude_off_B[i] = one.gyro_off_B[i], one.attitude_off_B[i]
    for j in range(one.q.shape[0]):
        other.q[j], other.qd[j], other.tau[j] = one.q[j], one.qd[j], one.tau[j]


def reason(plant: Any, parts: Parts, observers: Sequence[Observer]) -> str:
    """Why a run is taken part by part at every tick; empty if its ticks can be compiled.

    Args:
        plant: plant of the loop, or a wrapper of one.
        parts: parts of the loop.
        observers: beside the recorder.

    Returns:
        The part that has no kernel, or that has to see every tick.
    """
    if type(plant) is not Plant:
        return f"plant {type(plant).__name__}"
    if plant.spans():
        return plant.spans()
    period, kinds = plant.timestep, [type(sensor) for sensor in parts.sensors]
    for kind in _DRIVES:
        if kinds.count(kind) != 1:
            return f"{kinds.count(kind)} sensors {kind.__name__}"
    for sensor in parts.sensors:
        fast = sensor.period > 0.0 and sensor.period < 1.5 * period
        if fast != (type(sensor) in _DRIVES) or (fast and sensor.delay > 0.0):
            return f"rate or delay of sensor {type(sensor).__name__}"
    if type(parts.estimator) is not Navigation:
        return f"estimator {type(parts.estimator).__name__}"
    if parts.estimator.period != period:
        return f"period of {type(parts.estimator).__name__}"
    seeing = [type(observer).__name__ for observer in observers if not hasattr(observer, "slow_ticks")]
    return f"observer {seeing[0]}" if seeing else ""


def sensed_by(plant: Plant, states: Sequence[Any]) -> Sensed:
    """Memories of the sensors of every tick, and the truth of `plant` that they read.

    Args:
        plant: of the run.
        states: of the sensors in _DRIVES.
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


def drive_states(run: Rollout) -> list[Any]:
    """States of the sensors of every tick, in the order of `Sensed`."""
    states = dict(zip((type(sensor) for sensor in run.parts.sensors), run.sensor_states, strict=True))
    return [states[kind] for kind in _DRIVES]


class CompiledTicks:
    """Compiled ticks of one run (`uuv.sim.loop.rollout.Ticks`)."""

    def __init__(self, plant: Plant, recorder: Recorder) -> None:
        """Take what the ticks change beside the parts.

        Args:
            plant: the plant of the run, not wrapped.
            recorder: the only observer that needs every tick.
        """
        self._plant, self._recorder, self._slow_ticks = plant, recorder, frozenset[int]()

    def bind(self, run: Rollout) -> "CompiledTicks":
        """The ticks of `run`, which has taken its first step."""
        wrapper = run.parts.controller
        assert isinstance(wrapper, SafetyWrapper)
        self._drive = DriveSpan(wrapper, run.controller_state)
        self._slow_ticks = frozenset(ticks for each in run.observers for ticks in getattr(each, "slow_ticks", ()))
        self._noise = drive_states(run)
        self._pack(run)
        return self

    def _pack(self, run: Rollout) -> None:
        """Bind the arrays of all parts."""
        truth, navigation = self._plant.truth, run.estimator_state
        world = World(
            plant=self._plant.record(),
            sensed=sensed_by(self._plant, self._noise),
            filter=navigation.memory,
            sample=navigation.sample,
            joints=navigation.joints,
            estimate=navigation.estimate,
            sound=estimate_record(len(truth.q)),
            drive=self._drive.record,
            reference=self._drive.reference,
            thrusters=np.zeros(len(truth.thrust)),
            rows=self._recorder.record(truth),
            referred=np.zeros(1, dtype=np.int64),
        )
        self._world, self._box = world, box_of(as_annotated(world))

    def advance(self, run: Rollout, tick: int, end: int) -> int:
        """Run ticks from `tick` up to `end` as far as possible: up to a frame, a fault, or the end of the work.

        Args:
            run: its states and messages change as if its own step had run these ticks.
            tick: first one.
            end: one after the last one.

        Returns:
            The next tick for the run; its stage says how far that has come.
        """
        while tick < end:
            assert run.reference is not None
            ready, due = self._ready(run.reference), run.next_due(tick)
            if ready <= 0 or run.looking:
                break
            if tick == due:
                run.begin(tick)
                if run.frame is not None:
                    break
                due = min(tick + ready, run.next_due(tick + 1))
            if tick % run.planner_ticks == 0:
                if not self._plan(run):
                    break
                ready = min(ready, self._drive.ready(run.reference))
                due = min(due, run.next_due(tick + 1))  # the planner may have told navigation something
            begun = _PLANNED if run.stage else _NEW
            observed = (-tick % every for every in self._slow_ticks)
            planned = run.planner_ticks - tick % run.planner_ticks
            ticks = min(ready, planned, min(due, end) - tick, self._plant.ready(), *observed)
            after = tick + ticks
            if ticks == 0:  # `run` completes the tick after its command, with plant and observers
                onward = _COMMANDED
            elif ticks == planned and ticks < ready and after < min(due, end) and self._plant.ready() > ticks:
                onward = _PLANNED  # the planner comes next: its estimate is made in the same call
            else:
                onward = _NEW
            done = self._run(run, ticks, begun, onward)
            tick += done
            if run.stage > Stage.ESTIMATED or not done:
                break
        return tick

    def _ready(self, reference: Reference) -> int:
        """Number of ticks that sensors and controller may run now under `reference`."""
        noise = (each.ready() for each in self._noise)
        return min(self._drive.ready(reference), *noise)

    def _plan(self, run: Rollout) -> bool:
        """Estimate and planner of a tick; True if its rest may run compiled."""
        if run.stage == Stage.NEW:
            _, stage, _ = run_ticks(self._box, 0, _NEW, _PLANNED)
            if stage == _NEW:
                return False
            self._plant.publish()
            run.estimate = state_estimate(self._world.estimate)
        before, reference = run.reference, run.plan()
        run.stage = Stage.PLANNED
        if reference.state in (WorkState.DONE, WorkState.ABORT):  # the run may end at this tick
            return False
        return before is not None and reference.state is before.state and self._drive.ready(reference) > 0

    def _run(self, run: Rollout, ticks: int, begun: int, onward: int) -> int:
        """Run `ticks`, as `run_ticks` does, with the steps of the hull among them; returns how many were completed."""
        assert run.reference is not None
        assert run.command is not None
        if self._recorder.ready(ticks) is not self._world.rows.rows:
            self._pack(run)
        world, drive, total = self._world, self._drive, 0
        drive.load(run.reference)
        world.thrusters[:] = run.command.thrusters
        world.referred[0] = self._recorder.refer(run.reference)
        while True:
            done, stage, outcome = run_ticks(self._box, ticks - total, begun, onward)
            self._plant.publish()
            total += done
            if stage != _COMMANDED:
                break
            if done or begun == _NEW:
                run.estimate = state_estimate(world.estimate)
            run.stage, run.command = Stage.COMMANDED, drive.store(run.estimate, run.reference, outcome)
            if outcome != HULL or total == ticks or not drive.ready(run.reference):
                return total
            world.thrusters[:] = run.command.thrusters
            begun = _COMMANDED
        run.stage = Stage.NEW
        if done > (begun == _COMMANDED):  # more than the rest of a tick that is stored already
            run.estimate = state_estimate(world.estimate if stage == _NEW else world.sound)
            run.command = drive.store(run.estimate, run.reference, FINE)
        if stage == _PLANNED:
            run.estimate = state_estimate(world.estimate)
            run.stage = Stage.ESTIMATED if outcome == FINE else Stage.PLANNED
        return total
