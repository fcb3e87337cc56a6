"""Samples by which convex parts are judged: on the surface, even, with its normals; parts sunk
beneath it.
"""

import numpy as np
import pytest

from uuv.models.meshes import convex_parts
from uuv.models.meshes.closed_shells import box, sphere
from uuv.models.meshes.nearest_surface import NearestSurface


def test_samples_lie_evenly_on_the_surface() -> None:
    vertices, triangles = box([0.3, 0.2, 0.1], [0.0, 0.0, 0.0])
    judged = convex_parts._Judged.of(vertices, triangles)
    assert np.all(np.diff(judged.samples[:, 0]) >= 0.0)
    np.testing.assert_allclose(
        NearestSurface.of(vertices, triangles).query(judged.samples).distance, 0.0, atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.norm(judged.normals, axis=1), 1.0)
    for axis in range(3):
        for sign in (1.0, -1.0):
            on = judged.sample_normals[:, axis] * sign > 0.99
            assert on.sum() > 50
            middle = sign * 0.5 * np.array([0.3, 0.2, 0.1]) * np.eye(3)[axis]
            np.testing.assert_allclose(judged.samples[on].mean(axis=0), middle, atol=5e-3)


def test_a_patch_becomes_a_part_beneath_it() -> None:
    vertices, triangles = sphere(2)
    judged = convex_parts._Judged.of(0.2 * vertices, triangles)
    patch = np.array([0, 1, 2, 3])
    part = judged.hull(patch, 5e-3)
    assert part is not None
    corners = 0.2 * vertices[np.unique(triangles[patch])]
    normal = judged.normals[patch].mean(axis=0)
    normal /= np.linalg.norm(normal)
    assert np.linalg.norm(part, axis=1).max() <= 0.2 + 1e-9  # not out of the sphere
    depth = (part - corners.mean(axis=0)) @ normal
    flat = (corners - corners.mean(axis=0)) @ normal
    assert depth.min() < flat.min() - 1e-3  # sunk
    assert depth.max() == pytest.approx(flat.max())
