"""Symmetry found in a mesh: known groups, at any place and attitude, and what breaks them."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from uuv.models.objects import targets
from uuv.models.objects.mesh_symmetry import mesh_symmetry
from uuv.sim.interfaces.spatial import exp_so3, transform_points

AT = np.array([0.3, -0.2, 0.5])  # [m]
TURN = exp_so3([0.4, -1.1, 0.7])
SHAPES = {  # mesh, surface of revolution, number of rotations beside the turns about the axis
    "box": (trimesh.creation.box((0.3, 0.2, 0.5)), False, 4),
    "square bar": (trimesh.creation.box((0.2, 0.2, 0.5)), False, 8),
    "cube": (trimesh.creation.box((0.3, 0.3, 0.3)), False, 24),
    "pipe": (trimesh.creation.annulus(0.08, 0.1, 0.4), True, 2),
    "cone": (trimesh.creation.cone(0.1, 0.3), True, 1),
    "hexagonal bar": (trimesh.creation.cylinder(0.1, 0.4, sections=6), False, 12),
}


@pytest.mark.parametrize("name", SHAPES)
def test_known_groups(name, within):
    mesh, round_, count = SHAPES[name]
    vertices = np.asarray(mesh.vertices) @ TURN.T + AT
    symmetry = mesh_symmetry(vertices, np.asarray(mesh.faces), np.random.default_rng(0))
    assert (symmetry.axis is not None) == round_
    assert len(symmetry.rotations) == count
    within("identity first", symmetry.rotations[0] - np.eye(3), 1e-12)
    points = trimesh.sample.sample_surface(trimesh.Trimesh(vertices, mesh.faces), 40_000, seed=0)[0]
    for R in symmetry.rotations:
        off = cKDTree(points).query(transform_points(symmetry.about_center(R), points[::20]))[0]
        within("off the surface, sampled every 3 mm [m]", off, 8e-3)


def test_a_bolt_breaks_it():
    plate = trimesh.creation.box((0.6, 0.4, 0.02))
    bolt = trimesh.creation.cylinder(0.015, 0.03)
    bolt.apply_translation([0.2, 0.1, 0.02])
    whole = trimesh.Trimesh(
        *trimesh.util.append_faces([plate.vertices, bolt.vertices], [plate.faces, bolt.faces])
    )
    bare, bolted = (
        mesh_symmetry(np.asarray(mesh.vertices), np.asarray(mesh.faces), np.random.default_rng(0))
        for mesh in (plate, whole)
    )
    assert len(bare.rotations) == 4
    assert bolted.is_none


@pytest.mark.parametrize("name", targets.available())
def test_library_objects_declare_what_is_found(name, within):
    target = targets.named(name)
    symmetry = mesh_symmetry(target.vertices, target.triangles, np.random.default_rng(0))
    assert len(symmetry.rotations) == len(target.symmetry.rotations)
    assert (symmetry.axis is None) == (target.symmetry.axis is None)
    if symmetry.axis is not None and target.symmetry.axis is not None:
        within("axis", np.abs(symmetry.axis) - np.abs(target.symmetry.axis), 1e-3)
