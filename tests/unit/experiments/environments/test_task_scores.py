"""Scores of policies: which episodes there are, and what the page says of them."""

import pytest

from experiments.environments.task_scores import Episodes, cases, task_scores
from uuv.sim.interfaces.errors import ConfigurationError


def test_all_policies_get_the_same_episodes():
    pytest.importorskip("dm_control")
    drawn = list(cases(Episodes(tasks=("water/hover", "barrel/tap"), episodes=2, seed=7)))
    assert len(set(drawn)) == len(drawn) == 2 * 3 * 2
    assert [case.seed for case in drawn if case.policy == "random"] == [7, 8, 7, 8]
    with pytest.raises(ConfigurationError, match="water/hover"):
        list(cases(Episodes(tasks=("water/hoover",))))


def test_spoiled_episodes_and_failures_of_the_expert_are_on_the_page():
    row = {"task": "water/hover", "steps": 10}
    rows = [
        row | {"policy": policy, "seed": seed, "solved": solved, "total": total, "ended": ended}
        for policy, seed, solved, total, ended in (
            ("expert", 0, True, 8.0, ""),
            ("expert", 1, False, 4.0, "the force limit"),
            ("zero", 0, False, 1.0, ""),
        )
    ]
    summary = task_scores.summary(rows)
    assert [line[3:] for line in summary.tables[1].rows] == [
        ["6.0", "2.0", "1"],  # standard error of 8 and 4
        ["1.0", "-", "0"],
    ]
    assert summary.lines == ["not solved: water/hover, seed 1: the force limit"]
