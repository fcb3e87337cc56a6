"""Every named model: the figures of its source arrive, it is trimmed, stays, rights itself, hovers.

The figures below are typed from the sources, in their axes (forward, starboard, down), apart from
those in `models`.
"""

import ast
import json
import re
from functools import cache
from typing import Any

import mujoco
import numpy as np
import pytest

from uuv import models
from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.hull.allocation import Allocation
from uuv.controllers.hull.station_keeping import StationKeeping
from uuv.models import hydrodynamics as water
from uuv.models.hydrodynamics import BodyHydrodynamics, unpack
from uuv.models.naming import ARM_BASE_BODY, HOME_KEY, HULL_BODY, TIP_SITE
from uuv.models.vehicle import Vehicle
from uuv.models.vehicles import published_hulls
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import Command
from uuv.sim.interfaces.spatial import (
    Array,
    exp_so3,
    pose,
    quat_wxyz_from_rotation,
    rotation_angle,
    skew,
)
from uuv.sim.loop.true_estimate import true_estimate
from uuv.sim.plant.plant import Plant
from uuv.sim.sensors.depth_camera import DepthCamera
from uuv.sim.water.current import Current

# without the aliases
NAMES = sorted({models.VEHICLES.resolve(name) for name in models.available()})
# test_description_says_what_the_model_has holds these two lists against the models
FIXED = ["reach_alpha_5"]
# one holds no place, nothing drives the pitch or roll of the others
UNDERACTUATED = ["remus100", "bluerov2", "bluerov2_alpha5", "girona500_arm4"]
FLOATING = [name for name in NAMES if name not in FIXED]
HOVERING = [name for name in FLOATING if name not in UNDERACTUATED]
# of a six-vector that changes from the source's axes to ours
SIGNS = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])
L, RHO = 5.3, 1000.0  # PHOENIX

SOURCES = {
    "girona500_arm4": {
        "mass": 98.0,
        "gravity": (0, 0, 0.05),
        "inertia": 8.0 * np.eye(3),
        "buoyancy": (0, 0, 0),
        "added": np.diag([49.0, 49.0, 49.0, 0, 0, 0]),
        "linear": (0, 0, 0, 130.0, 130.0, 130.0),
        "quadratic": (148.0, 148.0, 148.0, 180.0, 180.0, 180.0),
    },
    "bluerov2_heavy_benzon2022": {
        "mass": 13.5,
        "gravity": (0, 0, 0),
        "inertia": np.diag([0.26, 0.23, 0.37]),
        "buoyancy": (0, 0, -0.01),
        "added": np.diag([6.36, 7.12, 18.68, 0.189, 0.135, 0.222]),
        "linear": (13.7, 0, 33.0, 0, 0.8, 0),
        "quadratic": (141, 217, 190, 1.19, 0.47, 1.5),
    },
    "bluerov2_heavy_wu2018": {
        "mass": 11.5,
        "gravity": (0, 0, 0.02),
        "inertia": 0.16 * np.eye(3),
        "buoyancy": (0, 0, 0),
        "added": np.diag([5.5, 12.7, 14.57, 0.12, 0.12, 0.12]),
        "linear": (4.03, 6.22, 5.18, 0.07, 0.07, 0.07),
        "quadratic": (18.18, 21.66, 36.99, 1.55, 1.55, 1.55),
    },
    "phoenix_smart3s": {
        "mass": 5454.54,
        "gravity": (0, 0, 0.061),
        "buoyancy": (0, 0, 0),
        "linear": (0, 0, 0, 0, 0, 0),
        "inertia": np.array([[2038, 13.58, 13.58], [13.58, 13587, 13.58], [13.58, 13.58, 13587]]),
        "quadratic": (
            0.5 * RHO * L**2 * 0.00385,
            150 * L,
            300 * L,
            0,
            300 * L**4 / 32,
            150 * L**4 / 32,
        ),
    },
}
# SIMURV 4.0, func/InverseDynamics_vehicle.m, as printed, with four digits: rigid body and water
# together.
PHOENIX_M = np.array(
    [
        [6.019e3, 5.122e-8, -1.180e-2, -3.200e-5, 3.325e2, -6.731e-5],
        [5.122e-8, 9.551e3, 3.717e-6, -3.802e2, -3.067e-5, -4.736e2],
        [-1.180e-2, 3.717e-6, 2.332e4, -1.514e-4, 2.683e3, -4.750e-4],
        [-3.200e-5, -3.802e2, -1.514e-4, 4.129e3, 1.358e1, 8.467e1],
        [3.325e2, -3.067e-5, 2.683e3, 1.358e1, 4.913e4, 1.357e1],
        [-6.731e-5, -4.736e2, -4.750e-4, 8.467e1, 1.357e1, 2.069e4],
    ]
)
# Thrusts 1 to 8 to the wrench on the hull. Wu's matrix is printed. Of von Benzon's set the places
# are: the upright four, all pushing up, give moments by hand; the level four are as Wu's.
LEVEL_ARM = 0.06 * np.array([[1, -1, 1, -1], [1, 1, -1, -1]])
WU_B = np.array(
    [
        [0.707, 0.707, -0.707, -0.707, 0, 0, 0, 0],
        [-0.707, 0.707, -0.707, 0.707, 0, 0, 0, 0],
        [0, 0, 0, 0, -1, 1, 1, -1],
        [*LEVEL_ARM[0], -0.218, -0.218, 0.218, 0.218],
        [*LEVEL_ARM[1], 0.12, -0.12, 0.12, -0.12],
        [-0.1888, 0.1888, 0.1888, -0.1888, 0, 0, 0, 0],
    ]
)
BENZON_B = np.vstack(
    [
        WU_B[:2],
        [0, 0, 0, 0, -1, -1, -1, -1],
        [*LEVEL_ARM[0], -0.218, 0.218, -0.218, 0.218],
        [*LEVEL_ARM[1], 0.12, 0.12, -0.12, -0.12],
        WU_B[5],
    ]
)


@cache
def compiled(name: str) -> mujoco.MjModel:
    return hydrodynamics.compile(models.load(name))


def coefficients(model: mujoco.MjModel, body: int) -> BodyHydrodynamics | None:
    row = model.body_user[body]
    return unpack(row) if water.carries(row) else None


def rotation(quat_wxyz: Array) -> Array:
    R = np.empty(9)
    mujoco.mju_quat2Mat(R, quat_wxyz)
    return R.reshape(3, 3)


def rigid(model: mujoco.MjModel, body: int) -> tuple[float, Array, Array]:
    """Mass, centre (3,) and inertia (3, 3) about the body's origin."""
    R, m, c = (
        rotation(model.body_iquat[body]),
        float(model.body_mass[body]),
        np.array(model.body_ipos[body]),
    )
    return m, c, R @ np.diag(model.body_inertia[body]) @ R.T - m * skew(c) @ skew(c)


# -- what is there ---------------------------------------------------------------------------------


def test_the_names_that_others_rely_on():
    assert {"uuv_puma", "bluerov2_heavy", "phoenix_smart3s", "reach_alpha_5"} <= set(
        models.available()
    )
    assert models.describe("bluerov2_heavy").name == "bluerov2_heavy_benzon2022"
    with pytest.raises(
        ConfigurationError,
        match=r"unknown vehicle 'bluerov3'; there are "
        r".*bluerov2_heavy_wu2018",
    ):
        models.describe("bluerov3")


@pytest.mark.parametrize("name", NAMES)
def test_description_says_what_the_model_has(name):
    described, model = models.describe(name), compiled(name)
    assert described.source
    assert (described.name, described.floating) == (name, name in FLOATING)
    assert (described.thrusters == 1) == (name == "remus100")
    assert (described.dof, described.thrusters) == (
        model.nv,
        sum(n.startswith("thruster_") for n in actuators(model)),
    )
    assert described.mass == pytest.approx(float(np.sum(model.body_mass)))
    if described.floating:
        assert 1025.0 * described.volume == pytest.approx(described.mass, rel=1e-12)
        vehicle = Vehicle.of(model)
        assert described.joints == vehicle.joint_names
        assert described.drive == ("thrusters" if len(vehicle.thruster_names) else "wrench")
        assert (described.drive == "wrench") == ("wrench_yaw" in actuators(model))
    else:
        assert described.drive == "fixed base"
        assert model.body_jntnum[model.body(ARM_BASE_BODY).id] == 0
        with pytest.raises(ConfigurationError, match="no body named 'hull'"):
            Vehicle.of(model)


def actuators(model: mujoco.MjModel) -> list[str]:
    return [model.actuator(i).name for i in range(model.nu)]


# -- axes, and figures -----------------------------------------------------------------------------


def test_axes_turn_as_wrenches_and_twists_do(rng):
    """Invariants that no sign table is needed for: power, energy, and that a moment is a lever
    times a force.
    """
    M = rng.normal(size=(6, 6))
    M = M + M.T
    nu, wrench, p, f = (
        rng.normal(size=6),
        rng.normal(size=6),
        rng.normal(size=3),
        rng.normal(size=3),
    )
    turned = published_hulls.from_ned(nu)
    assert turned @ published_hulls.from_ned(wrench) == pytest.approx(nu @ wrench, abs=1e-13)
    assert turned @ published_hulls.from_ned(M) @ turned == pytest.approx(nu @ M @ nu, abs=1e-12)
    assert np.cross(published_hulls.from_ned(p), published_hulls.from_ned(f)) == pytest.approx(
        published_hulls.from_ned(np.cross(p, f))
    )
    # forward, starboard, down
    assert published_hulls.from_ned([1.0, 2.0, 3.0]).tolist() == [1.0, -2.0, -3.0]
    assert published_hulls.from_ned(M) == pytest.approx(SIGNS[:, None] * M * SIGNS)
    assert published_hulls.from_ned(published_hulls.from_ned(M)) == pytest.approx(M)
    with pytest.raises(ConfigurationError, match=r"got shape \(4, 4\)"):
        published_hulls.from_ned(np.eye(4))


@pytest.mark.parametrize("name", SOURCES)
def test_figures_of_the_source_arrive_in_the_model(name, within):
    model, source = compiled(name), SOURCES[name]
    hull = model.body(HULL_BODY).id
    m, c, inertia = rigid(model, hull)
    identified = coefficients(model, hull)
    assert identified is not None
    within("mass [kg]", m - source["mass"], 1e-12)
    within("centre of gravity [m]", SIGNS[:3] * c - source["gravity"], 1e-15)
    turned = SIGNS[:3, None] * inertia * SIGNS[:3]
    # measured 1e-14
    within("inertia, relative", (turned - source["inertia"]) / np.max(inertia), 1e-13)
    within(
        "centre of buoyancy, height [m]",
        -identified.center_of_buoyancy[2] - source["buoyancy"][2],
        1e-14,
    )
    within("linear damping", identified.linear_damping - np.diag(source["linear"]), 1e-15)
    assert identified.quadratic_damping == pytest.approx(
        np.array(source["quadratic"], dtype=float), rel=1e-13
    )
    added = SIGNS[:, None] * identified.added_mass * SIGNS
    if "added" in source:
        within("added mass", added - source["added"], 1e-15)
    else:
        total = np.zeros((6, 6))
        total[:3, :3], total[3:, 3:] = m * np.eye(3), turned
        S = m * skew(SIGNS[:3] * c)
        total[:3, 3:], total[3:, :3] = -S, S
        scale = np.sqrt(np.outer(np.diag(PHOENIX_M), np.diag(PHOENIX_M)))
        # 3e-4
        within(
            "rigid body and water against the printed digits",
            (added + total - PHOENIX_M) / scale,
            1e-3,
        )


# dynamics_g500.yaml, allocation matrix: each column over its force, astern, up or starboard
GIRONA_B = np.array(
    [
        [1, 1, 0, 0, 0],
        [0, 0, 0, 0, 1],
        [0, 0, -1, -1, 0],
        [0, 0, 0, 0, 0],
        [0, 0, -0.35, 0.35, 0],
        [0.4, -0.4, 0, 0, 0],
    ]
)


@pytest.mark.parametrize(
    ("name", "B"),
    [
        ("bluerov2_heavy_benzon2022", BENZON_B),
        ("bluerov2_heavy_wu2018", WU_B),
        ("girona500_arm4", GIRONA_B),
    ],
)
def test_thrusters_act_as_the_source_says(name, B, within):
    found = Vehicle.of(compiled(name)).thruster_wrench
    # measured 1.1e-4: 0.06 for 0.0601
    within("wrench per thrust [-, m]", SIGNS[:, None] * found - B, 3e-4)


def test_arm_of_phoenix_is_its_denavit_hartenberg_table(rng, within):
    """The tip against the product of the table's matrices, base 1.5 m under the hull in the hull's
    published axes.
    """
    H = np.pi / 2
    table = [
        (0.15, -H, 0),
        (0.61, 0, 0),
        (0.11, -H, 0),
        (0, H, 0.61),
        (0, -H, -0.113),
        (0, 0, 0.103),
    ]
    model = compiled("phoenix_smart3s")
    data, q = mujoco.MjData(model), rng.uniform(-np.pi, np.pi, 6)
    data.qpos[Vehicle.of(model).qpos] = q
    mujoco.mj_kinematics(model, data)
    X = pose(None, [0.0, 0.0, 1.5])
    for (a, alpha, d), angle in zip(table, q, strict=True):
        X = X @ pose(exp_so3([0, 0, angle]), [0, 0, d]) @ pose(exp_so3([alpha, 0, 0]), [a, 0, 0])
    tip = data.site(TIP_SITE)
    within("tip [m]", SIGNS[:3] * tip.xpos - X[:3, 3], 1e-14)  # measured 1e-15
    within("axes", SIGNS[:3, None] * tip.xmat.reshape(3, 3) - X[:3, :3], 1e-14)


# First and last thruster of RexROV and joints of the Oberon 7, as printed by xacro, from the hull:
# position, roll pitch yaw, axis.
_Q = 1.5707963267948966
OBERON_JOINTS = (
    ("1.3 -0.5 -0.615", "0 0 0", "0 0 1"),
    ("0.06955 0.00015 0.01536", f"{_Q} 0 0", "0 0 1"),
    ("0.55616 -0.01229 0", "0 0 0", "0 0 1"),
    ("0.1349014 -0.1936267 0", f"{_Q} 0 0", "0 0 1"),
    ("0 0 0.31595760629823427", f"-{_Q} -{_Q} 0", "0 0 1"),
    ("0.19304 0 0", f"-{_Q} 0 0", "1 0 0"),
)
REXROV_THRUSTERS = {
    0: ("-0.890895 0.334385 0.528822", "0.0 -1.3007939272900002 -0.9286897205300001"),
    7: ("0.412125 -0.505415 0.129", "0.0 0.0 -2.356194555"),
}


def test_rexrov_with_the_oberon_7_is_that_of_the_published_urdf(rng, within):
    """Tip and thrusters against MuJoCo's own reading of the joints, as the source prints them."""
    mass = (
        '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
        "</inertial></link>"
    )
    parts = ['<mujoco><compiler fusestatic="false"/></mujoco>', f'<link name="l0">{mass}']
    for i, (xyz, rpy, axis) in enumerate(OBERON_JOINTS, start=1):
        parts.append(
            f'<link name="l{i}">{mass}<joint name="j{i}" type="continuous"><child link="l{i}"/>'
            f'<parent link="l{i - 1}"/><axis xyz="{axis}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/></joint>'
        )
    for i, (xyz, rpy) in REXROV_THRUSTERS.items():
        parts.append(
            f'<link name="t{i}">{mass}<joint name="f{i}" type="fixed"><parent link="l0"/>'
            f'<child link="t{i}"/><origin xyz="{xyz}" rpy="{rpy}"/></joint>'
        )
    urdf = mujoco.MjModel.from_xml_string(f'<robot name="rexrov">{"".join(parts)}</robot>')

    model = compiled("rexrov_oberon7")
    theirs, ours = mujoco.MjData(urdf), mujoco.MjData(model)
    q = rng.uniform(-1.0, 1.0, 6)
    theirs.qpos = q
    ours.qpos[Vehicle.of(model).qpos] = q
    for data in (theirs, ours):
        mujoco.mj_kinematics(data.model, data)
    hand = theirs.body("l6")
    found = ours.body("end_effector")
    within("hand [m]", found.xpos - hand.xpos, 1e-6)  # 4e-7: digits of a length
    within("axes of the hand", found.xmat - hand.xmat, 1e-12)
    along = ours.site(TIP_SITE).xmat.reshape(3, 3)[:, 2]
    within("tool axis", along - hand.xmat.reshape(3, 3)[:, 0], 1e-12)

    B = Vehicle.of(model).thruster_wrench
    for i in REXROV_THRUSTERS:
        thruster = theirs.body(f"t{i}")
        axis = thruster.xmat.reshape(3, 3)[:, 0]
        wrench = np.concatenate([axis, np.cross(thruster.xpos, axis)])
        within("wrench per thrust [-, m]", B[:, i] - wrench, 1e-6)  # angles of the xacro, rounded


# hkolano/PitchPrediction, urdf/blue_rov_hardware.urdf: the joints as printed, but for masses that
# MuJoCo asks for.
ALPHA_JOINTS = (
    ("0 0 0", "0 0 0"),
    ("0.020 0 0.046", "1.57075 1.3 0"),
    ("0.15 0 0", "3.1415 0 1.3"),
    ("0.020 0 0", "-1.57075 0 0"),
)


def test_arm_of_the_alpha_5_is_that_of_its_urdf(rng, within):
    """The jaws against MuJoCo's own reading of a URDF; its rounded right angles are off by 1e-4."""
    link = (
        '<link name="l{}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" '
        'ixz="0" iyz="0"/>'
    )
    joint = (
        '<joint name="j{0}" type="continuous"><parent link="l{1}"/><child link="l{0}"/><axis '
        'xyz="0 0 1"/>'
    )
    parts = [(link + "</inertial></link>").format(0)]
    for i, (xyz, rpy) in enumerate(ALPHA_JOINTS, start=1):
        parts += [(link + "</inertial></link>").format(i), joint.format(i, i - 1)]
        parts.append(f'<origin xyz="{xyz}" rpy="{rpy}"/></joint>')
    urdf = mujoco.MjModel.from_xml_string(f'<robot name="alpha">{"".join(parts)}</robot>')
    model, q = compiled("reach_alpha_5"), rng.uniform(-np.pi, np.pi, 4)
    theirs, ours = mujoco.MjData(urdf), mujoco.MjData(model)
    for data in (theirs, ours):
        data.qpos = q
        mujoco.mj_kinematics(data.model, data)
    wrist = theirs.body("l4")
    jaws = wrist.xpos + wrist.xmat.reshape(3, 3) @ [0.0, 0.0, -0.190]
    within("jaws [m]", ours.site(TIP_SITE).xpos - jaws, 1e-4)
    within(
        "tool axis",
        ours.site(TIP_SITE).xmat.reshape(3, 3)[:, 2] + wrist.xmat.reshape(3, 3)[:, 2],
        5e-4,
    )


def test_drag_of_the_alpha_5_in_uniform_flow_is_the_published():
    """A link that stands across the flow, or along it, is held back as the source says."""
    model = compiled("reach_alpha_5")
    for name, across, along in (
        ("shoulder", 0.26, 0.3),
        ("upper_arm", 1.6, 0.3),
        ("elbow", 0.26, 0.3),
        ("wrist", 1.8, 0.3),
    ):
        identified = coefficients(model, model.body(name).id)
        assert identified is not None
        (strip,) = identified.segments
        length = float(np.linalg.norm(strip.end - strip.start))
        assert (strip.normal * length, strip.tangential * length) == pytest.approx((across, along))


# hkolano/PitchPrediction, MagicNumAlpha.jl: kg, 1e-3 m^3 of volume, kg added across.
ALPHA_LINKS = {
    "arm_base": (0.341, 0.202, None),
    "shoulder": (0.194, 0.018, 0.032),
    "upper_arm": (0.429, 0.203, 0.201),
    "elbow": (0.115, 0.025, 0.032),
    "wrist": (0.333, 0.155, 0.226),
}


@pytest.mark.parametrize("name", ALPHA_LINKS)
def test_links_of_the_alpha_5_have_the_published_mass_and_water(name, within):
    mass, volume, added = ALPHA_LINKS[name]
    model = compiled("reach_alpha_5")
    body = model.body(name).id
    identified = coefficients(model, body)
    assert identified is not None
    within("relative mass", model.body_mass[body] / mass - 1.0, 1e-15)
    within("relative volume", identified.volume / (1e-3 * volume) - 1.0, 1e-15)
    if added is not None:  # twice across, none along
        within(
            "relative added mass",
            np.linalg.eigvalsh(identified.added_mass[:3, :3]) / added - [0.0, 1.0, 1.0],
            1e-14,
        )


# SIMURV 4.0, data/data_phoenix_smart3s.m: kg, radius and length [m] of each link; drag coefficient
# 0.6, fresh water.
PHOENIX_LINKS = (
    (80, 0.2, 0.85),
    (80, 0.1, 1.0),
    (30, 0.15, 0.2),
    (50, 0.1, 0.8),
    (20, 0.15, 0.2),
    (25, 0.1, 0.3),
)


@pytest.mark.parametrize("link", range(6))
def test_links_of_phoenix_have_the_published_mass_and_water(link, within):
    mass, radius, length = PHOENIX_LINKS[link]
    model = compiled("phoenix_smart3s")
    body = model.body(f"link{link + 1}").id
    identified = coefficients(model, body)
    assert identified is not None
    displaced = RHO * np.pi * radius**2 * length
    within("relative mass", model.body_mass[body] / mass - 1.0, 1e-15)
    within("relative volume", RHO * identified.volume / displaced - 1.0, 1e-14)
    across_along = sorted([0.1 * mass, displaced, displaced])
    within(
        "relative added mass",
        np.linalg.eigvalsh(identified.added_mass[:3, :3]) / across_along - 1.0,
        1e-13,
    )
    (strip,) = identified.segments
    within("length of the strip [m]", np.linalg.norm(strip.end - strip.start) - length, 1e-15)
    within("relative drag across", strip.normal / (0.5 * RHO * 0.6 * 2.0 * radius) - 1.0, 1e-15)
    assert strip.tangential == 0.0


def test_side_mounted_arm_is_the_same_arm_on_the_same_hull():
    """What differs is where arm and camera are, and the foam that trims it."""
    under, side = compiled("uuv_puma"), compiled("uuv_puma_side")
    for name in (
        "body_mass",
        "body_inertia",
        "body_ipos",
        "jnt_range",
        "jnt_axis",
        "dof_armature",
        "dof_damping",
    ):
        assert np.array_equal(getattr(under, name), getattr(side, name)), name
    assert np.array_equal(under.actuator_ctrlrange, side.actuator_ctrlrange)
    assert np.array_equal(under.key_qpos, side.key_qpos)
    assert np.array_equal(Vehicle.of(under).thruster_wrench, Vehicle.of(side).thruster_wrench)
    moved = {
        side.body(b).name
        for b in range(side.nbody)
        if not np.allclose(under.body_pos[b], side.body_pos[b])
    }
    assert moved == {ARM_BASE_BODY}
    X_BA = Vehicle.of(side).X_BA
    assert X_BA[:3, 2].tolist() == [0.0, 1.0, 0.0]  # it works to port
    assert np.hypot(*X_BA[:2, 3]) > 0.4  # aside of the vertical axis


def test_side_mounted_arm_folded_is_clear_of_jets_hull_and_camera():
    spec = models.load("uuv_puma_side")
    jets = [a.name for a in spec.actuators if a.name.startswith("thruster_")]
    for jet in jets:  # the water that a thruster moves, both ways, as wide as its housing
        site = compiled("uuv_puma_side").site(jet)
        along = pose(rotation(site.quat), site.pos) @ pose(exp_so3([0.0, np.pi / 2, 0.0]))
        spec.body(HULL_BODY).add_geom(
            name=jet,
            type=mujoco.mjtGeom.mjGEOM_CYLINDER,
            size=[0.11, 1.5, 0.0],
            pos=along[:3, 3],
            quat=quat_wxyz_from_rotation(along[:3, :3]),
            contype=0,
            conaffinity=0,
            rgba=[0.0, 0.0, 0.0, 0.0],
        )
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(HOME_KEY).id)
    mujoco.mj_forward(model, data)
    vehicle = Vehicle.of(model)
    arm = [g for g in range(model.ngeom) if model.geom_bodyid[g] > vehicle.hull]
    assert len(arm) > 8
    kept_off = [model.geom(name).id for name in (*jets, "hull_box", "foam")]
    for geom in kept_off:
        gap = min(mujoco.mj_geomDistance(model, data, g, geom, 1.0, None) for g in arm)
        # The base's own housing stands on the hull.
        assert gap > (-0.01 if model.geom(geom).name in ("hull_box", "foam") else 0.05), model.geom(
            geom
        ).name
    camera = DepthCamera.at_site(model, "camera", noise=None)
    depth, _ = camera.render(data.xpos, data.xmat.reshape(-1, 9))
    assert not np.isfinite(depth).any()


# -- statics and motion ----------------------------------------------------------------------------


def braked(name: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A floating model in its home pose, its driven joints locked there."""
    spec = models.load(name)
    model = compiled(name)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(HOME_KEY).id)
    mujoco.mj_kinematics(model, data)
    for joint in models.describe(name).joints:
        body = int(model.joint(joint).bodyid[0])
        parent = int(model.body_parentid[body])
        R = data.xmat[parent].reshape(3, 3).T
        locked = spec.body(model.body(body).name)
        locked.pos = R @ (data.xpos[body] - data.xpos[parent])
        locked.quat = quat_wxyz_from_rotation(R @ data.xmat[body].reshape(3, 3))
        for item in [spec.actuator(joint), spec.joint(joint), *spec.keys]:
            spec.delete(item)
    model = hydrodynamics.compile(spec)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def lever(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[float, Array]:
    """Net buoyancy [N], and the centre of buoyancy from the centre of mass (3,) [m], of the whole
    model.
    """
    displaced, moment = 0.0, np.zeros(3)
    for b in range(1, model.nbody):
        if (body := coefficients(model, b)) is not None:
            displaced += 1025.0 * body.volume
            moment += (
                1025.0
                * body.volume
                * (data.xpos[b] + data.xmat[b].reshape(3, 3) @ body.center_of_buoyancy)
            )
    weighed = float(np.sum(model.body_mass))
    center = np.sum(model.body_mass[:, None] * data.xipos, axis=0) / weighed
    return 9.81 * (displaced - weighed), moment / displaced - center


@pytest.mark.check("named models: trim", "weight is buoyancy, upright")
@pytest.mark.parametrize("name", FLOATING)
def test_it_is_trimmed(name, within):
    net, arm = lever(*braked(name))
    within("net weight [N]", net, 1e-9)  # asked for 0.1; measured 7e-12
    within("righting arm [m]", arm[:2], 1e-13)  # asked for 1e-3; measured 1e-16
    assert arm[2] > 0.005  # stable


@pytest.mark.check("named models left alone, 60 s", "stay where they are")
@pytest.mark.parametrize("name", FLOATING)
def test_left_alone_it_stays(name, within):
    model, data = braked(name)
    hull = model.body(HULL_BODY).id
    mujoco.mj_step(model, data, round(60.0 / model.opt.timestep))
    mujoco.mj_forward(model, data)
    within("drift in 60 s [m]", data.xpos[hull], 1e-8)
    within("turn in 60 s [rad]", rotation_angle(np.eye(3), data.xmat[hull].reshape(3, 3)), 1e-8)


@pytest.mark.parametrize("name", FIXED)
def test_fixed_arm_is_held_by_the_torque_of_its_weight_in_water(name, within):
    """The torques that hold it are the slope of its potential energy, and with them it stays for 60
    s.
    """
    model = compiled(name)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(HOME_KEY).id)
    home, step = data.qpos.copy(), 1e-6

    def potential(q: Array) -> float:
        data.qpos = q
        mujoco.mj_kinematics(model, data)
        total = 9.81 * float(model.body_mass @ data.xipos[:, 2])
        for b in range(1, model.nbody):
            if (body := coefficients(model, b)) is not None:
                height = data.xpos[b] + data.xmat[b].reshape(3, 3) @ body.center_of_buoyancy
                total -= 9.81 * 1025.0 * body.volume * height[2]
        return total

    slope = [
        (potential(home + step * e) - potential(home - step * e)) / (2.0 * step)
        for e in np.eye(model.nv)
    ]
    data.qpos = home
    mujoco.mj_forward(model, data)
    data.qacc[:] = 0.0
    mujoco.mj_inverse(model, data)
    within("holding torque [N m]", data.qfrc_inverse - slope, 5e-9)
    assert np.max(np.abs(slope)) > 0.05
    data.ctrl = data.qfrc_inverse
    mujoco.mj_step(model, data, round(60.0 / model.opt.timestep))
    within("joints in 60 s [rad]", data.qpos - home, 1e-9)


@pytest.mark.parametrize("name", FLOATING)
@pytest.mark.parametrize("axis", [0, 1], ids=["roll", "pitch"])
def test_heeled_it_rights_itself(name, axis):
    """It comes back upright within one period 2 pi sqrt(I / m g h) of its water and mass, later if
    linear damping holds it up, and never heels further.
    """
    model, data = braked(name)
    _, arm = lever(model, data)
    # the hull is free to give way
    inertia = 1.0 / np.linalg.inv(StationKeeping(compiled(name)).inertia)[3 + axis, 3 + axis]
    period = 2.0 * np.pi * np.sqrt(inertia / (9.81 * float(np.sum(model.body_mass)) * arm[2]))
    heel = np.radians(10.0)
    data.qpos[3:7] = [np.cos(heel / 2.0), *(np.sin(heel / 2.0) * np.eye(3)[axis])]
    hull, tilt = model.body(HULL_BODY).id, []
    # strong linear damping creeps back: to a tenth in 2.3 of its times
    known = coefficients(model, hull)
    assert known is not None
    righting = 9.81 * float(np.sum(model.body_mass)) * arm[2]
    period += 3.0 * known.linear_damping[3 + axis, 3 + axis] / righting
    for _ in range(100):
        mujoco.mj_step(model, data, round(period / model.opt.timestep / 100))
        tilt.append(float(np.arccos(min(data.xmat[hull].reshape(3, 3)[2, 2], 1.0))))
    assert min(tilt) < 0.1 * heel
    assert max(tilt) < 1.001 * heel


@pytest.mark.parametrize("name", SOURCES)
def test_towed_hull_reaches_the_speed_of_its_damping(name, within):
    """A surge force F on a hull that a rail keeps straight: F = a u + b u^2, in the end."""
    spec = models.load(name)
    hull = spec.body(HULL_BODY)
    for item in [*spec.keys, *spec.actuators, *hull.bodies, *hull.joints]:
        spec.delete(item)
    hull.add_joint(name="rail", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1, 0, 0])
    model = hydrodynamics.compile(spec)
    data = mujoco.MjData(model)
    a, b, speed = SOURCES[name]["linear"][0], SOURCES[name]["quadratic"][0], 4.0
    data.xfrc_applied[model.body(HULL_BODY).id, 0] = force = a * speed + b * speed**2
    mass = float(model.body_mass[1]) + unpack(model.body_user[1]).added_mass[0, 0]
    # 15 time constants
    mujoco.mj_step(model, data, round(15.0 * mass / (a + 2.0 * b * speed) / model.opt.timestep))
    exact = (-a + np.sqrt(a**2 + 4.0 * b * force)) / (2.0 * b)
    within("terminal surge, relative", data.qvel[0] / exact - 1.0, 5e-6)


# -- hover -----------------------------------------------------------------------------------------

CONTROL_TICKS, CURRENT = 10, (0.15, 0.1, 0.05)  # steps between commands; [m/s]


@pytest.mark.parametrize("name", HOVERING)
def test_it_hovers(name, within):
    """Hull and arm held at home in a current, from 0.3 m and 10 degrees away: by thrusters, or by
    the wrench.
    """
    model = compiled(name)
    X_start = pose(exp_so3([0.1, -0.1, 0.1]), [0.2, -0.2, 0.1])
    plant = Plant(model, current=Current(np.array(CURRENT)), X_WB=X_start)
    vehicle, true, none = plant.vehicle, plant.observe(), np.zeros(3)
    hover = StationKeeping(model)
    allocation = Allocation(vehicle) if vehicle.thruster_names else None
    arm = ArmDynamics(model) if vehicle.joint_names else None
    wrench_actuators = [i for i in range(model.nu) if model.actuator(i).name.startswith("wrench_")]
    state, thrusters, wrench = hover.init(), np.zeros(len(vehicle.thruster_names)), np.zeros(6)
    rest = np.zeros(len(vehicle.joint_names))
    stiffness = vehicle.torque_limits / 0.05  # [N m]/[rad]
    misses = []
    for tick in range(15_000):
        if tick % CONTROL_TICKS == 0:
            fed = np.zeros(6)
            if arm is not None:
                fed = arm.inverse(
                    true.q,
                    rest,
                    rest,
                    R_WB=true.R_WB,
                    nu_B=np.zeros(6),
                    a_B=np.zeros(6),
                    v_current_W=none,
                    wrench_tip_G=np.zeros(6),
                )[1]
            wrench = hover.step(
                state, true_estimate(true), np.eye(4), none, fed, CONTROL_TICKS * plant.timestep
            )
            if allocation is None:
                plant.data.ctrl[wrench_actuators] = wrench
            else:
                thrusters = allocation.command(allocation.thrust(wrench))
        hold = stiffness * (vehicle.q_home - true.q - 0.03 * true.qd)
        torque = np.clip(hold, -vehicle.torque_limits, vehicle.torque_limits)
        plant.step(Command(time=true.time, joint_torque=torque, thrusters=thrusters, scan=False))
        plant.observe()
        if tick >= 12_500:
            misses.append([np.linalg.norm(true.p_WB), rotation_angle(np.eye(3), true.R_WB)])
    within("off the place from 25 to 30 s [m]", np.array(misses)[:, 0], 0.03)  # measured up to 5e-3
    within("off the attitude [rad]", np.array(misses)[:, 1], 0.2)  # measured up to 0.034
    assert np.linalg.norm(wrench) > 1.0  # the current is felt


# -- your own vehicle ------------------------------------------------------------------------------


def test_vehicle_of_the_concepts_page_keeps_its_place(root, within, capfd):
    """The vehicle from scratch in docs/own_vehicle.md, as it stands there."""
    section = (
        (root / "docs" / "own_vehicle.md").read_text(encoding="utf-8").partition("## Vehicle")[2]
    )
    code = next(
        block
        for block in re.findall(r"^```python\n(.*?)^```", section, flags=re.M | re.S)
        if "StationKeeping(" in block
    )
    assert sum(isinstance(node, ast.stmt) for node in ast.walk(ast.parse(code))) <= 33
    names: dict[str, Any] = {}
    exec(compile(code, "own_vehicle.md", "exec"), names)
    assert "nan" not in capfd.readouterr().out
    plant = next(value for value in names.values() if isinstance(value, Plant))
    net, arm = lever(plant.model, plant.data)
    within("own_vehicle.md: net weight [N]", net, 1e-9)
    assert arm[2] > 0.01
    assert plant.truth.time > 20.0
    assert np.linalg.norm(plant.truth.current_W) > 0.1  # or to stay would be no feat
    within("own_vehicle.md: off the place [m]", np.linalg.norm(plant.truth.p_WB), 0.01)
    within(
        "own_vehicle.md: off the attitude [rad]", rotation_angle(np.eye(3), plant.truth.R_WB), 0.1
    )


def test_the_verb_lists_every_model(verb):
    printed = verb("models").stdout
    assert not [name for name in NAMES if f" {name} " not in printed]
    (figures,) = json.loads(verb("models", NAMES[0], "--json").stdout).values()
    assert figures["mass_kg"] > 0.0
