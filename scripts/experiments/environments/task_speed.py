"""Benchmark: actions per second of the dm_control tasks on one core, and how much of it is physics.

    ./uvw run scripts/experiments/environments/task_speed.py

Beside them are dm_control's own manipulation tasks, in the same run. Only ratios within one run are
comparable; the machine must be idle. An action of the suite lasts 20 ms in steps of 2 ms, one of
dm_control's manipulation 40 ms. Writes task_speed.json and .md into --out.
"""

from uuv.start import new_folder, parse, run_scenario  # isort: skip

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from rich.console import Console

from uuv import environments as composer
from uuv.experiment import Table
from uuv.experiment.options import at_least
from uuv.sim.runs.saving import write_json, write_whole

PEERS = ("reach_site_features", "place_brick_features", "stack_2_bricks_features")


@dataclass(kw_only=True)
class Options:
    """Speed of the tasks."""

    actions: int = 300
    """Actions of a round."""
    rounds: int = 5
    """Rounds over all tasks; the fastest counts."""
    out: Path | None = None
    """Folder for the results."""

    def __post_init__(self) -> None:
        at_least(self, actions=1, rounds=1)


def environments() -> dict[str, Any]:
    """All tasks by name, dm_control's own last."""
    from dm_control import manipulation

    own = {"/".join(name): composer.load(*name, seed=0) for name in composer.ALL_TASKS}
    return own | {f"dm_control {name}": manipulation.load(name, seed=0) for name in PEERS}


def time_of(environment: Any, actions: int) -> float:
    """Time [s] of an action; a tenth of full actions, begun anew where an episode ends."""
    spec, rng = environment.action_spec(), np.random.default_rng(0)
    drawn = 0.1 * rng.uniform(-1.0, 1.0, (actions, *spec.shape))
    environment.reset()
    begin = time.perf_counter()
    for action in drawn:
        environment.step(action)
    return (time.perf_counter() - begin) / actions


def physics_of(environment: Any, actions: int) -> float:
    """Time [s] that MuJoCo takes for the steps of an action, from where the environment stands."""
    model, data = environment.physics.model.ptr, environment.physics.data.ptr
    steps = round(environment.control_timestep() / model.opt.timestep)
    begin = time.perf_counter()
    for _ in range(actions):
        mujoco.mj_step(model, data, steps)
    return (time.perf_counter() - begin) / actions


def main() -> int:
    """Measures all tasks and prints the table; returns 0."""
    options, console = parse(Options), Console()
    folder = new_folder("task_speed", options.out)
    made = environments()
    best = {name: [np.inf, np.inf] for name in made}
    for _ in range(options.rounds):
        for name, environment in made.items():
            best[name][0] = min(best[name][0], time_of(environment, options.actions))
            best[name][1] = min(best[name][1], physics_of(environment, options.actions))
    rows, figures = [], {}
    for name, (whole, physics) in best.items():
        steps = made[name].control_timestep() / made[name].physics.timestep()
        figures[name] = {
            "actions_per_s": 1.0 / whole,
            "steps_per_s": steps / whole,
            "physics": physics / whole,
        }
        rows.append(
            [
                name,
                f"{1.0 / whole:.0f}",
                f"{steps:.0f}",
                f"{steps / whole:.0f}",
                f"{physics / whole:.0%}",
            ]
        )
    table = Table(
        title="Speed of the tasks on one core",
        columns=("task", "actions per s", "steps per action", "steps per s", "of it physics"),
        rows=rows,
    )
    console.print(table.printed())
    write_json(folder / "task_speed.json", figures)
    write_whole(folder / "task_speed.md", table.markdown())
    console.print(f"in {folder}")
    return 0


if __name__ == "__main__":
    run_scenario(main)
