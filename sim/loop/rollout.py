"""Closed-loop simulation of one run; all rates are whole multiples of the plant's step.

truth -> sensors -> estimator -> (depth frame) -> finder -> planner -> controller -> plant

The loop depends on protocols only.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from sim.interfaces.errors import ConfigurationError
from sim.interfaces.messages import (
    Command,
    DepthImage,
    Look,
    Measurement,
    Reference,
    SonarScan,
    StateEstimate,
    Target,
    WorkState,
)
from sim.interfaces.protocols import Controller, Estimator, Planner, Sensor, TargetFinder

LOOK_PERIOD = 0.1  # [s] between depth frames or sonar scans, while they are requested


class SteppedPlant(Protocol):
    """Plant interface that the loop requires."""

    timestep: float  # [s]

    def observe(self) -> Any:
        """Update the kinematics to the current time and return the truth."""
        ...

    def step(self, command: Command) -> None:
        """Advance by one `timestep` under `command`."""
        ...


class Observer(Protocol):
    """Read-only observer that is called at every step."""

    def observe(self, moment: "Moment") -> None:
        """Process one step; must not change `moment`."""
        ...


@dataclass(slots=True, eq=False)
class Moment:
    """Snapshot of one step for observers: truth, estimate, set points and command."""

    tick: int
    truth: Any  # sim.plant.plant.Truth; live views
    estimate: StateEstimate
    target: Target | None
    reference: Reference
    command: Command
    frame: Look | None  # depth frame or sonar scan that arrived in this step
    found: Any  # state of the finder, for its point clouds


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Parts:
    """Concrete components of one run."""

    sensors: Sequence[Sensor]
    estimator: Estimator
    finder: TargetFinder | None
    planner: Planner
    controller: Controller


def ticks_per_period(period: float, timestep: float, name: str) -> int:
    """Number of physics steps per `period`.

    Args:
        period: [s]
        timestep: [s]
        name: Begins the error message.

    Returns:
        The number of steps.

    Raises:
        ConfigurationError: The ratio is no whole number, or below 1.
    """
    ratio = period / timestep
    ticks = round(ratio)
    if ticks < 1 or abs(ratio - ticks) > 1e-6 * ratio:
        raise ConfigurationError(f"{name}: period {period} s is not a whole multiple of the physics step {timestep} s")
    return ticks


def at_rest_after_work(moment: Moment) -> bool:
    """True once the planner is in DONE or ABORT and asks for no motion of the arm: the usual end of a run."""
    reference = moment.reference
    over = reference.state is WorkState.DONE or reference.state is WorkState.ABORT
    return over and not reference.v_WG_W.any() and not reference.qd.any()


def never(moment: Moment) -> bool:
    """Never true: for `rollout(until=never)`, which runs for its whole duration."""
    del moment
    return False


def rollout(
    plant: SteppedPlant,
    parts: Parts,
    *,
    duration: float,
    rng: np.random.Generator,
    observers: Sequence[Observer] = (),
    until: Callable[[Moment], bool] = at_rest_after_work,
) -> Moment:
    """Run until `until` is true, or until `duration` is over.

    Every sensor gets its own random stream, spawned from `rng`, so adding one does not change the others.

    Args:
        plant: Plant, or a wrapper of one.
        parts: Sensors, estimator, finder, planner and controller.
        duration: Longest simulated time [s].
        rng: Source of all random streams.
        observers: Called at every step, in order.
        until: Called at the end of every step; the run ends where it is true.

    Returns:
        The last moment.

    Raises:
        ConfigurationError: A rate or delay is no whole multiple of the physics step.
    """
    dt = plant.timestep
    steps = ticks_per_period(duration, dt, "duration")
    sensor_ticks = [ticks_per_period(s.period, dt, type(s).__name__) if s.period > 0.0 else 0 for s in parts.sensors]
    sensor_delay = [
        ticks_per_period(s.delay, dt, f"delay of {type(s).__name__}") if s.delay > 0.0 else 0 for s in parts.sensors
    ]
    estimator_ticks = ticks_per_period(parts.estimator.period, dt, type(parts.estimator).__name__)
    look_ticks = ticks_per_period(LOOK_PERIOD, dt, "the time between looks")
    planner_ticks = ticks_per_period(parts.planner.period, dt, type(parts.planner).__name__)
    controller_ticks = ticks_per_period(parts.controller.period, dt, type(parts.controller).__name__)
    sensor_states = [s.init(stream) for s, stream in zip(parts.sensors, rng.spawn(len(parts.sensors)), strict=True)]
    finder_state = parts.finder.init() if parts.finder else None

    truth = plant.observe()
    first: list[Measurement] = []
    for i, sensor in enumerate(parts.sensors):
        if sensor_ticks[i]:
            sensor_states[i], measurement = sensor.step(sensor_states[i], truth)
            if measurement is not None:
                first.append(measurement)
    estimator_state = parts.estimator.init(first)
    estimator_state, estimate = parts.estimator.step(estimator_state, first)
    planner_state = parts.planner.init(estimate)
    controller_state = parts.controller.init(estimate)

    target: Target | None = None
    command: Command | None = None
    reference: Reference | None = None
    moment: Moment | None = None
    asked = 0  # tick at which the present request for frames began
    seen_from: dict[float, StateEstimate] = {}  # estimate at exposure, by the time stamp of a delayed frame
    arrived: list[Measurement] = []  # since the estimator's last step
    on_the_way: dict[int, list[Measurement]] = {}
    for tick in range(steps):
        if tick:
            truth = plant.observe()
        scan = command is not None and command.scan
        if not scan:
            asked = tick + 1
        for i, every in enumerate(sensor_ticks):
            due = tick % every == 0 if every else scan and not seen_from and (tick - asked) % look_ticks == 0
            if not due:
                continue
            sensor_states[i], measurement = parts.sensors[i].step(sensor_states[i], truth)
            if measurement is None:
                continue
            if sensor_delay[i]:
                on_the_way.setdefault(tick + sensor_delay[i], []).append(measurement)
                if not every:
                    seen_from[measurement.time] = estimate
            else:
                arrived.append(measurement)
        if tick in on_the_way:
            arrived += on_the_way.pop(tick)
        frame: Look | None = None
        if tick % estimator_ticks == 0:
            estimator_state, estimate = parts.estimator.step(estimator_state, arrived)
            for measurement in arrived:
                if isinstance(measurement, (DepthImage, SonarScan)):
                    frame = measurement
            arrived = []
        if frame is not None and parts.finder is not None:
            then = seen_from.pop(frame.time, estimate)
            finder_state, found = parts.finder.step(finder_state, then, frame)
            target = found or target  # None: the finder needs more frames first
        if tick % planner_ticks == 0:
            planner_state, reference = parts.planner.step(planner_state, estimate, target, command)
        assert reference is not None
        if tick % controller_ticks == 0:
            controller_state, command = parts.controller.step(controller_state, estimate, reference)
        assert command is not None
        moment = Moment(tick, truth, estimate, target, reference, command, frame, finder_state)
        for observer in observers:
            observer.observe(moment)
        plant.step(command)
        if until(moment):
            break
    assert moment is not None
    return moment
