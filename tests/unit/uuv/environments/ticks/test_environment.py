"""Compiled substeps of an action and single ones in Python give the same bits; what keeps it slow
is named.
"""

from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest

if find_spec("gymnasium") is None:  # nor is the rest of the extra `rl`
    pytest.skip("dm_control is not here", allow_module_level=True)

# isort: skip  # before dm_control, for which it chooses a renderer
import mujoco
from dm_control.rl.control import PhysicsError

from untyped import untyped
from uuv import environments as uuv
from uuv.environments.actions import JointVelocities, ThrusterSpeeds, ToolTwist
from uuv.environments.free_tasks import HoldStation
from uuv.environments.judges import KeptFor, PressedAt
from uuv.environments.suite import environment
from uuv.environments.ticks import environment as compiled
from uuv.sim.interfaces.spatial import Array
from uuv.sim.plant.truth import Truth
from uuv.sim.sensors.proprioception import Dvl, Imu
from uuv.sim.water.current import Current

Actions = Callable[[int, np.random.Generator], Array]


def thrusters(_: int, rng: np.random.Generator) -> Array:
    return rng.uniform(-0.6, 0.6, 6)


def thrusters_and_torques(_: int, rng: np.random.Generator) -> Array:
    return np.concatenate([rng.uniform(-0.6, 0.6, 6), rng.uniform(-0.1, 0.1, 6)])


def press(step: int, rng: np.random.Generator) -> Array:
    """To the surface, turning a little, and onto it under a force with compliance."""
    turn = 0.2 * rng.uniform(-1.0, 1.0, 3)
    return np.concatenate(
        [[0.1, 0.0, 1.0], turn, [0.4 if step > 50 else 0.0, float(step % 20 > 10)]]
    )


def back(_: int, rng: np.random.Generator) -> Array:
    """Away from the surface, turning a little."""
    return np.concatenate([[0.1, 0.0, -1.0], 0.1 * rng.uniform(-1.0, 1.0, 3), [0.0, 0.0]])


def close(step: int, _: np.random.Generator) -> Array:
    """The jaws open, and close on what is there."""
    return np.concatenate([np.zeros(8), [1.0 if step < 15 else -1.0, -0.2]])


def look(*_: Any) -> None:
    """Hook of a user's own, at every substep."""


def episode(made: Any, act: Actions, steps: int) -> list[Array]:
    """Observation, reward, state and verdict of each step."""
    rng = np.random.default_rng(5)
    moments = []
    made.reset()
    for step in range(steps):
        moment = made.step(act(step, rng))
        task = made.task
        data = made.physics.data
        observed = [np.ravel(entry) for entry in moment.observation.values()]
        judged = [
            float(getattr(task.judge, name, 0.0))
            for name in ("done", "s", "depth", "count", "_held")
        ]
        state = [
            data.qpos,
            data.qvel,
            data.act,
            data.xpos.ravel(),
            data.sensordata,
            task.vehicle.command.thrusters,
        ]
        moments.append(np.concatenate([*observed, *state, [moment.reward or 0.0, *judged]]))
        assert task.vehicle.command.time == pytest.approx(data.time - made.physics.timestep())
        if moment.last():
            break
    return moments


CASES = {
    "thrusters": (("water", "hover"), {}, thrusters, 15),
    "hull wrench": (("water", "hover"), {"actions": "hull_wrench"}, thrusters, 15),
    "torques": (("water", "reach"), {"actions": "thrusters_torques"}, thrusters_and_torques, 15),
    "joints": (("water", "reach"), {"period": 0.03}, thrusters, 20),
    "press": (("barrel", "press"), {}, press, 90),
    "insert": (("manifold", "insert"), {}, press, 80),
    "grasp": (("seabed", "grasp"), {}, close, 40),
    "turn": (("valve", "turn"), {}, back, 40),
}
OF_A_HAND = pytest.mark.long(
    guarded_by="tests/unit/uuv/environments/ticks/test_environment.py::"
    "test_both_ways_give_the_same_bits"
)


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, marks=OF_A_HAND) if name in ("grasp", "turn") else case
        for name, case in CASES.items()
    ],
    ids=CASES,
)
def test_both_ways_give_the_same_bits(case: tuple[Any, dict[str, Any], Actions, int]):
    name, options, act, steps = case
    fast, slow = (uuv.load(*name, seed=11, **options) for _ in range(2))
    slow.add_extra_hook("before_substep", look)
    assert (untyped(fast).slow_part, untyped(slow).slow_part) == ("", "hooks of substeps")
    by = episode(fast, act, steps), episode(slow, act, steps)
    assert len(by[0]) == len(by[1]) > 10
    for first, other in zip(*by, strict=True):
        np.testing.assert_array_equal(first, other)
    first, other = untyped(fast.task), untyped(slow.task)
    assert (first.damage, first.judge.failed) == (other.damage, other.judge.failed)
    if act is press:
        assert first.truth.contact_most > 1.0 or first.damage


def test_the_leash_holds_the_set_point_both_ways(monkeypatch: pytest.MonkeyPatch):
    """One so short that the tool, which lags by micrometres, is always at its end."""
    places = {}
    for leash, hook in ((0.15, False), (1e-7, False), (1e-7, True)):
        monkeypatch.setattr(ToolTwist, "LEASH", leash)
        environment_fast = uuv.load("barrel", "press", seed=11)
        if hook:
            environment_fast.add_extra_hook("before_substep", look)
        places[leash, hook] = (
            episode(environment_fast, back, 15)[-1],
            environment_fast.task.actions.tool_at(0.3)[:3, 3],
        )
    np.testing.assert_array_equal(*(places[1e-7, hook][0] for hook in (False, True)))
    np.testing.assert_array_equal(*(places[1e-7, hook][1] for hook in (False, True)))
    assert np.linalg.norm(places[1e-7, False][1] - places[0.15, False][1]) > 1e-3


def test_sensors_are_read_amid_an_action_at_their_own_rates():
    sensors = [Imu(period=0.006), Dvl(period=0.05, delay=0.014)]
    fast, slow = (uuv.load("water", "hover", seed=4, sensors=sensors) for _ in range(2))
    slow.add_extra_hook("after_substep", look)
    runs: list[int] = []
    usual = compiled.run_substeps

    def counted(box: Any, substeps: int) -> Any:
        runs.append(substeps)
        return usual(box, substeps)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compiled, "run_substeps", counted)
        by = episode(fast, thrusters, 20), episode(slow, thrusters, 20)
    for first, other in zip(*by, strict=True):
        np.testing.assert_array_equal(first, other)
    assert sum(runs) == 200  # all substeps ran compiled
    assert {1, 3} < set(runs)  # up to each sample of the IMU, and to the ends of actions


def test_the_ways_may_take_turns():
    """A callback of MuJoCo that comes and goes; it does nothing."""
    turns, whole = (uuv.load("water", "reach", seed=6) for _ in range(2))
    rng, other = np.random.default_rng(1), np.random.default_rng(1)
    turns.reset()
    whole.reset()
    for step in range(24):
        if step % 3 == 1:
            mujoco.set_mjcb_control(lambda _model, _data: None)
        try:
            turns.step(rng.uniform(-1.0, 1.0, 6))
        finally:
            mujoco.set_mjcb_control(None)
        whole.step(other.uniform(-1.0, 1.0, 6))
        np.testing.assert_array_equal(turns.physics.data.qpos, whole.physics.data.qpos)
        assert turns.task.actions.estimate.time == whole.task.actions.estimate.time


class Watched(HoldStation):
    """Looks at every step."""

    def before_substep(
        self, physics: Any, action: Array, random_state: np.random.RandomState
    ) -> None:
        super().before_substep(physics, action, random_state)


class Gentle(ThrusterSpeeds):
    """Half of what is asked."""

    def command(self, truth: Truth) -> Any:
        command = super().command(truth)
        return type(command)(
            time=command.time,
            joint_torque=command.joint_torque,
            thrusters=0.5 * command.thrusters,
            scan=False,
        )


class Waving(JointVelocities):
    """Set points of its own."""

    def reference(self, time: float) -> Any:
        return self._reference(time, q=self._q + 0.01 * np.sin(time))


class Strict(PressedAt):
    """A judge of its own."""

    def watch(self, truth: Truth, dt: float) -> None:
        super().watch(truth, dt)


def test_what_is_of_the_users_own_runs_in_python_and_is_named():
    vehicle = uuv.VehicleEntity()
    for task, slow in (
        (Watched(uuv.Sea(), vehicle, ThrusterSpeeds(vehicle.own)), "hook of Watched"),
        (HoldStation(uuv.Sea(), body := uuv.VehicleEntity(), Gentle(body.own)), "actions Gentle"),
        (HoldStation(uuv.Sea(), body := uuv.VehicleEntity(), Waving(body.own)), "actions Waving"),
    ):
        task_environment = environment(task, seed=0)
        task_environment.reset()
        assert untyped(task_environment).slow_part == slow
        task_environment.step(np.zeros(6))

    # A judge that watches states after actions alone may be of any kind; one of contact sees every
    # step.
    press_task: Any = uuv.load("barrel", "press", seed=0)
    press_task.task._judge.__class__ = Strict
    assert press_task.slow_part == "judge Strict"
    press_task.task.in_contact = False
    press_task.task._judge = KeptFor(lambda truth: truth.collision, 1.0)
    assert press_task.slow_part == ""


@pytest.mark.parametrize("slow", [False, True])
def test_a_simulation_that_diverges_is_an_error_of_the_physics(slow: bool):
    environment_of = uuv.load("water", "hover", seed=0)
    if slow:
        environment_of.add_extra_hook("before_substep", look)
    environment_of.reset()
    environment_of.step(np.zeros(6))
    environment_of.physics.data.qvel[3] = 1e12
    with pytest.raises(PhysicsError, match="BADQ"):
        environment_of.step(np.zeros(6))
    environment_of.reset()
    assert environment_of.step(np.zeros(6)).observation


class Squall(Current):
    """A current of one's own that fails at its 25th step."""

    steps = 0

    def step(self):
        self.steps += 1
        if self.steps == 25:
            raise ZeroDivisionError("the squall's own")
        return np.array([0.05 * np.sin(0.1 * self.steps), 0.0, 0.0]), np.zeros(3)


class StormySea(uuv.Sea):
    def flow(self, timestep):
        return Squall([0.0, 0.0, 0.0], timestep=timestep)


@pytest.mark.parametrize("hooked", [False, True])
def test_what_a_current_of_ones_own_raises_comes_out_as_it_is(hooked):
    vehicle = uuv.VehicleEntity("uuv_puma")
    environment_of = environment(
        HoldStation(StormySea(), vehicle, ThrusterSpeeds(vehicle.own)), seed=1
    )
    if hooked:
        environment_of.add_extra_hook("before_substep", look)
    environment_of.reset()
    assert bool(untyped(environment_of).slow_part) == hooked
    environment_of.step(np.zeros(6))
    environment_of.step(np.zeros(6))
    assert environment_of.task.vehicle.truth.current_W[0] != 0.0
    with pytest.raises(ZeroDivisionError, match="the squall's own"):
        environment_of.step(np.zeros(6))
