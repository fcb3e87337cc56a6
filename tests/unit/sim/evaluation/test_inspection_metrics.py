"""The figures of an inspection flight against their closed forms, around a box."""

from types import SimpleNamespace

import numpy as np
import pytest

from untyped import untyped
from uuv.models.objects.targets import TargetModel
from uuv.sim.evaluation.inspection_metrics import (
    TrueInspection,
    camera_poses,
    coverage,
    mesh_figures,
    off_and_view,
    seen_share,
)
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import (
    Array,
    exp_so3,
    pose,
    quat_wxyz_from_rotation,
    transform_points,
)

CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
SIDES = np.array(
    [
        [0, 1, 3],
        [0, 3, 2],
        [4, 7, 5],
        [4, 6, 7],
        [0, 5, 1],
        [0, 4, 5],
        [2, 3, 7],
        [2, 7, 6],
        [0, 2, 6],
        [0, 6, 4],
        [1, 5, 7],
        [1, 7, 3],
    ]
)
CUBE = TargetModel(name="cube", vertices=CORNERS, triangles=SIDES)
X_WT = pose(p=[1.0, 2.0, -5.0])


def truth(**changed: object) -> TrueInspection:
    fields_of = {
        "X_WT": X_WT,
        "X_BC": np.eye(4),
        "half_view": (1.0, 1.0),
        "far": 10.0,
        "distance": 1.5,
    }
    return TrueInspection(target=CUBE, **untyped({**fields_of, **changed}))


def looking(at_T: Array, axis: Array) -> Array:
    """A camera at `at_T` (3,) from the cube's middle that looks along `axis` (3,)."""
    z = axis / np.linalg.norm(axis)
    x = np.cross(z, [0.3, 0.5, 0.81])
    x /= np.linalg.norm(x)
    return pose(
        np.column_stack([x, np.cross(z, x), z]), transform_points(X_WT, np.asarray(at_T)[None])[0]
    )


def test_distance_and_view_are_those_to_the_nearest_of_the_outline(within):
    # 0.9 before a side, 1.2 over its middle
    side = looking(np.array([1.4, 0.1, 1.2]), np.array([-1.0, 0.0, -1.0]))
    corner = looking(np.array([0.8, 0.9, 0.0]), np.array([-1.0, -1.0, 0.0]))
    off, view = off_and_view(np.array([side, corner]), truth())
    within("off [m]", off - ([1.5, 0.5] - np.full(2, 1.5)), 1e-12)
    within("view [rad]", view - [0.0, np.arctan2(0.4, 0.3) - 0.25 * np.pi], 1e-9)


@pytest.mark.parametrize(
    ("cameras", "share"),
    [
        pytest.param(
            [looking(np.array([0.0, 0.0, 1.6]), np.array([0.0, 0.0, -1.0]))],
            1.0 / 6.0,
            id="from above",
        ),
        pytest.param(
            [looking(np.array([2.0, 2.0, 2.0]), np.array([-1.0, -1.0, -1.0]))],
            0.5,
            id="on a corner",
        ),
        pytest.param(
            [looking(np.array([0.0, 0.0, 1.6]), np.array([0.0, 0.0, 1.0]))], 0.0, id="looking away"
        ),
        pytest.param(
            [looking(s * np.array([2.0, 2.0, 2.0]), -s * np.ones(3)) for s in (1, -1)],
            1.0,
            id="all around",
        ),
        pytest.param(
            [looking(np.array([0.0, 0.0, 11.0]), np.array([0.0, 0.0, -1.0]))], 0.0, id="too far"
        ),
    ],
)
def test_surface_seen_of_a_cube(within, cameras, share):
    # 4000 random pieces: 4 sigma
    within("share", seen_share(np.array(cameras), truth()) - share, 0.03)


def test_a_narrow_view_sees_the_middle_alone(within):
    """A quarter of the top: 1 m away with a tangent of 0.25."""
    camera = pose(np.diag([1.0, -1.0, -1.0]), X_WT[:3, 3] + [0.0, 0.0, 1.5])
    within("share", seen_share(camera[None], truth(half_view=(0.25, 0.25))) - 0.25 / 6.0, 0.015)


def test_cameras_are_where_the_hull_carries_them(within):
    """Hulls askew, the camera 0.4 m ahead of the hull's origin, turned in it."""
    hulls = [pose(exp_so3([0.2 * k, -0.3, 0.5 + k]), [1.0 + k, -2.0, 0.3 * k]) for k in range(3)]
    X_BC = pose(exp_so3([0.1, 1.2, -0.4]), [0.4, 0.0, -0.1])
    series = {
        "p_WB": SimpleNamespace(value=np.array([X[:3, 3] for X in hulls])),
        "quat_WB_wxyz": SimpleNamespace(
            value=np.array([quat_wxyz_from_rotation(X[:3, :3]) for X in hulls])
        ),
    }
    X_WC = camera_poses(untyped(series), truth(X_BC=X_BC), np.array([0, 2]))
    within("X_WC", X_WC - np.array([hulls[0] @ X_BC, hulls[2] @ X_BC]), 1e-12)


def test_coverage_is_of_all_that_can_be_seen():
    """The top is allowed; it and a side are seen: the side counts as visible too, the other four
    are not.
    """
    top = looking(np.array([0.0, 0.0, 1.6]), np.array([0.0, 0.0, -1.0]))
    side = looking(np.array([1.6, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0]))
    assert coverage(np.array([top, side]), truth(allowed=top[None])) == 1.0
    half = coverage(top[None], truth(allowed=np.array([top, side])))
    assert half == pytest.approx(0.5, abs=0.04)  # 4000 random pieces
    away = looking(np.array([0.0, 0.0, 1.6]), np.array([0.0, 0.0, 1.0]))
    assert coverage(away[None], truth(allowed=away[None])) is None


def test_a_measured_surface_is_judged_by_its_distance_from_the_true_one():
    """A hundred points above the top, 0.1 to 10 mm off: of them the median is 5.05 mm and the 95 %
    9.505 mm.
    """
    off = 1e-4 * np.arange(1, 101, dtype=np.float64)
    points = np.column_stack(
        [0.3 * np.sin(np.arange(100)), 0.2 * np.cos(np.arange(100)), 0.5 + off]
    )
    mesh = mesh_figures(untyped(SimpleNamespace(vertices=points, deviation=-2.0 * off)), truth())
    assert mesh.vertices == 100
    assert mesh.true_p50_m == pytest.approx(5.05e-3, abs=1e-6)
    assert mesh.true_p95_m == pytest.approx(9.505e-3, abs=1e-6)
    assert mesh.model_p95_m == pytest.approx(2.0 * 9.505e-3, rel=1e-9)


def test_what_cannot_be_is_refused():
    with pytest.raises(ConfigurationError, match="half_view, far and distance must be > 0"):
        truth(far=0.0)
