"""Users' meshes as closed shells: open, turned, in many parts, without an inside."""

import numpy as np
import pytest

from uuv.models.meshes.closed_shells import open_edges
from uuv.models.water_from_geometry.geoms import primitive
from uuv.models.water_from_geometry.scan import scanned
from uuv.models.water_from_geometry.shells import shells_of
from uuv.models.water_from_geometry.surface import union_surface
from uuv.sim.interfaces.spatial import Array

CAPSULE = np.array([0.08, 0.15, 0.0])
VOLUME = np.pi * 0.08**2 * (0.3 + 4.0 / 3.0 * 0.08)


def volume(corners: Array) -> float:
    return float(np.mean([scanned(corners, 160, axis).volume for axis in range(3)]))


def test_a_closed_mesh_stays_as_it_is():
    vertices, triangles = primitive("capsule", CAPSULE)
    shells = shells_of(vertices, triangles)
    assert (shells.said, shells.doubt) == ("1 closed shell", 0.0)
    assert len(shells.corners) == len(triangles)
    assert abs(volume(shells.corners) / VOLUME - 1.0) < 1e-3  # lines at 160


def test_triangles_turned_at_random_are_turned_outward(rng):
    vertices, triangles = primitive("capsule", CAPSULE)
    wrong = rng.random(len(triangles)) < 0.4
    mixed = np.where(wrong[:, None], triangles[:, ::-1], triangles)
    soup = vertices[mixed].reshape(-1, 3)  # not even joined, as STL has them
    shells = shells_of(soup, np.arange(len(soup)).reshape(-1, 3))
    assert shells.said.startswith("1 closed shell")
    assert abs(volume(shells.corners) / VOLUME - 1.0) < 1e-3


def test_a_hole_is_bridged_and_doubted():
    vertices, triangles = primitive("capsule", CAPSULE)
    middles = vertices[triangles].mean(axis=1)
    hole = ~((middles[:, 0] > 0.07) & (np.abs(middles[:, 2]) < 0.05))  # a slot along its side
    shells = shells_of(vertices, triangles[hole])
    assert shells.said == "1 open surface closed by the winding number"
    error = abs(volume(shells.corners) - VOLUME)
    assert error < 0.04 * VOLUME  # measured 2.7 %
    assert error < shells.doubt < 0.1 * VOLUME
    surface = union_surface(shells.corners, volume(shells.corners), 800)
    assert open_edges(surface.triangles) == 0


def test_six_loose_squares_are_a_box():
    vertices, triangles = primitive("box", np.array([0.2, 0.1, 0.05]))
    soup = np.vstack([vertices[face] * (1.0 - 1e-3 * k) for k, face in enumerate(triangles[::2])])
    other = np.vstack([vertices[face] * (1.0 - 1e-3 * k) for k, face in enumerate(triangles[1::2])])
    both = np.vstack([soup, other])
    shells = shells_of(both, np.arange(len(both)).reshape(-1, 3))
    assert "closed by the winding number" in shells.said
    assert volume(shells.corners) == pytest.approx(0.2 * 0.4 * 0.1, rel=0.05)  # measured 1 %


def test_a_bent_sheet_is_its_hull_and_a_flat_one_nothing():
    bend = np.array(
        [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 0.02], [1, 0, 0.02]], dtype=np.float64
    )
    sheet = np.array([[0, 1, 2], [0, 2, 3], [0, 5, 1], [0, 4, 5]])
    shells = shells_of(bend, sheet)
    assert shells.said == "1 open surface without an inside, as convex hulls"
    assert shells.doubt == pytest.approx(0.01, rel=1e-6)  # all of the hull
    flat = shells_of(bend[:4], sheet[:2])
    assert (len(flat.corners), flat.said) == (0, "1 flat surface left out")
    assert shells_of(np.zeros((3, 3)), np.array([[0, 1, 2]])).said == "no surface"


def test_many_parts_count_once(rng):
    vertices, triangles = primitive("box", np.array([0.2, 0.15, 0.05]))
    meshes = [vertices]
    faces = [triangles]
    first = len(vertices)
    for p_part in rng.uniform(-0.1, 0.1, (20, 3)) * [1.0, 1.0, 0.2]:
        small, corners = primitive("box", np.array([0.02, 0.02, 0.01]))
        meshes.append(small + p_part)
        faces.append(corners + first)
        first += len(small)
    shells = shells_of(np.vstack(meshes), np.vstack(faces))
    assert shells.said == "21 closed shells"
    # all lie within the first
    assert volume(shells.corners) == pytest.approx(0.4 * 0.3 * 0.1, rel=1e-6)
