"""Rivals: an object of the other hand is refused, one without a hand is not asked; the model at
another size.

The mirror image is sought once from one place.
"""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from depth_scenes import halved, look, standing
from uuv.clouds.frames import camera_pose
from uuv.models.objects.target_model import TargetModel
from uuv.models.objects.targets import barrel, starfish
from uuv.perception.clouds.scan import Scan
from uuv.perception.finding.target_finder import KnownObjectFinder
from uuv.perception.registration import rival_shapes
from uuv.perception.registration.evidence import Evidence
from uuv.perception.registration.identification import identify
from uuv.perception.registration.likelihood import log_likelihood
from uuv.perception.registration.model_surface import ModelSurface
from uuv.perception.registration.pose_search import Found
from uuv.perception.registration.rival_shapes import (
    MirrorImage,
    is_told_again,
    mirror_image,
    resized,
    resized_log_likelihood,
)
from uuv.sim.interfaces.messages import DepthImage

VIEW = camera_pose(np.array([0.15, -0.4, 0.8]))


def hooked(hand: float) -> TargetModel:
    """Three bars, the last to the left or to the right."""
    bars = [((0.5, 0.08, 0.06), (0.0, 0.0, 0.0)), ((0.08, 0.3, 0.06), (0.21, 0.15, 0.0))]
    bars += [
        ((0.08, 0.08, 0.25), (-0.21, 0.0, 0.12)),
        ((0.06, 0.2, 0.06), (0.0, hand * 0.12, 0.05)),
    ]
    parts = []
    for size, at in bars:
        part = trimesh.creation.box(size)
        part.apply_translation(np.array(at) * [1.0, hand, 1.0])
        parts.append(part)
    vertices, triangles = trimesh.util.append_faces(
        [part.vertices for part in parts], [part.faces for part in parts]
    )
    return TargetModel(
        name="hook", vertices=np.asarray(vertices, dtype=np.float64), triangles=triangles
    )


def test_the_other_hand_is_refused():
    surface = ModelSurface.of(hooked(1.0))
    frame = look(hooked(-1.0), VIEW, np.random.default_rng(4), floor=False)
    identification = identify(Scan.from_depth(frame), surface, VIEW[:3, 3])
    assert not identification.accepted


def quick_look(target: TargetModel, X_CT: np.ndarray, rng: np.random.Generator) -> DepthImage:
    """A halved frame of the object alone."""
    return replace(halved(look(target, X_CT, rng, floor=False)), X_BC=np.eye(4))


def test_the_mirror_image_is_sought_once_from_one_place(monkeypatch):
    """The second of two looks differs from the first in its noise alone; what changes the answer is
    noticed.
    """
    searches = []
    search = rival_shapes.likeliest_of
    monkeypatch.setattr(
        rival_shapes, "likeliest_of", lambda *args: searches.append(1) or search(*args)
    )
    rng = np.random.default_rng(4)
    finder = KnownObjectFinder(hooked(1.0), None, VIEW[:3, 3])
    state = finder.init()
    poses = []
    for _ in range(2):
        state, verdict = finder.step(state, standing(np.eye(4)), quick_look(hooked(1.0), VIEW, rng))
        assert verdict is not None
        assert verdict.accepted, verdict.reason
        assert state.last is not None
        poses.append(state.last)
    first, second = poses
    assert len(searches) == 1
    assert first.mirror is not None
    assert first.mirror is second.mirror

    def holds(mirror: MirrorImage, evidence: Evidence | None = first.evidence) -> bool:
        assert evidence is not None
        return is_told_again(evidence, first.surface, first.X_sensor_target, mirror)

    assert holds(first.mirror)
    # from another place
    assert not holds(replace(first.mirror, p_TS=first.mirror.p_TS + np.array([0.0, 0.15, 0.0])))
    assert not holds(replace(first.mirror, hand=50.0))  # it was in doubt
    # the mirror image fits better now
    assert not holds(replace(first.mirror, hand=3.0 * first.mirror.hand))
    assert first.evidence is not None
    replaced = replace(first.evidence, scan=Scan.from_depth(quick_look(hooked(-1.0), VIEW, rng)))
    assert not holds(first.mirror, replaced)


def test_only_what_has_a_hand_has_a_rival(within):
    assert mirror_image(ModelSurface.of(barrel())) is None
    assert mirror_image(ModelSurface.of(starfish())) is None  # its planes are no principal ones
    surface = ModelSurface.of(hooked(1.0))
    rival = mirror_image(surface)
    assert rival is not None
    within(
        "reflected twice",
        np.sort(rival.points * [-1.0, 1.0, 1.0], axis=0) - np.sort(surface.points, axis=0),
        1e-12,
    )


@pytest.mark.parametrize("size", [0.95, 1.05])
def test_an_object_of_another_size_is_likelier_as_that(size):
    """Five percent: the scan is likelier at the right size by far more than what separates a pose
    from its rivals.
    """
    surface = ModelSurface.of(hooked(1.0))
    target = hooked(1.0)
    other = TargetModel(name="other", vertices=size * target.vertices, triangles=target.triangles)
    frame = look(other, VIEW, np.random.default_rng(4), floor=False)
    identification = identify(Scan.from_depth(frame), surface, VIEW[:3, 3])
    assert not identification.accepted
    assert identification.evidence is not None
    X_ST = identification.X_sensor_target
    search = Found(
        X_ST,
        None,
        X_ST,
        log_likelihood(identification.evidence, surface, X_ST),
        identification.hypotheses[1:],
    )
    assert (
        resized_log_likelihood(identification.evidence, surface, size, search)
        > search.log_likelihood + 20.0
    )


def test_a_resized_model_is_the_model_resized(within):
    surface = ModelSurface.of(hooked(1.0))
    twice = resized(surface, 2.0)
    within("centre [m]", twice.center - 2.0 * surface.center, 1e-12)
    ray = np.array([[0.0, 0.0, -1.0]])
    within(
        "ray [m]",
        twice.scene.distance([0.0, 0.0, 2.0], ray)
        - 2.0 * surface.scene.distance([0.0, 0.0, 1.0], ray),
        1e-5,
    )
