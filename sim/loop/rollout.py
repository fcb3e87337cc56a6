"""Closed-loop simulation of one run; all rates are whole multiples of the plant's step.

truth -> sensors -> estimator -> (depth frame) -> finder -> planner -> controller -> plant

The loop depends on protocols only.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Protocol

import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import (
    Command,
    JawReference,
    Look,
    Measurement,
    ObjectMotion,
    Reference,
    StateEstimate,
    Target,
    WorkState,
)
from uuv.sim.interfaces.protocols import (
    Controller,
    Estimator,
    Planner,
    Sensor,
    TargetFinder,
    TargetFollower,
)

LOOK_PERIOD = 0.1  # [s] between depth frames or sonar scans, while they are requested


class SteppedPlant(Protocol):
    """Plant interface that the loop requires.

    A run that is to be saved also needs `save` and `resume` (`uuv.sim.plant.plant.Plant`). A
    wrapper without a state of its own needs neither, if its attribute `plant` is the wrapped plant.
    """

    timestep: float  # [s]

    def observe(self) -> Any:
        """Update the kinematics to the current time and return the truth."""
        ...

    def step(self, command: Command) -> None:
        """Advance by one `timestep` under `command`."""
        ...


class Observer(Protocol):
    """Read-only observer that is called at every step.

    An observer with an attribute `slow_ticks`, a tuple of numbers of ticks, is called only at their
    multiples and when frame, target or state of the work change. Any other observer is called at
    every tick, also during compiled ticks, which slows them down.
    """

    def observe(self, moment: "Moment") -> None:
        """Process one step; must not change `moment`."""
        ...


@dataclass(slots=True, eq=False)
class Moment:
    """Snapshot of one step for observers: truth, estimate, set points and command."""

    tick: int
    truth: Any  # uuv.sim.plant.truth.Truth; live views
    estimate: StateEstimate
    target: Target | None
    reference: Reference
    command: Command
    frame: Look | None  # depth frame or sonar scan that arrived in this step
    found: Any  # state of the finder, for its point clouds
    motion: ObjectMotion | None = None  # newest motion of the followed object


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Parts:
    """Components of the simulation loop: sensors, estimator, finder, planner, controller."""

    sensors: Sequence[Sensor]
    estimator: Estimator
    finder: TargetFinder | None
    planner: Planner
    controller: Controller
    # tracker of the object while the vehicle scans; None: the object is not tracked
    follower: TargetFollower | None = None


def ticks_per_period(period: float, timestep: float, name: str) -> int:
    """Number of physics steps per `period`.

    Args:
        period: [s]
        timestep: [s]
        name: Begins the error message.

    Returns:
        The number of steps.

    Raises:
        ConfigurationError: The ratio is not a whole number, or below 1.
    """
    ratio = period / timestep
    ticks = round(ratio)

    if ticks < 1 or abs(ratio - ticks) > 1e-6 * ratio:
        raise ConfigurationError(
            f"{name}: period {period:g} s is not a whole multiple of the physics step "
            f"{timestep:g} s; set the model's "
            f'<option timestep="{period:g}"/>, or a whole part of it'
        )

    return ticks


def at_rest_after_work(moment: Moment) -> bool:
    """True once the planner is in DONE or ABORT without arm motion, which usually ends a run."""
    reference = moment.reference

    over = reference.state is WorkState.DONE or reference.state is WorkState.ABORT
    return over and not reference.v_WG_W.any() and not reference.qd.any()


def never(moment: Moment) -> bool:
    """Never true: for `rollout(until=never)`, which runs for its whole duration."""
    del moment
    return False


def _with(plant: Any, name: str, who: str) -> Any:
    """Outermost plant with this attribute, among a plant and those that it wraps.

    Raises:
        ConfigurationError: None of them has it; `who` asks for it.
    """
    while not hasattr(plant, name):
        if not hasattr(plant, "plant"):
            raise ConfigurationError(
                f"{who}: the plant {type(plant).__name__} must have {name}, or an attribute "
                "`plant` with the plant that it wraps"
            )
        plant = plant.plant
    return plant


def _keeper(plant: Any) -> Any:
    """Outermost plant that can be saved, among a plant and those that it wraps."""
    return _with(plant, "save", "saved run")


class Ticks(Protocol):
    """Compiled ticks of the loop, which run as long as no slow component is due."""

    def advance(self, run: "Rollout", tick: int, end: int) -> int:
        """Run ticks from `tick` up to `end` as far as possible.

        Args:
            run: Run whose states and messages change as if `Rollout.decide` and `act` had run these
                ticks.
            tick: First tick.
            end: Number after the last tick.

        Returns:
            The next tick for `Rollout.decide`; `Rollout.stage` is the stage that it has reached.
        """
        ...

    def close(self) -> None:
        """Free the callbacks into Python; no tick may run afterwards."""
        ...


class Stage(IntEnum):
    """Stage that a tick of the loop has reached."""

    NEW = 0
    ESTIMATED = 1
    PLANNED = 2
    COMMANDED = 3


class Rollout:
    """One run of the loop: states of the components, present messages, and the functions of a tick.

    `save` returns everything that changes; `resume` restores it in another run of the same
    scenario.
    """

    # not saved, because each run has its own
    _OF_THE_RUN = frozenset({"plant", "parts", "observers", "truth"})

    def __init__(
        self,
        plant: SteppedPlant,
        parts: Parts,
        rng: np.random.Generator,
        observers: Sequence[Observer] = (),
    ) -> None:
        """Make the initial states of all components from their first measurements.

        Args:
            plant: Plant, or a wrapper of one.
            parts: Sensors, estimator, finder, planner and controller.
            rng: Source of all random streams.
            observers: Called at every step, in order.

        Raises:
            ConfigurationError: A rate or delay is not a whole multiple of the physics step.
        """
        dt, sensors = plant.timestep, parts.sensors
        self.plant, self.parts, self.observers = plant, parts, observers

        # Rates and delays in ticks.
        self._every = [
            ticks_per_period(s.period, dt, type(s).__name__) if s.period > 0.0 else 0
            for s in sensors
        ]
        self._delay = [
            ticks_per_period(s.delay, dt, f"delay of {type(s).__name__}") if s.delay > 0.0 else 0
            for s in sensors
        ]

        self._estimator_ticks = ticks_per_period(
            parts.estimator.period, dt, type(parts.estimator).__name__
        )
        self._look_ticks = ticks_per_period(LOOK_PERIOD, dt, "the time between looks")
        self.planner_ticks = ticks_per_period(
            parts.planner.period, dt, type(parts.planner).__name__
        )
        self.controller_ticks = ticks_per_period(
            parts.controller.period, dt, type(parts.controller).__name__
        )

        # States of the parts.
        self.sensor_states = [
            s.init(stream) for s, stream in zip(sensors, rng.spawn(len(sensors)), strict=True)
        ]
        self._finder_state = parts.finder.init() if parts.finder else None
        follower = parts.follower
        self._follower_state = follower.init() if follower else None
        self._follower_ticks = (
            ticks_per_period(follower.period, dt, type(follower).__name__) if follower else 0
        )

        self._followed: set[float] = set()  # time stamps of frames that are not for the finder
        self.motion: ObjectMotion | None = None

        # First measurements and estimate, and the states that start from them.
        self.truth = plant.observe()
        first: list[Measurement] = []

        for i, sensor in enumerate(sensors):
            if self._every[i]:
                self.sensor_states[i], measurement = sensor.step(self.sensor_states[i], self.truth)
                if measurement is not None:
                    first.append(measurement)

        state = parts.estimator.init(first)
        self.estimator_state, self.estimate = parts.estimator.step(state, first)
        self.planner_state = parts.planner.init(self.estimate)
        self.controller_state = parts.controller.init(self.estimate)

        self.tick = 0  # number of the next tick, or of the tick in progress
        self.stage = Stage.NEW
        # Last message of each sensor that has a period.
        self.measured: list[Measurement | None] = [None for _ in sensors]
        self.commanded: Command | None = None  # command of the previous tick
        self.target: Target | None = None
        self.reference: Reference | None = None
        self.command: Command | None = None
        self.frame: Look | None = None

        self._asked = 0  # tick at which the present request for frames began
        # estimate at exposure, by the time stamp of a delayed frame
        self._seen_from: dict[float, StateEstimate] = {}
        self._arrived: list[Measurement] = []  # since the estimator's last step
        self._on_the_way: dict[int, list[Measurement]] = {}
        self._slow = [every for every in self._every if every > 1]

    def begin(self, tick: int) -> None:
        """Run a tick up to its estimate; `frame` is then a frame that a camera or sonar has
        sent.
        """
        if tick:
            self.truth = self.plant.observe()
        self._sense(tick)
        self._estimate(tick)
        self.stage = Stage.ESTIMATED

    def decide(self) -> Moment:
        """Run the present tick up to its command, from the stage that it has reached."""
        tick = self.tick
        if self.stage < Stage.ESTIMATED:
            self.commanded = self.command
            self.begin(tick)

        if self.stage < Stage.PLANNED and tick % self.planner_ticks == 0:
            self.plan()

        command = self.control(tick) if self.stage < Stage.COMMANDED else self.command
        self.stage = Stage.COMMANDED
        assert command is not None
        return self.moment(tick, self.estimate, command)

    def moment(self, tick: int, estimate: StateEstimate, command: Command) -> Moment:
        """Snapshot of a tick for observers, with this estimate and command."""
        assert self.reference is not None
        return Moment(
            tick,
            self.truth,
            estimate,
            self.target,
            self.reference,
            command,
            self.frame,
            self._finder_state,
            self.motion,
        )

    def act(self, moment: Moment) -> None:
        """Pass the result of `decide` to the observers, and step the plant."""
        self.stage = Stage.NEW
        self.frame = None

        for observer in self.observers:
            observer.observe(moment)

        self.plant.step(moment.command)
        self.tick += 1

    def save(self) -> dict[str, Any]:
        """Everything that changes except the observers, not copied: copy it before the next step.

        Raises:
            ConfigurationError: A wrapper of the plant has no attribute `plant` (`SteppedPlant`).
        """
        everything = vars(self).items()
        changing = {name: entry for name, entry in everything if name not in self._OF_THE_RUN}
        return {"plant": _keeper(self.plant).save(), "loop": changing}

    def resume(self, saved: dict[str, Any]) -> None:
        """Continue from a copy of the result of `save` of a run of the same scenario.

        Plant and sensors may be wrapped in faults that have not begun (`uuv.sim.plant.faults`).
        """
        fresh = self.sensor_states
        vars(self).update(saved["loop"])
        _keeper(self.plant).resume(saved["plant"], self.commanded)

        for i, sensor in enumerate(self.parts.sensors):
            resume = getattr(sensor, "resume", None)
            if resume is not None:
                self.sensor_states[i] = resume(fresh[i], self.sensor_states[i], self.measured[i])

    def plan(self) -> Reference:
        """Step the planner, and return its set points; the gripper's drive takes those for the
        jaws.
        """
        self.planner_state, self.reference = self.parts.planner.step(
            self.planner_state, self.estimate, self.target, self.command
        )

        reference = self.reference
        if reference.at_rest is not None:
            self._arrived.append(reference.at_rest)
        if isinstance(reference, JawReference):
            _with(self.plant, "jaws", "gripper").jaws.follow(reference.jaws)
        return reference

    def control(self, tick: int) -> Command:
        """Step the controller if it is due at `tick`, and return the present command."""
        assert self.reference is not None

        if tick % self.controller_ticks == 0:
            self.controller_state, command = self.parts.controller.step(
                self.controller_state, self.estimate, self.reference
            )
            self.take(tick, command)
        assert self.command is not None
        return self.command

    def take(self, tick: int, command: Command) -> None:
        """Take a command of the controller as the present one, from `tick` on."""
        if command.scan and not (self.command is not None and self.command.scan):
            self._asked = tick + 1
        self.command = command

    @property
    def looking(self) -> bool:
        """True while a frame is requested or in transit."""
        return self.command is None or self.command.scan or bool(self._seen_from) or self.following

    @property
    def following(self) -> bool:
        """True while frames are taken for the tracker: the vehicle scans, and has identified the
        object.
        """
        if self.parts.follower is None or self.target is None or self.reference is None:
            return False
        return self.target.accepted and self.reference.state is WorkState.SCAN

    @property
    def message_waits(self) -> bool:
        """True if a message waits for the estimator's next step."""
        return bool(self._arrived)

    def next_due(self, tick: int) -> int:
        """First tick from `tick` on at which a slow sensor measures, or a message or a frame
        arrives.
        """
        if self.looking or self.message_waits:
            return tick

        due = min((tick + -tick % every for every in self._slow), default=tick + self._look_ticks)
        return min(due, *self._on_the_way) if self._on_the_way else due

    def _sense(self, tick: int) -> None:
        """Let the sensors that are due measure, and collect the messages that arrive."""
        scan = self.command is not None and self.command.scan
        followed = self.following and not tick % self._follower_ticks
        truth = self.truth
        states = self.sensor_states
        sensors = self.parts.sensors
        arrived = self._arrived

        # Sensors without a period send frames on request, or for the tracker.
        for i, every in enumerate(self._every):
            if every:
                if tick % every:
                    continue
            elif self._seen_from:
                continue
            elif not scan or (tick - self._asked) % self._look_ticks:
                if not followed:
                    continue
                self._followed.add(float(truth.time))

            states[i], measurement = sensors[i].step(states[i], truth)
            if measurement is None:
                continue

            if every:
                self.measured[i] = measurement

            if self._delay[i]:
                self._on_the_way.setdefault(tick + self._delay[i], []).append(measurement)
                if not every:
                    self._seen_from[measurement.time] = self.estimate
            else:
                arrived.append(measurement)

        if tick in self._on_the_way:
            arrived += self._on_the_way.pop(tick)

    def _estimate(self, tick: int) -> None:
        """Step the estimator, and pass a frame that has arrived to the finder."""
        if tick % self._estimator_ticks == 0:
            self.estimator_state, self.estimate = self.parts.estimator.step(
                self.estimator_state, self._arrived
            )

            for measurement in self._arrived:
                if isinstance(measurement, Look):
                    self.frame = measurement
            self._arrived = []

        # A frame goes to the finder with the estimate at its exposure.
        frame = self.frame
        finder = self.parts.finder
        follower = self.parts.follower
        if frame is None or finder is None:
            return
        estimate_then = self._seen_from.pop(frame.time, self.estimate)

        if frame.time in self._followed:
            self._followed.discard(frame.time)
            self.frame = None
        else:
            self._finder_state, new_target = finder.step(self._finder_state, estimate_then, frame)
            self.target = new_target or self.target  # None: the finder needs more frames first

        if follower is not None and self.target is not None and self.target.accepted:
            self._follower_state, motion = follower.step(
                self._follower_state, estimate_then, self.target, frame
            )
            self.motion = motion or self.motion


def run_on(
    run: Rollout,
    duration: float,
    *,
    until: Callable[[Moment], bool] = at_rest_after_work,
    pause: Callable[[Moment], bool] | None = None,
    compiled: Callable[[Rollout], Ticks] | None = None,
) -> Moment:
    """Continue a run from its present state, until `until` is true or `duration` is over.

    Args:
        run: The run.
        duration: Longest simulated time [s], from its start.
        until: Called at the end of every step; the run ends when it is true. With `compiled`, it is
            called when the observers are.
        pause: Called before observers and plant at every step that is not compiled, which includes
            every step of the planner. When it is true, the run pauses in the stage COMMANDED. It
            can be saved then, and the next call continues it.
        compiled: Makes the compiled ticks, which run when no slow component is due; None: no tick
            is compiled.

    Returns:
        The last moment, or the moment of the pause.

    Raises:
        ConfigurationError: The duration is not a whole multiple of the physics step.
    """
    steps = ticks_per_period(duration, run.plant.timestep, "duration")
    paused = run.stage == Stage.COMMANDED
    moment = run.decide()
    if pause is not None and not paused and pause(moment):
        return moment
    run.act(moment)

    ticks = compiled(run) if compiled is not None else None
    try:
        while run.tick < steps and not until(moment):
            # Compiled ticks as long as no slow component is due. With `pause`, they end at the next
            # step of the planner, so that the messages of all sensors are kept.
            if ticks is not None:
                end = steps - 1
                if pause is not None:
                    end = min(end, run.tick + -run.tick % run.planner_ticks)
                run.tick = ticks.advance(run, run.tick, end)

            # One tick in Python.
            moment = run.decide()
            if pause is not None and pause(moment):
                return moment
            run.act(moment)
    finally:
        if ticks is not None:
            ticks.close()
    return moment


def rollout(
    plant: SteppedPlant,
    parts: Parts,
    *,
    duration: float,
    rng: np.random.Generator,
    observers: Sequence[Observer] = (),
    until: Callable[[Moment], bool] = at_rest_after_work,
    compiled: Callable[[Rollout], Ticks] | None = None,
) -> Moment:
    """Simulation loop: steps plant and components until `until` is true, or `duration` is over.

    Every sensor gets its own random stream, spawned from `rng`, so adding one does not change the
    others.

    Args:
        plant: Plant, or a wrapper of one.
        parts: Sensors, estimator, finder, planner and controller.
        duration: Longest simulated time [s].
        rng: Source of all random streams.
        observers: Called at every step, in order; with `compiled`, when a slow component is due.
        until: Called at the end of every step; the run ends when it is true. With `compiled`, it is
            called when the observers are.
        compiled: Makes the compiled ticks, which run when no slow component is due; None: no tick
            is compiled.

    Returns:
        The last moment.

    Raises:
        ConfigurationError: A rate or delay is not a whole multiple of the physics step.
    """
    return run_on(Rollout(plant, parts, rng, observers), duration, until=until, compiled=compiled)
