"""Pictures without OpenGL show what is where, as a pinhole camera does."""

import mujoco
import numpy as np
import pytest

from uuv.sim.reporting.ray_picture import RayPicture

BALL = """
<mujoco><visual><global fovy="40"/></visual><worldbody>
<body name="ball" pos="1 2 3"><geom size=".5" rgba="1 0 0 1"/></body>
<body name="hidden" pos="1 2 3"><geom size=".6" rgba="0 1 0 0"/></body>
</worldbody></mujoco>
"""


@pytest.mark.parametrize(("azimuth", "elevation"), [(0.0, 0.0), (130.0, -25.0)])
def test_ball_is_as_large_and_as_far_as_it_should_be(azimuth: float, elevation: float, within):
    model = mujoco.MjModel.from_xml_string(BALL)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    camera = mujoco.MjvCamera()
    camera.lookat[:] = [1.0, 2.0, 3.0]
    camera.distance = 4.0
    camera.azimuth = azimuth
    camera.elevation = elevation
    picture, depth = RayPicture(model, 201, 301).render(data, camera)
    within("depth of the ball's nearest point [m]", abs(depth[100, 150] - 3.5), 2e-3)
    covered = np.isfinite(depth)
    angle = np.arcsin(0.5 / 4.0)
    radius = np.tan(angle) / np.tan(np.radians(20.0)) * 100.5  # [px]
    within("area of the ball, share", abs(covered.sum() / (np.pi * radius**2) - 1.0), 0.02)
    rows, columns = np.nonzero(covered)
    assert [rows.mean(), columns.mean()] == pytest.approx([100.0, 150.0], abs=0.2)
    assert not picture[~covered].any()
    assert picture[covered][:, 0].min() > 60
    assert not picture[..., 1:].any()  # red: what is transparent is not drawn
    upper, lower = (
        picture[rows_of][covered[rows_of]].mean() for rows_of in (slice(0, 90), slice(111, 201))
    )
    assert upper > lower  # the light is above
