"""Hull places chosen by hand: with a singular posture of the arm on the path, or no room."""

from dataclasses import replace

import numpy as np
import pytest

from uuv.controllers.arm import tool_motion
from uuv.controllers.arm.joint_servo import _factor
from uuv.controllers.planning.hull_place import HullPlace
from uuv.controllers.planning.hull_placement import PathStanding, StandingLimits
from uuv.controllers.planning.path_poses import tool_pose
from uuv.models.objects.targets import barrel
from uuv.models.site import scenes
from uuv.own_vehicle import OwnVehicle, vehicle_spec
from uuv.sim.interfaces.errors import ConfigurationError, ReachError
from uuv.sim.interfaces.messages import Target, ToolPath
from uuv.sim.interfaces.spatial import exp_so3, inverse, pose, transform_points

X_WT = pose(exp_so3([0.0, 0.0, 0.4]), [0.3, -0.2, -1.5])
STANDOFF = 0.1  # [m]
THROUGH = HullPlace(x=-0.65, y=-0.52, z=1.15)
BESIDE = HullPlace(x=-0.8, y=-0.46, z=1.15)


@pytest.fixture(scope="module")
def work() -> tuple[PathStanding, Target, ToolPath]:
    """The path around the barrel's side, on the fast side of the speeds to keep the test short."""
    model = barrel(arc=0.87, arc_azimuth=1.4)
    path = model.path("transverse")
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path.p, axis=0), axis=1))])
    R = X_WT[:3, :3]
    tool_path = ToolPath(
        s=s,
        p=transform_points(X_WT, path.p),
        z=path.a @ R.T,
        x=path.b @ R.T,
        on_scan=np.ones(len(s), dtype=bool),
    )
    target = Target(
        time=0.0, X_WT=X_WT, accepted=True, check_m=0.0, range_m=1.0, reason="", path=tool_path
    )
    own = OwnVehicle.of(vehicle_spec("uuv_puma", tool="pad")).at_work()
    standing = PathStanding(
        vehicle=own.vehicle,
        chain=own.chain,
        model=model,
        hull_box=own.hull_box,
        limits=StandingLimits(force=60.0, standoff=STANDOFF, speed=0.1),
        floor=scenes.seabed_height(model, X_WT),
    )
    return standing, target, tool_path


def at(standing: PathStanding, place: HullPlace, *, unchecked: bool = False) -> PathStanding:
    limits = replace(standing.limits, place=place, unchecked=unchecked)
    return replace(standing, limits=limits)


def test_the_lock_is_passed_where_the_tool_keeps_its_path(work) -> None:
    standing, target, path = work
    placement, worked, share = at(standing, THROUGH)(target, path)
    assert share == 1.0
    assert worked is path
    assert "passes a singular posture" in placement.note

    # the hull stands where it was told to, and the arm begins at the stand-off
    away = inverse(X_WT) @ placement.X_WB
    assert away[:3, 3] == pytest.approx([THROUGH.x, THROUGH.y, THROUGH.z])
    first = tool_pose(path, 0.0, placement.roll)[0]
    first[:3, 3] -= STANDOFF * first[:3, 2]
    tip = placement.X_WB @ standing.vehicle.X_BA @ standing.chain.forward(placement.q_start)
    assert np.abs(tip - first).max() < 2e-3  # the tolerance of the postures


def test_the_lock_is_refused_where_the_tool_would_leave_its_path(work) -> None:
    """With its place on the path and the figures; unchecked the placement is given."""
    standing, target, path = work
    said = r"singular posture at 0\.2\d m of the path: .* by [\d.]+ mm and \d+\.\d deg, allowed are"
    with pytest.raises(ReachError, match=said):
        at(standing, BESIDE)(target, path)
    placement, *_ = at(standing, BESIDE, unchecked=True)(target, path)
    assert placement.reached == 1.0


def test_a_joint_at_its_limit_is_named(work) -> None:
    """The wrist bends up to 92 deg, and the path through its lock needs a little more."""
    standing, target, path = work
    spec = vehicle_spec("uuv_puma", tool="pad")
    spec.joint("joint5").range = np.radians([-92.0, 92.0])
    own = OwnVehicle.of(spec).at_work()
    stiff = replace(standing, vehicle=own.vehicle, chain=own.chain)
    said = r"joint5 is at its limit at 0\.\d\d m of the path: .* [\d.]+ deg, allowed are 3 mm"
    with pytest.raises(ReachError, match=said):
        at(stiff, THROUGH)(target, path)


def test_a_place_without_room_is_refused(work) -> None:
    standing, target, path = work
    with pytest.raises(ReachError, match=r"less than 0\.25 m to the object or the seabed"):
        at(standing, HullPlace(x=0.0, y=0.0, z=0.6))(target, path)
    with pytest.raises(ReachError, match="out of reach from the chosen place"):
        at(standing, HullPlace(x=5.0, y=0.0, z=1.2))(target, path)
    with pytest.raises(ConfigurationError, match=r"task\.hull_place\.x \[m\]"):
        HullPlace(x=np.inf, y=0.0, z=0.0)


def test_a_place_is_level_beside_any_object() -> None:
    place = HullPlace(x=1.0, y=0.0, z=0.5, heading=0.3)
    upright = pose(exp_so3([0.0, -0.5 * np.pi, 0.0]), [1.0, 2.0, 3.0])  # x_T up
    for X in (X_WT @ pose(exp_so3([0.7, 0.0, 0.0])), upright):
        X_WB = place.in_world(X)
        assert X_WB[2, :3] == pytest.approx([0.0, 0.0, 1.0])
        assert X_WB[2, 3] == pytest.approx(X[2, 3] + 0.5)
        assert np.linalg.norm((X_WB - X)[:2, 3]) == pytest.approx(1.0)
    turned = place.in_world(X_WT)[:3, :3]
    assert turned == pytest.approx(exp_so3([0.0, 0.0, 0.7]))


def test_nearness_and_damping_beside_a_singular_posture() -> None:
    """The kernels' plain forms against a singular value decomposition and NumPy's factor."""
    rng = np.random.default_rng(0)
    near = 0
    for _ in range(200):
        U, _, V = np.linalg.svd(rng.normal(size=(6, 6)))
        J = U @ np.diag([1.0, 0.9, 0.8, 0.7, 0.5, rng.uniform(0.0, 0.3)]) @ V
        scaled = J * np.array([0.5, 0.5, 0.5, 1.0, 1.0, 1.0])[:, None]
        least = np.linalg.svd(scaled, compute_uv=False)[-1]
        assert tool_motion._is_near.py_func(J, 2.0) == (least < tool_motion.NEAR)
        near += least < tool_motion.NEAR

        L = np.zeros((6, 6))
        pivot = _factor.py_func(J @ J.T, 1e-3, L)
        assert pytest.approx(np.linalg.cholesky(J @ J.T + 1e-3 * np.eye(6)), abs=1e-9) == L
        assert pivot == pytest.approx((np.diag(L) ** 2).min())
    assert 20 < near < 180
