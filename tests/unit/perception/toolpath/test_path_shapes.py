"""Analytic curves on meshes against the shapes that the meshes stand for, and what is refused."""

import numpy as np
import pytest

from uuv.models.objects.targets import (
    PILE_DIAMETER,
    TargetModel,
    barrel,
    helix,
    longitudinal,
    pile,
    ring,
    transverse,
)
from uuv.perception.toolpath.path_shapes import circle, cut, joined, laid_on, line, raster, through
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, exp_so3

RADIUS = 0.5 * PILE_DIAMETER


def tilted_plate(slope: float = 0.3, size: float = 0.5) -> TargetModel:
    """A square plate z = slope * y, seen from +z."""
    x = np.array([[-size, -size], [size, -size], [size, size], [-size, size]])
    vertices = np.column_stack([x, slope * x[:, 1]])
    return TargetModel(name="plate", vertices=vertices, triangles=np.array([[0, 1, 2], [0, 2, 3]]))


def length(points: Array) -> float:
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def test_curves_are_what_they_are_called(within):
    within("line [m]", length(line([0, 0, 0], [0.3, 0.4, 0.0])) - 0.5, 1e-12)
    w = np.array([1.0, 2.0, 2.0]) / 3.0
    c = np.array([0.1, -0.2, 0.3])
    start = c + 0.4 * np.cross(w, [1.0, 0.0, 0.0]) / np.linalg.norm(np.cross(w, [1.0, 0.0, 0.0]))
    arc = circle(c, w, start, 1.2)
    within("radius [m]", np.linalg.norm(arc - c, axis=1) - 0.4, 1e-12)
    within("in its plane [m]", (arc - c) @ w, 1e-12)
    within("its end", arc[-1] - (c + exp_so3(1.2 * w) @ (start - c)), 1e-12)
    spring = circle(c, w, start, 7.0, rise=0.2)
    within("rise [m]", (spring - c) @ w - np.linspace(0.0, 0.2, len(spring)), 1e-12)
    within("length [m]", length(spring) - np.hypot(0.4 * 7.0, 0.2), 1e-3)


def test_raster_covers_the_patch_without_a_corner(within):
    way = raster([0, 0, 1.0], [0.3, 0, 0], [0, 0.2, 0], 0.06)
    assert np.abs(way[:, 1]).max() == pytest.approx(0.1)
    lines = np.unique(np.round(way[np.abs(way[:, 0]) < 0.1, 1], 9))
    # 5 lines at most 6 cm apart over 20 cm
    assert np.diff(lines) == pytest.approx(np.full(4, 0.05))
    within("length [m]", length(way) - (5 * 0.3 + 4 * np.pi * 0.025), 2e-3)
    along = np.diff(way, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    turn = np.arccos(np.clip(np.einsum("ij,ij->i", along[:-1], along[1:]), -1.0, 1.0))
    assert turn.max() < np.deg2rad(15.0)  # half circles, no corners
    within("flat [m]", way[:, 2] - 1.0, 1e-12)


def test_the_objects_own_paths_come_out_of_projection(within):
    """Line, arc and helix laid on barrel and pile by rays: the same as the closed forms that the
    objects bring.
    """
    shell, leg = barrel(), pile()
    direct = longitudinal(0.6, 0.3)
    projected = laid_on(
        shell, line(direct.p[0] - 0.1 * direct.a[0], direct.p[-1] - 0.1 * direct.a[0]), direct.a[0]
    )
    within("line [m]", np.linalg.norm(projected.p[:, 1:], axis=1) - 0.3, 3e-5)
    within("line's axes", projected.a - direct.a[0], 1e-2)  # one side of 256 is 1.4 deg wide
    within("line's way", projected.b - direct.b[0], 1e-2)

    direct = transverse(2.0)
    around = circle([0, 0, 0], [1.0, 0, 0], 1.2 * direct.p[0], 2.0)
    projected = laid_on(shell, around, -around)
    within("arc [m]", np.linalg.norm(projected.p[:, 1:], axis=1) - 0.3, 5e-5)
    within("arc's ends [m]", projected.p[[0, -1]] - direct.p[[0, -1]], 1e-4)
    within("arc's axes", projected.a[5:-5] + projected.p[5:-5] / 0.3, 2e-2)

    direct = helix(1.5, 0.3)
    spring = circle(
        [0, 0, direct.p[0, 2]], [0, 0, 1.0], direct.p[0] * [1.3, 1.3, 1.0], 1.5, rise=0.3
    )
    projected = laid_on(leg, spring, -spring * [1.0, 1.0, 0.0])
    within("helix [m]", np.linalg.norm(projected.p[:, :2], axis=1) - RADIUS, 5e-5)
    within("helix' height [m]", projected.p[[0, -1], 2] - direct.p[[0, -1], 2], 1e-6)
    within("helix' way", projected.b[len(projected.b) // 2] - direct.b[len(direct.b) // 2], 1e-2)


def test_cut_is_the_plane_s_profile(within):
    """Across the pile by a plane through two of its points: an arc of a circle; obliquely: an
    ellipse.
    """
    direct = ring(1.2, height=-0.4)
    profile = cut(pile(), direct.p[0], direct.p[-1], [-1.0, 0.0, 0.0])
    within("arc [m]", np.linalg.norm(profile.p[:, :2], axis=1) - RADIUS, 5e-5)
    within("in the plane [m]", profile.p[:, 2] + 0.4, 1e-6)
    within("length [m]", length(profile.p) - RADIUS * 1.2, 1e-3)
    lower = direct.p[0] - [0, 0, 0.1]
    upper = direct.p[-1] + [0, 0, 0.1]
    profile = cut(pile(), lower, upper, [-1.0, 0.0, 0.0])
    normal = np.cross(upper - lower, [-1.0, 0.0, 0.0])
    within("in the oblique plane [m]", (profile.p - lower) @ normal / np.linalg.norm(normal), 1e-5)
    within("on the shell [m]", np.linalg.norm(profile.p[:, :2], axis=1) - RADIUS, 5e-5)
    within("ends [m]", profile.p[[0, -1]] - [lower, upper], 5e-5)


def test_normals_and_way_on_a_plate(within):
    """z = slope y: the tool axis is (0, slope, -1) normed, everywhere, and the second axis lies in
    the plate.
    """
    projected = laid_on(
        tilted_plate(), raster([0, 0, 0.3], [0.4, 0, 0], [0, 0.3, 0], 0.1), [0.0, 0.0, -1.0]
    )
    within("on the plate [m]", projected.p[:, 2] - 0.3 * projected.p[:, 1], 1e-6)
    within("axis", projected.a - np.array([0.0, 0.3, -1.0]) / np.hypot(0.3, 1.0), 1e-6)
    within("perpendicular", np.einsum("ij,ij->i", projected.a, projected.b), 1e-9)


def test_point_list_with_axes(within):
    """Few points of an arc, with axes of any length: a dense path through them."""
    direct = transverse(1.5)
    rows = np.linspace(0, len(direct.p) - 1, 9).astype(int)
    fitted = through(direct.p[rows], 3.0 * direct.a[rows])
    within("radius [m]", np.linalg.norm(fitted.p[:, 1:], axis=1) - 0.3, 2e-4)
    within("way", fitted.b - np.cross([1.0, 0.0, 0.0], -fitted.a), 2e-2)
    assert np.linalg.norm(np.diff(fitted.p, axis=0), axis=1).max() < 7e-3
    assert through(direct.p[rows], direct.a[rows], direct.b[rows]).b[0] == pytest.approx(
        direct.b[0]
    )


def test_paths_are_joined_where_they_meet():
    first, then = longitudinal(0.3), longitudinal(0.3)
    moved = then.p + np.array([0.3, 0.0, 0.0])
    whole = joined([first, type(first)(p=moved, a=then.a, b=then.b)])
    assert length(whole.p) == pytest.approx(0.6)
    with pytest.raises(ConfigurationError, match="paths 0 and 1 are 300 mm apart"):
        joined([first, then])


@pytest.mark.parametrize(
    ("make", "match"),
    [
        pytest.param(lambda: line([0, 0, 0], [0, 0, 0]), "coincide", id="line without length"),
        pytest.param(
            lambda: circle([0, 0, 0], [0, 0, 1], [0, 0, 2]),
            "on the axis",
            id="circle without radius",
        ),
        pytest.param(
            lambda: circle([0, 0, 0], [0, 0, 0], [0, 1, 2]), "axis: must not be zero", id="no axis"
        ),
        pytest.param(
            lambda: raster([0, 0, 0], [1, 0, 0], [1, 1, 0], 0.1),
            "perpendicular",
            id="oblique raster",
        ),
        pytest.param(
            lambda: raster([0, 0, 0], [1, 0, 0], [0, 1, 0], 0.0),
            r"pitch.*must be positive",
            id="no pitch",
        ),
        pytest.param(
            lambda: laid_on(barrel(), line([-0.4, 0, 1], [0.8, 0, 1]), [0, 0, -1]),
            r"\d+ of \d+ rays miss",
            id="miss",
        ),
        pytest.param(
            lambda: laid_on(pile(), line([0.35, 0, 0.0], [0.35, 0, 0.5]), [-1, 0, 0]),
            "falls off an edge",
            id="flange",
        ),
        pytest.param(
            lambda: laid_on(barrel(), line([0, 0, 1], [0, 0.286, 1]), [0, 0, -1]),
            "nearly parallel to the direction",
            id="grazing",
        ),
        pytest.param(
            lambda: laid_on(barrel(), np.zeros((9, 3)), [0, 0, -1]), "coincide", id="on the spot"
        ),
        pytest.param(
            lambda: laid_on(barrel(), np.full((9, 3), np.nan), [0, 0, -1]), "not finite", id="NaN"
        ),
        pytest.param(
            lambda: laid_on(barrel(), np.zeros((9, 2)), [0, 0, -1]), r"\(N, 3\)", id="two columns"
        ),
        pytest.param(
            lambda: through(transverse().p[:3], transverse().a[:3]), "N >= 4", id="three points"
        ),
        pytest.param(
            lambda: through(transverse().p[:5], np.zeros((5, 3))), "row 0 is zero", id="no axes"
        ),
        pytest.param(
            lambda: through(line([0, 0, 0], [0, 0, 1])[:5], np.tile([0, 0, 1.0], (5, 1))),
            "parallel to the path",
            id="axis",
        ),
        pytest.param(
            lambda: through(
                transverse().p[:5], transverse().a[:5] * np.array([[1], [1], [-1], [1], [1]])
            ),
            "90 deg or more apart",
            id="axis turned over",
        ),
    ],
)
def test_what_makes_no_path_is_refused(make, match: str):
    with pytest.raises(ConfigurationError, match=match):
        make()
