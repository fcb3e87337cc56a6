"""Pictures of a run made by hand: what they show, and what is refused in one line."""

from dataclasses import replace
from functools import cache
from types import MappingProxyType

import mujoco
import numpy as np
import pytest
from PIL import Image

from recorded_work import TIME, TRUTH, recorded
from uuv import models
from uuv.models.site import scenes
from uuv.models.vehicle import Vehicle
from uuv.sim.evaluation.bounds import Bounds
from uuv.sim.interfaces.errors import ConfigurationError, MissingLibraryError
from uuv.sim.interfaces.spatial import exp_so3, quat_wxyz_from_rotation
from uuv.sim.loop.recording import Recording, Series
from uuv.sim.reporting.scene import clip, run_scene
from uuv.sim.reporting.scene.clip import write_clip, write_still
from uuv.sim.reporting.scene.run_scene import PictureStyle, RunScene
from uuv.sim.reporting.scene.view import FOVY
from uuv.sim.reporting.scene.work import Work

STYLE = PictureStyle(width=192, height=108, gl="off", title="a run")


@cache
def model() -> mujoco.MjModel:
    return scenes.work_site(models.load("uuv_puma"), TRUTH.model, TRUTH.X_WT).compile()


@cache
def run() -> Recording:
    """Work with poses at every half second: the hull over the barrel, which it leaves at 8 s."""
    data, vehicle = mujoco.MjData(model()), Vehicle.of(model())
    times = np.arange(0.0, 10.0, 0.5)
    poses = []
    for time in times:
        away = 6.0 * max(time - 8.0, 0.0)
        at = vehicle.hull_qpos
        data.qpos[at : at + 3] = TRUTH.X_WT[:3, 3] + [0.2 + away, 0.1, 1.5]
        data.qpos[at + 3 : at + 7] = quat_wxyz_from_rotation(exp_so3([0.05, 0.1, 0.4]))
        mujoco.mj_kinematics(model(), data)
        poses.append(np.column_stack([data.xpos, data.xquat]).ravel())

    work = recorded(contact_normal=60.0 + np.where(TIME > 5.0, 2.5, 0.1)[:, None])
    current = np.tile([0.1, 0.2, 0.0], (len(times), 1))
    more = {
        "body_pose": Series(time=times, value=np.array(poses), unit="", labels=()),
        "current": Series(time=times, value=current, unit="m/s", labels=("x", "y", "z")),
    }
    return replace(work, series=MappingProxyType({**work.series, **more}))


def test_a_picture_has_the_size_asked_for_and_shows_the_vehicle():
    with RunScene(model(), run(), STYLE) as scene:
        picture = scene.picture(4.0)
        assert (picture.shape, picture.dtype) == ((108, 192, 3), np.uint8)
        assert scene.renderer == "rays"
    yellow = (picture[..., 0] > 1.5 * picture[..., 2]) & (picture[..., 1] > 90)
    assert yellow.mean() > 0.02  # its foam


def test_poses_are_those_of_the_kinematics():
    """Geoms are placed as MuJoCo places them, for pictures by OpenGL."""
    data, vehicle = mujoco.MjData(model()), Vehicle.of(model())
    data.qpos[vehicle.hull_qpos : vehicle.hull_qpos + 7] = [1.0, 2.0, -1.0, 0.9, 0.1, 0.3, -0.2]
    data.qpos[vehicle.qpos] = [0.3, -0.4, 0.5, 0.6, -0.7, 0.8]
    mujoco.mj_kinematics(model(), data)
    poses = np.column_stack([data.xpos, data.xquat]).reshape(1, -1)
    row = Series(time=TIME[:1], value=poses, unit="", labels=())
    placed = run_scene.Poses(
        model(), replace(run(), series=MappingProxyType({**run().series, "body_pose": row}))
    )
    placed.put(0)
    assert placed.data.geom_xpos == pytest.approx(data.geom_xpos)
    assert placed.data.geom_xmat == pytest.approx(data.geom_xmat)


def test_a_clip_has_its_frames_at_even_times(tmp_path):
    with RunScene(model(), run(), STYLE, (2.0, None)) as scene:
        times = scene.times(4)
        assert times == pytest.approx([2.0, 4.5, 7.0, 9.5])
        frames = list(scene.pictures(times))
    size = write_clip(tmp_path / "clip.webp", frames, 10.0)
    assert size == (tmp_path / "clip.webp").stat().st_size
    with Image.open(tmp_path / "clip.webp") as image:
        assert (image.size, getattr(image, "n_frames", 1)) == ((192, 108), 4)
        image.seek(3)
        shown = np.asarray(image.convert("RGB")).astype(float)
    assert abs(shown - frames[3]).mean() < 12.0 < abs(shown - frames[0]).mean()


def test_the_camera_stays_while_the_work_does_and_follows_the_hull_away():
    with RunScene(model(), run(), STYLE) as scene:
        views = [scene.view(time) for time in (1.0, 3.0, 9.5)]
    assert views[0] is views[1]
    assert np.linalg.norm(views[2].lookat_W - views[0].lookat_W) > 1.0


def test_an_object_is_in_view_where_no_tool_works():
    """Without a commanded tip the barrel is seen with the hull above it."""
    nowhere = {"p_command": replace(run()["p_command"], value=np.full((len(TIME), 3), np.nan))}
    flown = replace(run(), series=MappingProxyType({**run().series, **nowhere}))
    with RunScene(model(), flown, STYLE, (0.0, 5.0)) as scene:
        view = scene.view(1.0)
        assert not len(scene.work.time)
        assert not scene.work.readout(1.0).touching  # nor is there a tool to be seen from near
    across, down, ahead = view.axes_W
    at = TRUTH.X_WT[:3, 3] - view.eye_W
    assert abs(at @ down) < 0.9 * (at @ ahead) * np.tan(np.radians(0.5 * FOVY))
    assert abs(at @ across) < 0.9 * (at @ ahead) * np.tan(np.radians(0.5 * FOVY))


def test_the_path_is_coloured_by_the_error_and_thin_where_it_is_still_to_be_worked():
    work = Work.of(run())
    good, bad = work.path(4.0, 3.0), work.path(9.9, 3.0)
    thick = [mark.radius > 0.006 for mark in good]
    assert thick == sorted(thick, reverse=True)
    assert 0.3 < np.mean(thick) < 0.5  # 4 s of 10
    red, green, _ = np.array([mark.colour for mark in bad[-5:]]).mean(axis=0)
    assert red > 1.5 * green
    red, green, _ = np.array([mark.colour for mark in bad[15:20]]).mean(axis=0)
    assert green > 2.0 * red


def test_the_colours_are_of_the_bounds_of_the_run():
    assert STYLE.judged_by(Bounds(force_error_rms=0.5)).error_scale == 0.5
    assert STYLE.judged_by(None) == STYLE
    with (
        RunScene(model(), run(), STYLE) as usual,
        RunScene(model(), run(), STYLE.judged_by(Bounds(force_error_rms=60.0))) as wide,
    ):
        assert usual.error_scale == Bounds().force_error_rms
        assert not np.array_equal(usual.picture(9.0), wide.picture(9.0))


def test_arrows_are_as_long_as_forces_and_current_are_large():
    scene_view = run_scene.CameraView(np.zeros(3), 5.0, 40.0, -20.0)
    work = Work.of(run())
    set_mark, felt = work.forces(4.0, scene_view)
    pushed = set_mark.end_W - set_mark.start_W
    assert pushed / np.linalg.norm(pushed) == pytest.approx(-TRUTH.X_WT[:3, 2])
    assert np.linalg.norm(felt.end_W - felt.start_W) == pytest.approx(np.linalg.norm(pushed))
    arrow = work.current(4.0, scene_view)[0]
    assert (arrow.end_W - arrow.start_W) / 0.3 == pytest.approx([1.0, 2.0, 0.0])
    readout = work.readout(4.0)
    assert (readout.set_force, readout.felt, readout.phase) == (60.0, 60.0, "work")
    assert readout.current == pytest.approx(np.hypot(0.1, 0.2))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"width": 20}, r"width of a picture \[px\]: must be a whole number in 64..4096, got 20"),
        ({"height": 9999}, r"height of a picture \[px\]"),
        ({"gl": "maybe"}, "gl: allowed auto, on, off, got 'maybe'"),
        ({"error_scale": 0.0}, r"error_scale \[N\]"),
    ],
)
def test_a_style_out_of_range_is_refused(changes, message):
    with pytest.raises(ConfigurationError, match=message):
        PictureStyle(**changes)


def test_times_outside_the_run_are_refused():
    with pytest.raises(ConfigurationError, match=r"end \[s\]"):
        RunScene(model(), run(), STYLE, (0.0, 30.0))
    with pytest.raises(ConfigurationError, match=r"begin \[s\] is after end: 5 and 4"):
        RunScene(model(), run(), STYLE, (5.0, 4.0))
    with (
        RunScene(model(), run(), STYLE, (1.0, 2.0)) as scene,
        pytest.raises(ConfigurationError, match=r"time of a picture \[s\]"),
    ):
        scene.picture(10.5)


def test_the_end_of_a_clip_may_be_that_of_the_run_and_a_still_lie_outside():
    with RunScene(model(), run(), STYLE, (1.0, 10.0)) as scene:  # the last poses are of 9.5 s
        assert scene.span == (1.0, 9.5)
        assert np.array_equal(scene.picture(10.0), scene.picture(9.5))
        assert scene.picture(0.5).shape == (108, 192, 3)
    with RunScene(model(), run(), STYLE, (8.0, 9.0)) as scene:
        assert scene.telling() == pytest.approx(5.0, abs=0.2)


def test_poses_that_lack_or_are_of_another_model_are_refused():
    bare = models.load("uuv_puma").compile()
    with pytest.raises(
        ConfigurationError, match=r"its poses are of 11 bodies, its scenario has 10"
    ):
        RunScene(bare, run(), STYLE)
    with pytest.raises(ConfigurationError, match="recorded in full"):
        RunScene(model(), recorded(), STYLE)
    lost = run()["body_pose"]
    nowhere = replace(lost, value=np.where(np.arange(20)[:, None] == 7, np.nan, lost.value))
    series = MappingProxyType({**run().series, "body_pose": nowhere})
    with pytest.raises(ConfigurationError, match="a recorded pose is not finite"):
        RunScene(model(), replace(run(), series=series), STYLE)


def test_without_opengl_it_is_said_and_drawn_by_rays(monkeypatch, capsys):
    def no_gl(*_: object, **__: object) -> None:
        raise RuntimeError("no display\nfor 3 reasons")

    monkeypatch.setattr(mujoco, "Renderer", no_gl)
    with RunScene(model(), run(), replace(STYLE, gl="auto")) as scene:
        assert scene.renderer == "rays"
    said = capsys.readouterr().err
    assert "no OpenGL here: no display for 3 reasons: pictures by ray casting" in said
    with pytest.raises(MissingLibraryError, match="no OpenGL here"):
        RunScene(model(), run(), replace(STYLE, gl="on"))


def test_files_of_other_kinds_and_clips_too_large_are_refused(tmp_path, rng, monkeypatch):
    noise = [rng.integers(0, 255, (90, 160, 3), dtype=np.uint8) for _ in range(3)]
    monkeypatch.setattr(clip, "MOST_BYTES", 2000)
    with pytest.raises(ConfigurationError, match=r"at the lowest quality, 0.002 MB allowed"):
        write_clip(tmp_path / "clip.webp", noise, 15.0)
    assert not list(tmp_path.iterdir())
    with pytest.raises(ConfigurationError, match=r"clip: must be a file \*.webp, got 'clip.gif'"):
        write_clip(tmp_path / "clip.gif", noise[:2], 15.0)
    with pytest.raises(ConfigurationError, match=r"still: must be a file \*.png, \*.webp, \*.jpg"):
        write_still(tmp_path / "still", noise[0])
    with pytest.raises(ConfigurationError, match="still: there is no folder"):
        write_still(tmp_path / "nowhere" / "still.png", noise[0])
