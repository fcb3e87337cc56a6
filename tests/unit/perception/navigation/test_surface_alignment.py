"""Direct alignment of rendered pictures of a flat wall: accuracy, what a view does not observe, and
refusals.
"""

import numpy as np
import pytest

from uuv.perception.navigation.surface_alignment import Alignment, PictureNoise, align, prepare
from uuv.sim.interfaces.spatial import Array, pose
from uuv.sim.sensors.textured_view import SmallStereo, Texture, Turbidity, expose

CAMERA = SmallStereo()
NOISE = PictureNoise(
    intensity=CAMERA.intensity_noise, inverse_depth=0.06, correlation=CAMERA.stereo.correlation
)
NOTHING_HIDDEN = np.zeros((CAMERA.height, CAMERA.width), dtype=bool)
RANGE = 0.18  # [m] of the wall z = RANGE in the axes of the key picture
MOVED = np.array([6e-3, -4e-3, 1e-3])  # [m]
ROTATION = 1e-4  # [rad]


def aligned(
    contrast: float, seed: int, bend: float = 0.0, moved: Array = MOVED, guess: Array | None = None
) -> Alignment | None:
    """Two pictures of a wall z = RANGE + bend y^2, the second from `moved`."""
    rng = np.random.default_rng(seed)
    texture = Texture.of(seed, contrast)
    rays = CAMERA.rays()
    pictures = []
    for p in (np.zeros(3), moved):
        depth = np.full(rays.shape[:2], RANGE - p[2])
        for _ in range(20):  # fixed point of the depth along each ray
            depth = RANGE - p[2] + bend * (p[1] + depth * rays[..., 1]) ** 2
        slope = 2.0 * bend * (p[1] + depth * rays[..., 1])
        cosine = (
            np.abs(1.0 - slope * rays[..., 1])
            / np.hypot(1.0, slope)
            / np.linalg.norm(rays, axis=-1)
        )
        shot = expose(CAMERA, (depth, cosine), pose(p=p), texture, Turbidity(), rng)
        pictures.append(prepare(shot.intensity, shot.depth, NOTHING_HIDDEN, CAMERA.focal, NOISE))
    start = pose(p=moved + 1e-3 * rng.standard_normal(3)) if guess is None else guess
    return align(pictures[0], pictures[1], start, ROTATION, NOISE)


def test_motion_over_a_textured_wall_is_found_to_a_tenth_of_a_millimetre():
    """Forty pairs: none lost, and the squared error is what the information says (measured 1.0 a
    direction).
    """
    squares, errors = [], []
    for seed in range(40):
        motion = aligned(0.2, seed)
        assert motion is not None
        assert motion.settled
        error = motion.p_KC - MOVED
        errors.append(error)
        squares.append(float(error @ motion.information_K @ error) / 3.0)
    assert np.sqrt(np.mean(np.square(errors), axis=0)).max() < 2e-4
    assert 0.3 < np.mean(squares) < 2.0


@pytest.mark.parametrize(("bend", "directions"), [(0.0, 1), (5.0, 2)])
def test_a_plain_surface_is_observed_along_its_normals_only(bend: float, directions: int):
    """A plain wall tells the distance; a plain barrel along x, of 10 cm radius, nothing along its
    generator.
    """
    motion = aligned(0.0, 3, bend)
    assert motion is not None
    eigenvalues, axes = np.linalg.eigh(motion.information_K)
    observed = eigenvalues > 1.0  # [1/m^2] beyond rounding
    assert int(observed.sum()) == directions
    assert np.abs(axes[0, observed]).max() < 0.05
    assert abs(motion.p_KC[2] - MOVED[2]) < 5e-4


def test_what_was_not_observed_keeps_the_prediction():
    """A guess that is 1.5 mm off along the generator of a plain barrel stays off (noise moves it by
    0.2 mm).
    """
    off = np.array([1.5e-3, 0.0, 0.0])
    motion = aligned(0.0, 3, 5.0, guess=pose(p=MOVED + off))
    assert motion is not None
    assert motion.p_KC[0] - MOVED[0] == pytest.approx(off[0], abs=5e-4)


def test_pictures_with_nothing_in_common_give_no_motion():
    assert aligned(0.2, 0, moved=np.array([0.5, 0.0, 0.0])) is None
