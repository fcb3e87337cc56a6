"""Verdicts on calibrations: every kind spoils its input, and inputs end as the verdict says."""

from pathlib import Path

import numpy as np
import pytest

from experiments.calibration.real_verdicts import RealInputs, RealVerdictCase
from experiments.calibration.real_verdicts import cases as real_cases
from experiments.calibration.verdict import AS_RIGHT, ENDS, KINDS, REFUSED, end_of
from experiments.calibration.verdicts import VerdictCase, calibration_verdicts
from experiments.calibration.wrong_inputs import WRONG, Input
from uuv.arm_identification.calibration_case import nominal
from uuv.calib.touch_files import write_touches
from uuv.sim.interfaces.errors import ConfigurationError

REASONS = {
    "right": "",
    "last column shuffled": "the readings of joint 6 are not those of these touches",
    "last two columns a tenth of a row late": "touches scatter by",
    "joint 5 slips by 3 degrees within a file": "joint 5 reads +3 deg off from touch 11 of p0 to "
    "its last",
    "poses of the flange": "the table, a joint sign or a joint zero is wrong",
    "rows repeated in another file": "the same touches were written twice",
}


@pytest.mark.parametrize("kind", WRONG)
def test_every_kind_changes_its_input(kind: str) -> None:
    rng = np.random.default_rng(1)
    right = Input(
        source=nominal("panda", Path(), None, None),
        series=tuple(rng.uniform(-2.0, 2.0, (20, 7)) for _ in range(3)),
        distances=(("p0", "p1", 0.4),),
    )
    spoilt = WRONG[kind](right, rng)
    assert spoilt is not None

    same = len(spoilt.series) == len(right.series) and all(
        map(np.array_equal, spoilt.series, right.series)
    )
    table = np.array_equal(spoilt.source.arm.table, right.source.arm.table)
    rest = spoilt.distances == right.distances and spoilt.units == right.units
    assert not (same and table and rest)


def test_wrong_inputs_of_an_arm_are_refused_for_what_is_wrong() -> None:
    rows = [
        calibration_verdicts.row(VerdictCase(kind=kind, arm="ur5", pin="straight", seed=105))
        for kind in REASONS
    ]
    for row, reason in zip(rows, REASONS.values(), strict=True):
        assert reason in "; ".join(row["reasons"])
        assert (row["end"] == REFUSED) == row["wrong"]

    summary = calibration_verdicts.summary(rows)
    assert summary.tables[0].rows[0][:2] == ["5", "5"]
    assert summary.lines[0].startswith("right inputs accepted: 100.0 %")
    assert summary.tables[1].rows == []  # no right input was refused


@pytest.mark.parametrize(
    ("reasons", "apart", "hidden", "end"),
    [
        (["no"], 0.0, [], ENDS[0]),
        ([], 0.5 * AS_RIGHT, [], ENDS[1]),
        (
            [],
            2.0 * AS_RIGHT,
            ["the arm and its mirror image fit the touches equally: ..."],
            ENDS[2],
        ),
        ([], 2.0 * AS_RIGHT, ["something else"], ENDS[3]),
    ],
)
def test_an_input_has_one_end(
    reasons: list[str], apart: float, hidden: list[str], end: str
) -> None:
    assert end_of("signs of all joints", reasons, hidden, apart) == end
    if end == ENDS[2]:  # of another input that says nothing
        assert end_of("last column shuffled", reasons, hidden, apart) == ENDS[3]


def test_positions_of_a_real_arm_are_left_out_and_alone(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="a folder with one for each arm"):
        list(real_cases(RealInputs(data=tmp_path)))
    for position in ("a", "b", "c"):
        folder = tmp_path / "robot" / position
        write_touches(folder, ["hole_0"], [np.zeros((2, 7))], [f"joint{k}" for k in range(7)])

    drawn = list(real_cases(RealInputs(data=tmp_path)))
    assert len(set(drawn)) == len(drawn) == len(WRONG) + 1 + 3 * 3
    left_out = RealVerdictCase(
        folder=str(tmp_path / "robot"),
        arm="panda",
        kind="right",
        positions=("a", "b"),
        held_out=("c",),
    )
    assert left_out in drawn


def test_the_quick_subset_is_some_of_the_default_cases() -> None:
    whole = calibration_verdicts.space.cases(calibration_verdicts.options_with({}))
    quick = calibration_verdicts.space.cases(
        calibration_verdicts.options_with(calibration_verdicts.quick)
    )
    assert len(quick) == len(KINDS)
    assert len(whole) == 10 * len(WRONG) + 20 * (len(KINDS) - len(WRONG))
    assert set(quick) < set(whole)
