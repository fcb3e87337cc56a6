"""Sensitivity: coefficients against regression and closed forms, intervals that hold, and ranks
alone that count.
"""

import numpy as np
import pytest
from scipy.stats import norm, rankdata, spearmanr

from uuv.campaigns.sensitivity import Factor, factors_of, sensitivity, shifts, worst_ratio


def columns(*values: np.ndarray) -> list[Factor]:
    return [Factor(f"x{i}", column[:, None]) for i, column in enumerate(values)]


def residual(of: np.ndarray, others: np.ndarray) -> np.ndarray:
    """What the least-squares regression on `others`, with a constant, leaves."""
    design = np.column_stack([np.ones(len(of)), others])
    return of - design @ np.linalg.lstsq(design, of, rcond=None)[0]


def test_coefficients_are_those_of_the_regressions(rng, within):
    x = rng.normal(size=(60, 4))
    x[:, 3] += x[:, 0]
    y = x[:, 0] - 2.0 * x[:, 1] + rng.normal(size=60)
    effects = sensitivity(columns(*x.T), y, rng, 10)
    assert effects is not None
    ranks = rankdata(x, axis=0)
    response = rankdata(y)
    for i in range(4):
        others = np.delete(ranks, i, axis=1)
        expected = np.corrcoef(residual(ranks[:, i], others), residual(response, others))[0, 1]
        within(f"x{i}", effects.coefficient[i] - expected, 1e-8)  # measured 5e-10, the ridge
    left = residual(response, ranks)
    within("R^2", effects.explained - (1.0 - left @ left / (60 * response.var())), 1e-8)


def test_one_parameter_alone_gives_spearman(rng, within):
    x = rng.normal(size=50)
    y = np.exp(x) + rng.normal(size=50)
    effects = sensitivity(columns(x), y, rng, 10)
    assert effects is not None
    within("r", effects.coefficient[0] - spearmanr(x, y)[0], 1e-8)
    within("p against the t distribution", effects.p[0] / spearmanr(x, y)[1] - 1.0, 1e-6)


def test_monotone_maps_of_parameters_and_response_change_nothing(rng):
    x = rng.uniform(0.1, 2.0, size=(50, 3))
    y = x[:, 0] + rng.normal(size=50)
    plain = sensitivity(columns(*x.T), y, np.random.default_rng(0))
    bent = sensitivity(
        columns(np.log(x[:, 0]), x[:, 1] ** 3, -1.0 / x[:, 2]),
        np.exp(3.0 * y),
        np.random.default_rng(0),
    )
    assert plain is not None
    assert bent is not None
    for name in ("coefficient", "low", "high", "p", "place"):
        assert np.array_equal(getattr(plain, name), getattr(bent, name)), name


def test_strong_effects_come_first_with_their_signs(rng):
    x = rng.uniform(size=(200, 7))
    y = np.exp(4.0 * x[:, 2]) - 9.0 * x[:, 5] + rng.normal(size=200)
    effects = sensitivity(columns(*x.T), y, rng, 300)
    assert effects is not None
    assert set(effects.ranking[:2]) == {2, 5}
    assert effects.low[2] > effects.null[2]
    assert effects.high[5] < -effects.null[5]
    assert effects.place[[2, 5]].max() == 2
    assert 0.7 < effects.explained_by_first <= effects.explained


def test_a_parameter_without_effect_is_told_as_one_at_the_stated_rate():
    """Of 5 idle parameters in each of 80 tables: the intervals hold 0, the coefficients are below
    the null level.
    """
    rng = np.random.default_rng(1)
    held = []
    below = []
    for _ in range(80):
        x = rng.uniform(size=(100, 6))
        effects = sensitivity(columns(*x.T), x[:, 0] + rng.normal(size=100), rng, 200)
        assert effects is not None
        held += ((effects.low <= 0.0) & (effects.high >= 0.0))[1:].tolist()
        below += (np.abs(effects.coefficient) <= effects.null)[1:].tolist()
    slack = norm.ppf(0.999) * np.sqrt(0.95 * 0.05 / len(held))  # of a share of 400: 0.034
    assert abs(np.mean(below) - 0.95) < slack
    assert np.mean(held) > 0.95 - slack  # measured 0.93


def test_categories_are_one_parameter(rng, within):
    """Of three categories the squared coefficient is the share eta^2 of the ranks' variance between
    them.
    """
    kinds = np.array(["a", "b", "c"])[rng.integers(3, size=90)]
    y = rng.normal(size=90) + 2.0 * (kinds == "b")
    (factor,) = factors_of([{"kind": kind} for kind in kinds.tolist()])
    effects = sensitivity([factor], y, rng, 50)
    assert effects is not None
    rank = rankdata(y)
    between = sum(
        (kinds == kind).sum() * (rank[kinds == kind].mean() - rank.mean()) ** 2 for kind in "abc"
    )
    within("eta^2", effects.coefficient[0] ** 2 - between / (90 * rank.var()), 1e-8)
    assert effects.low[0] > effects.null[0]


def test_what_becomes_a_parameter():
    draws = [
        {"v": [3.0, 4.0, 0.0], "seed": 1, "same": 2.0, "path": "a", "x": 1},
        {"v": [0.0, 0.0, 1.0], "seed": 2, "same": 2.0, "path": "b", "x": 2.5},
        {"path": "a"},
    ]
    columns_of = {factor.name: factor.columns[:, 0] for factor in factors_of(draws)}
    assert list(columns_of) == ["v (length)", "v (x)", "v (y)", "v (z)", "path = b", "x"]
    assert columns_of["v (length)"][:2].tolist() == [5.0, 1.0]
    assert np.isnan(columns_of["v (length)"][2])
    assert columns_of["path = b"].tolist() == [0.0, 1.0, 0.0]


def test_the_adjusted_share_counts_columns_and_the_constant(rng, within):
    """Of n runs and k columns, n - k - 1 are left to the residual: 1 - (1 - R^2) (n - 1) / (n - k -
    1).
    """
    x = rng.normal(size=(40, 5))
    effects = sensitivity(columns(*x.T), x[:, 0] + rng.normal(size=40), rng, 10)
    assert effects is not None
    within("adjusted", effects.adjusted - (1.0 - (1.0 - effects.explained) * 39.0 / 34.0), 1e-12)


def test_places_count_from_the_strongest(rng):
    x = rng.normal(size=(200, 4))
    effects = sensitivity(
        columns(*x.T), 9.0 * x[:, 2] - 3.0 * x[:, 0] + rng.normal(size=200), rng, 200
    )
    assert effects is not None
    assert (effects.place[2].tolist(), effects.place[0].tolist()) == ([1, 1], [2, 2])
    assert effects.place[[1, 3]].min() == 3


def test_too_few_runs_give_none(rng):
    x = rng.normal(size=(7, 3))
    assert sensitivity(columns(*x.T), x[:, 0], rng) is None
    assert sensitivity(columns(rng.normal(size=30)), np.ones(30), rng) is None
    assert sensitivity([], np.ones(30), rng) is None


@pytest.mark.parametrize(
    ("values", "wanted"),
    [
        ({"a": 1.0, "b": 0.0}, 0.5),
        ({"a": 3.0, "b": 0.0}, 1.5),
        ({"a": 1.0, "b": 0.1}, np.inf),
        ({"a": 1.0, "b": None}, np.inf),
    ],
)
def test_the_worst_ratio(values, wanted):
    assert worst_ratio(values, {"a": 2.0, "b": 0.0}) == wanted


def test_shifts_in_closed_form():
    """The five largest of ten values: 1 of 252 divisions is as extreme, on either side."""
    x = np.arange(10.0)
    (shift,) = shifts(columns(x), [["late"] if x_of_run >= 5.0 else [] for x_of_run in x])
    assert (shift.reason, shift.runs) == ("late", 5)
    assert shift.median_rank == pytest.approx(7.0 / 9.0)
    assert shift.p == pytest.approx(2.0 / 252.0)
    assert shifts(columns(x), [["late"] if x_of_run >= 8.0 else [] for x_of_run in x]) == []
