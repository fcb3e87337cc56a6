"""The experiment of the loop runs, and its parts add up."""

import pytest

from experiments.runtime.loop import LoopCase, loop
from uuv.experiment import read_rows
from uuv.sim.interfaces.errors import ConfigurationError


@pytest.mark.long
def test_parts_of_a_step_add_up(script, tmp_path):
    done = script("experiments.runtime.loop", "--job=--quick", "--workers", 1, "--out", tmp_path)
    assert done.returncode in (0, 1), done.stderr  # 1: slower than its goal
    (row,) = read_rows(tmp_path)
    assert {"controller", "planner", "navigation"} <= set(row["step"])
    assert all(duration >= 0.0 for duration in row["step"].values())
    assert sum(row["share"].values()) == pytest.approx(1.0)


def test_options_of_the_job_are_read_before_anything_runs():
    assert LoopCase(job="--seed 3").scenario().seed == 3
    with pytest.raises(ConfigurationError, match="--job"):
        LoopCase(job="--seed '3")


def test_times_are_shown_over_that_of_the_physics():
    """1000 steps of 10 us: 30 ms alone are 3 times as long, 50 ms in all 5 times."""
    row = {"job": "", "record": False, "digest": "a", "steps": 1000, "simulated": 2.0}
    row |= {"mujoco_step": 1e-5, "part_by_part": ""}
    row |= {name: {"controller": 1e-5} for name in ("calls", "call", "step", "share")}
    spans = {"whole run": 0.05, "identification": 0.01, "placement": 0.01, "loop alone": 0.03}
    summary = loop.summary([row | {"processor": spans}])

    cells = {line[0]: line[-2:] for line in summary.tables[1].rows}
    assert cells["whole run"] == ["5.0", "40"]
    assert cells["loop alone"] == ["3.0", "67"]
    assert summary.failed == []
