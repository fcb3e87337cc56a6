"""A framed view holds all points, and is no farther away than that takes."""

import numpy as np
import pytest

from uuv.sim.reporting.scene.view import FOVY, CameraView

ASPECT = 16.0 / 9.0


@pytest.mark.parametrize(("azimuth", "elevation"), [(20.0, -15.0), (-140.0, -40.0)])
def test_points_fill_the_picture_and_stay_in_it(azimuth: float, elevation: float, rng):
    points = rng.uniform([-2.0, 0.5, -3.0], [1.0, 1.5, -1.0], (50, 3))
    view = CameraView.framing(points, azimuth, elevation, ASPECT, fill=0.8)
    across, down, ahead = view.axes_W
    x, y, z = ((points - view.eye_W) @ axis for axis in (across, down, ahead))
    half = np.tan(np.radians(0.5 * FOVY))
    shares = np.array([abs(x / z) / (half * ASPECT), abs(y / z) / half])
    assert 0.78 < shares.max() < 0.84


def test_rays_go_through_the_middle_of_the_pixels():
    view = CameraView(np.array([0.3, -0.2, 1.0]), 2.0, 35.0, -20.0)
    rays = view.rays_W(9, 15)
    across, down, ahead = view.axes_W
    assert rays[4, 7] == pytest.approx(ahead)
    assert rays[0, 7] @ down < 0.0 < rays[4, 14] @ across
    assert rays @ ahead == pytest.approx(np.ones((9, 15)))
