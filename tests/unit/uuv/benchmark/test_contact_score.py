"""What an entry of the contact benchmark gets for runs made by hand: figures, class, totals, its
place on the page.
"""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from experiments.leaderboard.table import page
from untyped import untyped
from uuv.benchmark import score
from uuv.benchmark.cases import INSERTION
from uuv.sim.interfaces.messages import WorkState

STATES = (
    WorkState.CLOSE_IN,
    WorkState.APPROACH,
    WorkState.PRESS,
    WorkState.WORK,
    WorkState.RETREAT,
)


def run_of(
    states: tuple[WorkState, ...] = STATES,
    *,
    accepted: bool = True,
    collision_s: float = 0.0,
    peak: float = 66.0,
) -> Any:
    """A row in each state: the hull 9, 1, 2, 3 and 8 cm off; `peak` [N] of force at work, 60 N
    set.
    """
    off = np.outer([0.09, 0.01, 0.02, 0.03, 0.08], [0.6, 0.0, -0.8])[: len(states)]
    series = {
        "p_WB": np.array([1.0, 2.0, -3.0]) + off,
        "p_WB_reference": np.tile([1.0, 2.0, -3.0], (len(states), 1)),
        "set_force": np.array([60.0 if state is WorkState.WORK else 0.0 for state in states]),
        "contact_most": np.array([peak if state is WorkState.WORK else 0.0 for state in states]),
    }

    class Recorded(dict[str, Any]):
        final = SimpleNamespace(
            state=states[-1] if states[-1] is WorkState.ABORT else WorkState.DONE,
            note="why",
            abort=None,
        )
        duration = 60.0

        def within(self, *wanted: WorkState) -> np.ndarray:
            return np.array([state in wanted for state in states])

    metrics = {
        "contact": {"force_error_rms_n": 0.5, "force_error_max_n": 3.0},
        "tool": {"path_deviation_max_m": 0.002},
        "run": {"collision_s": collision_s},
        "accepted": accepted,
        "failed": [] if accepted else ["contact lost: 1 s, allowed 0 s"],
    }
    recording = Recorded(
        {name: SimpleNamespace(value=column, scalar=column) for name, column in series.items()}
    )
    placed = SimpleNamespace(begun=(WorkState.APPROACH, WorkState.PRESS, WorkState.WORK))
    return untyped(
        SimpleNamespace(
            assessment=SimpleNamespace(metrics=metrics),
            recording=recording,
            scenario=None,
            assembly=SimpleNamespace(placed=placed),
        )
    )


@pytest.fixture(autouse=True)
def set_force(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(score, "first_force", lambda _: 60.0)


def test_excursion_is_that_at_the_object():
    figures = score.figures(run_of(), 120.0)
    assert figures["excursion_max_m"] == pytest.approx(0.03)
    assert (figures["force_rms_n"], figures["path_max_m"], figures["energy_j"]) == (
        0.5,
        0.002,
        120.0,
    )
    assert figures["force_over_set"] == pytest.approx(1.1)
    assert score.figures(run_of((WorkState.SCAN, WorkState.ABORT)), 1.0)["excursion_max_m"] is None


@pytest.mark.parametrize(
    ("run", "told"),
    [
        (run_of(), score.KEPT),
        (run_of(accepted=False), score.MISSED),
        (run_of(accepted=False, peak=91.0), score.DAMAGED),  # before all else
        (run_of((*STATES[:3], WorkState.ABORT), collision_s=0.1), score.DAMAGED),
        (run_of((*STATES[:3], WorkState.ABORT)), score.BROKEN),
        (run_of((WorkState.SCAN, WorkState.ABORT)), score.NOT_BEGUN),
    ],
)
def test_class_of_a_run(run: Any, told: str):
    assert score._class(run)["class"] == told


def row(kept: bool, family: str = "barrel", **figures: float) -> dict[str, Any]:
    """A row of a result; all figures are 1 but for those given."""
    ones = dict.fromkeys(score.FIGURES, 1.0)
    return {
        "case": 0,
        "family": family,
        "class": score.KEPT if kept else score.MISSED,
        "door": None,
        **ones,
        **figures,
    }


def test_totals_leave_forces_of_insertions_out_and_count_steps():
    rows = [
        row(True, force_rms_n=force, energy_j=energy)
        for force, energy in ((1.0, 10.0), (2.0, 20.0), (3.0, 60.0))
    ]
    rows += [row(True, INSERTION, force_rms_n=90.0, energy_j=90.0)] * 2
    rows[0]["door"] = {"steps": 300, "waited_s": 0.6, "longest_s": 0.01}
    rows[1]["door"] = {"steps": 100, "waited_s": 0.6, "longest_s": 0.03}
    totals = score.totals(rows)
    assert (totals["force_rms_n"]["value"], totals["energy_j"]["value"]) == (2.0, 60.0)
    assert (totals["step_wall_s"], totals["step_longest_s"]) == (pytest.approx(1.2 / 400), 0.03)


def test_the_interval_of_a_median_is_no_interval_of_the_mean():
    """One value far away drags the mean of a draw along, and leaves its median where it was."""
    interval = score.median([1.0] * 10 + [1000.0])
    assert interval == {"value": 1.0, "of": 11, "low": 1.0, "high": 1.0}


def test_the_page_has_the_best_first_and_energies_in_kilojoules():
    about = {
        "version": 1,
        "seed": 1,
        "public": False,
        "cases": 2,
        "cases_digest": "a",
        "code": "c",
        "source": "",
    }
    worse = {"benchmark": {**about, "entry": "a"}, "rows": [row(False), row(False)]}
    better = {
        "benchmark": {**about, "entry": "b"},
        "rows": [row(True, energy_j=2340.0, path_max_m=0.0015)] * 2,
    }
    lines = [
        line.split(" | ")
        for line in page([worse, better]).splitlines()
        if line.startswith(("| a |", "| b |"))
    ]
    assert [cells[0] for cells in lines[:2]] == ["| b", "| a"]
    assert (lines[0][5], lines[0][7]) == ("1.50 (1.50 to 1.50)", "2.34 (2.34 to 2.34)")
