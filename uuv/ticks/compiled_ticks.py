"""Compiled ticks of the loop: all that happens at the rate of the drives, several in one call.

    ticks = CompiledTicks(plant, recorder)
    rollout(plant, parts, compiled=ticks.bind, ...)

Only this room may wire plant, sensors, navigation and controller. Each of them gives a record of
its arrays, and the compiled functions that its own step in Python calls too; the two ways therefore
give the same bits. The controller is a slot, called by its address: a kernel, or plain Python
through a trampoline, which takes its time at every tick (`slow_parts`). So is a sensor of every
tick whose state has no record for the kernel, a faulty one for instance. The planner is called
between two compiled stretches, which are long where it foresees its steps. Ticks at which something
else is due run part by part: fixes, frames. So does a whole run with a plant, sensor or estimator
without a kernel; `reason` names it.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from uuv.sim.interfaces.kernels.control import (
    ControlTick,
    Inputs,
    PythonControl,
    commanded,
    has_tick,
)
from uuv.sim.interfaces.kernels.record_box import as_annotated
from uuv.sim.interfaces.kernels.slots import FINE, gives_kernel
from uuv.sim.interfaces.messages import Command, Reference, StateEstimate, WorkState
from uuv.sim.interfaces.records import estimate_record
from uuv.sim.loop.recording import Recorder
from uuv.sim.loop.rollout import Parts, Rollout, Stage
from uuv.sim.plant.plant import Plant, parts_in_python
from uuv.sim.sensors.proprioception import ENCODERS, IMU, TORQUE_SENSORS
from uuv.ticks.planner_ahead import PlannerAhead
from uuv.ticks.python_sensors import PythonSensors
from uuv.ticks.tick_kernels import COMMANDED, NEW, PLANNED, World, box_of, run_ticks, sensed_by

# Sensors of every tick, in the order of `Sensed`: their channels, and the kinds of their memories
_CHANNELS = {"encoders": ENCODERS, "torques": TORQUE_SENSORS, "imu": IMU}


def reason(plant: Any, parts: Parts) -> str:
    """Reason why a run calls its parts singly at every tick; empty if its ticks can be compiled.

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
    """First part without a kernel, of a part and those that it wraps; empty if all have one.

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


class CompiledTicks:
    """Compiled ticks (`uuv.sim.loop.rollout.Ticks`) of a run for which `reason` is empty."""

    def __init__(self, plant: Plant, recorder: Recorder) -> None:
        """Take what the ticks change in addition to the parts.

        Args:
            plant: the plant of the run, not wrapped.
            recorder: the only observer that needs every tick.
        """
        self._plant = plant
        self._recorder = recorder
        self._slow_ticks = frozenset[int]()
        self.slow_parts: tuple[str, ...] = ()  # in plain Python, called at every tick

    def bind(self, run: Rollout) -> "CompiledTicks":
        """The ticks of `run`, which has taken its first step."""
        # Observers: those that say at which ticks they look, and those that see every one.
        rates = [getattr(observer, "slow_ticks", ()) for observer in run.observers]
        self._slow_ticks = frozenset(ticks for rate in rates for ticks in rate)
        self._watching = [
            observer for observer in run.observers if not hasattr(observer, "slow_ticks")
        ]
        self._present = np.zeros(1, dtype=np.int64)  # tick that a slot is called at

        # Plant and planner.
        self._in_plant = parts_in_python(run.plant)
        self._foresight = PlannerAhead(run, self._plant)

        # Sensors and navigation, whose estimate the controller's inputs refer to.
        estimator: Any = run.parts.estimator
        self._navigation: Any = estimator.records(run.estimator_state)
        self._bind_sensors(run)
        self._inputs = Inputs(self._navigation.estimate, _completion(run))
        self._inputs.ahead = self._foresight.table.present
        self._sound = estimate_record(len(self._plant.truth.q))

        # Controller: called in Python until its kernel is ready.
        self._compiled: ControlTick | None = None
        self._python = self._called(run)
        self._name_slow_parts(self._python)

        # Arrays of all of them, by the address of the controller's tick; rows of the recording.
        self._worlds: dict[int, tuple[World, Any]] = {}
        self._rows = self._recorder.ready(0)
        return self

    def close(self) -> None:
        """Release the callbacks, since they and the run refer to each other."""
        self._worlds.clear()
        self._plant.hooks.clear()

        # Those of the controller; a run that goes on makes its ticks anew.
        for control in (self._python, self._compiled):
            if control is not None:
                control.slots.clear()

    def _bind_sensors(self, run: Rollout) -> None:
        """Memories of the sensors of every tick; those without one are called in Python."""
        channels = [_channel(sensor) for sensor in run.parts.sensors]
        numbers = [channels.index(channel) for channel in _CHANNELS]
        states = [run.sensor_states[i] for i in numbers]
        self._noise = [state for state in states if hasattr(state, "record")]
        self._sampled = np.array([hasattr(state, "record") for state in states])
        self._memories = [
            getattr(state, "record", np.zeros(1, kind))
            for state, kind in zip(states, _CHANNELS.values(), strict=True)
        ]
        called = {
            channel: i
            for channel, i, compiled in zip(_CHANNELS, numbers, self._sampled, strict=True)
            if not compiled
        }
        self._python_sensors = PythonSensors(run, self._plant, self._navigation, called)

    def _called(self, run: Rollout) -> PythonControl:
        """The whole controller as a slot in Python."""
        controller = run.parts.controller
        truth = self._plant.truth

        def step(estimate: StateEstimate, reference: Reference) -> Command:
            state = run.controller_state
            run.controller_state, command = controller.step(state, estimate, reference)
            return command

        command = commanded(len(truth.q), len(truth.thrust))
        return PythonControl(step, self._inputs, command, type(controller).__name__)

    def _name_slow_parts(self, control: ControlTick) -> None:
        watching = (type(observer).__name__ for observer in self._watching)
        sensors = self._python_sensors.names
        self.slow_parts = (*self._in_plant, *sensors, *control.slow, *watching)

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
            for observer in self._watching:
                observer.observe(moment)

        return control.slots.add(watch)

    def _control(self, run: Rollout, reference: Reference) -> ControlTick:
        """The controller's tick: its kernel once that is ready, until then the controller in
        Python.
        """
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
            navigation = self._navigation
            inputs = self._inputs
            plant: Any = run.plant
            world = World(
                plant=plant.record(),
                sensed=sensed_by(self._plant, self._memories),
                filter=navigation.memory,
                sample=navigation.sample,
                joints=navigation.joints,
                estimate=navigation.estimate,
                sound=self._sound,
                # The controller, and what it follows.
                control=np.array([control.address, control.memory, inputs.address]),
                command=control.command,
                reference=control.reference,
                table=self._foresight.table.record,
                rows=self._recorder.record(self._plant.truth),
                sampled=self._sampled,
                sensors=self._python_sensors.slot(control.slots),
                referred=np.zeros(1, dtype=np.int64),
                every=run.controller_ticks,
                plans=run.planner_ticks,
                observers=self._watch(run, control),
                present=self._present,
            )
            self._worlds[control.address] = world, box_of(as_annotated(world))
        return self._worlds[control.address]

    def advance(self, run: Rollout, tick: int, end: int) -> int:
        """Run ticks from `tick` on, at most to `end`, until one needs the run's own step.

        Args:
            run: its states and messages change as if its own step had run these ticks.
            tick: first one.
            end: one after the last one.

        Returns:
            The tick that the run goes on with; `run.stage` says which of its parts are done.
        """
        while tick < end and not run.looking:
            # A frame of a camera is processed by the run.
            if tick == run.next_due(tick):
                run.begin(tick)
                if run.frame is not None:
                    break

            # A new state of the task, and a scan, begin in the run.
            if tick % run.planner_ticks == 0 and not self._plan(run, tick):
                break
            assert run.reference is not None  # there is one from the first step on
            if run.reference.scan:
                break

            # The sensors' own step draws the next block of their noise.
            samples = min((source.ready() for source in self._noise), default=end - tick)
            if samples <= 0:
                break

            # As many ticks at once as nobody outside looks at.
            control = self._control(run, run.reference)
            ticks, onward = self._stretch(run, tick, min(end, tick + samples), control)
            done = self._run(run, tick, ticks, onward, control)
            tick += done

            # A tick that stopped after its planner or command is completed by the run.
            if run.stage > Stage.ESTIMATED or not done:
                break
        return tick

    def _stretch(self, run: Rollout, tick: int, end: int, control: ControlTick) -> tuple[int, int]:
        """Number of ticks from `tick` on that may run at once, and the stage of the tick after
        them.
        """
        observed = (-tick % every for every in self._slow_ticks)
        planned = run.planner_ticks - tick % run.planner_ticks
        most = min(min(run.next_due(tick + 1), end) - tick, self._plant.ready())
        ticks = min((most, *observed))
        if ticks == 0:  # `run` completes the tick after its command, with plant and observers
            return 0, COMMANDED

        # Beyond the next step of the planner, as far as it is foreseen.
        foreseen = 0
        if ticks > planned and not self._watching and control is self._compiled:
            foreseen = self._foresight.look(tick, tick + planned, tick + ticks)
        ticks = min(ticks, planned + foreseen * run.planner_ticks)

        # Where the planner comes next, its estimate is made in the same call.
        plans = (tick + ticks) % run.planner_ticks == 0
        return ticks, PLANNED if plans and ticks < most else NEW

    def _plan(self, run: Rollout, tick: int) -> bool:
        """Run estimator and planner of a tick; returns True if the rest of the tick may run
        compiled.
        """
        if run.stage == Stage.NEW:
            control = self._compiled or self._python
            _, box = self._world(control, run)
            _, stage, answer = run_ticks(box, tick, 0, NEW, PLANNED)
            control.slots.check(answer)
            if stage == NEW:
                return False
            self._plant.publish()
            run.estimate = self._inputs.message_of(self._navigation.estimate)

        # The planner.
        before = run.reference
        reference = run.plan()
        run.stage = Stage.PLANNED
        if reference.state in (WorkState.DONE, WorkState.ABORT):  # the run may end at this tick
            return False
        return before is not None and reference.state is before.state

    def _run(self, run: Rollout, tick: int, ticks: int, onward: int, control: ControlTick) -> int:
        """Run `ticks`, as `run_ticks` does; returns how many were completed."""
        begun = PLANNED if run.stage else NEW
        reference = run.reference
        assert reference is not None
        rows = self._recorder.ready(ticks)
        if rows is not self._rows:
            self._rows = rows
            self._worlds.clear()

        # The controller's tick, with its set points.
        if control is self._python and run.command is not None:
            self._python.load(run.command)
        world, box = self._world(control, run)
        control.refer(reference)
        world.referred[0] = self._recorder.refer(reference)

        # Ticks, and the messages of the last one.
        done, stage, answer = run_ticks(box, tick, ticks, begun, onward)
        self._plant.publish()
        control.slots.check(answer)
        reference = self._follow(run, reference)
        if stage == COMMANDED:
            if done or begun == NEW:
                run.estimate = self._inputs.message_of(world.estimate)
            run.stage = Stage.COMMANDED
            if _controls(run, tick, tick + done):
                run.take(tick + done, control.done(run.estimate, reference, answer))
            return done

        # The command of the last tick completed, and the estimate of the next one.
        run.stage = Stage.NEW
        if done:
            run.estimate = self._inputs.message_of(world.estimate if stage == NEW else world.sound)
            if _controls(run, tick, tick + done - 1):
                run.take(tick + done - 1, control.done(run.estimate, reference, FINE))
        if stage == PLANNED:
            run.estimate = self._inputs.message_of(world.estimate)
            run.stage = Stage.ESTIMATED if answer == FINE else Stage.PLANNED
        return done

    def _follow(self, run: Rollout, reference: Reference) -> Reference:
        """Adopt the planner's periods that have passed; returns the set points of the last one."""
        references = self._foresight.close()
        for taken in references:
            self._recorder.refer(taken)
        run.reference = references[-1] if references else reference
        return run.reference


def _completion(run: Rollout) -> Callable[[StateEstimate], StateEstimate] | None:
    """Function with which the estimator completes an estimate outside the ticks; None: none."""
    completed = getattr(run.parts.estimator, "completed", None)
    return completed and (lambda estimate: completed(run.estimator_state, estimate))


def _controls(run: Rollout, first: int, last: int) -> bool:
    """Whether the controller was due at a tick from `first` to `last`."""
    return first + -first % run.controller_ticks <= last
