"""Terrains of the seabed: what the page says of rows made by hand, and what is refused."""

from typing import Any

import pytest

from experiments.seabed.seabed import TerrainCase, terrains
from experiments.seabed.seabed_speed import seabed_speed
from uuv.sim.interfaces.errors import ConfigurationError


def terrain(seed: int, kind: str, refused: str, truly: str, **figures: Any) -> dict[str, Any]:
    """A row; a terrain that was worked has figures."""
    case = {"seed": seed, "beam": 1.0, "noise": 0.3, "vehicle": "uuv_puma"}
    absent = dict.fromkeys(("targets", "profile", "margin", "aside", "hull_gap", "arm_gap"))
    outcome = {"kind": kind, "points": 900, "refused": refused, "truly_refused": truly}
    return {**case, **outcome, **absent, **figures}


WORKED = {
    "targets": [0.2, 1.1],
    "profile": [0.1, 0.3, 0.5, 2.0],
    "margin": 0.4,
    "aside": 0.1,
    "hull_gap": 0.6,
    "arm_gap": 0.25,
}


def test_page_counts_errors_over_all_terrains_and_wrong_refusals():
    rows = [
        terrain(0, "flat", "", "", **WORKED),
        terrain(4, "flat", "too steep", "", targets=[0.3, 0.4], profile=[0.2, 0.2]),
        terrain(1, "ripples", "", "no place", **WORKED | {"margin": 0.3, "hull_gap": 0.7}),
        terrain(5, "ripples", "a hole", "a hole"),
    ]
    summary = terrains.summary(rows)
    flat, ripples, total = summary.tables[0].rows
    assert flat[:2] == ["flat", "2"]
    assert flat[2].startswith("75.0 (")
    assert flat[2].endswith("of 4")
    assert flat[3].endswith("of 6")
    assert flat[5:] == ["1", "0.40", "0.60", "0.25", "1"]
    assert ripples[5:] == ["1", "0.30", "0.70", "0.25", "1"]
    assert total[1] == "4"
    assert total[-1] == "2"
    assert list(summary.lines) == [
        "flat 4: too steep | truly: would do",
        "ripples 1: worked | truly: no place",
        "ripples 5: a hole | truly: a hole",
    ]


@pytest.mark.parametrize(
    "values", [{"beam": 0.0}, {"noise": -0.1}, {"noise": float("inf")}, {"vehicle": "nowhere"}]
)
def test_a_terrain_that_cannot_be_scanned_is_refused(values: dict[str, Any]):
    with pytest.raises(ConfigurationError, match=str(next(iter(values.values())))):
        TerrainCase(seed=1, **values)


def test_page_of_the_speed_has_a_line_for_each_triangulation():
    """The larger cloud was triangulated in no other way."""
    few = {
        "time": {"ours": None, "Poisson": 1.5},
        "error": {"ours": 0.012, "Poisson": 0.03},
        "missed": {"ours": 0.0, "Poisson": 0.02},
    }
    many = {name: {"ours": medians["ours"]} for name, medians in few.items()}
    rows = [
        {"points": 20_000, "seed": 3, "path_time": 0.1, "lacking": "", **few},
        {"points": 50_000, "seed": 3, "path_time": 0.25, "lacking": "no open3d", **many},
    ]
    summary = seabed_speed.summary(rows)
    times, others = summary.tables
    assert [list(row) for row in times.rows] == [["20000", "0.100"], ["50000", "0.250"]]
    assert [list(row) for row in others.rows] == [
        ["20000", "ours", "-", "12.0", "0.0"],
        ["20000", "Poisson", "1.50", "30.0", "2.0"],
        ["50000", "ours", "-", "12.0", "0.0"],
    ]
    assert list(summary.lines) == ["no other triangulations: no open3d"]
