"""Compiled ticks around a controller without a kernel, such as a user's own: plant, sensors and navigation.

    ticks = TicksAround(plant, recorder)
    rollout(plant, parts, compiled=ticks.bind, ...)

Planner and controller are called in Python, each at its rate. Between a command and the next estimate there is one
call: it records the tick, advances the plant, reads the sensors and makes the estimate. The kernels are those of
`uuv.ticks.compiled_ticks`, so the bits are those of a run part by part. Ticks at which a fix, a frame or an
observer is due run part by part.
"""

from typing import NamedTuple

import numpy as np

from uuv.controllers.whole_body.drive_span import replaced_part
from uuv.controllers.whole_body.drive_tick import NORMAL as FELT
from uuv.controllers.whole_body.drive_tick import NUMBERS
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.messages import Command, WorkState
from uuv.sim.interfaces.records import EstimateRecord, ImuRecord, JointRecord, state_estimate
from uuv.sim.interfaces.spatial import Array
from uuv.sim.loop.record_box import as_annotated
from uuv.sim.loop.recording import Recorder, RecorderRecord
from uuv.sim.loop.rollout import Parts, Rollout, Stage
from uuv.sim.plant.compiled_step import PlantRecord, advance, observe
from uuv.sim.plant.plant import Plant
from uuv.ticks.compiled_ticks import CompiledTicks, Sensed, box_of, drive_states, perceive, record_row, sensed_by

# What `pass_on` came to
REFUSED = 0  # nothing was done: the command is not finite
STEPPED = 1  # the tick is completed
SENSED = 2  # and the estimate of the next one is made


class Commanded(NamedTuple):
    """What a controller has commanded, and felt."""

    tau: Array  # (n,) [N m] of the motors
    f_W: Array  # (3,) [N] force of the world on the tip, W
    numbers: Array  # as of `uuv.controllers.whole_body.drive_tick`; the normal force alone is used


class Surround(NamedTuple):
    """Everything that changes at the rate of the drives but the controller."""

    plant: PlantRecord
    sensed: Sensed
    filter: Array  # (1,) of `filter_kernel.FILTER`
    sample: ImuRecord
    joints: JointRecord
    estimate: EstimateRecord
    drive: Commanded
    thrusters: Array  # (m,) command, normalised
    rows: RecorderRecord
    referred: np.ndarray  # (1,) index of the present reference in the recording


@kernel(nogil=True)
def sense(box):
    """Make the estimate of a tick; False if `Plant.check` must be called first."""
    if observe(box.record.plant):
        return False
    perceive(box.record)
    return True


@kernel(nogil=True)
def pass_on(box, onward):
    """Complete a tick under the command of a `Surround`; with `onward`, make the estimate of the next one.

    Args:
        box: `RecordBox` of a `Surround`.
        onward: False where the next tick runs part by part.

    Returns:
        REFUSED, STEPPED or SENSED.
    """
    world = box.record
    if not (np.isfinite(world.drive.tau).all() and np.isfinite(world.thrusters).all()):
        return REFUSED
    record_row(world)
    advance(world.plant, world.drive.tau, world.thrusters)
    if not onward or observe(world.plant):
        return STEPPED
    perceive(world)
    return SENSED


class TicksAround:
    """Compiled ticks of one run with a controller in Python (`uuv.sim.loop.rollout.Ticks`)."""

    def __init__(self, plant: Plant, recorder: Recorder) -> None:
        """Take what the ticks change beside the parts.

        Args:
            plant: the plant of the run, not wrapped.
            recorder: the only observer that needs every tick.
        """
        self._plant, self._recorder, self._slow_ticks = plant, recorder, frozenset[int]()

    def bind(self, run: Rollout) -> "TicksAround":
        """The ticks of `run`, which has taken its first step."""
        self._slow_ticks = frozenset(ticks for each in run.observers for ticks in getattr(each, "slow_ticks", ()))
        self._noise = drive_states(run)
        truth = self._plant.truth
        self._drive = Commanded(np.zeros(len(truth.q)), np.zeros(3), np.zeros(NUMBERS))
        self._thrusters = np.zeros(len(truth.thrust))
        self._referred = np.zeros(1, dtype=np.int64)
        self._pack(run)
        return self

    def _pack(self, run: Rollout) -> None:
        """Bind the arrays of all parts."""
        navigation = run.estimator_state
        world = Surround(
            plant=self._plant.record(),
            sensed=sensed_by(self._plant, self._noise),
            filter=navigation.memory,
            sample=navigation.sample,
            joints=navigation.joints,
            estimate=navigation.estimate,
            drive=self._drive,
            thrusters=self._thrusters,
            rows=self._recorder.record(self._plant.truth),
            referred=self._referred,
        )
        self._estimate, self._rows = world.estimate, world.rows.rows
        self._box = box_of(as_annotated(world))

    def advance(self, run: Rollout, tick: int, end: int) -> int:
        """Run ticks from `tick` up to `end` as far as possible: up to a frame, a refusal, or the end of the work.

        Args:
            run: its states and messages change as if its own step had run these ticks.
            tick: first one.
            end: one after the last one.

        Returns:
            The next tick for the run; its stage says how far that has come.
        """
        while tick < end and not run.looking:
            due = run.next_due(tick)
            if tick == due:
                run.begin(tick)
                if run.frame is not None:
                    break
                due = run.next_due(tick + 1)
            noise = (each.ready() for each in self._noise)
            room = min(min(due, end) - tick, self._plant.ready(), *noise)
            done = self._stretch(run, tick, room)
            tick += done
            if done < room or not room:
                break
        return tick

    def _stretch(self, run: Rollout, tick: int, room: int) -> int:
        """Run at most `room` ticks, of which none has anything slow; returns how many were completed."""
        if self._recorder.ready(room) is not self._rows:
            self._pack(run)
        done = 0
        while done < room and self._command(run, tick + done):
            result = pass_on(self._box, done + 1 < room and not run.told)
            if result == REFUSED:
                break
            done += 1
            run.stage = Stage.NEW
            if result == SENSED:
                run.stage, run.estimate = Stage.ESTIMATED, state_estimate(self._estimate)
            if run.told:
                break
        self._plant.publish()
        return done

    def _command(self, run: Rollout, tick: int) -> bool:
        """Take a tick up to its command; False if `Rollout.step` has to go on with it."""
        if run.stage < Stage.ESTIMATED:
            if not sense(self._box):
                return False
            run.stage, run.estimate = Stage.ESTIMATED, state_estimate(self._estimate)
        if any(tick % every == 0 for every in self._slow_ticks):
            return False
        if tick % run.planner_ticks == 0:
            state = run.plan().state
            run.stage = Stage.PLANNED
            if state in (WorkState.DONE, WorkState.ABORT):  # the run may end at this tick
                return False
        command = run.control(tick)
        run.stage = Stage.COMMANDED
        return not command.scan and self._load(run, command)

    def _load(self, run: Rollout, command: Command) -> bool:
        """Take over a command; False if the plant would refuse its shape."""
        torque, thrusters = np.shape(command.joint_torque), np.shape(command.thrusters)
        if torque != self._drive.tau.shape or thrusters != self._thrusters.shape:
            return False
        assert run.reference is not None
        self._drive.tau[:], self._thrusters[:] = command.joint_torque, command.thrusters
        self._drive.f_W[:], self._drive.numbers[FELT] = command.contact.force_W, command.contact.normal
        self._referred[0] = self._recorder.refer(run.reference)
        return True


def ticks_for(plant: Plant, parts: Parts, recorder: Recorder) -> CompiledTicks | TicksAround:
    """Compiled ticks of a run for which `compiled_ticks.reason` finds none against: with the controller, or around it.

    Args:
        plant: of the run.
        parts: of its loop.
        recorder: of the run.
    """
    whole = parts.controller.period == plant.timestep and not replaced_part(parts.controller)
    return (CompiledTicks if whole else TicksAround)(plant, recorder)
