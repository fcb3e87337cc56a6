"""Actions per second of the dm_control tasks on one core, and how much of it is physics.

Beside them are dm_control's own manipulation tasks. All take turns in one process, and the fastest
round counts: only ratios within one run are comparable; the machine must be idle. An action of the
suite lasts 20 ms in steps of 2 ms, one of dm_control's manipulation 40 ms.
"""

from uuv.start import run_scenario  # isort: skip

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from uuv.experiment import Page, column, experiment, stat
from uuv.experiment.options import at_least

PEERS = ("reach_site_features", "place_brick_features", "stack_2_bricks_features")


@dataclass(frozen=True, kw_only=True)
class TaskSpeedCase:
    """All tasks in turns."""

    actions: int = 300
    """Actions of a round."""
    rounds: int = 5
    """Rounds over all tasks; the fastest counts."""

    def __post_init__(self) -> None:
        at_least(self, actions=1, rounds=1)


@dataclass(frozen=True, kw_only=True)
class TaskSpeedRow:
    """Times by task."""

    steps: Mapping[str, float] = column("steps per action", digits=0, by="task")
    action: Mapping[str, float] = column("an action", "ms", factor=1e3, by="task", tolerance=None)
    physics: Mapping[str, float] = column(
        "of it physics", "ms", factor=1e3, by="task", tolerance=None
    )


@experiment("task_speed", quick={"rounds": TaskSpeedCase.rounds})
def task_speed(case: TaskSpeedCase) -> TaskSpeedRow:
    """Measures all tasks."""
    tasks = environments()
    action = dict.fromkeys(tasks, np.inf)
    physics = dict.fromkeys(tasks, np.inf)
    for _ in range(case.rounds):
        for name, environment in tasks.items():
            action[name] = min(action[name], time_of(environment, case.actions))
            physics[name] = min(physics[name], physics_of(environment, case.actions))

    steps = {
        name: environment.control_timestep() / environment.physics.timestep()
        for name, environment in tasks.items()
    }
    return TaskSpeedRow(steps=steps, action=action, physics=physics)


def environments() -> dict[str, Any]:
    """All tasks by name, dm_control's own last."""
    from dm_control import manipulation

    from uuv import environments as composer

    ours = {"/".join(name): composer.load(*name, seed=0) for name in composer.ALL_TASKS}
    return ours | {f"dm_control {name}": manipulation.load(name, seed=0) for name in PEERS}


def time_of(environment: Any, actions: int) -> float:
    """Time [s] of an action; a tenth of full actions, begun anew where an episode ends."""
    spec = environment.action_spec()
    drawn = 0.1 * np.random.default_rng(0).uniform(-1.0, 1.0, (actions, *spec.shape))

    environment.reset()
    begin = time.perf_counter()
    for action in drawn:
        environment.step(action)
    return (time.perf_counter() - begin) / actions


def physics_of(environment: Any, actions: int) -> float:
    """Time [s] that MuJoCo takes for the steps of an action, from where the environment stands."""
    model = environment.physics.model.ptr
    data = environment.physics.data.ptr
    steps = round(environment.control_timestep() / model.opt.timestep)

    begin = time.perf_counter()
    for _ in range(actions):
        mujoco.mj_step(model, data, steps)
    return (time.perf_counter() - begin) / actions


task_speed.page = Page().table(
    "Speed of the tasks on one core",
    by="task",
    columns=[
        stat("value", lambda row: 1.0 / row["action"], "actions per s", digits=0),
        "steps",
        stat("value", lambda row: row["steps"] / row["action"], "steps per s", digits=0),
        stat("value", lambda row: 100 * row["physics"] / row["action"], "of it physics", unit="%"),
    ],
)

if __name__ == "__main__":
    run_scenario(task_speed.main)
