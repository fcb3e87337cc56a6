"""Deviation carried over unseen parts of a path: fading smoothly beyond its ends, joined within."""

import numpy as np
import pytest

from uuv.perception.toolpath import path_deviation
from uuv.sim.interfaces.spatial import Array

S = np.linspace(0.0, 1.0, 201)


def over(
    usable: np.ndarray,
    along: Array,
    across: Array,
    bridged: np.ndarray | None = None,
    on: bool = True,
) -> tuple:
    joined = np.zeros(len(S), dtype=bool) if bridged is None else bridged
    return path_deviation._over_gaps(along, across, np.full(len(S), on), usable, joined, S)


def test_beyond_what_is_seen_a_deviation_fades_to_nothing_without_a_step() -> None:
    usable = (S > 0.4) & (S < 0.6)
    along, across, on = over(usable, np.where(usable, 0.02, 0.0), np.where(usable, -0.3, 0.0))
    np.testing.assert_allclose(along[usable], 0.02)
    after = S >= 0.6
    before = S <= 0.4
    for profile, size in ((along, 0.02), (across, -0.3)):
        share = profile / size
        assert np.all((share >= 0.0) & (share <= 1.0 + 1e-12))
        assert np.all(np.diff(share[after]) <= 1e-12)
        assert np.all(np.diff(share[before]) >= -1e-12)
        np.testing.assert_allclose(share[[0, -1]], 0.0, atol=1e-12)
        assert np.abs(np.diff(share)).max() < 0.3
        # A cubic with level ends: as far from one as from the other at equal distances from its
        # middle.
        width = max(path_deviation._FADE[0], path_deviation._FADE[1] * 0.02)
        edge = S[usable][-1]
        for u in (0.1, 0.25, 0.4):
            here, mirrored = np.interp([edge + u * width, edge + (1.0 - u) * width], S, share)
            assert here + mirrored == pytest.approx(1.0, abs=0.05)
    assert not on[~usable].any()
    assert on[usable].all()


def test_a_larger_deviation_takes_a_longer_way_to_fade() -> None:
    usable = S < 0.3
    ways = []
    for size in (0.001, 0.05):
        along, *_ = over(usable, np.where(usable, size, 0.0), np.zeros(len(S)))
        ways.append(float(S[along > 0.01 * size].max() - 0.3))
    assert 0.0 < ways[0] < ways[1]


def test_bridged_gaps_are_passed_on_a_curve_through_both_sides() -> None:
    usable = (S < 0.4) | (S > 0.6)
    line = 0.01 + 0.02 * S
    along, across, on = over(
        usable, np.where(usable, line, 9.0), np.where(usable, 3.0 * line, 9.0), ~usable
    )
    np.testing.assert_allclose(along, line, atol=1e-12)
    np.testing.assert_allclose(across, 3.0 * line, atol=1e-12)
    assert on.all()
    *_, on = over(usable, line, line, ~usable, on=False)
    assert not on.any()


def test_nothing_seen_is_no_deviation_and_all_seen_is_kept() -> None:
    none = np.zeros(len(S), dtype=bool)
    along, across, on = over(none, np.ones(len(S)), np.ones(len(S)))
    assert not along.any()
    assert not across.any()
    assert not on.any()
    along, across, on = over(~none, S, 2.0 * S)
    np.testing.assert_array_equal(along, S)
    np.testing.assert_array_equal(across, 2.0 * S)
    assert on.all()


def test_the_nearest_known_row(rng: np.random.Generator) -> None:
    known = rng.uniform(size=60) < 0.2
    known[7] = True
    nearest = path_deviation._nearest(known)
    assert known[nearest].all()
    rows = np.flatnonzero(known)
    np.testing.assert_array_equal(
        np.abs(nearest - np.arange(60)), np.abs(rows[:, None] - np.arange(60)).min(axis=0)
    )
    np.testing.assert_array_equal(path_deviation._nearest(np.zeros(4, dtype=bool)), range(4))
