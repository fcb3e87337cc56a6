"""The loop's protocol, with parts that only write down what is asked of them."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import (
    Command,
    DepthImage,
    EncoderMeasurement,
    Reference,
    StateEstimate,
    Target,
    WorkState,
)
from uuv.sim.loop.rollout import Moment, Parts, at_rest_after_work, never, rollout

STEP = 0.01  # [s]
NONE = np.zeros(0)


@dataclass
class Fake:
    """What all parts share: one diary, of (who, tick) and what came in."""

    diary: list[tuple[str, int, Any]]
    period: float = STEP
    delay: float = 0.0

    def note(self, tick: int, what: Any = None) -> None:
        self.diary.append((type(self).__name__, tick, what))


@dataclass
class Plant(Fake):
    timestep: float = STEP
    tick: int = 0

    def observe(self) -> int:
        self.note(self.tick, "observe")
        return self.tick

    def step(self, command: Command) -> None:
        self.note(self.tick, "step")
        assert command.time <= self.tick * STEP + 1e-9
        self.tick += 1


class Sensor(Fake):
    def init(self, rng: np.random.Generator) -> np.random.Generator:
        self.drawn = rng.uniform()
        return rng


class Encoder(Sensor):
    def step(self, state: Any, truth: int) -> tuple[Any, EncoderMeasurement]:
        self.note(truth)
        return state, EncoderMeasurement(time=truth * STEP, q=np.array([float(truth)]), qd=NONE)


class Camera(Sensor):
    def step(self, state: Any, truth: int) -> tuple[Any, DepthImage]:
        self.note(truth)
        return state, DepthImage(
            time=truth * STEP, depth=np.ones((1, 1)), K=np.eye(3), X_BC=np.eye(4)
        )


class Estimator(Fake):
    calls: int = -1  # the first is that of the start

    def init(self, first: Any) -> str:
        self.note(-1, [m.time for m in first])
        return "estimator"

    def step(self, state: str, measurements: Any) -> tuple[str, StateEstimate]:
        assert state == "estimator"
        tick = max(self.calls, 0) * round(self.period / STEP)
        self.note(
            tick if self.calls >= 0 else -1,
            [(type(m).__name__, round(m.time / STEP)) for m in measurements],
        )
        self.calls += 1
        zero = np.zeros(3)
        return state, StateEstimate(
            time=tick * STEP,
            X_WB=np.eye(4),
            v_WB_B=zero,
            w_WB_B=zero,
            a_WB_B=zero,
            q=NONE,
            qd=NONE,
            tau=NONE,
        )


class Finder(Fake):
    def init(self) -> int:
        return 0

    def step(self, state: int, estimate: StateEstimate, measurement: Any) -> tuple[int, Target]:
        self.note(round(estimate.time / STEP), round(measurement.time / STEP))
        return state + 1, Target(
            time=measurement.time,
            X_WT=np.eye(4),
            accepted=False,
            check_m=0.0,
            range_m=1.0,
            reason="",
            path=None,
        )


@dataclass
class Planner(Fake):
    scan: tuple[int, ...] = ()  # ticks at which a frame is asked for
    done_at: int = 10**6
    at_rest_at: int = 0

    def init(self, estimate: StateEstimate) -> None:
        self.note(-1, estimate.time)

    def step(
        self, state: None, estimate: StateEstimate, target: Target | None, last: Command | None
    ) -> Any:
        tick = round(estimate.time / STEP)
        self.note(tick, (None if target is None else round(target.time / STEP), last is not None))
        zero = np.zeros(3)
        reference = Reference(
            time=estimate.time,
            state=WorkState.DONE if tick >= self.done_at else WorkState.WORK,
            X_WB=np.eye(4),
            v_WB_W=zero,
            X_WG=None,
            v_WG_W=zero + (tick < self.at_rest_at),
            w_WG_W=zero,
            q=NONE,
            qd=NONE,
            set_force=0.0,
            force_control=False,
            tare=False,
            scan=tick in self.scan,
            path_s=0.0,
        )
        return state, reference


class Controller(Fake):
    def init(self, estimate: StateEstimate) -> None:
        self.note(-1, estimate.time)

    def step(
        self, state: None, estimate: StateEstimate, reference: Reference
    ) -> tuple[None, Command]:
        self.note(round(estimate.time / STEP))
        return state, Command(
            time=estimate.time, joint_torque=NONE, thrusters=NONE, scan=reference.scan
        )


@dataclass
class Watcher(Fake):
    moments: list[tuple[int, bool, int]] = field(default_factory=list)

    def observe(self, moment: Moment) -> None:
        self.note(moment.tick)
        self.moments.append((moment.tick, moment.frame is not None, moment.found))


@dataclass
class Rig:
    """One run of fakes."""

    duration: float = 20 * STEP
    sensors: dict[str, float] = field(default_factory=dict)  # period and delay of the encoder
    estimator: float = STEP
    planner: dict[str, Any] = field(default_factory=dict)
    controller: float = STEP
    camera_delay: float = 0.0
    until: Callable[[Moment], bool] = at_rest_after_work

    def __post_init__(self) -> None:
        self.diary: list[tuple[str, int, Any]] = []
        self.watcher = Watcher(self.diary)
        self.encoder = Encoder(self.diary, **self.sensors)
        self.camera = Camera(self.diary, period=0.0, delay=self.camera_delay)

    def run(self, seed: int = 0) -> "Rig":
        self.last = rollout(
            Plant(self.diary),
            Parts(
                sensors=[self.encoder, self.camera],
                estimator=Estimator(self.diary, period=self.estimator),
                finder=Finder(self.diary),
                planner=Planner(self.diary, **self.planner),
                controller=Controller(self.diary, period=self.controller),
            ),
            duration=self.duration,
            rng=np.random.default_rng(seed),
            observers=[self.watcher],
            until=self.until,
        )
        return self

    def ticks(self, who: str) -> list[int]:
        return [tick for name, tick, _ in self.diary if name == who and tick >= 0]


def test_order_of_calls_within_a_step():
    rig = Rig(planner={"scan": (2,)}).run()
    at_three = [
        (who, what) if who == "Plant" else (who, None) for who, tick, what in rig.diary if tick == 3
    ]
    assert [(who, what) for who, what in at_three if (who, what) != ("Estimator", None)] == [
        ("Plant", "observe"),
        ("Encoder", None),
        ("Camera", None),
        ("Finder", None),
        ("Planner", None),
        ("Controller", None),
        ("Watcher", None),
        ("Plant", "step"),
    ]
    names = [who for who, _ in at_three]
    assert names.index("Camera") < names.index("Estimator") < names.index("Finder")


def test_start():
    """First measurements, estimator, planner and controller once before the loop; no frame among
    the first.
    """
    diary = Rig(duration=STEP).run().diary
    assert diary[:6] == [
        ("Plant", 0, "observe"),
        ("Encoder", 0, None),
        ("Estimator", -1, [0.0]),
        ("Estimator", -1, [("EncoderMeasurement", 0)]),
        ("Planner", -1, 0.0),
        ("Controller", -1, 0.0),
    ]
    planned = [what for who, tick, what in diary if who == "Planner" and tick == 0]
    assert planned == [(None, False)]  # neither target nor command yet


def test_rates_are_kept():
    rig = Rig(
        sensors={"period": 3 * STEP},
        estimator=STEP,
        planner={"period": 4 * STEP},
        controller=2 * STEP,
    ).run()
    assert rig.ticks("Encoder") == [0, 0, 3, 6, 9, 12, 15, 18]  # once more for the start
    assert rig.ticks("Estimator") == list(range(20))
    assert rig.ticks("Planner") == [0, 4, 8, 12, 16]
    assert rig.ticks("Controller") == list(range(0, 20, 2))
    assert rig.ticks("Watcher") == list(range(20))


@pytest.mark.parametrize("delay", [0, 1, 7])
def test_measurements_arrive_after_their_delay_and_keep_their_time(delay):
    rig = Rig(sensors={"period": 5 * STEP, "delay": delay * STEP}).run()
    arrived = {
        tick: when
        for who, tick, message in rig.diary
        if who == "Estimator" and tick >= 0
        for kind, when in message
        if isinstance(message, list)
    }
    assert arrived == {when + delay: when for when in (0, 5, 10, 15) if when + delay < 20}


def test_one_frame_for_each_rising_edge():
    """Asked for in ticks 2 to 5 and again in 9: the command of a tick reaches the camera in the
    next.
    """
    rig = Rig(planner={"scan": (2, 3, 4, 5, 9)}, camera_delay=3 * STEP).run()
    assert rig.ticks("Camera") == [3, 10]
    frames = [(tick, what) for who, tick, what in rig.diary if who == "Finder"]
    # Late frames are handed on with the estimate of when they were taken: the last one before ticks
    # 3 and 10.
    assert frames == [(2, 3), (9, 10)]
    assert [tick for tick, framed, _ in rig.watcher.moments if framed] == [6, 13]
    assert [state for _, _, state in rig.watcher.moments] == [0] * 6 + [1] * 7 + [2] * 7
    targets = [what[0] for who, tick, what in rig.diary if who == "Planner" and tick >= 0]
    assert targets == [None] * 6 + [3] * 7 + [10] * 7


def test_early_stop_when_done_and_at_rest():
    rig = Rig(planner={"done_at": 5, "at_rest_at": 8}).run()
    assert rig.ticks("Watcher")[-1] == 8
    assert rig.last.reference.state is WorkState.DONE
    assert rig.diary[-1] == ("Plant", 8, "step")


def test_no_stop_before_done():
    assert Rig().run().ticks("Watcher")[-1] == 19


def test_every_sensor_has_a_stream_of_its_own():
    first, again, other = Rig().run(seed=1), Rig().run(seed=1), Rig().run(seed=2)
    assert first.encoder.drawn == again.encoder.drawn != other.encoder.drawn
    assert first.encoder.drawn != first.camera.drawn


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"sensors": {"period": 0.025}}, r"Encoder: period 0.025 s .* step 0.01 s"),
        ({"sensors": {"delay": 0.013}}, r"delay of Encoder: period 0.013 s .* step 0.01 s"),
        ({"estimator": 0.004}, r"Estimator: period 0.004 s .* step 0.01 s"),
        ({"planner": {"period": 0.0333}}, r"Planner: period 0.0333 s .* step 0.01 s"),
        ({"controller": 0.015}, r"Controller: period 0.015 s .* step 0.01 s"),
        ({"duration": 0.105}, r"duration: period 0.105 s .* step 0.01 s"),
    ],
)
def test_rates_that_do_not_fit_are_refused_with_both_numbers(options, said):
    with pytest.raises(ConfigurationError, match=said):
        Rig(**options).run()


def test_a_run_ends_where_until_says_so():
    over = {"done_at": 5}
    assert Rig(planner=over).run().last.tick == 5
    assert Rig(planner=over, until=never).run().last.tick == 19
    assert Rig(planner=over, until=lambda moment: moment.tick == 8).run().last.tick == 8
