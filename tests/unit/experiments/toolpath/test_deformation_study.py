"""Maps of deformation: what the page says of rows made by hand."""

from typing import Any

import pytest

from experiments.toolpath.deformation import BOUND, deformation

ONE = {"size": 0.008, "noise": 0.002, "regions": 2, "error": 0.004, "both": 60, "either": 80}


def deformed(seed: int, both: int) -> dict[str, Any]:
    """A dented pile whose map of three frames has `both` of 100 pixels at the default size."""
    few = {name: [figure] * 4 for name, figure in ONE.items()}
    many = few | {"both": [both, 60, 50, 40], "either": [100, 80, 80, 0]}
    case = {"object": "dented pile", "looks": 3, "seed": seed}
    maps = {name: {"1": few[name], "3": many[name]} for name in ONE}
    return {**case, "deformed": True, "accepted": seed > 1, "reason": "", **maps}


def clean(seed: int, regions: int | None) -> dict[str, Any]:
    """An undeformed anode; None: it was not accepted."""
    case = {"object": "anode", "looks": 3, "seed": seed}
    figures: dict[str, Any] = dict.fromkeys(ONE)
    if regions is not None:
        figures |= {"size": {"1": [0.01]}, "noise": {"1": [0.002]}, "error": {"1": [0.001]}}
        figures["regions"] = {"1": [regions]}
    accepted = regions is not None
    return {**case, "deformed": False, "accepted": accepted, "reason": "", **figures}


def test_overlap_is_by_frames_and_size_and_clean_objects_stand_apart():
    rows = [deformed(1, 90), deformed(2, 96), clean(1, 0), clean(2, None)]
    summary = deformation.summary(rows)
    single, fused = summary.tables[0].rows
    assert single[:2] == ["dented pile", "1"]
    assert single[2].startswith("50.0 (")
    assert single[3:8] == ["2.0", "4.0", "8.0", "0.75", "0.75"]
    assert fused[6:] == ["0.93", "0.90", "0.75", "0.75", "0.62", "0.62", "40.00", "40.00"]
    assert summary.lines[0].startswith("accepted undeformed objects with a region: 0.0 %")
    assert summary.accepted


@pytest.mark.parametrize(
    "rows", [[deformed(1, 95), deformed(2, round(100 * BOUND) - 1)], [deformed(1, 95), clean(3, 1)]]
)
def test_a_small_overlap_or_a_false_region_is_not_accepted(rows: list[dict[str, Any]]):
    summary = deformation.summary(rows)
    assert not summary.accepted
    named = [line for line in summary.lines if line.startswith("region on an undeformed object")]
    assert len(named) == sum(not row["deformed"] for row in rows)
