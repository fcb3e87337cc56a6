"""Models that slip along themselves: the motion in closed form, and the place by the likelihood."""

import numpy as np
import pytest

from uuv.models.objects.target_model import TargetModel
from uuv.models.objects.targets import barrel, named
from uuv.perception.clouds.scan import Scan, SensorModel
from uuv.perception.registration.evidence import Evidence
from uuv.perception.registration.likelihood import log_likelihood
from uuv.perception.registration.model_surface import ModelSurface
from uuv.perception.registration.slipping import resting_places, settled, with_slip
from uuv.perception.registration.symmetry import slipped, slipping_twist
from uuv.sim.interfaces.pose_covariance import PoseCovariance
from uuv.sim.interfaces.spatial import Array, exp_so3, log_so3, pose

COIL = 0.12
WIRE = 0.02
PITCH = 0.09
TURNS = 4.0
PER_TURN = 24
AROUND = 10
X_ST = pose(exp_so3([1.4, 0.3, 0.2]), [0.02, -0.01, 1.1])
TANGENTS = 2e-3 * np.arange(-149.5, 150.0)


def spring() -> TargetModel:
    """A wire of circular section along a helix about the z axis of T, its ends open."""
    turn = 2.0 * np.pi * np.arange(int(TURNS * PER_TURN) + 1) / PER_TURN
    middle = np.column_stack(
        [COIL * np.cos(turn), COIL * np.sin(turn), PITCH * turn / (2.0 * np.pi)]
    )
    outward = np.column_stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)])
    along = np.column_stack(
        [-COIL * np.sin(turn), COIL * np.cos(turn), np.full_like(turn, PITCH / (2.0 * np.pi))]
    )
    across = np.cross(along / np.linalg.norm(along, axis=1, keepdims=True), outward)
    angle = 2.0 * np.pi * np.arange(AROUND) / AROUND
    rings = middle[:, None] + WIRE * (
        np.cos(angle)[:, None] * outward[:, None] + np.sin(angle)[:, None] * across[:, None]
    )
    first = (AROUND * np.arange(len(turn) - 1)[:, None] + np.arange(AROUND)).ravel()
    beside = (AROUND * np.arange(len(turn) - 1)[:, None] + np.roll(np.arange(AROUND), -1)).ravel()
    faces = np.vstack(
        [
            np.column_stack([first, first + AROUND, beside]),
            np.column_stack([beside, first + AROUND, beside + AROUND]),
        ]
    )
    return TargetModel(name="spring", vertices=rings.reshape(-1, 3), triangles=faces)


@pytest.fixture(scope="module")
def surface() -> ModelSurface:
    return ModelSurface.of(spring())


@pytest.fixture(scope="module")
def evidence(surface: ModelSurface) -> Evidence:
    """The spring alone, without noise."""
    empty = Scan.of_grid(np.full((300, 300), 1.0), TANGENTS, TANGENTS)
    scan = Scan.of_grid(surface.depth(X_ST, empty), TANGENTS, TANGENTS)
    return Evidence.of(scan, np.isfinite(scan.depth), 0.8 * surface.spacing, SensorModel())


def test_a_spring_slips_as_a_screw(surface: ModelSurface, within):
    """By a turn it rises by the pitch, and the surface moves by as much as was asked for."""
    by = 3.0 * surface.spacing
    G = slipped(surface, by)
    w = log_so3(G[:3, :3])
    within("axis", w[:2] / w[2], 0.02)
    within("rise over pitch - 1", G[2, 3] / (PITCH * w[2] / (2.0 * np.pi)) - 1.0, 0.05)
    moved = np.linalg.norm(surface.points @ G[:3, :3].T + G[:3, 3] - surface.points, axis=1)
    within("motion, relative", np.sqrt(np.mean(moved**2)) / by - 1.0, 0.01)


def test_what_resists_every_motion_does_not_slip():
    assert slipping_twist(ModelSurface.of(named("manifold"))) is None
    assert slipping_twist(ModelSurface.of(barrel())) is None  # its turn is declared


def test_the_likelihood_leads_back(surface: ModelSurface, evidence: Evidence, within):
    """Half a spacing along itself, where nearest points see nothing."""
    X = X_ST @ slipped(surface, 0.5 * surface.spacing)
    X_settled, likelihood = settled(evidence, surface, X, log_likelihood(evidence, surface, X))
    assert likelihood > log_likelihood(evidence, surface, X)
    within("left, in spacings", _slip(surface, X_settled) / surface.spacing, 0.2)


def test_the_next_facet_is_a_place_of_rest(surface: ModelSurface, evidence: Evidence, within):
    """From one facet along the wire the true place is among the next ones."""
    facet = 2.0 * np.pi / PER_TURN * np.hypot(COIL, PITCH / (2.0 * np.pi))
    places = resting_places(evidence, surface, X_ST @ slipped(surface, facet))
    assert places
    within(
        "nearest, in spacings", min(abs(_slip(surface, X)) for X in places) / surface.spacing, 1.0
    )


def test_its_own_doubt_is_what_the_likelihood_says(surface: ModelSurface, evidence: Evidence):
    """Pairs of points would state a tenth of a millimetre; the other directions stay as they
    are.
    """
    narrow = PoseCovariance(
        matrix=1e-8 * np.eye(6),
        free=np.zeros((0, 6)),
        center=X_ST[:3, 3],
        radius=surface.radius,
        size_sigma=0.01,
    )
    wide = with_slip(evidence, surface, X_ST, narrow)
    eigenvalues = np.linalg.eigvalsh(wide.matrix)
    assert eigenvalues[-1] > 100.0 * 1e-8
    np.testing.assert_allclose(eigenvalues[:5], 1e-8, rtol=1e-6)


def _slip(surface: ModelSurface, X: Array) -> float:
    """Motion [m] along the slipping twist from the true pose to `X` (4, 4)."""
    twist = slipping_twist(surface)
    assert twist is not None
    turn = log_so3((np.linalg.inv(X_ST) @ X)[:3, :3])
    return float(turn @ twist[3:] / (twist[3:] @ twist[3:]))
