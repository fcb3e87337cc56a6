"""What the study of unseen objects says of rows made by hand: found, accepted, false accepts, and
its covariances.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from experiments.identification.unseen.scenes import present
from experiments.identification.unseen.unseen import (
    _TITLES,
    FIGURES,
    case_of,
    confusion,
    consistency,
    known_beforehand,
    line,
    unseen,
)
from uuv.perception.registration.pose_check import Decision


def row(
    found: bool, decision: Decision, content: str = "present", **changed: Any
) -> dict[str, Any]:
    """A scene 2 mm and 1 deg off, identified in 0.2 s."""
    blank = dict.fromkeys(unseen.columns)
    figures = {"position_m": 0.002, "angle_deg": 1.0, "identify_s": 0.2, "mirror_share": 0.0}
    case = {"content": content, "sensor": "white", "hidden": "none", "known": "place", "reason": ""}
    verdict = {"found": found, "decision": decision, "nees_degrees": 6}
    return {**blank, **figures, **case, **verdict, **changed}


ROWS = [
    row(True, Decision.ACCEPT, position_m=0.001),
    row(True, Decision.ACCEPT, position_m=0.003),
    row(True, Decision.RESCAN),
    row(False, Decision.ACCEPT, position_m=0.5, identify_s=1.0),
]


def test_shares_are_of_the_scenes_and_of_those_found():
    """Three of four found, two of them accepted; one wrong pose is accepted too.

    Errors are those of found poses.
    """
    bound = [figure.bound_to(unseen.columns, "test") for figure in FIGURES]
    figures = {figure.label: figure.numbers(ROWS) for figure in bound}
    assert figures["found"]["share"] == 0.75
    assert figures["accepted of those found"]["share"] == pytest.approx(2.0 / 3.0)
    assert figures["false accepts"]["count"] == 1
    assert figures["error of those found, median"]["median"] == pytest.approx(2.0)
    assert figures["angle"]["median"] == 1.0
    assert figures["time, median"]["median"] == pytest.approx(0.2)
    assert figures["time, 95 %"]["p95"] == pytest.approx(0.88)
    assert confusion(ROWS) == {
        f"{_TITLES['present']}, found": {"accept": 2, "rescan": 1, "refuse": 0},
        f"{_TITLES['present']}, not found": {"accept": 1, "rescan": 0, "refuse": 0},
    }


@pytest.mark.parametrize("degrees", [5, 6])
def test_errors_are_covered_by_their_own_degrees_of_freedom(degrees: int):
    """40 errors at the middles of 40 equal shares of the distribution: 38 lie within 95 %; the
    median is that of it.
    """
    errors = chi2.ppf((np.arange(40) + 0.5) / 40.0, degrees)
    rows = [row(True, Decision.ACCEPT, nees=float(error), nees_degrees=degrees) for error in errors]
    told = consistency([*rows, row(False, Decision.REFUSE)])
    assert (told["poses"], told["covered_percent"]) == (40, 95.0)
    assert told["nees_median"] == pytest.approx(1.0, rel=0.01)
    assert told["nees_mean"] == pytest.approx(errors.mean() / degrees)


def test_the_page_says_what_was_known_of_its_rows():
    """Rows of drawn cases are those of their file, whatever the options say."""
    assert known_beforehand([row(True, Decision.ACCEPT, known="any")]) == [
        "known of 1 scenes: nothing"
    ]
    assert known_beforehand([*ROWS, row(True, Decision.ACCEPT, known="coarse")]) == [
        "known of 1 scenes: position within 0.3 m and attitude within 45 deg",
        "known of 4 scenes: position within 0.3 m",
    ]


@pytest.mark.parametrize(
    ("found", "decision", "content", "wrong"),
    [
        (True, Decision.ACCEPT, "present", False),
        (True, Decision.RESCAN, "present", True),
        (False, Decision.ACCEPT, "pile", True),
        (False, Decision.REFUSE, "absent", False),
        (False, Decision.ACCEPT, "mirrored", True),
    ],
)
def test_a_line_is_printed_for_what_went_wrong(found, decision, content, wrong: bool):
    text = line(row(found, decision, content, hidden_share=0.2, index=7, around="alone"))
    assert bool(text) == wrong
    assert not wrong or text.startswith(f"{content} 7, ")


def test_the_scene_of_a_row_is_the_drawn_one():
    """A row holds lists where its case has pairs of names and states."""
    case = replace(present(3, 4), streams=(("shape", "12ab 34cd 0 0"),))
    stored = {**vars(case), "streams": [list(pair) for pair in case.streams]}
    assert case_of(row(True, Decision.ACCEPT, **stored)) == case
