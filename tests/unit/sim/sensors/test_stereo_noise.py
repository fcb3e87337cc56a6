"""Errors of a stereo camera, step by step, each alone: their size, their reach, what they leave
out.
"""

import numpy as np
import pytest

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.sensors import stereo_noise
from uuv.sim.sensors.stereo_noise import StereoNoise, add_noise

SHAPE = (60, 90)
FOCAL = 80.0
NONE = {
    "baseline": 0.1,
    "disparity_sigma": 0.0,
    "correlation": 0.0,
    "disparity_step": 0.0,
    "flying": 0.0,
    "max_incidence": 0.5 * np.pi,
    "attenuation": 0.0,
    "least_contrast": 0.0,
}


def noise(**changed: float) -> StereoNoise:
    return StereoNoise(**(NONE | changed))


def seen(depth: np.ndarray, seed: int = 1, cosine: float = 1.0, **changed: float) -> np.ndarray:
    angles = np.full(depth.shape, cosine, dtype=np.float32)
    return add_noise(depth, angles, FOCAL, noise(**changed), np.random.default_rng(seed))


def disparity(depth: np.ndarray) -> np.ndarray:
    return FOCAL * NONE["baseline"] / depth


def flat(z: float) -> np.ndarray:
    return np.full(SHAPE, z, dtype=np.float32)


def test_without_errors_depth_is_true() -> None:
    depth = np.random.default_rng(2).uniform(0.5, 3.0, SHAPE).astype(np.float32)
    depth[3, 4] = np.inf
    np.testing.assert_allclose(seen(depth), depth, rtol=1e-6)


def test_errors_of_disparity_are_as_large_as_said_at_any_distance() -> None:
    for z in (0.8, 2.5):
        error = disparity(seen(flat(z), disparity_sigma=0.2)) - disparity(flat(z))
        assert error.std() == pytest.approx(0.2, rel=0.05)
        assert abs(error.mean()) < 0.02


def test_neighbours_err_alike() -> None:
    noises = [
        stereo_noise._smooth_noise((200, 200), 6.0, np.random.default_rng(seed))
        for seed in range(4)
    ]
    assert np.std(noises) == pytest.approx(1.0, rel=0.05)
    for axis in (1, 2):
        for lag, share in ((6, np.exp(-1.0)), (3, np.exp(-0.25)), (24, 0.0)):
            other = np.roll(noises, lag, axis=axis)
            assert np.mean(noises * other) == pytest.approx(share, abs=0.07)


def test_turbid_water_makes_errors_grow_with_the_length_of_the_ray() -> None:
    """By exp(attenuation times range), at the picture's edge as in its middle."""
    depth = flat(1.5)
    c = 0.4
    clear = disparity(seen(depth, disparity_sigma=0.01)) - disparity(depth)
    turbid = disparity(seen(depth, disparity_sigma=0.01, attenuation=c)) - disparity(depth)
    y, x = np.indices(SHAPE) - 0.5 * (np.array(SHAPE)[:, None, None] - 1.0)
    distance = 1.5 * np.sqrt(1.0 + (x / FOCAL) ** 2 + (y / FOCAL) ** 2)
    noticeable = np.abs(clear) > 2e-3
    np.testing.assert_allclose(
        (turbid / clear)[noticeable], np.exp(c * distance)[noticeable], rtol=5e-3
    )


def test_contrast_is_lost_with_range() -> None:
    lost = [
        np.isinf(seen(flat(z), attenuation=0.5, least_contrast=0.3)).mean()
        for z in (0.3, 1.0, 2.0, 4.0)
    ]
    assert np.all(np.diff(lost) > 0.02)
    # |N|^2 / 2 of two normal numbers is exponential: P(lost) = 1 - exp(-(least / contrast)^2).
    y, x = np.indices(SHAPE) - 0.5 * (np.array(SHAPE)[:, None, None] - 1.0)
    ray = np.sqrt(1.0 + (x / FOCAL) ** 2 + (y / FOCAL) ** 2)
    expected = [
        np.mean(1.0 - np.exp(-((0.3 / np.exp(-0.5 * z * ray)) ** 2))) for z in (0.3, 1.0, 2.0, 4.0)
    ]
    np.testing.assert_allclose(lost, expected, atol=0.03)


def test_disparity_is_rounded_to_its_step() -> None:
    depth = np.linspace(0.5, 3.0, SHAPE[0] * SHAPE[1], dtype=np.float32).reshape(SHAPE)
    steps = disparity(seen(depth, disparity_step=0.25)) / 0.25
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-4)
    assert np.abs(steps - disparity(depth) / 0.25).max() <= 0.5001
    far = seen(flat(200.0), disparity_step=0.25)  # rounds to nothing
    assert np.isinf(far).all()


def test_grazing_incidence_is_not_seen() -> None:
    for cosine, lost in ((0.49, True), (0.51, False)):
        assert np.isinf(seen(flat(1.0), cosine=cosine, max_incidence=np.pi / 3.0)).all() == lost


def test_flying_pixels_stand_between_both_sides_of_an_edge_and_nowhere_else() -> None:
    depth = flat(2.0)
    depth[:, 40:] = 1.0
    depth[30:, :] = 3.0
    for share in (0.3, 1.0):
        depth_read = seen(depth, flying=share)
        moved = np.abs(depth_read - depth) > 1e-4
        near_edge = np.zeros(SHAPE, dtype=bool)
        near_edge[:30, 39:41] = True
        near_edge[29:31] = True
        assert not moved[~near_edge].any()
        assert 0.2 * share < moved[near_edge].mean() <= share + 0.1
        assert np.all((depth_read >= 1.0 - 1e-5) & (depth_read <= 3.0 + 1e-5))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(
            (name, -0.1)
            for name in (
                "disparity_sigma",
                "correlation",
                "disparity_step",
                "attenuation",
                "least_contrast",
            )
        ),
        *((name, np.inf) for name in ("disparity_sigma", "attenuation")),
        ("baseline", 0.0),
        ("flying", -0.1),
        ("flying", 1.1),
        ("max_incidence", 0.0),
        ("max_incidence", 1.6),
    ],
)
def test_what_is_out_of_range_is_refused(name: str, value: float) -> None:
    with pytest.raises(ConfigurationError, match=name):
        noise(**{name: value})
