"""The tasks in Gymnasium under ids, which are registered by the import of this module.

    import gymnasium
    import uuv.environments.gym_tasks

    environment = gymnasium.make("uuv/Hover-v0")
    observation, info = environment.reset(seed=0)

A spawned worker process does not import this module. The id to use there is
"uuv.environments.gym_tasks:uuv/Hover-v0".
"""

from typing import Any

import gymnasium
import numpy as np
from dm_control import composer
from dm_env import specs
from gymnasium import spaces

from uuv.environments import suite
from uuv.environments.pictures import picture
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, shown

NAMESPACE, VERSION = "uuv", "v0"
_MODULE = "uuv.environments.gym_tasks"
_METADATA = {"render_modes": ["rgb_array"], "render_fps": 50}
_BEYOND = 1e6  # bound of an observation whose specification states none
Observation = dict[str, Array]


class TaskEnvironment(gymnasium.Env[Any, Any]):
    """A task of the suite: observations by name, actions in [-1, 1], success in `info`.

    `terminated` means damage, `truncated` that the time is over. `info` has "is_success", "failed"
    (the reason of a failure) and "damage". A seed given to `reset` seeds all following random
    numbers.
    """

    metadata = _METADATA

    def __init__(
        self,
        domain: str = "water",
        task: str = "hover",
        *,
        environment: composer.Environment | None = None,
        render_mode: str | None = None,
        **options: Any,
    ) -> None:
        """Make a task of the suite, or take a user's environment.

        Args:
            domain: As for `suite.load`.
            task: As for `suite.load`.
            environment: Environment to use in place of a task of the suite; its task is a
                `VehicleTask`.
            render_mode: "rgb_array", or None.
            options: Further arguments of `suite.load`.

        Raises:
            ConfigurationError: As for `suite.load`, or there is no such render mode.
        """
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ConfigurationError(f"render_mode {shown(render_mode)}: allowed rgb_array or None")

        self.render_mode = render_mode
        self.environment = (
            suite.load(domain, task, **options) if environment is None else environment
        )
        self.metadata = dict(self.metadata)
        self.metadata["render_fps"] = round(1.0 / self.environment.control_timestep())

        action = self.environment.action_spec()
        self.action_space = _box(action)
        stated = self.environment.observation_spec()
        self.observation_space = spaces.Dict({name: _box(spec) for name, spec in stated.items()})

        self._over, self._closed = True, False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode."""
        super().reset(seed=seed)
        if seed is not None:  # the same episodes as from `suite.load(seed=seed)`
            self.environment.random_state.seed(seed % 2**32)
        moment = self.environment.reset()
        self._over = False
        return dict(moment.observation), self._info()

    def step(self, action: Array) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Act for one period.

        Raises:
            ConfigurationError: The episode is over, or the action has another shape or is not
                finite.
        """
        if self._closed:
            raise ConfigurationError("step: the environment is closed")
        if self._over:
            raise ConfigurationError(
                "step: the episode is over, or has not begun: call reset() first"
            )

        moment = self.environment.step(action)
        self._over = moment.last()
        terminated = moment.last() and moment.discount == 0.0

        return (
            dict(moment.observation),
            float(moment.reward or 0.0),
            terminated,
            moment.last() and not terminated,
            self._info(),
        )

    def render(self) -> np.ndarray | None:
        """Image (240, 320, 3) of the scene; None without a render mode.

        Raises:
            MissingLibraryError: No GL is available for rendering.
        """
        return picture(self.environment.physics) if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Free the physics."""
        if not getattr(self, "_closed", True):
            self._closed = True
            self.environment.close()

    def _info(self) -> dict[str, Any]:
        task: Any = self.environment.task
        facts = {
            "is_success": bool(task.is_success),
            "failed": task.judge.failed,
            "damage": task.damage,
        }
        return facts | ({"drawn": task.vehicle.drawn} if task.vehicle.drawn else {})


def _box(spec: specs.Array) -> spaces.Box:
    """Box space of an observation; an observation without stated bounds gets wide ones."""
    low = np.full(spec.shape, getattr(spec, "minimum", -_BEYOND), np.float64)
    high = np.full(spec.shape, getattr(spec, "maximum", _BEYOND), np.float64)
    return spaces.Box(np.maximum(low, -_BEYOND), np.minimum(high, _BEYOND), spec.shape, np.float64)


def id_of(task: str) -> str:
    """Gymnasium's id of a task: "uuv/Hover-v0" for "hover"."""
    return f"{NAMESPACE}/{task.capitalize()}-{VERSION}"


IDS = {(domain, task): id_of(task) for domain, task in suite.ALL_TASKS}
for (_domain, _task), _id in IDS.items():
    if _id not in gymnasium.registry:
        gymnasium.register(
            _id, entry_point=f"{_MODULE}:TaskEnvironment", kwargs={"domain": _domain, "task": _task}
        )
