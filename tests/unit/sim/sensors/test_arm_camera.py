"""The camera on the arm: its errors have the stated covariance, keys are chained, and a lost view
ends the track.
"""

from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
import pytest

from experiments.navigation.arm_camera_errors import KeyCase
from experiments.navigation.arm_camera_fit import pairs_of, squared, to_toml
from experiments.navigation.fit_arm_camera import fit_arm_camera
from uuv.perception.navigation import surface_alignment
from uuv.sensors.rendered_arm_camera import RenderedArmCamera
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import SurfaceMotionMeasurement
from uuv.sim.interfaces.spatial import Array
from uuv.sim.sensors import arm_camera
from uuv.sim.sensors.arm_camera import (
    CELL,
    GRID,
    OBSERVED,
    ArmCamera,
    ErrorModel,
    Prediction,
    ViewConditions,
    fitted,
    predict,
)
from uuv.sim.sensors.textured_view import SmallStereo, Texture, Turbidity

SCENE = """
<mujoco>
  <worldbody>
    <body name="object" pos="0 0 -.2"><geom type="box" size="2 2 .2"/></body>
    <body name="hull"><freejoint/>
      <geom type="box" size=".1 .1 .1" pos="0 0 1"/>
      <body name="link"><site name="tip" euler="180 0 0"/></body>
    </body>
  </worldbody>
</mujoco>
"""
CLEAR = ViewConditions(texture=0.3, cloud_rate=0.0, scale=0.0)


@dataclass
class Truth:
    """True state that a sensor takes."""

    time: float
    xpos: Array
    xmat: Array
    q: Array


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(SCENE)


def truth(model: mujoco.MjModel, time: float, p: Array) -> Truth:
    """The tool at `p` [m]; the surface is z = 0."""
    data = mujoco.MjData(model)
    data.qpos[:3] = p
    mujoco.mj_kinematics(model, data)
    return Truth(time, data.xpos.copy(), data.xmat.copy(), np.zeros(0))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("pairs = 2086\n", "", "the file: pairs is missing"),
        (
            "pairs = 2086",
            "pairs = 2086\npears = 1",
            "the file has no 'pears'; .*did you mean pairs",
        ),
        ("pairs = 2086", "pairs = 2.5", "pairs: must be a whole number, at least 1, got 2.5"),
        ("common = 0.279", "common = 3.0", "common: must be at least 0 and at most 1, got 3.0"),
        ("common = 0.279", "common = nan", "common: must not be NaN"),
        ("bias = [-8.9e-06, ", "bias = [", r"bias \[m\]: must be 3 values"),
    ],
)
def test_a_wrong_table_of_errors_is_one_line(old, new, said, tmp_path):
    text = arm_camera.TABLE.read_text()
    assert old in text
    (tmp_path / "camera.toml").write_text(text.replace(old, new))
    with pytest.raises(
        ConfigurationError, match=f"^errors of the arm camera '.*camera.toml': {said}"
    ):
        ErrorModel.read(tmp_path / "camera.toml")


def readings(
    model: mujoco.MjModel, camera: ArmCamera | RenderedArmCamera, seed: int, places: Array
) -> list[SurfaceMotionMeasurement | None]:
    """Messages of one run over the tool's places (n, 3) [m]."""
    state: Any = camera.init(np.random.default_rng(seed))
    messages = []
    for k, p in enumerate(places):
        state, message = camera.step(state, truth(model, k * camera.period, p))
        messages.append(message)
    return messages


def test_errors_have_the_covariance_that_is_stated(model: mujoco.MjModel):
    """Many first motions of 5 mm: the squared error over the covariance is 1 a direction."""
    errors = replace(fitted(), lost=(-50.0, 0.0, 0.0, 0.0), bias=(0.0, 0.0, 0.0), outliers=0.0)
    camera = ArmCamera(model, "tip", "object", conditions=CLEAR, errors=errors)
    moved = np.array([5e-3, 0.0, 0.0])
    squares = []
    for seed in range(200):
        first, second = readings(model, camera, seed, np.array([np.zeros(3), moved]))
        assert first is not None
        assert second is not None
        assert not first.information_K.any()
        assert second.key_time == first.time
        X = camera.camera_pose(truth(model, 0.0, np.zeros(3)))[0]
        error = X[:3, :3] @ second.p_KC - moved
        L = X[:3, :3] @ second.information_K @ X[:3, :3].T
        assert int((np.linalg.eigvalsh(L) > OBSERVED).sum()) == 3
        squares.append(float(error @ L @ error) / 3.0)
    # 3.5 standard deviations of the mean of 200
    assert np.mean(squares) == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize("attenuation", [0.0, 0.7, 2.2])
def test_water_dims_what_a_flat_wall_tells(attenuation: float):
    """Square to the view at 0.2 m, in closed form: depth by stereo z^2 s / (f b) exp(a z), light
    exp(-2 a z).
    """
    camera = SmallStereo(intensity_noise=1e-5)
    z = 0.2
    depth = np.full(camera.rays(GRID).shape[:2], z)
    texture = Texture.of(3, 0.3)

    def told(a: float) -> Prediction:
        return predict(
            camera, depth, np.zeros_like(depth, dtype=bool), texture, Turbidity(attenuation=a), 0.0
        )

    information = told(attenuation)
    sigma = (
        z**2
        * camera.stereo.disparity_sigma
        / (camera.focal * camera.stereo.baseline)
        * np.exp(attenuation * z)
    )
    assert information.shape[2, 2] == pytest.approx(depth.size * GRID**2 / CELL / sigma**2)
    assert abs(information.shape[0, 0]) < 1e-9 * information.shape[2, 2]
    # With little noise every pixel is used; its weight is the square of the light that comes back.
    assert information.texture / told(0.0).texture[0, 0] == pytest.approx(
        np.exp(-4.0 * attenuation * z) * told(0.0).texture / told(0.0).texture[0, 0],
        rel=1e-3,
        abs=1e-9,
    )
    assert information.range == pytest.approx(z)


def test_a_new_key_is_a_picture_that_was_itself_measured(model: mujoco.MjModel):
    """Over 30 cm there are several keys, each at the time of a message against the key before
    it.
    """
    errors = replace(fitted(), lost=(-50.0, 0.0, 0.0, 0.0))
    places = np.column_stack([np.linspace(0.0, 0.3, 61), np.zeros((61, 2))])
    messages_of = readings(
        model, ArmCamera(model, "tip", "object", conditions=CLEAR, errors=errors), 1, places
    )
    messages = [message for message in messages_of if message is not None]
    assert len(messages) == len(places)
    keys = {message.key_time for message in messages}
    assert len(keys) > 3
    assert keys <= {message.time for message in messages}


def test_a_plain_wall_tells_its_distance_only(model: mujoco.MjModel):
    camera = ArmCamera(model, "tip", "object", conditions=replace(CLEAR, texture=0.0))
    message = readings(model, camera, 2, np.zeros((4, 3)))[-1]
    assert message is not None
    eigenvalues, axes = np.linalg.eigh(message.information_K)
    assert int((eigenvalues > OBSERVED).sum()) == 1
    X = camera.camera_pose(truth(model, 0.0, np.zeros(3)))[0]
    assert abs((X[:3, :3] @ axes[:, -1])[2]) > 0.99


def test_without_a_surface_in_range_there_is_no_message_and_the_track_ends(model: mujoco.MjModel):
    camera = ArmCamera(
        model,
        "tip",
        "object",
        conditions=CLEAR,
        errors=replace(fitted(), lost=(-50.0, 0.0, 0.0, 0.0)),
    )
    away = np.array([0.0, 0.0, 2.0])
    places = np.array([np.zeros(3)] * 3 + [away] * 6 + [np.zeros(3)] * 3)
    messages = readings(model, camera, 3, places)
    assert all(message is None for message in messages[3:9])
    again = messages[9]
    assert again is not None
    assert again.key_time == again.time == 9 * camera.period


def test_silt_makes_pictures_worse_or_loses_them(model: mujoco.MjModel):
    """In clouds that come all the time the information falls, and pictures are lost."""
    messages: dict[bool, list[SurfaceMotionMeasurement | None]] = {}
    for silty in (False, True):
        conditions = replace(CLEAR, cloud_rate=16.0 if silty else 0.0)
        messages[silty] = readings(
            model, ArmCamera(model, "tip", "object", conditions=conditions), 4, np.zeros((60, 3))
        )
    lost = {
        silty: sum(message is None for message in of_water) for silty, of_water in messages.items()
    }
    weight = {
        silty: np.median(
            [np.trace(message.information_K) for message in of_water if message is not None]
        )
        for silty, of_water in messages.items()
    }
    assert lost[True] > lost[False] + 5
    assert weight[True] < 0.5 * weight[False]


def test_a_rendered_camera_measures_the_same_motion(model: mujoco.MjModel):
    """Every picture rendered and aligned: 5 mm over a textured wall, to the tracker's own
    information.
    """
    camera = RenderedArmCamera(model, "tip", "object", conditions=CLEAR)
    moved = np.array([5e-3, 0.0, 0.0])
    first, second = readings(model, camera, 5, np.array([np.zeros(3), moved]))
    assert first is not None
    assert second is not None
    X = camera.camera_pose(truth(model, 0.0, np.zeros(3)))[0]
    error = X[:3, :3] @ second.p_KC - moved
    assert np.linalg.norm(error) < 5e-4  # measured 1e-4
    L = X[:3, :3] @ second.information_K @ X[:3, :3].T
    assert float(error @ L @ error) < 16.3  # chi-square of 3, 0.999


def test_the_error_model_holds_on_pictures_that_it_was_not_fitted_to():
    """Twelve fresh key pictures, rendered and aligned: error over the model's covariance, outliers
    left out.
    """
    model = fitted()
    parameters = np.concatenate([model.texture, model.shape])
    rows = [fit_arm_camera.row(KeyCase(draws=4242, seed=number)) for number in range(12)]
    pairs = [pair for pair in pairs_of(rows) if not pair.lost]
    judged = np.array([squared(pair, parameters) for pair in pairs])
    assert len(pairs) > 18
    inside = judged[judged[:, 0] < 28.0]
    assert len(inside) >= 0.93 * len(judged)
    assert inside[:, 0].sum() / inside[:, 1].sum() == pytest.approx(1.0, abs=0.4)


def test_the_table_of_the_package_is_written_by_the_fit():
    assert to_toml(fitted()) == arm_camera.TABLE.read_text()


def test_sensor_and_tracker_mean_the_same_by_observed():
    assert arm_camera.WEAKEST == surface_alignment.WEAKEST
    assert arm_camera.LEAST_GRADIENT == surface_alignment.LEAST_GRADIENT
    assert surface_alignment.LEVELS[-1] == arm_camera.FINE_BLUR


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"texture": -0.1}, "texture"),
        ({"cloud_time": 0.0}, "cloud_time"),
        ({"attenuation": np.nan}, "attenuation"),
    ],
)
def test_bad_conditions_are_named(changed: dict[str, Any], named: str):
    with pytest.raises(ConfigurationError, match=named):
        ViewConditions(**changed)


def test_bad_mounts_are_named(model: mujoco.MjModel):
    with pytest.raises(ConfigurationError, match="nowhere"):
        ArmCamera(model, "nowhere", "object")
    with pytest.raises(ConfigurationError, match="nothing"):
        ArmCamera(model, "tip", "nothing")
    with pytest.raises(ConfigurationError, match="period"):
        ArmCamera(model, "tip", "object", period=0.0)
