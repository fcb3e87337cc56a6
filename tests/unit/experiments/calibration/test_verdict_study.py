"""The study of verdicts: every kind spoils its input, and rows end as the verdict said."""

from pathlib import Path

import numpy as np
import pytest

from experiments.calibration.verdict_study import (
    AS_RIGHT,
    Source,
    VerdictCase,
    cases,
    outcome_of,
    summarise,
    verdict_of,
)
from experiments.calibration.wrong_inputs import WRONG, Input
from uuv.arm_identification.calibration_case import nominal
from uuv.calib.touch_files import write_touches
from uuv.sim.interfaces.errors import ConfigurationError

STRAIGHT = Source("ur5", 105, "straight")
ENDS = {
    "right": "",
    "last column shuffled": "the readings of joint 6 are not those of these touches",
    "last two columns a tenth of a row late": "touches scatter by",
    "joint 5 slips by 3 degrees within a file": "joint 5 reads +3 deg off from touch 11 of p0 to "
    "its last",
    "poses of the flange": "the table, a joint sign or a joint zero is wrong",
    "rows repeated in another file": "the same touches twice",
}


@pytest.mark.parametrize("kind", WRONG)
def test_every_kind_changes_its_input(kind: str) -> None:
    rng = np.random.default_rng(1)
    given = Input(
        source=nominal("panda", Path(), None, None),
        series=tuple(rng.uniform(-2.0, 2.0, (20, 7)) for _ in range(3)),
        distances=(("p0", "p1", 0.4),),
    )
    spoilt = WRONG[kind](given, rng)
    assert spoilt is not None
    same = len(spoilt.series) == len(given.series) and all(
        map(np.array_equal, spoilt.series, given.series)
    )
    table = np.array_equal(spoilt.source.arm.table, given.source.arm.table)
    assert not (
        same and table and spoilt.distances == given.distances and spoilt.units == given.units
    )


def test_wrong_inputs_of_an_arm_are_refused_for_what_is_wrong() -> None:
    rows = [verdict_of(VerdictCase(STRAIGHT, kind)) for kind in ENDS]
    for row, said in zip(rows, ENDS.values(), strict=True):
        assert said in "; ".join(row["reasons"])
        assert bool(row["reasons"]) == row["wrong"]
    summary = summarise(rows)
    assert summary.metrics["wrong"]["refused"] == summary.metrics["wrong"]["files"] == len(ENDS) - 1
    assert summary.metrics["right"] == {"files": 1, "accepted": 1}
    assert all(len(row) == len(table.columns) for table in summary.tables for row in table.rows)


@pytest.mark.parametrize(
    ("reasons", "off", "untold", "end"),
    [
        (["no"], None, [], "refused"),
        ([], 0.5 * AS_RIGHT, [], "the arm is right"),
        ([], 2.0 * AS_RIGHT, ["touches cannot tell the arm from its mirror image: ..."], "said"),
        ([], 2.0 * AS_RIGHT, ["something else"], "accepted wrongly"),
    ],
)
def test_an_end_is_counted_once(
    reasons: list[str], off: float | None, untold: list[str], end: str
) -> None:
    row = {"kind": "signs of all joints", "reasons": reasons, "off_m": off, "untold": untold}
    assert outcome_of(row) == end
    if end == "said":  # of another input it says nothing
        assert outcome_of({**row, "kind": "last column shuffled"}) == "accepted wrongly"


def test_positions_of_a_real_arm_are_left_out_and_alone(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="at least two folders"):
        list(cases(0, 0, 0, [tmp_path], "panda"))
    for position in ("a", "b", "c"):
        write_touches(
            tmp_path / position, ["hole_0"], [np.zeros((2, 7))], [f"joint{k}" for k in range(7)]
        )
    mine = list(cases(1, 2, 7, [tmp_path], "panda"))
    assert len(set(mine)) == len(mine) == 2 * len(WRONG) + 2 * 3 + 1 + 3 * 3
    assert VerdictCase(Source("panda", folder=str(tmp_path)), "right", ("a", "b"), ("c",)) in mine
