"""Paths on deformed objects: what the page says of rows made by hand."""

from typing import Any

import pytest

from experiments.toolpath.paths import PathCase, paths
from uuv.sim.interfaces.errors import ConfigurationError

SEEN = {
    "refused": "",
    "seen": 0.5,
    "model_rms": 0.01,
    "model_largest": 0.03,
    "path_rms": 0.001,
    "path_largest": 0.002,
    "within": 1.0,
    "unseen_largest": 0.04,
    "tilt_rms": 0.01,
    "tilt_largest": 0.02,
    "turn_rms": 0.01,
    "profile": {"s": [0.0, 0.1], "distance": [0.001, 0.002], "seen": [True, False]},
}
NONE: dict[str, Any] = dict.fromkeys(SEEN)
UNSEEN = NONE | {"refused": "", "seen": 0.0, "unseen_largest": 0.06}
REFUSED = NONE | {"refused": "a hole"}


def row(seed: int, figures: dict[str, Any]) -> dict[str, Any]:
    """A row of a fouled pile with one path."""
    case = {"object": "fouled pile", "looks": 4, "exact": False, "judged": True, "seed": seed}
    pose = {"accepted": True, "reason": "", "position_error": 0.001, "angle_error": 0.01}
    return {**case, **pose, **{name: {"ring": figure} for name, figure in figures.items()}}


def test_page_tells_refused_and_unseen_paths_and_draws_the_seen_ones():
    rows = [row(1, SEEN), row(2, UNSEEN), row(3, REFUSED), row(4, REFUSED)]
    summary = paths.summary(rows)
    (cells,) = summary.tables[0].rows
    assert cells[:3] == ["fouled pile", "4", "ring"]
    assert cells[3].startswith("50.0 (")
    assert cells[4:11] == ["25", "10.0", "30.0", "1.0", "2.0", "100.0", "60.0"]
    assert summary.accepted
    ((title, _, figure),) = summary.pictures
    assert title == "Paths"
    assert len(figure.axes) == 1


@pytest.mark.parametrize("figures", [SEEN | {"path_largest": 0.0031}, REFUSED])
def test_a_path_off_the_surface_and_no_path_at_all_are_not_accepted(figures: dict[str, Any]):
    assert not paths.summary([row(1, figures)]).accepted


def test_a_path_needs_a_frame():
    with pytest.raises(ConfigurationError, match="--looks: must be at least 1, got 0"):
        PathCase(object="fouled pile", seed=1, looks=0)
