"""Rates of decisions, from rows made by hand."""

from typing import Any

from experiments.identification.decisions import decisions, false_accepts


def row(kind: str, right: bool, **decided: str) -> dict[str, Any]:
    """A scene with decisions by pose; only that of the scene's kind may be right."""
    return {
        "sensor": "stereo",
        "object": "valve",
        "kind": kind,
        "seed": 7,
        "position": 0.001,
        "angle": 0.01,
        "hidden": 0.3,
        "decision": decided,
        "right": {pose: pose == kind and right for pose in decided},
        "reason": dict.fromkeys(decided, ""),
        "published": dict.fromkeys(decided),
    }


ROWS = [
    row("clean", True, clean="accept", off="refuse"),
    row("hidden", True, hidden="rescan", off="accept"),
    row("fouled", True, fouled="refuse", off="refuse"),
    row("hidden_most", True, hidden_most="rescan"),
    row("absent", False, absent="accept"),
    row("other", False, other="refuse"),
]


def test_rates_are_over_wrong_poses_and_over_right_ones_with_enough_in_view():
    """Five wrong poses, two of them accepted; of four right ones one is mostly hidden."""
    tables = {table.title: table for table in decisions.summary(ROWS).tables}
    rates = dict(zip(tables["Rates"].columns, tables["Rates"].rows[-1], strict=True))
    assert rates["false accepts [%]"].startswith("22.2 (")
    assert rates["false accepts [%]"].endswith("of 9")
    assert rates["of wrong poses [%]"].startswith("40.0 (")
    assert rates["false refusals [%]"].endswith("of 3")
    assert rates["right, rescan asked [%]"].startswith("33.3 (")


def test_false_accepts_are_named():
    assert false_accepts(ROWS) == [
        "false accept: valve, off, stereo, seed 7",
        "false accept: valve, absent, stereo, seed 7",
    ]
