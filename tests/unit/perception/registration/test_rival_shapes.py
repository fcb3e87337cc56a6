"""The mirror image as a rival: an object of the other hand is refused, one without a hand is not asked."""

import numpy as np
import pytest
import trimesh

from depth_scenes import look, seen_from
from models.objects.target_model import TargetModel
from models.objects.targets import barrel, starfish
from perception.clouds.scan import Scan
from perception.registration.identification import identify
from perception.registration.model_surface import ModelSurface
from perception.registration.rival_shapes import mirror_image

VIEW = seen_from(np.array([0.15, -0.4, 0.8]))


def hooked(hand: float) -> TargetModel:
    """Three bars, the last to the left or to the right."""
    bars = [((0.5, 0.08, 0.06), (0.0, 0.0, 0.0)), ((0.08, 0.3, 0.06), (0.21, 0.15, 0.0))]
    bars += [((0.08, 0.08, 0.25), (-0.21, 0.0, 0.12)), ((0.06, 0.2, 0.06), (0.0, hand * 0.12, 0.05))]
    parts = []
    for size, at in bars:
        part = trimesh.creation.box(size)
        part.apply_translation(np.array(at) * [1.0, hand, 1.0])
        parts.append(part)
    vertices, triangles = trimesh.util.append_faces([part.vertices for part in parts], [part.faces for part in parts])
    return TargetModel(name="hook", vertices=np.asarray(vertices, dtype=np.float64), triangles=triangles)


@pytest.mark.parametrize("hand", [1.0, -1.0])
def test_the_other_hand_is_refused(hand):
    surface = ModelSurface.of(hooked(1.0))
    frame = look(hooked(hand), VIEW, np.random.default_rng(4), floor=False)
    found = identify(Scan.from_depth(frame), surface, VIEW[:3, 3])
    assert found.accepted == (hand > 0.0), found.reason


def test_only_what_has_a_hand_has_a_rival(within):
    assert mirror_image(ModelSurface.of(barrel())) is None
    assert mirror_image(ModelSurface.of(starfish())) is None  # its planes are no principal ones
    surface = ModelSurface.of(hooked(1.0))
    rival = mirror_image(surface)
    assert rival is not None
    within("reflected twice", np.sort(rival.points * [-1.0, 1.0, 1.0], axis=0) - np.sort(surface.points, axis=0), 1e-12)
