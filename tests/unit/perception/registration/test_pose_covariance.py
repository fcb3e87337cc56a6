"""Covariance of a pose: against a closed form, against the errors of many frames, and its free
directions.
"""

import numpy as np
import pytest
from scipy.stats import chi2

from depth_scenes import look
from uuv.clouds.frames import camera_pose
from uuv.models.objects.targets import barrel, named
from uuv.perception.clouds.scan import Scan
from uuv.perception.registration.identification import Identification, identify
from uuv.perception.registration.model_surface import ModelSurface
from uuv.perception.registration.pose_covariance import PoseCovariance
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import exp_so3, pose, transform_points

VIEW = camera_pose(np.array([0.3, -0.9, 0.6]))
FRAMES = 5


@pytest.fixture(scope="module")
def found() -> list[Identification]:
    """The manifold in several frames from one place, each with its own noise."""
    surface = ModelSurface.of(named("manifold"))
    frames = (
        look(surface.target, VIEW, np.random.default_rng(k), floor=False) for k in range(FRAMES)
    )
    return [
        identify(
            Scan.from_depth(frame), surface, transform_points(VIEW, surface.center), VIEW[:3, :3]
        )
        for frame in frames
    ]


def made(matrix: np.ndarray, free: np.ndarray) -> PoseCovariance:
    return PoseCovariance(matrix=matrix, free=free, center=np.zeros(3), radius=0.5, size_sigma=0.01)


def test_errors_are_as_large_as_it_says(found, within):
    """The errors from one place share their systematic part, so that the mean square is rougher
    than its chi-square.
    """
    squares = []
    for identification in found:
        assert identification.covariance is not None
        assert identification.covariance.degrees == 6
        squares.append(
            identification.covariance.normalised_error(identification.X_sensor_target, VIEW) / 6.0
        )
    # 0.7 measured
    within("log of the mean square over its expectation", np.log(np.mean(squares)), np.log(2.5))
    assert np.mean(np.array(squares) < chi2.isf(0.05, 6) / 6.0) > 0.7


def test_nearer_more_certain(found):
    surface = found[0].surface
    X = pose(p=0.6 * VIEW[:3, 3]) @ VIEW
    frame = look(surface.target, X, np.random.default_rng(0), floor=False)
    far = identify(Scan.from_depth(frame), surface, transform_points(X, surface.center), X[:3, :3])
    assert found[0].covariance is not None
    assert far.covariance is not None
    assert far.covariance.position_sigma > 1.3 * found[0].covariance.position_sigma


def test_symmetry_is_unbounded(within):
    surface = ModelSurface.of(barrel())
    frame = look(surface.target, VIEW, np.random.default_rng(0), floor=False)
    identification = identify(Scan.from_depth(frame), surface, VIEW[:3, 3], VIEW[:3, :3])
    covariance = identification.covariance
    assert covariance is not None
    assert covariance.degrees == 5
    assert np.isinf(covariance.rotation_sigma)
    assert np.isfinite(covariance.position_sigma)
    axis = identification.X_sensor_target[:3, 0]
    side = np.cross(axis, [0.0, 0.0, 1.0])
    assert np.isinf(covariance.sigma(covariance.center + 0.2 * side, np.cross(axis, side)))
    assert covariance.sigma(covariance.center, axis) < 0.005
    turned = identification.X_sensor_target @ pose(exp_so3([0.01, 0.0, 0.0]))
    within(
        "a turn about the axis is no error",
        covariance.normalised_error(identification.X_sensor_target, turned),
        1e-3,
    )


def test_closed_forms(within):
    matrix = np.diag([4.0, 1.0, 1.0, 0.25, 0.25, 9.0]) * 1e-6
    held = made(matrix, np.zeros((0, 6)))
    within("along x", held.sigma([0.0, 0.0, 0.0], [2.0, 0.0, 0.0]) - 2e-3, 1e-12)
    # A point 0.5 m = 1 radius aside on y moves along x by the rotation about z as well.
    within(
        "along x, aside", held.sigma([0.0, 0.5, 0.0], [1.0, 0.0, 0.0]) - np.sqrt(13.0) * 1e-3, 1e-12
    )
    within("position", held.position_sigma - 2e-3, 1e-12)
    within("rotation", held.rotation_sigma - 3e-3 / 0.5, 1e-12)
    moved = pose(p=[2e-3, 0.0, 0.0])
    within("one sigma", held.normalised_error(np.eye(4), moved) - 1.0, 1e-6)
    spin = np.zeros((1, 6))
    spin[0, 5] = 1.0
    free = made(np.diag([4.0, 1.0, 1.0, 0.25, 0.25, 0.0]) * 1e-6, spin)
    assert free.degrees == 5
    assert np.isinf(free.rotation_sigma)
    assert np.isinf(free.sigma([0.0, 0.5, 0.0], [1.0, 0.0, 0.0]))
    with pytest.raises(ConfigurationError, match="direction"):
        free.sigma([0.0, 0.0, 0.0], [0.0, 0.0, 0.0])


def test_the_chance_to_be_within_bounds_is_that_of_the_normal(within):
    """Monte Carlo of 4096 draws: 0.008 at most, one standard deviation 0.005."""
    sigma = 0.002
    covariance = np.zeros((6, 6))
    covariance[0, 0] = sigma**2
    within(
        "one direction",
        made(covariance, np.zeros((0, 6))).chance_within(2.0 * sigma, 0.1) - chi2.cdf(4.0, 1),
        0.012,
    )
    three = sigma**2 * np.diag([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    within(
        "in space",
        made(three, np.zeros((0, 6))).chance_within(2.0 * sigma, 0.1) - chi2.cdf(4.0, 3),
        0.02,
    )
    turn = sigma**2 * np.diag([0.0, 0.0, 0.0, 1.0, 0.0, 0.0])
    angle = 1.5 * sigma / 0.5
    within(
        "turned", made(turn, np.zeros((0, 6))).chance_within(0.1, angle) - chi2.cdf(1.5**2, 1), 0.02
    )
    assert made(np.zeros((6, 6)), np.zeros((0, 6))).chance_within(1e-6, 1e-6) == 1.0
