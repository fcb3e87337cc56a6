"""The scan's likelihood against its closed form on a flat face, and the depth edges that something
nearer makes.
"""

import numpy as np
import pytest

from uuv.models.objects.target_model import TargetModel
from uuv.perception.clouds.contours import contour
from uuv.perception.clouds.scan import Scan, SensorModel
from uuv.perception.registration.evidence import Evidence
from uuv.perception.registration.likelihood import log_likelihood
from uuv.perception.registration.model_surface import ModelSurface
from uuv.sim.interfaces.spatial import Array, pose

SENSOR = SensorModel()
# tangents; few enough pixels that all are used
GRID = np.linspace(-0.3, 0.3, 200), np.linspace(-0.2, 0.2, 150)
WIDE, HIGH, DEEP = 0.2, 0.15, 0.05  # [m] half sizes of the slab


def slab() -> ModelSurface:
    """A slab whose near face lies in z_T = 0."""
    x, y, z = np.meshgrid([-WIDE, WIDE], [-HIGH, HIGH], [0.0, DEEP], indexing="ij")
    faces = [
        [0, 2, 6],
        [0, 6, 4],
        [1, 5, 7],
        [1, 7, 3],
        [0, 4, 5],
        [0, 5, 1],
        [2, 3, 7],
        [2, 7, 6],
        [0, 1, 3],
        [0, 3, 2],
        [4, 6, 7],
        [4, 7, 5],
    ]
    vertices = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    return ModelSurface.of(TargetModel(name="slab", vertices=vertices, triangles=np.array(faces)))


def face(z: float) -> np.ndarray:
    """Mask of the pixels that show the near face when it lies at `z` [m]."""
    x, y = np.meshgrid(*GRID)
    return (np.abs(x) * z < WIDE) & (np.abs(y) * z < HIGH)


def scan_of(depth: Array) -> Scan:
    x, y = np.meshgrid(*GRID)
    return Scan(
        points=np.stack([x * depth, y * depth, depth], axis=-1),
        tangent_x=GRID[0],
        tangent_y=GRID[1],
    )


@pytest.fixture(scope="module")
def surface() -> ModelSurface:
    return slab()


def test_pixels_left_out_count(surface: ModelSurface, within):
    """Thinned to a ninth, the sum changes by the pixels at the rim only, however short the noise is
    correlated.
    """
    shown = face(1.0)
    for length in (1.0, 5.0):
        evidence = Evidence.of(
            scan_of(np.where(shown, 1.0, np.nan)), shown, 0.01, SensorModel(noise_length=length)
        )
        whole, ninth = (
            log_likelihood(evidence, surface, pose(p=[0.0, 0.0, 1.0]), n) for n in (40_000, 3_000)
        )
        within("share of the sum", ninth / whole - 1.0, 0.05)


@pytest.mark.parametrize("hidden", [False, True])
def test_a_flat_face_moved_away(surface: ModelSurface, hidden: bool, within):
    """Cost: half the squared offset in sigma a pixel, 2 where the smaller picture leaves a pixel
    unexplained.
    """
    shown = face(1.0)
    depth = np.where(shown, 1.0, np.nan)
    if hidden:  # something 0.4 m before the upper half: it says the same of both poses
        depth[:75] = 0.6
    evidence = Evidence.of(scan_of(depth), shown, 0.005, SENSOR)
    off = 0.006
    cost = np.where(face(1.0 + off), 0.5 * (off / SENSOR.sigma(1.0 + off)) ** 2, 2.0)[
        shown & (depth == 1.0)
    ].sum()
    near, far = (log_likelihood(evidence, surface, pose(p=[0.0, 0.0, z])) for z in (1.0, 1.0 + off))
    # rays are single precision
    within("difference, relative", 25.0 * (near - far) / cost - 1.0, 1e-4)


def test_a_pixel_that_contradicts_costs_no_more_than_its_share(surface: ModelSurface, within):
    """Far behind the model: 4.5 a pixel, less the 2 or 0.5 that it costs uncovered.

    Out of view it tells nothing.
    """
    shown = face(1.0)
    evidence = Evidence.of(scan_of(np.where(shown, 1.0, 3.0)), shown, 0.005, SENSOR)
    through = log_likelihood(evidence, surface, pose(p=[0.0, 0.0, 0.9]))
    cost = (
        4.5 * face(0.9).sum() - 2.0 * (shown & face(0.9)).sum() - 0.5 * (face(0.9) & ~shown).sum()
    )
    within("seen through [nats]", through + cost / 25.0, 1e-4)
    away = log_likelihood(evidence, surface, pose(p=[0.0, 0.0, -5.0]))
    within("out of view [nats]", away, 1e-12)


def test_what_hides_a_surface_makes_no_edge_of_it():
    """A face ends at column 150 before nothing; at column 60 a nearer one hides it, with a seam of
    empty pixels.
    """
    depth = np.full((150, 200), np.nan)
    depth[20:130, 64:150] = 1.0
    depth[20:130, :60] = 0.6
    mask = depth == 1.0
    edges = contour(scan_of(depth), mask, depth)
    sides = edges.columns[(edges.rows > 22) & (edges.rows < 127)]
    assert set(sides) == {149}
    alone = np.where(mask, depth, np.nan)
    assert set(contour(scan_of(alone), mask, alone).columns[20:-20]) >= {64, 149}
