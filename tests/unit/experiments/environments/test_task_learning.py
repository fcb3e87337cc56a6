"""Learning of a task: a short run gives the same again, and what the options ask for."""

from dataclasses import asdict

import numpy as np
import pytest

from experiments.environments import task_learning as module
from experiments.environments.task_learning import Learning, cases, observed, task_learning
from uuv.sim.interfaces.errors import ConfigurationError


def test_a_short_run_can_be_repeated(monkeypatch):
    monkeypatch.setattr(module, "FRESH", 2)
    (case,) = cases(
        Learning(tasks=("water/hover",), generations=1, population=8, time_limit=0.1, seed=3)
    )
    assert case.actions == "hull_wrench"
    row = task_learning(case)
    assert row == task_learning(case)
    assert len(row.before) == len(row.after) == 2
    assert row.bests[0] > row.means[0]
    assert np.any(row.parameters)
    summary = task_learning.summary([asdict(case) | asdict(row)])
    assert summary.failed is not None


def test_goals_and_velocities_are_observed_and_nothing_else():
    seen = {"goal": np.ones(3), "vehicle/velocity": np.zeros(2), "vehicle/arm/joint_position": [5]}
    assert observed(seen).tolist() == [1.0, 1.0, 1.0, 0.0, 0.0]


def test_tasks_and_values_that_are_refused():
    with pytest.raises(ConfigurationError, match=r"--tasks: allowed .*did you mean water/hover"):
        list(cases(Learning(tasks=("water/hoover",))))
    with pytest.raises(ConfigurationError, match="--population: must be at least 8"):
        Learning(population=7)
    with pytest.raises(ConfigurationError, match="--time-limit"):
        Learning(time_limit=0.0)
