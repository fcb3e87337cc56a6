"""Pictures without OpenGL show what is where, as a pinhole camera does."""

import mujoco
import numpy as np
import pytest

from uuv.sim.reporting.scene.marks import Mark
from uuv.sim.reporting.scene.ray_picture import RayPicture
from uuv.sim.reporting.scene.sea import SeaLook
from uuv.sim.reporting.scene.view import FOVY, CameraView

BALL = """
<mujoco><worldbody>
<body name="ball" pos="1 2 3"><geom size=".5" rgba="1 0 0 1"/></body>
<body name="hidden" pos="1 2 3"><geom size=".6" rgba="0 1 0 0"/></body>
</worldbody></mujoco>
"""
MIDDLE = np.array([1.0, 2.0, 3.0])
DISTANCE, RADIUS = 4.0, 0.5  # [m]


def drawn(view: CameraView, *marks: Mark) -> np.ndarray:
    model = mujoco.MjModel.from_xml_string(BALL)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return RayPicture(model, 201, 301).render(data, view, SeaLook(model, DISTANCE), marks)


@pytest.mark.parametrize(("azimuth", "elevation"), [(0.0, 0.0), (130.0, -25.0)])
def test_ball_is_as_large_and_where_it_should_be(azimuth: float, elevation: float, within):
    picture = drawn(CameraView(MIDDLE, DISTANCE, azimuth, elevation)).astype(float)
    red = picture[..., 0] > picture[..., 2]  # the water is blue, and what is transparent not drawn
    tangent = np.tan(np.arcsin(RADIUS / DISTANCE)) / np.tan(np.radians(0.5 * FOVY))
    within("area of the ball, share", abs(red.sum() / (np.pi * (100.5 * tangent) ** 2) - 1.0), 0.03)
    rows, columns = np.nonzero(red)
    assert [rows.mean(), columns.mean()] == pytest.approx([100.0, 150.0], abs=0.5)
    upper, lower = (picture[..., 0][part][red[part]].mean() for part in (np.s_[:90], np.s_[111:]))
    assert upper > 1.2 * lower  # the light is above


def test_what_is_far_takes_the_colour_of_the_water():
    """The ball from ten times as far as the work of the scene: water, paler than from near."""
    near, far = (
        drawn(CameraView(MIDDLE, distance, 30.0, -10.0))[100, 150].astype(float)
        for distance in (DISTANCE, 10.0 * DISTANCE)
    )
    water = drawn(CameraView(MIDDLE, DISTANCE, 30.0, -10.0))[100, 5].astype(float)
    assert abs(far - water).max() < 0.4 * abs(near - water).max()
    assert near[0] > 2.0 * far[0]  # red goes first


def test_a_mark_is_drawn_in_its_colour_and_hidden_by_the_ball():
    view = CameraView(MIDDLE, DISTANCE, 0.0, 0.0)
    ahead = view.axes_W[2]
    ends = np.array([[0.0, -0.4, 0.0], [0.0, 0.4, 0.0]])
    before, behind = (
        drawn(view, Mark(start, end, 0.03, (0.0, 1.0, 0.0)))[100, 150]
        for start, end in (MIDDLE + side * ahead + ends for side in (-0.8, 0.8))
    )
    assert before[1] > 150
    assert before[1] > 2.0 * before[0]
    assert behind[0] > 2.0 * behind[1]


def test_a_model_without_anything_visible_is_water():
    model = mujoco.MjModel.from_xml_string(BALL.replace("1 0 0 1", "1 0 0 0"))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    view = CameraView(MIDDLE, DISTANCE, 0.0, 0.0)
    picture = RayPicture(model, 20, 30).render(data, view, SeaLook(model, DISTANCE)).astype(float)
    assert np.ptp(picture, axis=1).max() < 8.0  # it varies from above down
    assert (picture[..., 2] > picture[..., 0]).all()


def test_ground_has_a_shadow_under_the_ball():
    floor = BALL.replace("<worldbody>", '<worldbody><geom type="plane" size="4 4 .1" pos="0 0 2"/>')
    model = mujoco.MjModel.from_xml_string(floor)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    view = CameraView(np.array([1.0, 2.0, 2.0]), 5.0, 90.0, -60.0)
    picture = RayPicture(model, 90, 160).render(data, view, SeaLook(model, 5.0)).astype(float)
    ground = picture.sum(axis=2)
    assert np.percentile(ground, 99) > 1.8 * np.percentile(ground, 1)
    without = floor.replace('size=".5" rgba="1 0 0 1"', 'size=".5" rgba="1 0 0 0"')
    bare_model = mujoco.MjModel.from_xml_string(without)
    bare = (
        RayPicture(bare_model, 90, 160).render(data, view, SeaLook(bare_model, 5.0)).astype(float)
    )
    changed = abs(bare - picture).max(axis=2) > 20.0
    red = picture[..., 0] > 1.4 * picture[..., 1]
    assert (changed & ~red).sum() > 0.15 * red.sum()  # the shadow, beside the ball itself
