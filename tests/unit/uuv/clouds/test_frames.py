"""How scenes are seen: readings lie about the exact ones, and viewpoints at their range."""

import numpy as np
import pytest

from uuv.clouds.frames import (
    FOCAL,
    SENSORS,
    Camera,
    Imager,
    camera_pose,
    coarse_pose,
    meshed,
    viewpoint,
)
from uuv.models.meshes.closed_shells import box, moved
from uuv.models.objects.targets import barrel
from uuv.sim.interfaces.spatial import exp_so3, pose, transform_points
from uuv.sim.sensors.depth_camera import Optics
from uuv.sim.sensors.refraction import FlatPort, in_water

WALL = 1.3  # [m] depth of a wall's front
PORT = FlatPort()
BEHIND_PORT = Camera(
    optics=Optics(port=PORT, calibration=in_water(PORT, FOCAL, 400.0, move_center=True))
)


@pytest.mark.parametrize("sensor", [*SENSORS.values(), BEHIND_PORT], ids=[*SENSORS, "port"])
def test_readings_of_a_leaning_wall_lie_about_the_exact_ones(sensor: Camera | Imager, within, rng):
    """Behind a port the camera's frame is that of the calibration."""
    wall = box([6.0, 6.0, 0.4], np.array([0.0, 0.0, WALL + 0.2]))
    model = meshed([moved(wall, pose(exp_so3([0.1, 0.0, 0.0])))])
    off = sensor.readings(model, rng) - sensor.exact(model)
    assert np.isfinite(off).mean() > 0.9
    within("median [m]", np.nanmedian(off), 2e-3)
    assert np.nanmedian(sensor.look(model, rng).depth) == pytest.approx(WALL, abs=0.1)


def test_a_viewpoint_has_its_range_and_sees_the_origin_ahead(within):
    eye = viewpoint(1.7, np.sin(0.4), 2.1)
    assert np.linalg.norm(eye) == pytest.approx(1.7)
    assert np.arctan2(eye[2], np.hypot(*eye[:2])) == pytest.approx(0.4)
    X_CF = camera_pose(eye, roll=0.3)
    within("origin in C [m]", X_CF[:3, 3] - [0.0, 0.0, 1.7], 1e-12)


def test_a_coarse_pose_is_off_by_what_was_asked_for():
    target = barrel()
    X_CT = pose(exp_so3([0.3, -0.2, 1.1]), [0.1, -0.2, 1.4])
    approach, R = coarse_pose(
        target, X_CT, (0.2, np.array([3.0, 4.0, 0.0])), (0.5, np.array([0.0, 2.0, 0.0]))
    )
    off = approach - transform_points(X_CT, target.center)
    assert off == pytest.approx([0.12, 0.16, 0.0])
    turn = R @ X_CT[:3, :3].T
    assert turn == pytest.approx(exp_so3([0.0, 0.5, 0.0]))
