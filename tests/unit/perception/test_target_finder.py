"""Several looks as one: their median, wherever each was taken from; and the covariance of a find in
W.
"""

from dataclasses import replace

import numpy as np
import pytest

from depth_scenes import look
from uuv.clouds.frames import camera_pose
from uuv.models.objects.targets import barrel
from uuv.perception.clouds.scan import Scan
from uuv.perception.finding.target_finder import Frame, KnownObjectFinder, fused, with_fused_frames
from uuv.perception.registration.identification import identify
from uuv.perception.registration.model_surface import ModelSurface
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import StateEstimate
from uuv.sim.interfaces.spatial import exp_so3, inverse, pose, readonly, transform_points

BARREL = barrel()
ZERO = np.zeros(3)
AT_REST = StateEstimate(
    time=0.0, X_WB=np.eye(4), v_WB_B=ZERO, w_WB_B=ZERO, a_WB_B=ZERO, q=ZERO, qd=ZERO, tau=ZERO
)
VIEW = camera_pose(np.array([0.2, -0.75, 0.85]))


def plane_from(X_WS: np.ndarray, noise: float, rng: np.random.Generator) -> Frame:
    """The plane z_W = 1 m, seen from `X_WS` by 120 x 90 pixels."""
    tangent_x, tangent_y = np.linspace(-0.4, 0.4, 120), np.linspace(-0.3, 0.3, 90)
    rays = np.stack([*np.meshgrid(tangent_x, tangent_y), np.ones((90, 120))], axis=-1)
    depth = (1.0 - X_WS[2, 3]) / (rays @ X_WS[2, :3]) + noise * rng.standard_normal((90, 120))
    scan = Scan(
        points=readonly(rays * depth[..., None]),
        tangent_x=readonly(tangent_x),
        tangent_y=readonly(tangent_y),
    )
    return Frame(scan=scan, X_WS=X_WS)


def test_median_of_looks_from_several_places(within):
    rng = np.random.default_rng(0)
    X = [
        pose(exp_so3(0.02 * rng.standard_normal(3)), 0.05 * rng.standard_normal(3))
        for _ in range(9)
    ]
    looks = [plane_from(X_plane, 0.0, rng) for X_plane in X]
    points_W = transform_points(X[-1], fused(looks).points.reshape(-1, 3))
    assert np.isfinite(points_W).all(axis=1).mean() > 0.9
    # half a pixel aside
    within("exact looks, off the plane [m]", np.nanmax(np.abs(points_W[:, 2] - 1.0)), 5e-3)
    noisy = [plane_from(X[-1], 0.01, rng) for _ in range(25)]
    error = fused(noisy).depth - fused(looks[-1:]).depth
    within(
        "median of 25 against 1.25 / 5 of the noise",
        np.nanstd(error) / (0.01 * 1.25 / 5.0) - 1.0,
        0.05,
    )


def test_what_few_looks_saw_is_left_out():
    rng = np.random.default_rng(0)
    looks = [plane_from(np.eye(4), 0.0, rng) for _ in range(5)]
    points = [np.array(frame.scan.points) for frame in looks]
    points[0][10, 10] *= 0.5  # something swam by
    for points_of in points[:4]:
        points_of[20, 20] = np.nan
    depth = fused(
        [
            replace(frame, scan=replace(frame.scan, points=p))
            for frame, p in zip(looks, points, strict=True)
        ]
    ).depth
    assert depth[10, 10] == looks[-1].scan.depth[10, 10]
    assert np.isnan(depth[20, 20])
    with pytest.raises(ConfigurationError, match="at least one"):
        fused([])


def test_all_looks_are_less_noisy_evidence_of_the_same_pose():
    rng = np.random.default_rng(0)
    looks = [
        Frame(scan=Scan.from_depth(look(BARREL, VIEW, rng)), X_WS=inverse(VIEW)) for _ in range(5)
    ]
    identification = identify(
        looks[-1].scan, ModelSurface.of(BARREL), VIEW[:3, 3] + 0.1, VIEW[:3, :3]
    )
    of_all = with_fused_frames(identification, looks)
    assert identification.evidence is not None
    assert of_all.evidence is not None
    assert with_fused_frames(identification, looks[:2]) is identification  # too few for a median
    assert np.array_equal(of_all.X_sensor_target, identification.X_sensor_target)
    true = np.array(Scan.from_depth(look(BARREL, VIEW, rng, noise=None)).depth)
    errors = [
        evidence_of.scan.depth[identification.evidence.mask] - true[identification.evidence.mask]
        for evidence_of in (identification.evidence, of_all.evidence)
    ]
    single, median = (1.48 * np.nanmedian(np.abs(error)) for error in errors)
    assert median < 0.75 * single  # 0.56 for normal errors
    assert (
        of_all.evidence.sensor.disparity_sigma
        < 0.6 * identification.evidence.sensor.disparity_sigma
    )


@pytest.mark.long
def test_covariance_is_that_of_the_errors_in_the_world(within):
    """Sixteen frames with drawn errors of the believed hull pose: mean NEES over its degrees of
    freedom 1, 16 % by chance; the hull's part is told apart from that of the registration.
    """
    rng = np.random.default_rng(3)
    sigma = np.array([3e-3, 2e-3, 1e-3])
    squares = []
    X_WT = pose(exp_so3([0.0, 0.0, 0.7]), [12.0, -7.0, -20.0])
    X_WB = X_WT @ inverse(VIEW)  # the camera at the hull's origin
    finder = KnownObjectFinder(BARREL, None, X_WT[:3, 3], X_WT[:3, :3], attitude_sigma=2e-3)
    for _ in range(16):
        wrong = pose(
            exp_so3(2e-3 * rng.standard_normal(3)), X_WB[:3, 3] + sigma * rng.standard_normal(3)
        )
        believed = pose(wrong[:3, :3] @ X_WB[:3, :3], wrong[:3, 3])
        estimate = replace(AT_REST, X_WB=believed, position_sigma=sigma)
        frame = replace(look(BARREL, VIEW, rng), X_BC=np.eye(4))
        target = finder.step(finder.init(), estimate, frame)[1]
        assert target is not None
        assert target.covariance is not None
        true = BARREL.symmetry.nearest_pose(X_WT, target.X_WT[:3, :3])
        squares.append(
            target.covariance.normalised_error(target.X_WT, true) / target.covariance.degrees
        )
        eigenvalues = np.linalg.eigvalsh(target.covariance.matrix - target.hull_covariance)
        assert eigenvalues[0] > -1e-12
        assert target.covariance.position_sigma > sigma[0]
    within("mean NEES over its degrees", np.mean(squares) - 1.0, 0.5)
