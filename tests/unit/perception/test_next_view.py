"""The next view is where the model predicts the most information, or the clearest difference of two
poses.
"""

from dataclasses import replace

import numpy as np
import pytest

from depth_scenes import look
from uuv.clouds.frames import camera_pose
from uuv.models.objects.targets import barrel
from uuv.perception.clouds.scan import Scan
from uuv.perception.finding.next_view import (
    predicted_information,
    predicted_sigma,
    ranked_views,
    telling_nats,
    views_around,
)
from uuv.perception.registration.identification import Identification, identify
from uuv.perception.registration.model_surface import ModelSurface
from uuv.perception.registration.pose_search import Hypothesis
from uuv.sim.interfaces.spatial import Array, inverse, pose, transform_points

VIEW = camera_pose(np.array([0.2, -1.0, 0.7]))
BARREL = ModelSurface.of(barrel())
CENTER = transform_points(VIEW, BARREL.center)
UP = VIEW[:3, 2]


@pytest.fixture(scope="module")
def found() -> Identification:
    scan = Scan.from_depth(look(barrel(), VIEW, np.random.default_rng(0), floor=False))
    return identify(scan, BARREL, CENTER, VIEW[:3, :3])


def test_views_keep_range_and_aim(within):
    for X in views_around(CENTER, UP):
        at = transform_points(inverse(X), CENTER)
        within("centre in the sensor's frame [m]", at - CENTER, 1e-12)
        assert np.linalg.norm(X[:3, 3]) > 0.2


def test_prediction_for_the_same_view_is_what_the_fit_had(found):
    """Standard deviations of the same look again, against those of the covariance: within a factor
    of three.
    """
    assert found.covariance is not None
    held = np.linalg.svd(found.covariance.free)[2][1:]  # but for the turn about the axis
    of_fit, of_view = (
        np.sqrt(np.linalg.eigvalsh(held @ matrix @ held.T))
        for matrix in (
            found.covariance.matrix,
            np.linalg.inv(predicted_information(found, np.eye(4))),
        )
    )
    assert np.all(of_view < 3.0 * of_fit)
    assert np.all(of_fit < 3.0 * of_view)


def test_view_from_far_aside_adds_more_than_the_same_again(found):
    aside = views_around(CENTER, UP, (0.8,))[0]
    assert predicted_sigma(found, aside) < predicted_sigma(found, np.eye(4))


def screened(found: Identification, side: float) -> Identification:
    """The find, with a screen before the object that hides it from views on one side of the
    sensor.
    """
    assert found.evidence is not None
    points = np.array(found.evidence.scan.points)
    x = np.linspace(-0.5, 0.5, points.shape[1])
    hidden = side * x > 0.0
    rays = found.evidence.scan.rays
    points[:, hidden] = 0.5 * rays[:, hidden]  # 0.5 m ahead
    scan = replace(found.evidence.scan, points=points)
    # nothing else is known
    return replace(found, covariance=None, evidence=replace(found.evidence, scan=scan))


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_view_past_what_stands_before_the_object_is_preferred(found, side):
    """A screen over one half of the picture: from its side nothing more would be seen."""
    views = views_around(CENTER, UP, (-0.5, 0.5))
    best = views[ranked_views(screened(found, side), views)[0]]
    assert best[0, 3] * side < 0.0


def test_rival_is_told_where_it_looks_different(found):
    """A rival 10 mm nearer is told from ahead, less from 80 deg aside, where it differs along the
    surface.
    """

    def rival(way: Array) -> Identification:
        X = pose(p=1e-2 * way) @ found.X_sensor_target
        best = Hypothesis(X_sensor_target=found.X_sensor_target, log_likelihood=0.0)
        return replace(
            found,
            accepted=False,
            hypotheses=(best, Hypothesis(X_sensor_target=X, log_likelihood=-1.0)),
        )

    ahead = np.array([0.0, 0.0, 1.0])
    views = [views_around(CENTER, UP, (1.4,))[0], np.eye(4)]
    both = rival(ahead)
    nats = [telling_nats(both, both.hypotheses[1].X_sensor_target, X) for X in views]
    assert nats[1] > 1.3 * nats[0] > 0.0
    assert ranked_views(both, views) == [1, 0]


def test_nothing_to_go_by(found):
    assert ranked_views(replace(found, evidence=None), [np.eye(4)]) == []
    assert ranked_views(found, []) == []
