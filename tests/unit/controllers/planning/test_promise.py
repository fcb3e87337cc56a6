"""The chance to keep a path: closed forms, order, and simulated errors of the stated size."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.special import ndtr

from at_rest import at_rest
from uuv.controllers.planning.promise import NAVIGATION_TIME, PromiseLimits, promise
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import Promise, StateEstimate, Target, ToolPath
from uuv.sim.interfaces.pose_covariance import PoseCovariance
from uuv.sim.interfaces.spatial import Array

N = 21
ONCE = 0.5 * NAVIGATION_TIME  # [s] of work in which the hull's place errs once


def target(sigma: float, free: Array | None = None) -> Target:
    """A straight path along x on an object whose place is known to `sigma` [m] in every direction,
    without rotation.
    """
    p = np.column_stack([np.linspace(-0.1, 0.1, N), np.zeros((N, 2))])
    z = np.tile([0.0, 0.0, -1.0], (N, 1))
    x = np.tile([1.0, 0.0, 0.0], (N, 1))
    path = ToolPath(s=np.linspace(0.0, 0.2, N), p=p, z=z, x=x, on_scan=np.ones(N, dtype=bool))
    none = np.zeros((0, 6)) if free is None else free
    matrix = np.diag([sigma**2] * 3 + [0.0] * 3)
    covariance = PoseCovariance(
        matrix=matrix, free=none, center=np.zeros(3), radius=0.3, size_sigma=np.inf
    )
    return Target(
        time=0.0,
        X_WT=np.eye(4),
        accepted=True,
        check_m=0.0,
        range_m=1.0,
        reason="",
        path=path,
        covariance=covariance,
    )


def estimate(sigma: float) -> StateEstimate:
    return at_rest(position_sigma=np.full(3, sigma))


def chance(
    of_hull: float, of_object: float, duration: float = ONCE, tolerance: float = 3e-3
) -> float:
    promised = promise(estimate(of_hull), target(of_object), tolerance, duration)
    assert promised is not None
    return promised.chance


def within(sigma: float, tolerance: float = 3e-3) -> float:
    """Chance of one normal error."""
    return float(2.0 * ndtr(tolerance / sigma) - 1.0)


def test_one_error_of_either_kind_has_the_normal_chance_on_both_axes():
    # a step, by 512 quantiles
    assert chance(0.0, 2e-3) == pytest.approx(within(2e-3) ** 2, abs=4e-3)
    assert chance(2e-3, 0.0) == pytest.approx(within(2e-3) ** 2, rel=1e-9)
    assert chance(1.2e-3, 1.6e-3) == pytest.approx(within(2e-3) ** 2, abs=1e-3)


def test_a_longer_work_has_more_errors_of_the_hull_and_one_of_the_object():
    """Against a hundred thousand simulated works."""
    rng = np.random.default_rng(0)
    of_hull = 0.9e-3
    of_object = 0.7e-3
    looks = 20
    errors = of_object * rng.standard_normal((100_000, 1)) + of_hull * rng.standard_normal(
        (100_000, looks)
    )
    probability = float(np.mean(np.abs(errors).max(axis=1) < 3e-3)) ** 2
    assert chance(of_hull, of_object, looks * ONCE) == pytest.approx(probability, abs=6e-3)
    assert chance(0.0, 2e-3, looks * ONCE) == pytest.approx(chance(0.0, 2e-3), rel=1e-9)


def test_the_chance_falls_with_each_error_and_rises_with_the_tolerance():
    sigmas = np.linspace(1e-4, 3e-3, 12)
    assert np.all(np.diff([chance(s, 5e-4, 40.0) for s in sigmas]) <= 0.0)
    assert np.all(np.diff([chance(5e-4, s, 40.0) for s in sigmas]) <= 0.0)
    assert np.all(np.diff([chance(1e-3, 1e-3, 40.0, t) for t in sigmas]) >= 0.0)


def test_a_direction_in_which_the_object_can_slide_is_left_out():
    along = np.array([[1.0, 0.0, 0.0, 0.0, 0.0, 0.0]])
    promised = promise(estimate(2e-3), target(0.0, along), 3e-3, ONCE)
    assert promised is not None
    assert promised.chance == pytest.approx(within(2e-3), rel=1e-9)


def test_nothing_is_promised_without_a_covariance():
    assert promise(estimate(np.nan), target(1e-3), 3e-3, 40.0) is None
    assert promise(estimate(1e-3), replace(target(1e-3), covariance=None), 3e-3, 40.0) is None


def test_it_is_said_with_its_figures():
    promised = Promise(chance=0.973, tolerance=3e-3, navigation_sigma=6e-4, object_sigma=1.24e-3)
    assert str(promised) == (
        "path error < 3 mm: probability 97.3% (sigma: hull 0.6 mm, object 1.2 mm)"
    )


@pytest.mark.parametrize(
    ("limits", "named"),
    [
        ({"tolerance": 0.0}, "tolerance"),
        ({"least": 1.1}, "least"),
        ({"wanted": 1.5}, "wanted"),
        ({"most_thrust": 0.0}, "most_thrust"),
    ],
)
def test_bad_limits_are_named(limits: dict[str, Any], named: str):
    with pytest.raises(ConfigurationError, match=named):
        PromiseLimits(**limits)
