"""The tasks keep dm_env's contract, experts solve them, judges say what is done or spoiled, bad
input is told.
"""

import re
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec
from types import MappingProxyType, SimpleNamespace
from typing import Any
from unittest import TestCase

import numpy as np
import pytest

if find_spec("gymnasium") is None:  # nor is the rest of the extra `rl`
    pytest.skip("dm_control is not here", allow_module_level=True)

# isort: skip  # before dm_control, for which it chooses a renderer
import pyarrow.parquet as pq
from dm_env.test_utils import EnvironmentTestMixin

from untyped import untyped
from uuv import environments as uuv
from uuv.controllers.planning.hull_placement import PathStanding
from uuv.environments import work_place
from uuv.environments.actions import ThrusterSpeeds, ToolAndJaws, ToolTwist
from uuv.environments.episodes import run_episode
from uuv.environments.free_tasks import ALIGNED, CLOSE, HoldStation
from uuv.environments.judges import (
    InsertedTo,
    KeptFor,
    PressedAt,
    SetForce,
    TappedAt,
    TurnedTo,
    WipedAlong,
)
from uuv.environments.suite import FORCE, TAP_FORCE
from uuv.sim.evaluation.insertion_metrics import TrueHole
from uuv.sim.evaluation.surface.force_levels import SETTLING
from uuv.sim.interfaces.errors import ConfigurationError, ReachError
from uuv.sim.interfaces.messages import JawSetpoint, ToolPath
from uuv.sim.interfaces.spatial import Array, exp_so3, pose
from uuv.sim.sensors.proprioception import Dvl

DT = 0.002


class _Contract(EnvironmentTestMixin):
    """dm_env's own checks on one task, through the end of an episode."""

    name: tuple[str, str]

    def make_object_under_test(self) -> Any:
        return uuv.load(*self.name, seed=0, time_limit=0.3)

    def make_action_sequence(self) -> Iterator[Array]:
        rng = np.random.default_rng(0)
        for _ in range(25):
            yield rng.uniform(-1.0, 1.0, self.environment.action_spec().shape)


# Of each kind of task one is held to the contract here; Gymnasium's checks go through all.
_ANOTHER = pytest.mark.long(
    guarded_by="tests/unit/uuv/environments/test_gym_tasks.py::test_gymnasium_has_nothing_to_say"
)
_OF_ITS_KIND = ("hover", "reach", "press")

for _name in uuv.ALL_TASKS:
    _title = f"Test{_name[1].capitalize()}"
    globals()[_title] = type(_title, (_Contract, TestCase), {"name": _name, "__test__": True})
    if _name[1] not in _OF_ITS_KIND:
        globals()[_title] = _ANOTHER(globals()[_title])


@cache
def begun() -> Any:
    """A hover that has begun, for tests that do not step it."""
    environment = uuv.load("water", "hover", seed=0)
    environment.reset()
    return environment


SHORT = [
    ("water", "hover"),
    ("water", "waypoint"),
    ("water", "reach"),
    ("barrel", "press"),
    ("manifold", "insert"),
    ("seabed", "grasp"),
]


SOLVES = "tests/unit/uuv/environments/test_suite.py::test_the_expert_solves_it"


@pytest.mark.parametrize(
    "name",
    [
        *SHORT[2:],
        *(pytest.param(name, marks=pytest.mark.long(guarded_by=SOLVES)) for name in SHORT[:2]),
    ],
)
def test_the_expert_solves_it(name: tuple[str, str]):
    environment = uuv.load(*name, seed=21)
    episode = run_episode(environment, uuv.expert(environment), stop_when_done=True)
    assert episode.success, episode.ended
    assert episode.total / episode.steps > 0.3


@pytest.mark.long
@pytest.mark.parametrize("name", [("barrel", "wipe"), ("barrel", "tap"), ("valve", "turn")])
def test_the_expert_solves_long_work(name: tuple[str, str]):
    environment = uuv.load(*name, seed=21)
    episode = run_episode(environment, uuv.expert(environment), stop_when_done=True)
    assert episode.success, episode.ended


def test_the_expert_earns_more_than_nothing_and_chance():
    environment = uuv.load("water", "reach", seed=2, time_limit=4.0)
    by = {
        "expert": uuv.score(environment, uuv.expert(environment), 2),
        "random": uuv.score(environment, uuv.at_random(environment, np.random.default_rng(0)), 2),
        "zero": uuv.score(environment, uuv.zero(environment), 2),
    }
    assert by["expert"].solved == 1.0
    assert by["zero"].solved == by["random"].solved == 0.0
    assert by["expert"].mean > 2.0 * max(by["random"].mean, by["zero"].mean)
    assert "100% solved" in str(by["expert"])


def test_a_sparse_reward_is_success():
    environment = uuv.load("water", "reach", seed=2, sparse=True, time_limit=5.0)
    policy = uuv.expert(environment)
    moment = environment.reset()
    rewards = []
    while not moment.last():
        moment = environment.step(policy(moment))
        rewards.append(moment.reward)
    assert rewards[0] == 0.0
    assert rewards[-1] == 1.0
    assert set(rewards) == {0.0, 1.0}
    assert np.all(np.diff(rewards) >= 0.0)


@pytest.mark.parametrize(
    ("offset", "angle", "reward"),
    [
        (0.5 * CLOSE[0], 0.5 * ALIGNED[0], 1.0),
        (sum(CLOSE), 0.0, 0.1),
        (0.0, sum(ALIGNED), 0.1),
        (sum(CLOSE), sum(ALIGNED), 0.01),
    ],
)
def test_the_reward_of_holding_station(offset: float, angle: float, reward: float):
    """Full within CLOSE and ALIGNED; each further margin costs a factor of ten."""
    task = begun().task
    X_HB = pose(exp_so3([0.0, 0.0, angle]), [0.0, offset, 0.0])
    task.X_WH = pose(exp_so3([0.2, -0.1, 0.7]), [0.5, -0.3, -5.0])
    X_WB = task.X_WH @ X_HB
    truth = untyped(SimpleNamespace(R_WB=X_WB[:3, :3], p_WB=X_WB[:3, 3]))
    assert task.shaped(truth) == pytest.approx(reward, abs=1e-12)


@pytest.mark.parametrize("angle", [0.0, 0.4, np.pi - 1e-6, np.pi])
def test_the_turn_to_a_goal_is_its_angle_also_where_the_tool_points_the_wrong_way(angle: float):
    task = uuv.load("water", "reach", seed=0).task
    R_WG = exp_so3([0.4, -0.2, 0.9])
    task.X_WH = pose(R_WG @ exp_so3(angle * np.array([0.6, 0.8, 0.0])), [0.1, 0.2, -5.0])
    truth = untyped(SimpleNamespace(R_WG=R_WG, p_WG=task.X_WH[:3, 3]))
    turn = task.goal(truth)["goal_turn"]
    assert np.linalg.norm(turn) == pytest.approx(angle, abs=1e-9)
    assert exp_so3(turn)[:, 2] == pytest.approx((R_WG.T @ task.X_WH[:3, :3])[:, 2], abs=1e-9)


@pytest.mark.parametrize("vehicle", ["bluerov2_heavy", "uuv_puma_side"])
def test_other_vehicles_hover(vehicle: str):
    environment = uuv.load("water", "hover", vehicle=vehicle, seed=0)
    assert run_episode(environment, uuv.expert(environment), stop_when_done=True).success


def test_a_place_of_work_is_searched_once_for_the_same_vehicle_and_work(
    monkeypatch: pytest.MonkeyPatch,
):
    searched: list[float] = []

    def standing(**known: Any) -> PathStanding:
        searched.append(known["limits"].force)
        return PathStanding(**known)

    monkeypatch.setattr(work_place, "PathStanding", standing)
    monkeypatch.setattr(work_place, "_CHOSEN", {})
    first, again = (untyped(uuv.load("barrel", "press", seed=seed).task) for seed in (1, 2))
    assert np.array_equal(first.place.placement.X_WB, again.place.placement.X_WB)
    uuv.load("barrel", "tap", seed=1)
    assert searched == [FORCE, TAP_FORCE]


def test_thrusters_and_torques_by_names():
    environment = uuv.load("barrel", "press", actions="thrusters_torques", seed=0)
    names = environment.action_spec().name.split("\t")
    assert names[:2] == ["surge_left", "surge_right"]
    assert names[-1].endswith("joint6")
    environment.reset()
    assert environment.step(np.zeros(len(names))).observation


def test_a_collision_ends_the_episode_without_discount():
    environment = uuv.load("barrel", "press", actions="thrusters_torques", seed=0, time_limit=20.0)
    moment = environment.reset()
    dive = np.zeros(12)
    dive[3:6] = -1.0
    while not moment.last():
        moment = environment.step(dive)
    assert moment.discount == 0.0
    assert moment.reward == 0.0
    assert (
        untyped(environment.task).damage in {"collision"}
        or "force" in untyped(environment.task).damage
    )
    assert not untyped(environment.task).is_success


def test_the_set_point_of_the_tool_stays_near_it():
    environment = uuv.load("barrel", "press", seed=0)
    environment.reset()
    away = np.zeros(8)
    away[2] = -1.0
    for _ in range(400):
        environment.step(away)
    actions, truth = untyped(environment.task.actions), untyped(environment.task.truth)
    assert np.linalg.norm(actions.tool_at(truth.time)[:3, 3] - truth.p_WG) < 1.05 * ToolTwist.LEASH


def test_records_of_episodes(tmp_path):
    environment = uuv.load("water", "hover", seed=0, time_limit=0.4)
    file = tmp_path / "hover.parquet"
    record = uuv.record_episodes(
        environment, uuv.zero(environment), file, episodes=2, task="water/hover"
    )
    table = pq.read_table(file)
    assert table.num_rows == 42 == sum(episode.steps + 1 for episode in record.episodes)
    assert pq.ParquetFile(file).num_row_groups == 2
    assert table.schema.metadata[b"task"] == b"water/hover"
    assert table.schema.metadata[b"actions"].startswith(b"surge_left,")
    assert len(table["action"][0].as_py()) == 6
    assert table["episode"].to_pylist() == [0] * 21 + [1] * 21
    assert sum(table["reward"].to_pylist()[:20]) == pytest.approx(record.episodes[0].total)
    # the last moment has none
    assert table["action"][20].as_py() is table["reward"][20].as_py() is None
    assert table["discount"].to_pylist() == [1.0] * 42
    assert table.schema.metadata[b"vehicle"] == b"uuv_puma"
    assert table.schema.metadata[b"period_s"] == b"0.02"
    assert {"goal_position", "vehicle/position", "vehicle/arm/joints"} <= set(table.column_names)


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        (("water", "hovr"), {}, "unknown task 'water/hovr'; there are water/hover.*water/hover"),
        (("water", "hover"), {"actions": "wings"}, "unknown actions 'wings'; there are thrusters"),
        (("water", "hover"), {"time_limit": 0.0}, "time_limit: must be > 0"),
        (
            ("water", "hover"),
            {"period": 0.003},
            "time between actions: period 0.003 s is not a whole multiple",
        ),
        (("water", "hover"), {"period": -0.02}, "period"),
        (("water", "hover"), {"seed": 1.5}, "seed"),
        (("water", "hover"), {"seed": -1}, "seed"),
        (("water", "hover"), {"sensors": Dvl()}, r"sensors: expected a list, got Dvl\("),
        (("water", "hover"), {"sensors": [Dvl]}, r"did you mean Dvl\(\)\?"),
        (
            ("water", "hover"),
            {"perturbations": ["water"]},
            "perturbations: must be such objects, got 'water'",
        ),
        (("water", "hover"), {"vehicle": "phoenix_smart3s"}, "the vehicle must have thrusters"),
        (
            ("water", "reach"),
            {"vehicle": "phoenix_smart3s"},
            "must have thrusters for station keeping",
        ),
        (
            ("water", "reach"),
            {"vehicle": "bluerov2_heavy"},
            "JointVelocities: the vehicle must have an arm",
        ),
        (
            ("water", "reach"),
            {"vehicle": "bluerov2_heavy", "actions": "thrusters"},
            "ReachPose: the vehicle must have an arm",
        ),
        (
            ("barrel", "press"),
            {"vehicle": "bluerov2_heavy", "actions": "thrusters"},
            "lacks parts that this work needs",
        ),
        (("seabed", "grasp"), {"tool": "small_pad"}, "the work needs driven jaws"),
        (("water", "reach"), {"actions": "tool_jaws"}, "the work needs driven jaws"),
        (("valve", "turn"), {"tool": "gripper"}, "the vehicle's tool must be a handle_socket"),
    ],
)
def test_refuses(arguments: tuple[str, str], options: dict[str, Any], message: str):
    with pytest.raises((ConfigurationError, ReachError), match=message):
        uuv.load(*arguments, **options)


@pytest.mark.parametrize(
    ("action", "message"),
    [
        (np.zeros(5), r"action: expected shape \(6,\)"),
        (np.full(6, np.nan), "action: .*finite"),
        (np.zeros((1, 6)), "action"),
    ],
)
def test_refuses_an_action(action: Array, message: str):
    with pytest.raises(ConfigurationError, match=message):
        begun().step(action)


EPISODE = (
    "tests/unit/uuv/environments/test_suite.py::test_an_episode_has_as_many_actions_as_its_time"
)


@pytest.mark.parametrize(
    "seconds", [0.5, 3.0, pytest.param(10.0, marks=pytest.mark.long(guarded_by=EPISODE))]
)
def test_an_episode_has_as_many_actions_as_its_time(seconds: float):
    environment = uuv.load("water/hover", seed=0, time_limit=seconds)
    assert run_episode(environment, uuv.zero(environment)).steps == round(seconds / 0.02)


def test_an_expert_is_for_dm_control():
    with pytest.raises(
        ConfigurationError,
        match=r"a Gymnasium environment has it as "
        r"`unwrapped\.environment`",
    ):
        uuv.expert(untyped("uuv/Hover-v0"))


class Wrong(HoldStation):
    """Gives other numbers than it has stated, and a reward beyond its bounds."""

    off: Any = MappingProxyType({})
    reward = 0.5

    def goal(self, truth: Any) -> Any:
        return {**super().goal(truth), **self.off}

    def shaped(self, truth: Any) -> float:
        return self.reward


def wrong() -> Any:
    vehicle = uuv.VehicleEntity("uuv_puma")
    return Wrong(uuv.Sea(), vehicle, ThrusterSpeeds(vehicle.own))


def test_a_task_of_your_own_is_held_to_what_it_states():
    task = wrong()
    task.off = {"goal_position": np.zeros(2)}
    with pytest.raises(ConfigurationError, match=r"goal goal_position: expected shape \(3,\)"):
        uuv.environment(task, seed=0).reset()
    task = wrong()
    task.reward = 7.0
    environment = uuv.environment(task, seed=0)
    environment.reset()
    with pytest.raises(ConfigurationError, match=r"Wrong.shaped: must be in \[0, 1\], got 7"):
        environment.step(np.zeros(6))


def test_a_step_after_the_end_begins_anew():
    """As dm_env has it."""
    environment = uuv.load("water", "hover", seed=0, time_limit=0.04)
    environment.reset()
    environment.step(np.zeros(6))
    assert environment.step(np.zeros(6)).last()
    assert environment.step(np.zeros(6)).first()


def test_an_expert_acts_by_its_own_kind_of_action():
    environment = uuv.load("water", "hover", actions="thrusters_torques")
    with pytest.raises(
        ConfigurationError,
        match="HoldStation needs the actions ThrusterSpeeds, got ThrustersAndTorques",
    ):
        uuv.expert(environment)


# Judges, by hand-made states

LINE = ToolPath(
    s=np.linspace(0.0, 0.1, 21),
    p=np.linspace(0.0, 0.1, 21)[:, None] * [1.0, 0.0, 0.0],
    z=np.tile([0.0, 0.0, -1.0], (21, 1)),
    x=np.tile([1.0, 0.0, 0.0], (21, 1)),
    on_scan=np.ones(21, dtype=bool),
)


def at(x: float, force: float, y: float = 0.0, z: float = 0.0, side: float = 0.0) -> Any:
    """State with the pad at a place, pressed with a force [N] along -z."""
    return untyped(
        SimpleNamespace(
            p_pad=np.array([x, y, z]),
            contact_normal=force,
            contact_least=force,
            contact_most=force,
            contact_force_W=np.array([side, 0.0, force]),
        )
    )


def test_kept_for_wants_no_break():
    judge = KeptFor(lambda truth: truth.contact_normal > 1.0, 1.0)
    for force in [2.0] * 400 + [0.0] + [2.0] * 499:
        judge.watch(at(0.0, force), DT)
    assert not judge.done
    judge.watch(at(0.0, 2.0), DT)
    judge.watch(at(0.0, 2.0), DT)
    assert judge.done
    judge.start()
    assert not judge.done


def wiped(force: float = 60.0, y: float = 0.0, gap: float | None = None) -> WipedAlong:
    judge = WipedAlong(SetForce(LINE, 60.0))
    judge.start()
    for _ in range(round(1.2 * SETTLING / DT)):
        judge.watch(at(0.0, 60.0), DT)
    for x in np.arange(0.0, 0.1, 0.02 * DT):
        judge.watch(at(x, 0.0 if gap is not None and x > gap else force, y), DT)
    return judge


def test_wiping_is_done_within_the_bounds_and_spoiled_outside():
    assert wiped().done
    assert wiped(force=62.5).done
    assert "force error 3.9 N RMS" in wiped(force=64.0).failed
    assert "force error 10.0 N" in wiped(force=70.0).failed
    assert "4.0 mm path error" in wiped(y=0.004).failed
    assert wiped(gap=0.05).failed == "contact lost"
    assert not wiped(gap=0.05).done


def test_wiping_begins_at_the_start_of_the_path():
    judge = WipedAlong(SetForce(LINE, 60.0))
    judge.start()
    for x in np.arange(0.05, 0.1, 0.02 * DT):
        judge.watch(at(x, 60.0), DT)
    assert not judge.done
    assert judge.s == 0.0


def test_pressing_is_held_where_it_is_to_be():
    for y, force, done in (
        (0.0, 60.0, True),
        (0.004, 60.0, False),
        (0.0, 64.0, False),
        (0.0, 50.0, False),
    ):
        judge = PressedAt(SetForce(LINE, 60.0), 2.0)
        for _ in range(1500):
            judge.watch(at(0.0, force, y), DT)
        assert judge.done == done, (y, force)


def test_taps_need_the_tool_off_in_between():
    judge = TappedAt(SetForce(LINE, 40.0), (0.0, 0.05), 0.3)
    for x, force, seconds in ((0.0, 40.0, 0.5), (0.05, 40.0, 0.5)):
        for _ in range(round(seconds / DT)):
            judge.watch(at(x, force), DT)
    assert judge.count == 1
    for force, seconds in ((0.0, 0.01), (60.0, 0.5), (41.0, 0.5)):
        for _ in range(round(seconds / DT)):
            judge.watch(at(0.05, force), DT)
    assert judge.done


def test_insertion_counts_in_the_bore_and_within_the_forces():
    X_WH = np.diag([1.0, -1.0, -1.0, 1.0])
    hole = TrueHole(X_WH=X_WH, radius=0.02, tool_radius=0.018, depth=0.06)
    for x, z, side, done, failed in (
        (0.0, -0.056, 0.0, True, ""),
        (0.0, -0.054, 0.0, False, ""),
        (0.03, -0.06, 0.0, False, ""),
        (0.0, -0.056, 25.0, False, "side force 25 N"),
    ):
        judge = InsertedTo(hole)
        judge.watch(at(x, 10.0, z=z, side=side), DT)
        assert (judge.done, judge.failed) == (done, failed)
    judge.watch(at(0.0, 45.0, z=-0.02), DT)
    assert judge.failed == "side force 25 N"


def test_a_handle_must_stay_at_its_stop_and_never_be_forced():
    handle = [0.0, 0.0]
    judge = TurnedTo(1.5, 1.0, most=30.0, handle=lambda: (handle[0], handle[1]))

    def watch(angle: float, moment: float, seconds: float) -> None:
        handle[:] = angle, moment
        for _ in range(round(seconds / DT)):
            judge.watch(at(0.0, 0.0), DT)

    watch(1.51, 20.0, 0.9)
    watch(1.49, 20.0, DT)
    watch(1.51, 20.0, 0.9)
    assert not judge.done
    watch(1.51, 20.0, 0.2)
    assert judge.done
    watch(1.51, -40.0, 0.2)
    assert judge.done
    assert not judge.failed

    judge.start()
    watch(0.5, -31.0, DT)
    assert judge.failed == "moment of 31 N m"
    watch(1.51, 0.0, 2.0)
    assert not judge.done


def test_the_last_two_numbers_of_an_action_are_opening_and_force_of_the_jaws():
    actions = ToolAndJaws(uuv.VehicleEntity("uuv_puma", tool="gripper").own)
    assert actions.names[8:] == ("opening", "grip")
    for opening, force in ((0.0, 40.0), (0.1, 100.0), (0.03, 0.0)):
        setpoint = JawSetpoint(opening=opening, speed=0.01, force=force)
        low, high = actions.jaws_to(setpoint)
        assert 0.05 * (1.0 + low) == pytest.approx(opening)
        assert 50.0 * (1.0 + high) == pytest.approx(force)


def test_the_code_of_the_page_runs(root, tmp_path, monkeypatch):
    """Block after block, each by itself."""
    monkeypatch.chdir(tmp_path)
    page = (root / "docs" / "environments.md").read_text()
    blocks = re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)
    assert len(blocks) == 9
    for block in blocks:
        exec(compile(block, "docs/environments.md", "exec"), {"__name__": "of_the_page"})
    assert (tmp_path / "reach.parquet").exists()
    task = next(block for block in blocks if "class Dive" in block)
    assert len(task.splitlines()) <= 60
    listing = next(block for block in blocks if "observable.Generic" in block)
    assert len(listing.splitlines()) <= 10
