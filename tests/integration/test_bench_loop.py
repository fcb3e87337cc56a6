"""The benchmark of the loop runs, and its parts add up."""

import json

import pytest


@pytest.mark.long
def test_parts_of_a_step_add_up(script, tmp_path):
    done = script("experiments.runtime.loop", "--quick", "--out", tmp_path / "out")
    assert done.returncode in (0, 1), done.stderr  # 1: slower than its goal
    found = json.loads((tmp_path / "out" / "bench_loop.json").read_text("utf-8"))
    assert {"controller", "planner", "navigation"} <= set(found["us_a_step"])
    assert all(value >= 0.0 for value in found["us_a_step"].values())
