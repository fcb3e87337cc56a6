"""The check's decisions on evidence that contradicts a pose, that lacks, and that hides; the
paper's Q beside it.
"""

from dataclasses import replace

import numpy as np
import pytest

from depth_scenes import dented_barrel, look
from uuv.clouds.frames import camera_pose
from uuv.models.objects.target_model import Symmetry
from uuv.models.objects.targets import Solid, barrel
from uuv.perception.clouds.scan import Scan, SensorModel
from uuv.perception.registration.evidence import Evidence
from uuv.perception.registration.fine_fit import fine_fit
from uuv.perception.registration.identification import segment
from uuv.perception.registration.model_surface import ModelSurface
from uuv.perception.registration.pose_check import Decision, check
from uuv.perception.registration.published.paper_check import published_criterion
from uuv.perception.registration.symmetry import ambiguous_poses
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, exp_so3, inverse, pose, transform_points

BARREL = barrel()
VIEW = camera_pose(np.array([0.1, -0.9, 0.75]))
SENSOR = SensorModel()


def evidence_of(surface: ModelSurface, balls: tuple[tuple[Array, float], ...] = ()) -> Evidence:
    """A look at the barrel with `balls` (centre (3,) [m] in C, radius [m]) in the scene."""
    solids = tuple(
        Solid(
            name=f"ball_{i}",
            kind="sphere",
            size=(radius, 0.0, 0.0),
            X_TS=pose(p=transform_points(inverse(VIEW), center)),
        )
        for i, (center, radius) in enumerate(balls)
    )
    rng = np.random.default_rng(5)
    scan = Scan.from_depth(look(replace(BARREL, stand=(*BARREL.stand, *solids)), VIEW, rng))
    mask = segment(scan, BARREL, VIEW[:3, 3], SENSOR, 0.3, rng)
    return Evidence.of(scan, mask, 0.8 * surface.spacing, SENSOR)


@pytest.fixture(scope="module")
def surface() -> ModelSurface:
    return ModelSurface.of(BARREL)


@pytest.fixture(scope="module")
def clear(surface: ModelSurface) -> Evidence:
    return evidence_of(surface)


def test_the_true_pose_is_accepted_and_wrong_ones_are_not(clear: Evidence, surface: ModelSurface):
    true = check(clear, surface, VIEW)
    assert true.decision is Decision.ACCEPT
    assert true.coverage > 0.9
    assert true.hidden < 0.02
    assert true.figure_m < true.threshold_m
    for wrong in (
        pose(p=[0.03, 0.0, 0.0]),
        pose(p=[0.0, 0.03, 0.0]),
        pose(exp_so3([0.0, np.deg2rad(10.0), 0.0])),
    ):
        verdict = check(clear, surface, VIEW @ wrong)
        assert verdict.decision is not Decision.ACCEPT
        assert verdict.move_m > true.move_m  # the fit goes back
    far = check(clear, surface, VIEW @ pose(p=[0.0, 0.0, -0.3]))
    assert far.decision is Decision.REFUSE


def test_what_is_hidden_is_no_evidence(surface: ModelSurface):
    """A ball between hides a third of the barrel: accepted as before; one that hides nearly all:
    look again.
    """
    third = check(
        evidence_of(surface, ((0.5 * VIEW[:3, 3] + [0.1, 0.0, 0.0], 0.09),)), surface, VIEW
    )
    assert 0.15 < third.hidden < 0.6
    assert third.decision is Decision.ACCEPT, third.reason
    assert third.agreement > 0.9
    most = check(evidence_of(surface, ((0.4 * VIEW[:3, 3], 0.185),)), surface, VIEW)
    assert most.hidden > 0.7
    assert most.decision is Decision.RESCAN
    assert most.reason


def test_a_model_of_a_part_of_what_is_seen_is_not_accepted(clear: Evidence, surface: ModelSurface):
    """Half a barrel fits the barrel as truly as the whole; the other half of the surface is then
    nobody's.
    """
    fine = dented_barrel(0.0)
    half = replace(
        fine, triangles=fine.triangles[fine.vertices[fine.triangles, 0].mean(axis=1) < 0.0]
    )
    verdict = check(clear, ModelSurface.of(half), VIEW)
    assert 0.35 < verdict.beyond < 0.65
    assert verdict.decision is not Decision.ACCEPT
    assert check(clear, surface, VIEW).beyond < 0.02


@pytest.mark.parametrize("share", [0.85, 1.15])
def test_the_object_in_another_size_is_not_accepted(
    clear: Evidence, surface: ModelSurface, share: float, within
):
    other = ModelSurface.of(replace(BARREL, vertices=share * BARREL.vertices))
    verdict = check(clear, other, fine_fit(clear, other, VIEW).X_ST)
    assert verdict.decision is not Decision.ACCEPT
    assert (verdict.size - 1.0) * (1.0 - share) > 0.0
    assert f"at {verdict.size:.2f} times its size the model fits better" in verdict.reason
    within("size of the right model - 1", check(clear, surface, VIEW).size - 1.0, 0.01)


def test_q_grows_with_the_number_of_rays_as_the_paper_has_it(
    clear: Evidence, surface: ModelSurface, within
):
    """Four times as many rays on the same line: twice the Q, for the same pose."""
    few, many = (published_criterion(clear, surface, VIEW, n=n) for n in (200, 800))
    assert few.rays + few.missed == 200
    within("Q(4n) / 2 Q(n) - 1", many.q_m / few.q_m / 2.0 - 1.0, 0.3)
    off = published_criterion(clear, surface, VIEW @ pose(p=[0.0, 0.0, 0.03]), "circle")
    assert off.q_m > 2.0 * published_criterion(clear, surface, VIEW, "circle").q_m
    with pytest.raises(ConfigurationError, match="'line' or 'circle'"):
        published_criterion(clear, surface, VIEW, "square")


def test_declared_symmetry_is_no_look_alike(surface: ModelSurface):
    """The barrel turned about its axis or end to end is declared the same; undeclared, its turns
    look alike.
    """
    assert not ambiguous_poses(surface)
    undeclared = replace(surface, symmetry=Symmetry())
    for G in ambiguous_poses(undeclared):
        assert BARREL.symmetry.error(G, np.eye(4))[1] < np.deg2rad(2.0)
    assert len(ambiguous_poses(undeclared)) > 3
