"""Vehicles of a user's own: a URDF with a mapping is the vehicle of an MJCF, and what is absent is
computed.
"""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from uuv import models
from uuv.check.check import check_vehicle
from uuv.models.completing.complete import complete
from uuv.models.completing.hull_box import hull_box
from uuv.models.completing.mounting import mount_arm
from uuv.models.completing.postures import PostureSearch
from uuv.models.files.notes import computed
from uuv.models.files.parts_file import PartPlace, read_parts
from uuv.models.files.urdf import parse
from uuv.models.naming import CAMERA_SITE, HOME_KEY, READY_KEY, TIP_SITE, TOOL_GEOM
from uuv.models.vehicle import Vehicle
from uuv.models.water import thrusters
from uuv.own_vehicle import vehicle_spec
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError

URDF = """<robot name="rov">
  <link name="base_link">
    <inertial><mass value="13.5"/>
      <inertia ixx="0.26" iyy="0.23" izz="0.37" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><box size="0.4 0.5 0.2"/></geometry></collision>
    <visual><geometry><mesh filename="package://rov/meshes/not_there.dae"/></geometry></visual>
  </link>
  <link name="bracket"/>
  <link name="upper">
    <inertial><origin xyz="0 0 0.1"/><mass value="0.4"/>
      <inertia ixx="1e-3" iyy="1e-3" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0 0 0.1"/><geometry><cylinder radius="0.02" length="0.16"/></geometry>
      </collision>
  </link>
  <link name="lower">
    <inertial><origin xyz="0 0 0.1"/><mass value="0.3"/>
      <inertia ixx="1e-3" iyy="1e-3" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0 0 0.1"/><geometry><cylinder radius="0.02" length="0.16"/></geometry>
      </collision>
  </link>
  <joint name="fixed" type="fixed"><origin xyz="0.15 0 -0.14" rpy="3.141592653589793 0 0"/>
    <parent link="base_link"/><child link="bracket"/></joint>
  <joint name="lift" type="revolute"><parent link="bracket"/><child link="upper"/>
    <axis xyz="0 1 0"/>
    <limit lower="-1.5" upper="1.5" effort="9" velocity="1"/><dynamics damping="1.5"/></joint>
  <joint name="bend" type="revolute"><origin xyz="0 0 0.2"/><parent link="upper"/>
    <child link="lower"/>
    <axis xyz="0 1 0"/><limit lower="-2.4" upper="2.4" effort="5" velocity="1"/></joint>
</robot>"""
MJCF = """<mujoco>
  <compiler angle="radian"/><option integrator="implicitfast" cone="elliptic"/><worldbody>
  <body name="base_link"><freejoint/>
    <inertial pos="0 0 0" mass="13.5" diaginertia="0.26 0.23 0.37"/>
    <geom type="box" size="0.2 0.25 0.1" mass="0" contype="1" conaffinity="2"/>
    <body name="bracket" pos="0.15 0 -0.14" quat="0 1 0 0">
      <body name="upper"><inertial pos="0 0 0.1" mass="0.4" diaginertia="1e-3 1e-3 1e-4"/>
        <joint name="lift" axis="0 1 0" range="-1.5 1.5" damping="1.5"/>
        <geom type="cylinder" size="0.02 0.08" pos="0 0 0.1" mass="0" contype="1" conaffinity="2"/>
        <body name="lower" pos="0 0 0.2">
          <inertial pos="0 0 0.1" mass="0.3" diaginertia="1e-3 1e-3 1e-4"/>
          <joint name="bend" axis="0 1 0" range="-2.4 2.4"/>
          <geom type="cylinder" size="0.02 0.08" pos="0 0 0.1" mass="0"
            contype="1" conaffinity="2"/>
        </body></body></body></body></worldbody></mujoco>"""
PARTS = """
hull: base_link
arm_base: bracket
tip: {body: lower, pos: [0, 0, 0.19], z: [0, 0, 1]}
camera: {body: base_link, pos: [0.21, 0, 0], z: [1, 0, -0.3]}
joints: {lift: 9, bend: 5}
thrusters:
  - {name: ahead, pos: [-0.2, 0, 0.05], direction: [2, 0, 0]}
  - {name: up_port, pos: [0, 0.2, 0], direction: [0, 0, 1], kind: {forward: 30, reverse: 20}}
"""
WATER = """
bodies:
  base_link: {box: {size: [0.4, 0.5, 0.2]}}
  upper: {cylinder: {radius: 0.02, start: [0, 0, 0.02], end: [0, 0, 0.18]}}
  lower: {cylinder: {radius: 0.02, start: [0, 0, 0.02], end: [0, 0, 0.18]}}
"""


def written(folder: Path, ending: str, text: str, parts: str = PARTS) -> Path:
    """File of a vehicle with its mapping and its water beside it."""
    file = folder / f"rov{ending}"
    file.write_text(text, encoding="utf-8")
    (folder / "rov.parts.yaml").write_text(parts, encoding="utf-8")
    (folder / "rov.water.yaml").write_text(WATER, encoding="utf-8")
    return file


def stepped(model: mujoco.MjModel) -> mujoco.MjData:
    """State after half a second under constant thrust and torque."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(READY_KEY).id)
    for name, command in {
        "thruster_ahead": 10.0,
        "thruster_up_port": 2.0,
        "lift": 1.0,
        "bend": -0.5,
    }.items():
        data.actuator(name).ctrl = command
    mujoco.mj_step(model, data, nstep=250)
    return data


def test_a_urdf_with_a_mapping_moves_as_the_mjcf_does(tmp_path: Path, within) -> None:
    (tmp_path / "mjcf").mkdir()
    of_urdf = hydrodynamics.compile(vehicle_spec(written(tmp_path, ".urdf", URDF)))
    of_mjcf = hydrodynamics.compile(vehicle_spec(written(tmp_path / "mjcf", ".xml", MJCF)))
    assert [of_urdf.body(i).name for i in range(of_urdf.nbody)] == [
        "world",
        "hull",
        "arm_base",
        "upper",
        "lower",
    ]
    a, b = stepped(of_urdf), stepped(of_mjcf)
    assert np.linalg.norm(b.qvel[:3]) > 0.05  # or to agree would be no feat
    within("URDF against MJCF after 0.5 s: qpos", np.abs(a.qpos - b.qpos).max(), 1e-9)
    within("URDF against MJCF after 0.5 s: qvel", np.abs(a.qvel - b.qvel).max(), 1e-9)
    vehicle = Vehicle.of(of_urdf)
    assert vehicle.joint_names == ("lift", "bend")
    np.testing.assert_allclose(vehicle.torque_limits, [9.0, 5.0])
    with_reaction = [1, 0, 0, -0.014, 0.05, 0]
    np.testing.assert_allclose(vehicle.thruster_wrench[:, 0], with_reaction, atol=1e-12)
    assert thrusters.unpack(vehicle.thruster_table[1]).forward == 30.0
    data = mujoco.MjData(of_urdf)
    mujoco.mj_kinematics(of_urdf, data)
    R = data.site(CAMERA_SITE).xmat.reshape(3, 3)
    np.testing.assert_allclose(R[:, 2], np.array([1.0, 0.0, -0.3]) / np.hypot(1.0, 0.3), atol=1e-12)
    np.testing.assert_allclose(R[:, 0], [0.0, -1.0, 0.0], atol=1e-12)  # to starboard


def test_what_a_file_leaves_out_is_said(tmp_path: Path) -> None:
    notes = computed(vehicle_spec(written(tmp_path, ".urdf", URDF)))
    assert "not_there.dae" in notes["note_1"]
    assert "rotor inertia of light joints" in notes["note_2"]
    assert set(notes) == {"note_1", "note_2", HOME_KEY, READY_KEY}


def test_a_mapping_can_lock_a_joint_and_replace_a_servo(tmp_path: Path) -> None:
    servo = (
        '<actuator><position name="servo" joint="bend" kp="50" forcerange="-4 '
        '4"/></actuator></mujoco>'
    )
    parts = PARTS.replace("{lift: 9, bend: 5}", "[bend]")
    file = written(tmp_path, ".xml", MJCF.replace("</mujoco>", servo), parts)
    model = vehicle_spec(file).compile()
    vehicle = Vehicle.of(model)
    assert vehicle.joint_names == ("bend",)
    assert vehicle.torque_limits == pytest.approx([4.0])
    assert model.njnt == 2
    assert model.actuator("bend").biastype[0] == mujoco.mjtBias.mjBIAS_NONE


SECOND_ARM = """<body name="port" pos="0.15 0.2 -0.14">
      <joint name="port_lift" axis="0 1 0"/><geom size="0.03" mass="0.2"/>
      <body name="finger" pos="0 0 -0.1"><joint name="grip" type="slide" axis="0 1 0"/>
        <geom size="0.01" mass="0.02"/>
      <joint name="soft" type="slide" stiffness="100"/></body></body>"""
DRIVEN = """<actuator><motor name="lifter" joint="port_lift"/></actuator>
  <equality><joint joint1="port_lift" joint2="grip"/></equality>
  <sensor><jointpos joint="port_lift"/></sensor></mujoco>"""


def test_joints_of_a_second_arm_are_locked_but_for_its_springs(tmp_path: Path) -> None:
    both = MJCF.replace('<body name="bracket"', f'{SECOND_ARM}<body name="bracket"').replace(
        "</mujoco>", DRIVEN
    )
    spec = vehicle_spec(written(tmp_path, ".xml", both))
    model = spec.compile()
    locked = "joints held at 0, which the mapping does not list: port_lift, grip"
    assert locked in computed(spec).values()
    assert locked in [
        finding.said for finding in check_vehicle(tmp_path / "rov.xml", jobs=()).findings
    ]
    assert [model.joint(j).name for j in range(model.njnt)] == ["", "soft", "lift", "bend"]
    assert (model.neq, model.nsensor) == (0, 0)
    assert "lifter" not in [model.actuator(i).name for i in range(model.nu)]


def test_a_name_of_another_kind_is_told_as_what_it_is(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigurationError,
        match=r"no site 'lower'.*there is a body of that name: write tip: "
        r"\{body: lower\}",
    ):
        vehicle_spec(written(tmp_path, ".xml", MJCF, re.sub("tip: {.*", "tip: lower", PARTS)))
    filmed = MJCF.replace('<body name="bracket"', '<camera name="front"/><body name="bracket"')
    with pytest.raises(
        ConfigurationError,
        match=r"no site 'front'.*there is a <camera> of that name: write "
        r"its position, camera:",
    ):
        vehicle_spec(
            written(tmp_path, ".xml", filmed, re.sub("camera: {.*", "camera: front", PARTS))
        )
    macro = URDF.replace("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ', 1)
    macro = macro.replace("</robot>", '<xacro:property name="m" value="3"/></robot>')
    with pytest.raises(ConfigurationError, match="is a xacro text, which must be converted first"):
        parse(macro)


ROS = """<robot name="rov"><link name="world"/>
  <joint name="float" type="floating"><parent link="world"/><child link="base"/></joint>
  <link name="base"/>
  <joint name="j" type="fixed"><origin xyz="0.2 -0.1 0.3" rpy="0.4 -0.3 1.2"/>
    <parent link="base"/><child link="heavy"/></joint>
  <link name="heavy"><inertial><origin xyz="0.1 0 -0.2" rpy="-0.2 0.5 0.3"/><mass value="30"/>
    <inertia ixx="3" iyy="2" izz="1.5" ixy="0.1" ixz="-0.2" iyz="0.3"/></inertial></link></robot>"""


def test_a_root_of_ros_floats_with_the_mass_that_is_fixed_to_it(tmp_path: Path, within) -> None:
    (tmp_path / "rov.urdf").write_text(ROS, encoding="utf-8")
    spec = vehicle_spec(tmp_path / "rov.urdf")
    model = spec.compile()
    notes = computed(spec)
    assert notes["note_1"] == "link world left out: base floats"
    assert "the mass of 'heavy'" in notes["note_2"]
    joint, inertial = (
        Rotation.from_euler("xyz", angles) for angles in ([0.4, -0.3, 1.2], [-0.2, 0.5, 0.3])
    )
    p_com = np.array([0.2, -0.1, 0.3]) + joint.apply([0.1, 0.0, -0.2])
    R = (joint * inertial).as_matrix()
    tensor = R @ np.array([[3.0, 0.1, -0.2], [0.1, 2.0, 0.3], [-0.2, 0.3, 1.5]]) @ R.T
    axes = np.empty(9)
    mujoco.mju_quat2Mat(axes, model.body_iquat[1])
    axes = axes.reshape(3, 3)
    assert model.body_mass[1] == 30.0
    within("centre of mass [m]", model.body_ipos[1] - p_com, 1e-12)
    within("inertia [kg m^2]", axes * model.body_inertia[1] @ axes.T - tensor, 1e-12)


def test_the_hull_is_as_large_as_what_is_fixed_to_it(tmp_path: Path) -> None:
    """A URDF has the hull's shapes on links of their own; the arm's base does not count."""
    quarter = 'quat="0.7071068 0 0 0.7071068"'
    skid = (
        f'<body name="skid" pos="0 0 -0.3" {quarter}><geom type="box" size="0.1 0.4 0.05"/></body>'
    )
    base = '<body name="bracket" pos="0.15 0 -0.14" quat="0 1 0 0"><geom size="0.5" mass="0"/>'
    mjcf = re.sub('<body name="bracket" .*?>', skid + base, MJCF)
    model = vehicle_spec(written(tmp_path, ".xml", mjcf)).compile()
    box = hull_box(model, model.body("hull").id, model.body("arm_base").id)
    assert box == pytest.approx(np.array([[-0.4, -0.25, -0.35], [0.4, 0.25, 0.1]]), abs=1e-6)


PROPELLER = """<actuator>
  <general name="prop" site="stern" gear="0 0 40 0 0 0" ctrlrange="-1 1" gainprm="3"
    biastype="affine" biasprm="0 0 1" dyntype="filter" dynprm="0.1" forcerange="-3 3"/>
</actuator></mujoco>"""


def test_an_actuator_of_the_model_becomes_a_thruster_of_its_kind(tmp_path: Path) -> None:
    """Its own gain, limits and dynamics give way; it pushes along its gear."""
    mjcf = MJCF.replace('<body name="bracket"', '<site name="stern"/><body name="bracket"').replace(
        "</mujoco>", PROPELLER
    )
    parts = PARTS + "  - {actuator: prop, kind: {forward: 30, reverse: 20}}\n"
    model = vehicle_spec(written(tmp_path, ".xml", mjcf, parts)).compile()
    vehicle = Vehicle.of(model)
    column = vehicle.thruster_wrench[:, vehicle.thruster_names.index("prop")]
    assert column[:3] == pytest.approx([0.0, 0.0, 1.0])
    data = mujoco.MjData(model)
    hydrodynamics.install()
    data.actuator("prop").ctrl = 1.0
    mujoco.mj_forward(model, data)
    assert data.qfrc_actuator[:3] == pytest.approx([0.0, 0.0, 30.0])


def test_a_hull_without_a_joint_floats(tmp_path: Path) -> None:
    held = MJCF.replace("<freejoint/>", "")
    model = vehicle_spec(written(tmp_path, ".xml", held)).compile()
    assert model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE
    assert model.nq == 7 + 2
    assert Vehicle.of(model).joint_names == ("lift", "bend")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "hull: base_link",
            "hull: base",
            "no body 'base'; it has base_link, bracket, upper, lower",
        ),
        ("tip:", "tipp:", "the file has no 'tipp'; .*did you mean tip"),
        ("body: lower", "body: lowr", "no body 'lowr'.*did you mean lower"),
        ("{lift: 9, bend: 5}", "[bend, lift]", "in this order: lift, bend; got bend, lift"),
        ("{lift: 9, bend: 5}", "{lift: -9}", r"joints\.lift \[N m\]: must be above 0, got -9"),
        ("{lift: 9, bend: 5}", "5", "must be names, or names with torque limits"),
        (
            "direction: [2, 0, 0]",
            "direction: [0, 0, 0]",
            r"thrusters\[0\]: direction: must not be "
            r"zero",
        ),
        ("pos: [0, 0.2, 0]", "body: nowhere, pos: [0, 0.2, 0]", "no body 'nowhere'"),
        (
            ", direction: [2, 0, 0]",
            "",
            r"thrusters\[0\]: direction: three numbers each are missing",
        ),
        (
            "kind: {forward: 30, reverse: 20}",
            "kind: {forwrd: 30}",
            r"thrusters\[1\].kind has no 'forwrd'.*did you mean forward",
        ),
        (
            "kind: {forward: 30, reverse: 20}",
            "kind: t500",
            r"thrusters\[1\]: kind: t200 is the only name that is allowed, got 't500'",
        ),
        (
            "pos: [-0.2, 0, 0.05]",
            "pos: [.nan, 0, 0.05]",
            r"thrusters\[0\]\.pos\[0\]: must not be "
            r"NaN",
        ),
        (
            "pos: [-0.2, 0, 0.05]",
            "pos: [-0.2, 0.05]",
            r"thrusters\[0\]: pos \[m\]: expected shape "
            r"\(3,\), got \(2,\)",
        ),
        (
            "pos: [-0.2, 0, 0.05]",
            "pos: [true, 0, 0]",
            r"thrusters\[0\].pos\[0\] \[m\]: must be a "
            r"number, got True",
        ),
        (
            "{lift: 9, bend: 5}",
            "{lift: .inf}",
            r"joints.lift \[N m\]: must be finite, above 0, "
            r"got inf",
        ),
        ("hull: base_link", "hull: base_link\nhull: other", "the key 'hull' occurs twice"),
        ("hull: base_link", "hull: 5", "hull: must be a name, got 5"),
        ("hull: base_link", "trim: -1", r"trim \[m\]: must be at least 0 and at most 10, got -1"),
        ("hull: base_link", "trim: '0.05'", "it is text: leave out the quotes"),
        ("name: up_port", "name: ahead", "repeated name 'thruster_ahead'"),
        ("hull: base_link", "- hull", r"cannot be read \(.*at line 3"),
    ],
)
def test_a_slip_in_a_mapping_is_one_line(tmp_path: Path, old: str, new: str, said: str) -> None:
    assert old in PARTS
    with pytest.raises(ConfigurationError, match=said) as raised:
        vehicle_spec(written(tmp_path, ".urdf", URDF, PARTS.replace(old, new, 1)))
    assert "\n" not in str(raised.value)
    assert len(str(raised.value)) < 600


def test_an_arm_without_effort_asks_for_it(tmp_path: Path) -> None:
    parts = PARTS.replace("joints: {lift: 9, bend: 5}\n", "")
    with pytest.raises(ConfigurationError, match="joint 'bend' has no torque limit"):
        vehicle_spec(written(tmp_path, ".urdf", URDF.replace('effort="5" ', ""), parts))


def test_places_in_a_mapping_are_read(tmp_path: Path) -> None:
    written(tmp_path, ".urdf", URDF)
    tip = read_parts(tmp_path / "rov.parts.yaml").tip
    assert isinstance(tip, PartPlace)
    np.testing.assert_allclose(tip.pos, [0.0, 0.0, 0.19])


@pytest.mark.parametrize("name", ["uuv_puma", "uuv_puma_side", "bluerov2_heavy_alpha5"])
def test_computed_postures_are_clear_and_better_conditioned_than_those_by_hand(name: str) -> None:
    by_hand = models.load(name)
    search = PostureSearch(by_hand.compile())
    theirs = {key.name: np.array(key.qpos)[search.vehicle.qpos] for key in by_hand.keys}
    spec = models.load(name)
    for key in list(spec.keys):
        spec.delete(key)
    assert len(complete(spec)) == 2
    vehicle = Vehicle.of(spec.compile())
    again = models.load(name)
    for key in list(again.keys):
        again.delete(key)
    complete(again)
    # the same every time
    np.testing.assert_array_equal(vehicle.q_home, Vehicle.of(again.compile()).q_home)
    low, high = vehicle.q_limits.T
    for q in (vehicle.q_home, vehicle.q_ready):
        assert np.all((low <= q) & (q <= high))
        assert search.is_clear(q)
    assert search.view_blocked(vehicle.q_home) == 0.0
    assert search.singular_value(vehicle.q_ready) > search.singular_value(theirs[READY_KEY])


def test_an_arm_that_cannot_be_read_is_told_by_who_needs_it(tmp_path: Path) -> None:
    endless = MJCF.replace(' range="-2.4 2.4"', ' type="slide"')
    spec = vehicle_spec(written(tmp_path, ".xml", endless))
    assert not computed(spec)
    with pytest.raises(ConfigurationError, match="joint 'bend' of the arm must have a range"):
        Vehicle.of(spec.compile())


def test_what_a_vehicle_has_is_left_as_it_is() -> None:
    spec = models.load("uuv_puma")
    before = spec.to_xml()
    assert complete(spec) == []
    assert spec.to_xml() == before
    hull_alone = models.load("bluerov2_heavy")
    assert complete(hull_alone) == []


def test_an_arm_of_a_urdf_is_mounted_on_another_hull(tmp_path: Path) -> None:
    arm = (
        URDF[: URDF.index('  <link name="base_link">')]
        + URDF[URDF.index('  <link name="bracket"/>') :]
    )
    start, end = arm.index('  <joint name="fixed"'), arm.index('  <joint name="lift"')
    (tmp_path / "arm.urdf").write_text(arm[:start] + arm[end:], encoding="utf-8")
    spec = models.load("bluerov2_heavy")
    mass = float(spec.copy().compile().body_mass.sum())
    bodies = mount_arm(
        spec,
        tmp_path / "arm.urdf",
        p=[0.15, 0.0, -0.16],
        rpy=[np.pi, 0.0, 0.0],
        tip="lower",
        tip_p=[0.0, 0.0, 0.19],
    )
    assert bodies == ["arm_base", "arm_upper", "arm_lower"]
    model = spec.compile()
    assert float(model.body_mass.sum()) == pytest.approx(mass + 0.7)
    assert Vehicle.of(model).joint_names == ("arm_lift", "arm_bend")
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    np.testing.assert_allclose(data.site(TIP_SITE).xpos, [0.15, 0.0, -0.16 - 0.39], atol=1e-6)
    assert len(complete(spec)) == 2
    with pytest.raises(ConfigurationError, match="no body 'arm_base'"):
        mount_arm(spec, tmp_path / "arm.urdf", p=[0, 0, 0], tip="lower")
    assert mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, TOOL_GEOM) < 0


def test_a_hull_that_is_ballasted_folds_its_arm_whatever_it_would_list(tmp_path: Path) -> None:
    """Ballast levels the hull with the arm at home, so a list there is no reason to stretch it."""
    heavy = URDF.replace('<mass value="0.4"/>', '<mass value="6"/>')
    heavy = heavy.replace('<mass value="0.3"/>', '<mass value="6"/>')
    spread = {}
    for parts in (PARTS, PARTS + "trim: 0.05\n"):
        folder = tmp_path / str(len(parts))
        folder.mkdir()
        model = vehicle_spec(written(folder, ".urdf", heavy, parts)).compile()
        search = PostureSearch(model, trimmed=True)
        home = np.array(model.key(HOME_KEY).qpos)[search.vehicle.qpos]
        spread[parts] = search._spread(home)
    assert spread[PARTS + "trim: 0.05\n"] < spread[PARTS] - 0.002  # [m] 0.1814, 0.1847
