"""Figures of calibration's verdicts in closed form: comparison with a tracker, places, predicted
touches, doubts.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import betaln

from untyped import untyped
from uuv.calib.verdicts import doubts
from uuv.calib.verification import PointTouches, compare, kabsch, pair_distances, places, scores
from uuv.models.arms import published_arms
from uuv.sim.interfaces.spatial import Array, exp_so3, pose, transform_points

# [m]
CORNERS = np.array([[x, y, z] for x in (-0.3, 0.3) for y in (-0.2, 0.2) for z in (-0.1, 0.1)])
X = pose(exp_so3([0.4, -1.1, 0.7]), [1.0, -2.0, 0.5])


def test_clouds_are_compared_by_the_rms_of_what_alignment_leaves():
    """Half the corners of a box stretched by 6 mm each way, half pressed: no pose makes up for
    it.
    """
    off = (
        0.006
        * np.sign(CORNERS[:, [0]] * CORNERS[:, [1]])
        * [0.0, 0.0, 1.0]
        * np.sign(CORNERS[:, [2]])
    )
    off[0] *= 2.0  # one corner by twice as much
    comparison = compare(transform_points(X, CORNERS), {"arm": CORNERS + off})["arm"]
    assert comparison.rms == pytest.approx(np.sqrt(np.mean(comparison.deviations**2)))
    assert comparison.rms > 1.02 * comparison.deviations.mean()
    assert 0.005 < comparison.rms < np.sqrt(np.mean(np.sum(off**2, axis=1)))


def test_a_mirrored_cloud_is_turned_and_never_mirrored():
    R = kabsch(
        CORNERS * [1.0, 1.0, -1.0] + 0.01 * CORNERS[:, [1, 2, 0]], transform_points(X, CORNERS)
    )[:3, :3]
    assert np.linalg.det(R) == pytest.approx(1.0)


def test_a_place_is_a_tenth_of_the_reach():
    """Three points in a chain, 4 and 6 cm apart, and a fourth 30 cm off, of arms of 0.5, 0.8 and 5
    m.
    """
    points = np.array([[1.0, 2.0, 0.0], [1.0, 2.04, 0.0], [1.0, 2.1, 0.0], [1.0, 2.4, 0.0]])
    places_of = [places(points, reach).tolist() for reach in (0.3, 0.5, 0.8, 5.0)]
    assert places_of == [[0, 1, 2, 3], [0, 0, 2, 3], [0, 0, 0, 3], [0, 0, 0, 0]]


def test_pair_distances_are_of_each_series_alone():
    series = [
        np.array([[0.0, 0.0, 0.0], [0.0, 3.0, 4.0]]),
        np.array([[1.0, 1.0, 1.0], [1.0, 1.0, 3.0], [1.0, 4.0, 1.0]]),
    ]
    assert pair_distances(series) == pytest.approx([5.0, 2.0, 3.0, np.sqrt(13.0)])


def refitted(
    rows: Array, readings: Array, noise: float, deviation: float, mine: np.ndarray
) -> Array:
    """Scores (n,) of the readings `mine` by a fit of one parameter to all the others, anew.

    Args:
        rows: (n,) derivatives of all readings.
        readings: (n,) of them, each less the mean of its four.
        noise: standard deviation of a reading.
        deviation: of the prior.
        mine: (n,) bool, True for those that are left out.
    """
    variance = 1.0 / (rows[~mine] @ rows[~mine] / noise**2 + deviation**-2)
    estimate = variance * (rows[~mine] @ readings[~mine]) / noise**2
    lost = 1.0 - 1.0 / 4.0  # less the mean of four touches
    return np.abs(readings[mine] - rows[mine] * estimate) / np.sqrt(
        rows[mine] ** 2 * variance + lost * noise**2
    )


def test_touches_are_predicted_as_by_a_fit_without_their_place(rng: np.random.Generator):
    """One parameter, four places of four touches: the step that removes a place is the fit to the
    three others.
    """
    noise, deviation = 2e-4, 5e-4
    rows = rng.normal(size=(4, 4, 3))
    rows -= rows.mean(axis=1, keepdims=True)
    readings = 0.7 * deviation * rows + noise * rng.normal(size=rows.shape)
    flat, read = rows.ravel(), readings.ravel()
    estimate = (flat @ read / noise**2) / (flat @ flat / noise**2 + deviation**-2)
    series = [
        PointTouches(rows=J[:, None, :], residuals=r - J * estimate, weights=np.ones(4))
        for J, r in zip(rows, readings, strict=True)
    ]
    residuals = np.concatenate(
        [
            refitted(flat, read, noise, deviation, np.repeat(np.arange(4), 12) == cluster)
            for cluster in range(4)
        ]
    )
    assert scores(series, np.arange(4), np.array([deviation]), noise) == pytest.approx(
        np.sort(residuals), rel=1e-9
    )


def test_odds_of_a_scatter_are_those_of_two_densities():
    """Log-normal about the usual value against log-uniform up to the most: by their densities of
    the logarithm.
    """
    scatter, usual, factor, most = 8e-3, 1e-3, 3.0, 0.5
    z = np.log(scatter / usual) / np.log(factor)
    normal = np.exp(-0.5 * z**2) / (np.sqrt(2.0 * np.pi) * np.log(factor))
    uniform = 1.0 / np.log(most / usual)
    assert doubts._log_unlike(scatter, usual, factor, most) == pytest.approx(
        np.log(uniform / normal)
    )
    assert doubts._log_unlike(0.9 * usual, usual, factor, most) == -np.inf


@pytest.mark.parametrize(("out", "of"), [(0, 10), (3, 10), (9, 10)])
def test_odds_of_touches_left_out_are_those_of_two_shares(out: int, of: int):
    """Any share, against one drawn from 20 (1 - s)^19: binomials over beta densities that integrate
    to one.
    """
    fit = SimpleNamespace(weights=[np.where(np.arange(of) < out, 0.0, 1.0)])
    rare = betaln(1.0 + out, 20.0 + of - out) - betaln(1.0, 20.0)
    doubt = doubts._left_out(untyped(fit), ["a"])
    assert doubt.log_odds == pytest.approx(betaln(1.0 + out, 1.0 + of - out) - rare)
    assert doubt.reason.startswith(f"{out} of all {of} touches")


def test_motion_is_the_rms_along_each_axis():
    """Of a joint that swings a tip by 0.1 rad to either side, as far as its lever goes: over three
    axes.
    """
    arm = published_arms.load("ur10e")
    q = np.tile([0.3, -1.2, 1.0, 0.4, 0.5, 0.2], (8, 1))
    q[:, 0] += 0.1 * (-1.0) ** np.arange(8)
    tcp = np.array([0.05, 0.02, 0.15])
    tips = arm.tips(q, tcp)
    across = 0.5 * float(np.linalg.norm(tips[0] - tips[1]))
    assert doubts.motion_of(arm, tcp, [q]) == pytest.approx(across / np.sqrt(3.0))


@pytest.mark.parametrize("off", [0.0, 0.05])
def test_odds_of_a_length_are_those_of_two_deviations(off: float):
    """A length right to its deviation, or wrong by a tenth: two normal densities of what the
    touches miss it by.
    """
    length, deviation = 0.4, 1e-3
    free = SimpleNamespace(
        points=np.array([[0.0, 0.0, 0.0], [0.0, 0.0, (1.0 + off) * length]]),
        estimate=SimpleNamespace(prior=np.array([1e-9])),
        noise=1e-12,
        weights=[np.ones(4), np.ones(4)],
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(doubts, "_information", lambda _: np.eye(1))
        patch.setattr(doubts, "as_made", lambda _: np.array([1e-9]))
        patch.setattr(doubts, "_slope", lambda *_: np.zeros((1, 3)))
        lengths = doubts.Told(names="ab", distances=[(0, 1, length, deviation)])
        (doubt,) = doubts._wrong_lengths(untyped(free), [np.zeros((4, 6))] * 2, lengths)
    narrow = deviation**2 + (1e-3 * length) ** 2
    wide = deviation**2 + (1e-3 * length) ** 2 + (0.1 * length) ** 2
    error2 = (off * length) ** 2
    odds = 0.5 * (np.log(narrow) - np.log(wide) + error2 / narrow - error2 / wide)
    assert doubt.log_odds == pytest.approx(odds, rel=1e-9)
