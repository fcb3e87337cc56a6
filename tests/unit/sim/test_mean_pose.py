"""Covariance of a pose with free twists, its change of frame, and the mean of several estimates."""

import numpy as np
import pytest

from uuv.sim.interfaces.messages import Target, ToolPath
from uuv.sim.interfaces.pose_covariance import PoseCovariance, mean_pose
from uuv.sim.interfaces.spatial import Array, exp_so3, pose, readonly, transform_points

RADIUS = 0.5  # [m]
NONE = np.zeros((0, 6))
AXIS = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])  # a turn about z


def drawn(
    rng: np.random.Generator, free: Array = NONE, center: Array | None = None
) -> PoseCovariance:
    """A random covariance of a millimetre or so, 0 along `free`."""
    L = 1e-3 * rng.normal(size=(6, 6))
    held = np.eye(6) - free.T @ free
    middle = np.zeros(3) if center is None else center
    matrix = held @ (L @ L.T + 1e-7 * np.eye(6)) @ held
    return PoseCovariance(
        matrix=matrix, free=free, same=free, center=middle, radius=RADIUS, size_sigma=np.inf
    )


def moved(X: Array, covariance: PoseCovariance, twist: Array) -> Array:
    """Pose (4, 4) moved by a twist (6,) about the centre of its covariance."""
    R = exp_so3(twist[3:] / RADIUS)
    c = covariance.center
    return pose(R @ X[:3, :3], c + twist[:3] + R @ (X[:3, 3] - c))


def test_sigma_is_the_same_in_every_frame(rng, within):
    covariance = drawn(rng, AXIS)
    X = pose(exp_so3(rng.normal(size=3)), [40.0, -25.0, -12.0])
    in_W = covariance.in_frame(X)
    points = rng.normal(size=(5, 3))
    way = np.array([0.0, 0.0, 1.0])
    here = [covariance.sigma(p, way) for p in points]
    in_world = [in_W.sigma(p, X[:3, :3] @ way) for p in transform_points(X, points)]
    within("sigma [m]", np.array(here) - in_world, 1e-13)
    assert min(here) > 1e-5
    assert np.isinf(in_W.rotation_sigma)
    assert np.isfinite(in_W.position_sigma)


def test_error_of_the_carrier_is_what_moving_it_does(rng, within):
    """The covariance of 20 000 drawn errors of the carrier's pose, against the stated one: 1 % by
    chance.
    """
    covariance = drawn(rng, center=np.array([1.0, 2.0, -3.0]))
    p_WB = np.array([0.0, 1.0, -2.0])
    stated = covariance.of_carrier(p_WB, [1e-3, 2e-3, 3e-3], 1e-3)
    X = pose(np.eye(3), [1.2, 2.1, -3.0])
    twists = []
    for move, turn in zip(
        rng.normal(size=(20000, 3)) * [1e-3, 2e-3, 3e-3],
        1e-3 * rng.normal(size=(20000, 3)),
        strict=True,
    ):
        R = exp_so3(turn)
        wrong = pose(R, p_WB + move - R @ p_WB) @ X
        twists.append(covariance.twist(X, wrong))
    within(
        "covariance, relative", (np.cov(np.array(twists).T) - stated) / np.abs(stated).max(), 0.06
    )


def test_mean_is_least_squares_and_its_covariance_the_inverse_of_the_information(rng):
    """NEES of 400 means of four finds with covariances of their own: 6 in the mean, 0.17 by
    chance.
    """
    squares = []
    for _ in range(400):
        covariances = [drawn(rng) for _ in range(4)]
        X = pose(exp_so3(rng.normal(size=3)), 0.1 * rng.normal(size=3))
        poses = [moved(X, c, rng.multivariate_normal(np.zeros(6), c.matrix)) for c in covariances]
        X_mean, covariance, _ = mean_pose(poses, covariances, np.zeros((6, 6)))
        information = sum(c.information for c in covariances)
        stated = np.linalg.inv(covariance.matrix)
        assert np.linalg.eigvalsh(stated)[-1] <= 1.01 * np.linalg.eigvalsh(information)[-1]
        squares.append(covariance.normalised_error(X_mean, X))
    assert 4.0 < np.mean(squares) < 7.0  # below 6: scatter beyond what is stated widens it


def test_an_error_that_all_share_does_not_shrink(rng):
    common = np.diag([1e-6] * 6)
    covariances = [drawn(rng).plus(common) for _ in range(9)]
    _, covariance, scatter = mean_pose([np.eye(4)] * 9, covariances, common)
    assert scatter == 0.0
    assert np.linalg.eigvalsh(covariance.matrix)[0] >= 0.999e-6


def test_free_twist_has_no_weight_and_stays(rng, within):
    """Turned barrels: the mean stays at the last one's angle, and a find that sees the angle
    decides it.
    """
    last = drawn(rng, AXIS)
    others = [moved(np.eye(4), last, np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.2 * RADIUS])), np.eye(4)]
    X, covariance, _ = mean_pose(others, [drawn(rng, AXIS), last], np.zeros((6, 6)))
    within("pose", X - np.eye(4), 1e-12)
    within("free", np.abs(covariance.free) - AXIS, 1e-12)
    X, covariance, _ = mean_pose(others, [drawn(rng), last], np.zeros((6, 6)))
    assert covariance.degrees == 6
    within("angle [rad]", np.arctan2(X[1, 0], X[0, 0]) - 0.2, 2e-2)


def test_distance_counts_what_both_hold(rng, within):
    first = drawn(rng, AXIS)
    other = drawn(rng)
    turned = moved(np.eye(4), first, np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.05]))
    within("turned about a free axis", first.distance(np.eye(4), other, turned), 1e-9)
    off = rng.multivariate_normal(np.zeros(6), first.matrix + other.matrix, size=2000)
    square = [
        first.distance(np.eye(4), other, moved(np.eye(4), first, twist)) ** 2 for twist in off
    ]
    # chi-square with 5 degrees over 5: 1.4 % by chance
    within("mean square", np.mean(square) - 1.0, 0.1)


def test_path_around_a_barrel_does_not_count_the_turn_about_its_axis(rng):
    """The axis moves every point along the path; what nobody can tell does not count, a slide that
    is free does.
    """
    angle = np.linspace(0.0, 2.0, 30)
    p = np.column_stack([0.3 * np.cos(angle), 0.3 * np.sin(angle), 0.0 * angle])
    path = ToolPath(
        s=0.3 * angle,
        p=p,
        z=-p / 0.3,
        x=np.cross([0.0, 0.0, 1.0], p / 0.3),
        on_scan=np.zeros(30, dtype=bool),
    )

    def sigma(covariance: PoseCovariance) -> Array:
        fields_of = {"time": 0.0, "accepted": True, "check_m": 0.0, "range_m": 1.0, "reason": ""}
        sigmas = Target(X_WT=np.eye(4), path=path, covariance=covariance, **fields_of).path_sigma
        assert sigmas is not None
        return sigmas

    assert np.isfinite(sigma(drawn(rng, AXIS))).all()
    along = np.array([[0.0, 0.0, 1.0, 0.0, 0.0, 0.0]])  # a barrel without its ends in view
    slides = drawn(rng, np.vstack([AXIS, along]))
    slides = PoseCovariance(
        matrix=slides.matrix,
        free=slides.free,
        same=AXIS,
        center=slides.center,
        radius=RADIUS,
        size_sigma=1.0,
    )
    sigmas_of_slides = sigma(slides)
    assert np.isfinite(sigmas_of_slides[:, :2]).all()
    assert np.isinf(sigmas_of_slides[:, 2]).all()
    assert slides.free_in_words == (
        "a turn about (0.00, 0.00, 1.00), a slide along (0.00, 0.00, 1.00)"
    )


def test_ellipsoid_holds_95_percent(rng, within):
    covariance = drawn(rng)
    half, axes = covariance.ellipsoid()
    errors = rng.multivariate_normal(np.zeros(3), covariance.matrix[:3, :3], size=20000)
    inside = np.sum((errors @ axes / half) ** 2, axis=1) <= 1.0
    within("share", inside.mean() - 0.95, 0.01)
    assert np.linalg.det(axes) == pytest.approx(1.0)


def test_matrix_stays_readonly(rng):
    covariance = drawn(rng).in_frame(np.eye(4)).plus(readonly(np.eye(6)))
    assert not covariance.matrix.flags.writeable
