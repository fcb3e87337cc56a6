"""The tasks in Gymnasium: its own checks, ids, seeds, vectors of processes; the same states as
through dm_control.
"""

import os
import subprocess
import sys
import warnings
from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest

if find_spec("gymnasium") is None:  # nor is the rest of the extra `rl`
    pytest.skip("dm_control is not here", allow_module_level=True)

# isort: skip  # before dm_control, for which it chooses a renderer
import gymnasium
from gymnasium.utils.env_checker import check_env

from untyped import untyped
from uuv import environments as uuv
from uuv.environments.gym_tasks import IDS, TaskEnvironment
from uuv.perturbations.vehicle import ThrusterSpread
from uuv.sim.interfaces.errors import ConfigurationError, MissingLibraryError

_PICTURE = """
from uuv import environments as composer
from uuv.sim.interfaces.errors import MissingLibraryError
environment = composer.load("water", "hover", seed=0)
environment.reset()
try:
    composer.picture(environment.physics)
except MissingLibraryError as error:
    print(error)
"""


OF_A_HAND = pytest.mark.long(
    guarded_by="tests/unit/uuv/environments/test_suite.py::test_the_expert_solves_it"
)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=OF_A_HAND) if name in uuv.BY_TAG["hand"] else name
        for name in uuv.ALL_TASKS
    ],
    ids="/".join,
)
def test_gymnasium_has_nothing_to_say(name: tuple[str, str]):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        environment = gymnasium.make(IDS[name])
        check_env(environment.unwrapped, skip_render_check=True)
    environment.close()


ANOTHER = pytest.mark.long(
    guarded_by="tests/unit/uuv/environments/test_gym_tasks.py::test_shimmy_has_nothing_to_say"
)


@pytest.mark.parametrize(
    "name",
    [
        name if name == ("water", "reach") else pytest.param(name, marks=ANOTHER)
        for name in uuv.ALL_TASKS
    ],
    ids="/".join,
)
def test_shimmy_has_nothing_to_say(name: tuple[str, str]):
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", module=r"shimmy|gymnasium|pkg_resources")
        from shimmy.dm_control_compatibility import DmControlCompatibilityV0
    environment = DmControlCompatibilityV0(uuv.load(*name, seed=0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(environment, skip_render_check=True)


@pytest.mark.parametrize("name", [("water", "hover"), ("barrel", "press")], ids="/".join)
def test_the_same_states_as_through_dm_control(name: tuple[str, str]):
    in_gym = TaskEnvironment(*name)
    observation, info = in_gym.reset(seed=5)
    assert info == {"is_success": False, "failed": "", "damage": ""}
    direct = uuv.load(*name, seed=5)
    moment = direct.reset()
    rng = np.random.default_rng(0)
    for _ in range(20):
        for key, entry in moment.observation.items():
            np.testing.assert_array_equal(observation[key], entry, err_msg=key)
        action = rng.uniform(-1.0, 1.0, in_gym.action_space.shape)
        observation, reward, terminated, truncated, _ = in_gym.step(action)
        moment = direct.step(action)
        assert reward == moment.reward
        assert not terminated
        assert not truncated
    np.testing.assert_array_equal(in_gym.environment.physics.data.qpos, direct.physics.data.qpos)


def test_seeds_repeat_and_differ():
    environment = gymnasium.make("uuv/Hover-v0")
    starts = [environment.reset(seed=seed)[0]["goal_position"] for seed in (1, 1, 2, None, None)]
    np.testing.assert_array_equal(starts[0], starts[1])
    assert not np.array_equal(starts[0], starts[2])
    assert not np.array_equal(starts[3], starts[4])


def test_time_is_truncation_and_damage_termination():
    environment = TaskEnvironment("water", "hover", time_limit=0.04)
    environment.reset(seed=0)
    assert environment.step(np.zeros(6))[2:4] == (False, False)
    assert environment.step(np.zeros(6))[2:4] == (False, True)
    with pytest.raises(ConfigurationError, match="the episode is over"):
        environment.step(np.zeros(6))
    fast = TaskEnvironment("water", "hover", time_limit=60.0)
    fast.reset(seed=0)
    over = False
    info = {}
    while not over:
        _, _, over, _, info = fast.step(np.array([1.0, 1.0, 0.0, 0.0, 0.0, 0.0]))
    assert info["damage"] == "outside the allowed box"
    with pytest.raises(ConfigurationError, match="has not begun"):
        TaskEnvironment("water", "hover").step(np.zeros(6))


def test_refuses():
    with pytest.raises(ConfigurationError, match="render_mode 'human': allowed rgb_array"):
        TaskEnvironment("water", "hover", render_mode="human")
    environment = TaskEnvironment("water", "hover")
    environment.reset(seed=0)
    with pytest.raises(ConfigurationError, match=r"action: .*finite"):
        environment.step(np.full(6, np.inf))
    environment.close()
    environment.close()
    with pytest.raises(ConfigurationError, match="the environment is closed"):
        environment.step(np.zeros(6))


def test_an_environment_of_your_own_in_gymnasium():
    environment_of_user = uuv.load(
        "water", "hover", seed=1, vehicle="bluerov2_heavy", time_limit=1.0
    )
    environment = TaskEnvironment(environment=environment_of_user)
    assert environment.action_space.shape == (8,)
    environment.reset(seed=0)
    assert environment.step(np.zeros(8))[4]["is_success"] is False


def test_perturbations_are_told():
    environment = gymnasium.make("uuv/Hover-v0", perturbations=[ThrusterSpread(gain=0.2)])
    _, info = environment.reset(seed=0)
    assert 0.8 < info["drawn"]["thruster_gain"] < 1.2


@pytest.mark.parametrize(
    ("camera", "size", "message"),
    [("front", (24, 32), "camera: must be one of .*, got 'front'"), (0, (0, 9), "size")],
)
def test_refuses_a_picture(camera: Any, size: tuple[int, int], message: str):
    environment = uuv.load("water", "hover", seed=0)
    with pytest.raises(ConfigurationError, match=message):
        uuv.picture(environment.physics, camera=camera, size=size)


@pytest.mark.parametrize("context", ["fork", pytest.param("spawn", marks=pytest.mark.long)])
def test_a_vector_of_processes_gives_what_one_gives(context: str):
    """Workers are spawned with the module in the id, for they import nothing by themselves."""
    name = "uuv.environments.gym_tasks:uuv/Hover-v0"
    many: Any = gymnasium.make_vec(
        name,
        num_envs=2,
        vectorization_mode="async",
        vector_kwargs={"context": context, "shared_memory": False},
    )
    observation, _ = many.reset(seed=[3, 4])
    rows = [observation["goal_position"]]
    action = np.tile([0.2, 0.1, 0.0, 0.3, 0.0, 0.0], (2, 1))
    for _ in range(5):
        observation, *_ = many.step(action)
        rows.append(observation["goal_position"])
    many.close()
    for k, seed in enumerate((3, 4)):
        single = gymnasium.make(name)
        first_observation, _ = single.reset(seed=seed)
        alone = [
            first_observation["goal_position"],
            *(single.step(action[k])[0]["goal_position"] for _ in range(5)),
        ]
        np.testing.assert_array_equal(np.array(alone), np.array(rows)[:, k])


def test_rendering_draws_or_says_what_is_missing():
    environment = TaskEnvironment("water", "hover", render_mode="rgb_array")
    environment.reset(seed=0)
    message = ""
    picture = untyped(None)
    try:
        picture = untyped(environment.render())
    except MissingLibraryError as error:
        message = str(error)
    if message:
        pytest.skip(f"no GL here: {message}")
    assert picture.shape == (240, 320, 3)
    assert picture.std() > 5.0


def test_the_viewer_needs_a_screen(monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(MissingLibraryError, match="no viewer: there is no screen"):
        uuv.view(uuv.load("water", "hover", seed=0))


def test_without_gl_one_line_says_what_to_install():
    ran = subprocess.run(
        [sys.executable, "-c", _PICTURE],
        env={**os.environ, "MUJOCO_GL": "off"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.stdout.startswith(
        "no picture: dm_control finds no GL (MUJOCO_GL is off): install libegl1"
    )
    assert ran.stdout.count("\n") == 1
