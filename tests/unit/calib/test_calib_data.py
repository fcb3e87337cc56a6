"""Bad touches: what is said about them, and what is found in spite of them."""

from collections.abc import Callable

import numpy as np
import pytest
from test_calib_fit import OFF_AXIS, PAPER, UR10E

from untyped import untyped
from uuv.calib import Arm, MapFit, identify
from uuv.calib.simulation import touch
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array


@pytest.fixture(scope="module")
def series() -> list[Array]:
    return touch(Arm.from_dh(PAPER), OFF_AXIS, np.random.default_rng(20))


def with_nan(series: list[Array]) -> list[Array]:
    bad = [q.copy() for q in series]
    bad[1][4, 2] = np.nan
    return bad


REFUSED: dict[str, tuple[Callable[[list[Array]], object], str]] = {
    "empty": (lambda _: [], "at least one series of touches"),
    "empty series": (lambda s: [s[0], np.empty((0, 6))], "series 2: must have at least one touch"),
    "not finite": (with_nan, "series 2, touch 5: joint 3 is nan"),
    "degrees": (lambda s: [np.rad2deg(q) for q in s], "degrees"),
    "joint count": (lambda s: [q[:, :5] for q in s], r"the arm has 6 joints.*\(21, 5\)"),
    "one array": (lambda s: s[0], "list of arrays"),
    "text": (lambda _: [[["a"] * 6] * 3], "series 1"),
    "one touch each": (lambda s: [q[:1] for q in s], "at least three times in different poses"),
    "equal touches": (
        lambda s: [np.repeat(q[:1], 10, axis=0) for q in s],
        "at least three times in different poses",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_in_one_line(case: str, series: list[Array]):
    spoil, words = REFUSED[case]
    with pytest.raises(ConfigurationError, match=words):
        identify(untyped(spoil(series)), UR10E)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"free": ["a", "lengths"]}, "'lengths' is no parameter.*theta, d, a"),
        ({"prior": {"a": -1.0}}, "deviation of a: must be positive"),
        ({"prior": {"b": 1.0}}, "'b' is not a free parameter"),
        ({"method": "magic"}, "map, paper"),
        ({"distances": [(0, 3, 1.0)]}, r"0\.\.2"),
        ({"distances": [(0, 1, -1.0)]}, "positive"),
        ({"tcp": [0.0, 0.0]}, "tcp"),
        ({"free": ["compliance"]}, "loads"),
    ],
)
def test_options_refused(options: dict, words: str, series: list[Array]):
    with pytest.raises(ConfigurationError, match=words):
        identify(series, UR10E, **options)


@pytest.mark.parametrize(
    ("dh", "words"),
    [
        (np.rad2deg(UR10E), "degrees"),
        (1e3 * UR10E * [0, 1, 1, 0], "millimetres"),
        (UR10E[:, :3], "nominal"),
    ],
    ids=["degrees", "millimetres", "columns"],
)
def test_nominal_refused(dh: Array, words: str, series: list[Array]):
    with pytest.raises(ConfigurationError, match=words):
        identify(series, dh)


def test_outliers_are_named_and_left_out(series: list[Array], within):
    arm = Arm.from_dh(PAPER)
    off = touch(
        arm, OFF_AXIS, np.random.default_rng(21), points=np.array([[0.5, 0.5, 0.3]]), touches=1
    )[0]
    spoilt = [q.copy() for q in series]
    # A slip of 20 mm: the wrist turned, so that the tip is elsewhere.
    clean = identify(series, UR10E)
    for s, j, joint in ((0, 3, 4), (2, 17, 3)):
        away = spoilt[s][j].copy()
        for angle in np.linspace(0.0, 0.5, 500):
            away[joint] = spoilt[s][j][joint] + angle
            if (
                np.linalg.norm(
                    arm.tips(away[None], OFF_AXIS) - arm.tips(spoilt[s][j][None], OFF_AXIS)
                )
                > 0.02
            ):
                break
        spoilt[s][j] = away
    fit = identify(spoilt, UR10E)
    assert {(outlier.series, outlier.touch) for outlier in fit.outliers} == {(0, 3), (2, 17)}
    assert all(0.018 < outlier.distance < 0.022 for outlier in fit.outliers)
    assert any("series 1, touch 4" in line for line in fit.warnings)
    assert not clean.outliers
    q = np.vstack([*series, off])
    gap = fit.tips(q) - clean.tips(q)
    within("tips without two touches [m]", gap - gap.mean(axis=0), 3e-4)
    assert identify(spoilt, UR10E, method=MapFit(robust=False)).noise > 5.0 * fit.noise


def test_single_and_repeated_touches_are_said_and_left_out(series: list[Array], within):
    clean = identify(series, UR10E)
    more = [np.vstack([series[0], series[0][:5]]), *series[1:], series[0][:1] + 0.1]
    fit = identify(more, UR10E)
    assert any("series 1: 5 of 26 touches left out" in line for line in fit.warnings)
    assert any("series 4: left out, since a single touch" in line for line in fit.warnings)
    within("table", fit.arm.table - clean.arm.table, 1e-9)
    assert [len(distances) for distances in fit.residuals] == [26, 21, 21, 1]


def test_touches_of_another_arm_are_doubted():
    other = Arm.from_dh(UR10E * [1, 1.3, 0.6, 1] + [0.3, 0.05, 0.1, 0.2])
    fit = identify(touch(other, OFF_AXIS, np.random.default_rng(22)), UR10E)
    assert any("were not made with this arm" in line for line in fit.warnings)
    far = Arm.from_dh(UR10E + np.array([0.02, 0.01, 0.01, 0.02]) * (-1.0) ** np.arange(6)[:, None])
    fit = identify(touch(far, OFF_AXIS, np.random.default_rng(22)), UR10E)
    assert any(
        "far from the nominal one" in line and "the prior is limited" in line
        for line in fit.warnings
    )
    shuffled = [q[:, ::-1] for q in touch(Arm.from_dh(PAPER), OFF_AXIS, np.random.default_rng(23))]
    assert any(
        "nominal" in line or "were not made with this arm" in line
        for line in identify(shuffled, UR10E).warnings
    )


def test_too_few_touches_are_not_believed(series: list[Array]):
    fit = identify([series[0][:3]], UR10E)
    assert any("cannot be validated" in line for line in fit.warnings)
    assert fit.noise > 5e-5
    full = identify(series, UR10E)
    assert np.all(fit.sigma[:24] > 0.9 * np.minimum(full.sigma[:24], fit.estimate.prior[:24]))


def test_masks_hold_the_rest(series: list[Array]):
    fit = identify(series, UR10E, free=["a", "alpha2", "tcp"])
    changed = np.abs(fit.arm.table - Arm.from_dh(UR10E).table) > 0.0
    assert fit.names == ("a1", "a2", "alpha2", "a3", "a4", "a5", "a6", "tcp_x", "tcp_y", "tcp_z")
    assert not changed[:, [0, 1, 4]].any()
    assert changed[:, 3].tolist() == [False, True, False, False, False, False]


@pytest.mark.parametrize(("size", "each"), [(0.02, 2), (0.05, 1), (0.05, 2), (0.05, 6)])
def test_blunders_are_left_out_and_pull_no_more_than_noise(
    size: float, each: int, series: list[Array]
):
    """Large ones would have the evidence widen the prior until the arm shrinks to a point."""
    spoilt = [q.copy() for q in series]
    rng = np.random.default_rng(31)
    for q in spoilt:
        q[:each] += rng.normal(0.0, size, (each, q.shape[1]))
    clean, fit = identify(series, UR10E), identify(spoilt, UR10E)
    assert {(outlier.series, outlier.touch) for outlier in fit.outliers} == {
        (s, j) for s in range(3) for j in range(each)
    }
    gap = fit.tips(np.vstack(series)) - clean.tips(np.vstack(series))
    assert np.abs(gap - gap.mean(axis=0)).max() < 5.0 * clean.noise


def test_touches_of_heavy_tail_are_kept(series: list[Array]):
    rng = np.random.default_rng(33)
    heavy = [
        q + 3e-4 * rng.standard_t(3.0, (len(q), 1)) * rng.standard_normal(q.shape) for q in series
    ]
    assert not identify(heavy, UR10E).outliers


def test_intervals_hold_new_places_of_an_arm_with_errors_of_its_gears():
    covered = []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        eccentric = touch(Arm.from_dh(PAPER), OFF_AXIS, rng, points=7)
        phase = rng.uniform(0.0, 2.0 * np.pi, 6)
        eccentric = [q + 4e-4 * np.sin(q + phase) for q in eccentric]
        fit = identify(eccentric[:6], UR10E)
        p = fit.tips(eccentric[6])
        covered.append(np.mean(np.abs(p - p.mean(axis=0)) < fit.half_widths(eccentric[6])))
    assert np.mean(covered) > 0.9


def test_intervals_of_a_right_model_are_those_of_its_noise():
    touches = touch(Arm.from_dh(PAPER), OFF_AXIS, np.random.default_rng(34), points=6)
    fit = identify(touches, UR10E)
    assert 1.7 < np.quantile(fit.scores, 0.95) < 2.3
