"""Grasps of an object: searched on its mesh, placed at the site, ranked, or refused."""

from dataclasses import replace

import numpy as np
import pytest

from uuv.controllers.planning.grasp_choice import GraspChoice, GraspLimits, carry_path
from uuv.models.meshes.closed_shells import sphere
from uuv.models.objects.anode import SMALL, small_anode
from uuv.models.objects.grasps import Grasp, antipodal, surface_points
from uuv.models.objects.rock import rock, stone
from uuv.models.objects.starfish import starfish
from uuv.models.objects.target_model import TargetModel
from uuv.models.tools.jaw_shape import JawShape
from uuv.sim.interfaces.errors import ConfigurationError, ReachError
from uuv.sim.interfaces.spatial import Array, exp_so3, inverse, pose, transform_points

JAWS = JawShape(
    opening=0.1,
    thickness=0.012,
    breadth=0.03,
    finger=0.088,
    force=100.0,
    friction=0.6,
    damping=3840.0,
    loss=4.0,
)
R = 0.03  # [m]


def ball() -> TargetModel:
    """A ball about the origin."""
    unit, triangles = sphere(3)
    return TargetModel(name="ball", vertices=R * unit, triangles=triangles)


def lying(target: TargetModel, yaw: float = 0.7) -> tuple[Array, float]:
    """Pose of an object on the ground, and the height of that."""
    X_WT = pose(exp_so3([0.0, 0.0, yaw]), [0.4, -0.3, -1.7])
    return X_WT, float(transform_points(X_WT, target.vertices)[:, 2].min())


def test_points_fill_a_surface_evenly_and_have_its_normals() -> None:
    target = ball()
    points, normals = surface_points(target.vertices, target.triangles, 2000)
    assert np.linalg.norm(points, axis=1) == pytest.approx(R, rel=0.02)
    assert np.einsum("ij,ij->i", points, normals) == pytest.approx(R, rel=0.02)
    assert np.abs(points.mean(axis=0)).max() < 0.02 * R


def test_every_line_through_the_middle_of_a_ball_is_a_grasp() -> None:
    target = ball()
    grasps = antipodal(target.vertices, target.triangles, friction=0.3, count=300)
    assert len(grasps) == 300
    assert [grasp.width for grasp in grasps] == pytest.approx([2.0 * R] * 300, rel=0.02)
    assert max(float(np.linalg.norm(grasp.p)) for grasp in grasps) < 0.1 * R


def test_sides_that_slope_more_than_friction_are_no_grasp() -> None:
    """The sides of the anode slope by 0.1 of their height, each."""
    target = small_anode()
    steep = antipodal(target.vertices, target.triangles, friction=0.6)
    across = [grasp for grasp in steep if abs(grasp.x[1]) > 0.9]
    assert across
    # Both sides lean the same way: the normals differ by twice the slope.
    assert {round(grasp.slope, 2) for grasp in across} == {0.2}

    slippery = antipodal(target.vertices, target.triangles, friction=0.15)
    assert not [grasp for grasp in slippery if abs(grasp.x[1]) > 0.9]


@pytest.mark.parametrize("seed", [0, 3])
def test_jaws_around_a_stone_come_from_above_and_touch_nothing_else(seed: int) -> None:
    target = stone(seed)
    X_WT, floor = lying(target)
    choice = GraspChoice.of(target, JAWS)
    best = choice.ranked(X_WT, floor)[0]

    X = best.X_WG
    assert X[2, 2] < -np.cos(np.radians(26.0))  # the tool points down
    assert X[2, 3] > floor + 0.9 * choice.limits.ground
    p = transform_points(inverse(X), transform_points(X_WT, target.vertices))
    between = (np.abs(p[:, 1]) < 0.5 * JAWS.breadth) & (p[:, 2] < 0.0)
    assert np.ptp(p[between, 0]) == pytest.approx(best.width, abs=2e-3)
    assert np.abs(p[between, 0]).max() < 0.5 * best.opening  # open jaws pass
    assert best.opening <= JAWS.opening


def test_an_arm_of_a_starfish_is_gripped_where_its_weight_allows() -> None:
    target = starfish()
    X_WT, floor = lying(target)
    with pytest.raises(ReachError, match="5 too far from the weight"):
        GraspChoice.of(target, JAWS).ranked(X_WT, floor)

    light = GraspChoice.of(target, JAWS, GraspLimits(aside=0.2))
    ranked = light.ranked(X_WT, floor)
    assert len(ranked) == 5
    assert ranked[0].width == pytest.approx(0.0634, abs=2e-3)


@pytest.mark.parametrize("degrees", [0.0, 12.0, 18.0])
def test_the_finger_on_the_low_side_of_a_leaning_grasp_stays_above_the_ground(
    degrees: float,
) -> None:
    lean = np.radians(degrees)
    leaning = Grasp(p=np.zeros(3), x=np.array([np.cos(lean), 0.0, np.sin(lean)]), width=2.0 * R)
    target = replace(ball(), grasps={"leaning": leaning})
    X_WT, floor = lying(target)
    choice = GraspChoice.of(target, JAWS)
    (grasp,) = choice.ranked(X_WT, floor)

    # Corners of both open fingers at their ends, from the shape of the jaws alone.
    outer = 0.5 * grasp.opening + JAWS.thickness
    corners = [
        (side * outer, edge * 0.5 * JAWS.breadth, 0.0) for side in (-1, 1) for edge in (-1, 1)
    ]
    heights = transform_points(grasp.X_WG, np.array(corners))[:, 2] - floor
    assert heights.min() >= choice.limits.ground - 1e-9


def test_a_grasp_that_is_not_possible_is_refused_for_its_own_reason() -> None:
    lean = np.radians(24.0)
    leaning = Grasp(p=np.zeros(3), x=np.array([np.cos(lean), 0.0, np.sin(lean)]), width=2.0 * R)
    slippery = Grasp(p=np.zeros(3), x=np.array([1.0, 0.0, 0.0]), width=2.0 * R, slope=0.7)
    for grasp, reason in ((leaning, "too near to the ground"), (slippery, "too slippery")):
        target = replace(ball(), grasps={"only": grasp})
        X_WT, floor = lying(target)
        with pytest.raises(ReachError, match=f"1 {reason}"):
            GraspChoice.of(target, JAWS).ranked(X_WT, floor)


def test_declared_grasps_take_the_place_of_a_search() -> None:
    across = Grasp(p=np.zeros(3), x=np.array([0.0, 1.0, 0.0]), width=2.0 * R)
    target = replace(ball(), grasps={"across": across})
    choice = GraspChoice.of(target, JAWS)
    assert choice.grasps == (across,)
    with pytest.raises(ConfigurationError, match="grasps must be a mapping of names to Grasp"):
        replace(ball(), grasps={"across": "across"})
    with pytest.raises(ConfigurationError, match="grasp x: must be a unit vector"):
        Grasp(p=np.zeros(3), x=np.array([0.0, 2.0, 0.0]), width=0.01)


def test_what_cannot_be_gripped_is_refused_with_the_reason() -> None:
    with pytest.raises(ConfigurationError, match=r"'rock' is too wide for the jaws: \d+ mm"):
        GraspChoice.of(rock(size=0.4), JAWS)

    # A thin disc on the ground leaves no room for the fingers' ends.
    unit, triangles = sphere(3)
    disc = TargetModel(name="disc", vertices=unit * [0.03, 0.03, 0.004], triangles=triangles)
    X_WT, floor = lying(disc)
    with pytest.raises(ReachError, match="too near to the ground"):
        GraspChoice.of(disc, JAWS).ranked(X_WT, floor)


def test_the_path_to_the_basket_is_straight_and_keeps_the_jaws() -> None:
    target = small_anode()
    X_WT, floor = lying(target)
    grasp = GraspChoice.of(target, JAWS).ranked(X_WT, floor)[0]
    assert grasp.width == pytest.approx(SMALL[2], abs=0.01)
    end = grasp.X_WG[:3, 3] + [0.3, 0.1, 0.05]
    path = carry_path(grasp, end)
    assert path.keeps_x
    assert path.p[0] == pytest.approx(grasp.X_WG[:3, 3])
    assert path.p[-1] == pytest.approx(end)
    assert path.s[-1] == pytest.approx(np.linalg.norm(end - grasp.X_WG[:3, 3]))
    assert np.ptp(path.x, axis=0) == pytest.approx(0.0)
