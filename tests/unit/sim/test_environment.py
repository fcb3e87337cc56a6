"""The RL door keeps dm_env's contract, is the plant and nothing else, repeats under a seed, and can be learnt."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from unittest import TestCase

import numpy as np
import pytest

if sys.version_info >= (3, 13):
    pytest.skip("dm_control has no packages for this Python", allow_module_level=True)

from uuv.sim import environment  # isort: skip  # before dm_control, whose absence it names

from dm_control.rl import control
from dm_env.test_utils import EnvironmentTestMixin

from uuv import models
from uuv.models.vehicle import Vehicle
from uuv.sim import hydrodynamics
from uuv.sim.environment import HoverTask, PlantPhysics, hover
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import Command
from uuv.sim.interfaces.spatial import Array, exp_so3, pose
from uuv.sim.plant.arm_hold import HOLD_ANGLE, HOLD_TIME
from uuv.sim.plant.plant import Plant
from uuv.sim.water.current import Current

STILL = Current(np.zeros(3))
THRUSTERS = 6


def new_plant() -> Plant:
    return Plant(hydrodynamics.compile(models.load("uuv_puma")), current=STILL)


def actions(count: int, seed: int = 7) -> Array:
    """Changing thrust (count, m) about a mean that lasts, so that the motion is not trivial."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-0.8, 0.8, THRUSTERS) + rng.uniform(-0.2, 0.2, (count, THRUSTERS))


def trace(env: control.Environment, commands: Array) -> Array:
    """One episode: a row of observation and reward per action."""
    rows = [np.append(np.concatenate(list(env.reset().observation.values())), 0.0)]
    for command in commands:
        moment = env.step(command)
        rows.append(np.append(np.concatenate(list(moment.observation.values())), moment.reward))
    return np.array(rows)


class TestContract(EnvironmentTestMixin, TestCase):
    """dm_env's own checks, through the end of an episode by its time limit."""

    def make_object_under_test(self) -> control.Environment:
        return hover(seed=0, time_limit=0.2)

    def make_action_sequence(self) -> Iterator[Array]:
        yield from actions(25)


class TestContractOutsideTheBox(TestContract):
    """The same, through the end of an episode by leaving the box."""

    def make_object_under_test(self) -> control.Environment:
        return hover(seed=0)

    def make_action_sequence(self) -> Iterator[Array]:
        yield from np.tile([1.0, 1.0, 0.0, 0.0, 0.0, 0.0], (500, 1))


def test_is_the_plant_bit_for_bit():
    steps, sub_steps = 40, 5
    by_environment, by_hand = new_plant(), new_plant()
    task = HoverTask(np.random.default_rng(3))
    env = control.Environment(PlantPhysics(by_environment), task, n_sub_steps=sub_steps)
    env.reset()
    physics = PlantPhysics(by_hand)
    physics.reset()
    HoverTask(np.random.default_rng(3)).initialize_episode(physics)  # the same start and current

    limits, q_home, truth = by_hand.vehicle.torque_limits, by_hand.vehicle.q_home, by_hand.truth
    stiffness = limits / HOLD_ANGLE
    damping = stiffness * HOLD_TIME
    for action in actions(steps):
        env.step(action)
        for _ in range(sub_steps):
            torque = np.clip(stiffness * (q_home - truth.q) - damping * truth.qd, -limits, limits)
            by_hand.step(Command(time=truth.time, joint_torque=torque, thrusters=action, scan=False))
            by_hand.observe()
        np.testing.assert_array_equal(by_environment.data.qpos, by_hand.data.qpos)
        np.testing.assert_array_equal(by_environment.data.qvel, by_hand.data.qvel)
    assert env.physics.time() == pytest.approx(steps * sub_steps * by_hand.timestep)
    assert np.linalg.norm(truth.v_WB_W) > 0.01
    assert np.linalg.norm(truth.w_WB_B) > 0.01
    assert truth.current_W.any()


def test_reset_leaves_nothing_behind():
    used = new_plant()
    used.reset(current=Current([0.3, 0.0, 0.0], gust=0.1, rng=np.random.default_rng(0)))
    rows = [Command(time=0.0, joint_torque=np.zeros(6), thrusters=u, scan=False) for u in actions(100)]
    for row in rows:
        used.observe()
        used.step(row)
    current, X_WB = Current([0.0, 0.2, 0.0]), pose(exp_so3([0.1, -0.2, 0.3]), [1.0, 2.0, -3.0])
    used.reset(current=current, X_WB=X_WB)
    fresh = Plant(hydrodynamics.compile(models.load("uuv_puma")), current=current, X_WB=X_WB)
    for row in rows:
        assert used.observe().time == fresh.observe().time
        for name in ("R_WB", "acceleration", "current_W", "propeller_speed", "q", "tau_drive", "thrust", "v_WB_W"):
            np.testing.assert_array_equal(getattr(used.truth, name), getattr(fresh.truth, name), err_msg=name)
        used.step(row)
        fresh.step(row)
    np.testing.assert_array_equal(used.data.qpos, fresh.data.qpos)
    assert np.linalg.norm(used.truth.v_WB_W) > 0.01


@pytest.mark.parametrize(
    "seed", [lambda: 5, lambda: np.random.default_rng(5), lambda: np.random.RandomState(5)], ids=["int", "new", "old"]
)
def test_seed_repeats_every_episode(seed: Callable[[], Any]):
    first, second = hover(seed=seed()), hover(seed=seed())
    commands = actions(20)
    runs = [(trace(first, commands), trace(second, commands)) for _ in range(2)]
    for a, b in runs:
        np.testing.assert_array_equal(a, b)
    assert not np.array_equal(runs[0][0][0], runs[1][0][0]), "every episode starts anew"
    assert not np.array_equal(trace(hover(seed=6), commands), runs[0][0])


def test_seeds_as_gymnasium_gives_them():
    """Shimmy, which makes a Gymnasium environment of it, replaces the task's `_random` before a reset with a seed."""
    env = hover(seed=0)
    starts = []
    for seed in (3, 3, 4):
        assert env.task._random is not None  # it is read as `np_random`
        env.task._random = np.random.RandomState(seed)
        starts.append(np.concatenate(list(env.reset().observation.values())))
    np.testing.assert_array_equal(starts[0], starts[1])
    assert not np.array_equal(starts[0], starts[2])


def test_observation_in_hull_axes(within: Callable[[str, object, float], None]):
    env = hover(seed=0)
    env.reset()
    phi, p_WB = np.array([0.0, 0.0, 0.4]), np.array([0.3, -0.2, 0.1])
    env.physics.place(current=STILL, X_WB=pose(exp_so3(phi), p_WB))
    observation = env.task.get_observation(env.physics)
    within("position", observation["position"] + exp_so3(phi).T @ p_WB, 1e-14)
    within("attitude", observation["attitude"] + phi, 1e-14)
    assert not observation["velocity"].any()

    sway = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    for _ in range(50):
        observation = env.step(sway).observation
    forward, left, up = observation["velocity"]
    assert left > 0.1
    assert abs(forward) < 0.05 * left
    assert abs(up) < 0.05 * left
    within("lag of the propeller", observation["propeller_speed"] - sway * (1.0 - np.exp(-1.0 / 0.15)), 1e-12)


@pytest.mark.parametrize(
    ("offset", "angle", "reward"),
    [
        (0.0, 0.0, 1.0),
        (environment.CLOSE[0] / 2.0, environment.ALIGNED[0] / 2.0, 1.0),
        (sum(environment.CLOSE), 0.0, 0.1),
        (0.0, sum(environment.ALIGNED), 0.1),
        (sum(environment.CLOSE), sum(environment.ALIGNED), 0.01),
    ],
)
def test_reward(offset: float, angle: float, reward: float):
    env = hover(seed=0)
    env.reset()
    env.physics.place(current=STILL, X_WB=pose(exp_so3([0.0, 0.0, angle]), [0.0, offset, 0.0]))
    assert env.task.get_reward(env.physics) == pytest.approx(reward, abs=1e-12)


def test_ends_by_the_box_and_by_the_clock():
    env = hover(seed=0)
    env.reset()
    for position, discount in ((environment.BOX - 0.01, None), (environment.BOX + 0.01, 0.0)):
        env.physics.place(current=STILL, X_WB=pose(exp_so3([0.0, 0.0, 0.7]), [0.0, 0.0, -position]))
        assert env.task.get_termination(env.physics) == discount
    env = hover(seed=0, time_limit=0.1, control_period=0.02)
    env.reset()
    moments = [env.step(np.zeros(THRUSTERS)) for _ in range(5)]
    assert [moment.last() for moment in moments] == [False] * 4 + [True]
    assert moments[-1].discount == 1.0


def test_arm_is_held_while_the_hull_is_shaken():
    env = hover(seed=0, time_limit=np.inf)
    env.reset()
    vehicle = env.physics.truth.vehicle
    fastest = 0.0
    for action in np.random.default_rng(0).choice([-1.0, 1.0], (50, THRUSTERS)):
        for _ in range(5):
            env.step(action)
        truth = env.physics.truth
        assert np.max(np.abs(truth.q - vehicle.q_home)) < HOLD_ANGLE
        assert np.all(np.abs(truth.tau_drive) <= vehicle.torque_limits)
        fastest = max(fastest, float(np.linalg.norm(truth.w_WB_B)))
    assert fastest > 0.1


def test_simple_policy_earns_more_than_drifting():
    vehicle = Vehicle.of(models.load("uuv_puma").compile())
    mix = np.linalg.pinv(vehicle.thruster_wrench) / 250.0  # [1]/[N]

    def proportional(o: dict[str, Array]) -> Array:
        force = 1200.0 * o["position"] - 1000.0 * o["velocity"]  # [N]/[m], [N]/[m/s]
        moment = 400.0 * o["attitude"] - 300.0 * o["angular_velocity"]  # [N m]/[rad], [N m]/[rad/s]
        return np.clip(mix @ np.concatenate([force, moment]), -1.0, 1.0)

    def earned(policy: Callable[[dict[str, Array]], Array]) -> float:
        env, total = hover(seed=1, time_limit=20.0), 0.0
        for _ in range(2):
            moment = env.reset()
            while not moment.last():
                moment = env.step(policy(moment.observation))
                total += moment.reward
        return total / 2.0 / 1000.0  # per action of a whole episode

    drifting, held = earned(lambda _: np.zeros(THRUSTERS)), earned(proportional)
    assert drifting < 0.15  # measured 0.04
    assert held > 0.7  # measured 0.87


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"control_period": 0.005}, r"control_period: .*0\.005 s .*0\.002 s"),
        ({"control_period": 0.001}, r"control_period: .*0\.001 s .*0\.002 s"),
        ({"time_limit": 0.0}, r"time_limit: must be > 0 s, got 0\.0"),
        ({"current_speed": -0.1}, r"current_speed: must be finite and >= 0 m/s, got -0\.1"),
        ({"vehicle": "submarine"}, r"'submarine'; there are .*uuv_puma"),
    ],
)
def test_refuses(options: dict[str, Any], message: str):
    with pytest.raises(ConfigurationError, match=message):
        hover(**options)


@pytest.mark.parametrize("action", [np.zeros(THRUSTERS - 1), np.full(THRUSTERS, np.nan)], ids=["shape", "nan"])
def test_refuses_action(action: Array):
    env = hover(seed=0)
    env.reset()
    with pytest.raises(ConfigurationError, match="action: "):
        env.step(action)


def test_refuses_vehicle_without_thrusters():
    spec = models.load("uuv_puma")
    for actuator in list(spec.actuators):
        if actuator.name.startswith("thruster_"):
            spec.delete(actuator)
    for key in list(spec.keys):
        spec.delete(key)
    with pytest.raises(ConfigurationError, match="no thrusters"):
        PlantPhysics(Plant(hydrodynamics.compile(spec), current=STILL))


def test_divergence_is_an_error(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.chdir(tmp_path)  # MuJoCo logs its warning to the working directory
    plant = new_plant()
    physics = PlantPhysics(plant)
    physics.reset()
    physics.step(3)
    plant.data.qvel[0] = np.inf
    with pytest.raises(control.PhysicsError, match="became unstable"):
        physics.step()


def test_needs_no_rendering(root: Path):
    code = "import sys, uuv.sim.environment; print(*sys.modules)"  # `import mujoco` loads glfw
    env = {name: value for name, value in os.environ.items() if name != "MUJOCO_GL"}  # tests of pictures may set it
    run = subprocess.run([sys.executable, "-c", code], cwd=root, env=env, capture_output=True, text=True, check=True)
    loaded = set(run.stdout.split())
    assert "dm_control.rl.control" in loaded
    assert not {"OpenGL", "dm_control._render", "dm_control.mujoco"} & loaded
