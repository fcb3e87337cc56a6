"""Noise as a scan shows it: white, correlated, and where the pose is wrong."""

import numpy as np
import pytest

from uuv.models.objects.target_model import TargetModel
from uuv.perception.clouds.scan import Scan, SensorModel
from uuv.perception.registration.evidence import Evidence, seen_noise, surface_noise
from uuv.perception.registration.model_surface import ModelSurface
from uuv.sim.interfaces.spatial import Array, pose
from uuv.sim.sensors.stereo_noise import StereoNoise, add_noise

TANGENT_X, TANGENT_Y = 2e-3 * np.arange(-159.5, 160.0), 2e-3 * np.arange(-119.5, 120.0)
SENSOR = SensorModel(focal=500.0)
X_ST = pose(p=[0.0, 0.0, 1.5])
HALF = np.array([0.3, 0.2])  # [m] of a plate
WHITE = 0.3  # [-] standard deviation of the white errors over what is stated


@pytest.fixture(scope="module")
def plate() -> ModelSurface:
    corners = HALF * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    vertices = np.vstack([np.column_stack([corners, np.full(4, z)]) for z in (0.0, 0.02)])
    around = [[i, (i + 1) % 4, 4 + (i + 1) % 4] for i in range(4)] + [
        [i, 4 + (i + 1) % 4, 4 + i] for i in range(4)
    ]
    faces = np.array([[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7], *around])
    return ModelSurface.of(TargetModel(name="plate", vertices=vertices, triangles=faces))


def evidence_of(noisy: Array) -> Evidence:
    scan = Scan.of_grid(noisy, TANGENT_X, TANGENT_Y)
    mask = np.isfinite(noisy) & (noisy < 1.75)
    return Evidence.of(scan, mask, 0.004, SENSOR)


def depth() -> Array:
    """The plate before a wall."""
    x, y = np.meshgrid(TANGENT_X, TANGENT_Y)
    on_plate = (np.abs(1.5 * x) < HALF[0]) & (np.abs(1.5 * y) < HALF[1])
    return np.where(on_plate, 1.5, 2.0)


def white(rng: np.random.Generator) -> Array:
    exact = depth()
    return exact + WHITE * SENSOR.sigma(exact) * rng.standard_normal(exact.shape)


def test_white_errors_are_seen_to_be_small_and_uncorrelated(plate: ModelSurface, rng, within):
    evidence = evidence_of(white(rng))
    floor = (0.001 / float(SENSOR.sigma(1.5))) ** 2  # of the model's accuracy
    expected = np.sqrt(WHITE**2 + floor)
    before = surface_noise(evidence.scan, evidence.mask, SENSOR)
    within(
        "from smooth surfaces",
        before.disparity_sigma / SENSOR.disparity_sigma / expected - 1.0,
        0.05,
    )
    assert before.noise_length == SENSOR.noise_length
    after = seen_noise(evidence, plate, X_ST)
    within("from the pose", after.disparity_sigma / SENSOR.disparity_sigma / expected - 1.0, 0.05)
    assert after.noise_length == 2.0  # the least that is believed
    sharper = evidence.with_noise(after)
    assert sharper.noise.information > 50.0 * evidence.noise.information
    assert sharper.sensor == SENSOR


def test_the_errors_of_a_matcher_stay_as_stated(plate: ModelSurface, rng):
    """Correlated over the stated length: nothing is gained, neither before nor after."""
    exact = depth().astype(np.float32)
    noisy = add_noise(exact, np.ones_like(exact), 500.0, StereoNoise(flying=0.0), rng).astype(
        np.float64
    )
    evidence = evidence_of(noisy)
    for noise in (
        surface_noise(evidence.scan, evidence.mask, SENSOR),
        seen_noise(evidence, plate, X_ST),
    ):
        assert noise.information < 1.5 * SENSOR.information


def test_a_wrong_pose_does_not_make_the_noise_smaller(plate: ModelSurface, rng):
    """A plate tilted by 8 deg: what differs is no noise, but correlated, and as large as stated."""
    evidence = evidence_of(white(rng))
    tilted = X_ST.copy()
    tilted[:3, :3] = [
        [np.cos(0.14), 0.0, np.sin(0.14)],
        [0.0, 1.0, 0.0],
        [-np.sin(0.14), 0.0, np.cos(0.14)],
    ]
    right, wrong = (seen_noise(evidence, plate, X).information for X in (X_ST, tilted))
    assert wrong < 0.1 * right
    assert wrong < 2.0 * SENSOR.information


def test_a_scan_without_smooth_surfaces_keeps_what_is_stated(rng):
    scattered = 1.0 + rng.random((240, 320))
    assert surface_noise(evidence_of(scattered).scan, scattered < 1.75, SENSOR) == SENSOR
