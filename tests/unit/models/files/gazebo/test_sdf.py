"""An SDF is the vehicle of the URDF that says the same."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from uuv.models import hydrodynamics
from uuv.models.files.gz_sim import body_hydrodynamics
from uuv.models.files.notes import computed
from uuv.models.files.vehicle_file import read
from uuv.own_vehicle import vehicle_spec
from uuv.sim.interfaces.errors import ConfigurationError

INERTIA = "<ixx>{0}</ixx><iyy>{0}</iyy><izz>{0}</izz>"
SDF = """<?xml version="1.0"?><sdf version="1.7"><model name="rov">
  <pose>5 5 5 0 0 1</pose>
  <link name="base"><pose>0.1 0.2 0.3 0 0 0.4</pose>
    <inertial><pose>0.01 0 0.02 0 0 0.5</pose><mass>20</mass>
      <inertia><ixx>0.5</ixx><iyy>0.6</iyy><izz>0.7</izz></inertia></inertial>
    <collision name="c"><pose>0 0 0.06 0 0 0</pose>
      <geometry><box><size>0.4 0.5 0.1</size></box></geometry></collision></link>
  <link name="upper"><pose relative_to="base">0.3 0.1 -0.2 0.2 0.1 -0.3</pose>
    <inertial><mass>1</mass><inertia>{upper}</inertia></inertial></link>
  <link name="hand"><pose relative_to="upper">0.2 0 0 0 0 0</pose>
    <inertial><mass>0.5</mass><inertia>{hand}</inertia></inertial></link>
  <link name="mount"><pose relative_to="upper">0 0 -0.1 0 0 0</pose></link>
  <joint name="fix" type="fixed"><parent>base</parent><child>mount</child></joint>
  <joint name="turn" type="revolute"><pose>0 0.05 0 0.3 0 0</pose><parent>mount</parent>
    <child>upper</child><axis><xyz>0 0 1</xyz><limit><lower>-1</lower><upper>1.2</upper>
      <effort>9</effort><velocity>2</velocity></limit>
      <dynamics><damping>0.7</damping></dynamics></axis></joint>
  <joint name="bend" type="revolute"><parent>upper</parent><child>hand</child>
    <axis><xyz expressed_in="__model__">0 1 0</xyz><limit><lower>-1e16</lower><upper>1e16</upper>
      <effort>5</effort></limit></axis></joint>
  {more}
</model></sdf>""".replace("{upper}", INERTIA.format(0.02)).replace("{hand}", INERTIA.format(0.01))
MAPPING = "arm_base: mount\ntip: {body: hand, pos: [0, 0, 0.1]}\njoints: {turn: 9, bend: 5}\n"
THRUSTER = """<link name="prop"><pose relative_to="base">-0.2 0.1 0 0 1.5707963267948966 0</pose>
    <inertial><mass>0.001</mass></inertial></link>
  <joint name="prop_joint" type="continuous"><parent>base</parent><child>prop</child>
    <axis><xyz>0 0 1</xyz></axis></joint>
  <plugin filename="gz-sim-thruster-system" name="gz::sim::systems::Thruster">
    <joint_name>prop_joint</joint_name><thrust_coefficient>0.004</thrust_coefficient>
    <fluid_density>1025</fluid_density><propeller_diameter>0.2</propeller_diameter>
    {limits}</plugin>"""
HYDRO = """<plugin filename="gz-sim-hydrodynamics-system" name="gz::sim::systems::Hydrodynamics">
    <link_name>base</link_name><water_density>1025</water_density><xDotU>-5.5</xDotU>
    <yDotV>-12.7</yDotV><xU>-4</xU><yR>1.5</yR><nV>-1.5</nV><yV>-20</yV><nR>-8</nR>
    <xUabsU>-33.8</xUabsU></plugin>"""


def written(folder: Path, more: str = "", mapping: str = MAPPING) -> Path:
    (folder / "model.sdf").write_text(SDF.replace("{more}", more))
    (folder / "model.parts.yaml").write_text(mapping)
    return folder / "model.sdf"


def test_a_pose_by_quaternion_is_that_by_angles(tmp_path: Path, within) -> None:
    angles = '<link name="base"><pose>0.1 0.2 0.3 0 0 0.4</pose>'
    turned = f"0 0 {2 * np.sin(0.2)} {2 * np.cos(0.2)}"  # of any length
    by_angles = vehicle_spec(str(written(tmp_path))).compile()

    file = tmp_path / "model.sdf"
    quaternion = angles.replace("<pose>", '<pose rotation_format="quat_xyzw">')
    by_quaternion = file.read_text().replace(angles, quaternion.replace("0 0 0.4", turned))
    file.write_text(by_quaternion)
    within("places", vehicle_spec(str(file)).compile().body_pos - by_angles.body_pos, 1e-14)
    within("turns", vehicle_spec(str(file)).compile().body_quat - by_angles.body_quat, 1e-14)

    file.write_text(by_quaternion.replace(turned, "0 0 0 0"))
    with pytest.raises(ConfigurationError, match=r"'?base'?.*quaternion must not be zero"):
        vehicle_spec(str(file))
    file.write_text(by_quaternion.replace(turned, "0 0 1"))
    with pytest.raises(ConfigurationError, match="base"):
        vehicle_spec(str(file))


def test_links_lie_where_their_poses_put_them(tmp_path: Path, within) -> None:
    spec = vehicle_spec(written(tmp_path), computed=False)
    model = spec.compile()
    assert [model.joint(j).name for j in range(model.njnt)] == ["hull", "turn", "bend"]
    assert model.joint("turn").range == pytest.approx([-1.0, 1.2])
    assert model.joint("bend").range == pytest.approx([-np.pi, np.pi])
    assert model.actuator("turn").ctrlrange == pytest.approx([-9.0, 9.0])
    assert model.joint("turn").damping[0] == 0.7
    within("centre of mass", model.body("hull").ipos - [0.01, 0.0, 0.02], 1e-12)
    inertia = np.sort(model.body("hull").inertia)
    within("inertia", inertia - [0.5, 0.6, 0.7], 1e-12)

    # The hand, by its own chain of poses: about the joint's axis through the joint's place.
    data = mujoco.MjData(model)
    data.qpos[:] = 0.0
    data.qpos[3] = 1.0
    turn, bend = 0.4, -0.9
    data.qpos[7:9] = turn, bend
    mujoco.mj_kinematics(model, data)
    from scipy.spatial.transform import Rotation

    R_BU = Rotation.from_euler("xyz", [0.2, 0.1, -0.3])
    axis = Rotation.from_euler("x", 0.3).apply([0.0, 0.0, 1.0])
    place = np.array([0.0, 0.05, 0.0])
    turned = Rotation.from_rotvec(turn * axis)
    hand = place + turned.apply(np.array([0.2, 0.0, 0.0]) - place)
    expected = R_BU.apply(hand) + np.array([0.3, 0.1, -0.2])
    within("hand [m]", data.body("hand").xpos - expected, 1e-12)
    bend_axis = (Rotation.from_euler("z", 0.4) * R_BU).inv().apply([0.0, 1.0, 0.0])
    R_WH = (R_BU * turned * Rotation.from_rotvec(bend * bend_axis)).as_matrix()
    within("hand, axes", data.body("hand").xmat.reshape(3, 3) - R_WH, 1e-12)


def test_water_and_thrusters_of_gz_sim_are_those_put_in_by_hand(tmp_path: Path, within) -> None:
    limits = "<max_thrust_cmd>40</max_thrust_cmd><min_thrust_cmd>-30</min_thrust_cmd>"
    mapping = "thrusters: []\n"
    spec = vehicle_spec(
        written(tmp_path, HYDRO + THRUSTER.replace("{limits}", limits), mapping), computed=False
    )
    body = hydrodynamics.attached(spec)["hull"]
    by_hand = body_hydrodynamics(
        {"xDotU": -5.5, "yDotV": -12.7, "xU": -4, "yR": 1.5, "nV": -1.5, "yV": -20, "nR": -8}
        | {"xUabsU": -33.8},
        volume=0.4 * 0.5 * 0.1,
        center_of_buoyancy=[0.0, 0.0, 0.06],
    )
    for field in ("volume", "center_of_buoyancy", "added_mass", "linear_damping"):
        within(field, np.asarray(getattr(body, field)) - getattr(by_hand, field), 1e-12)
    within("quadratic", body.quadratic_damping - by_hand.quadratic_damping, 1e-12)

    (thruster,) = read(tmp_path / "model.sdf").thrusters
    assert (thruster.thruster.forward, thruster.thruster.reverse) == (40.0, 30.0)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    axis = data.site("thruster_prop").xmat.reshape(3, 3)[:, 0]
    within("axis", axis - [1.0, 0.0, 0.0], 1e-12)


@pytest.mark.parametrize("endless", ["-1", "inf"])
def test_efforts_and_velocities_without_limit_are_none(tmp_path: Path, endless: str) -> None:
    file = written(tmp_path)
    text = file.read_text().replace("<effort>9<", f"<effort>{endless}<")
    file.write_text(text.replace("<velocity>2<", f"<velocity>{endless}<"))
    vehicle = read(file)
    assert vehicle.speeds == {}
    joints = {joint.name: joint for joint in vehicle.spec.joints}
    assert not np.any(joints["turn"].actfrcrange)
    assert joints["bend"].actfrcrange.tolist() == [-5.0, 5.0]


def test_a_heavy_hull_is_no_long_way(tmp_path: Path) -> None:
    file = written(tmp_path)
    text = file.read_text().replace("<mass>20<", "<mass>12000<")
    text = text.replace("<damping>0.7<", "<damping>2e4<")
    file.write_text(text)
    spec = read(file).spec
    assert spec.body("base").mass == 12000.0
    assert spec.joint("turn").damping[0] == 2e4


def test_what_is_fixed_to_a_link_weighs_once(tmp_path: Path) -> None:
    fixed = """<link name="foam"><pose relative_to="mount">0.1 0 0.2 0 0.1 0</pose>
      <inertial><mass>3</mass></inertial></link><joint name="foam_joint" type="fixed">
      <parent>mount</parent><child>foam</child></joint>"""
    thrusts = []
    for folder, more, mass in (("with", fixed, "17"), ("without", "", "20")):
        (tmp_path / folder).mkdir()
        file = written(tmp_path / folder, more + THRUSTER.replace("{limits}", ""))
        file.write_text(file.read_text().replace("<mass>20<", f"<mass>{mass}<"))
        thrusts.append(read(file).thrusters[0].thruster.forward)
    assert thrusts[0] == pytest.approx(thrusts[1], rel=1e-12)


def test_a_shape_lies_in_the_frame_that_its_pose_names(tmp_path: Path, within) -> None:
    frame = '<frame name="datum"><pose relative_to="upper">0.3 -0.2 0.1 0.4 0 0.2</pose></frame>'
    file = written(tmp_path, frame)
    direct = read(file).spec
    # The box of the base, in a frame on the upper link.
    named = '<pose relative_to="datum">0.5 0.1 0.06 0.1 0 0</pose>'
    file.write_text(file.read_text().replace("<pose>0 0 0.06 0 0 0</pose>", named))
    spec = read(file).spec
    from scipy.spatial.transform import Rotation

    def frame_of(p, rpy) -> np.ndarray:
        X = np.eye(4)
        X[:3, :3] = Rotation.from_euler("xyz", rpy).as_matrix()
        X[:3, 3] = p
        return X

    X_BU = frame_of([0.3, 0.1, -0.2], [0.2, 0.1, -0.3])
    X_UD = frame_of([0.3, -0.2, 0.1], [0.4, 0.0, 0.2])
    expected = X_BU @ X_UD @ frame_of([0.5, 0.1, 0.06], [0.1, 0.0, 0.0])
    (box,) = spec.body("base").geoms
    within("place", box.pos - expected[:3, 3], 1e-12)
    w, x, y, z = box.quat
    within("axes", Rotation.from_quat([x, y, z, w]).as_matrix() - expected[:3, :3], 1e-12)
    assert direct.body("base").geoms[0].pos.tolist() == [0.0, 0.0, 0.06]

    file.write_text(file.read_text().replace('"datum">0.5', '"nowhere">0.5'))
    with pytest.raises(ConfigurationError, match="no link, joint or frame 'nowhere'"):
        read(file)


def test_a_follower_counts_from_its_reference(tmp_path: Path) -> None:
    mimic = """<mimic joint="turn" axis="axis"><multiplier>-0.5</multiplier><offset>0.2</offset>
      <reference>0.3</reference></mimic>"""
    file = written(tmp_path)
    file.write_text(
        file.read_text().replace(
            '<xyz expressed_in="__model__">0 1 0</xyz>',
            f'<xyz expressed_in="__model__">0 1 0</xyz>{mimic}',
        )
    )
    (equality,) = read(file).spec.equalities
    # 0.2 - 0.5 (q - 0.3)
    assert equality.data[:2] == pytest.approx([0.35, -0.5])


def test_limits_of_ardupilots_commands_are_those_of_thrust(tmp_path: Path) -> None:
    control = """<plugin name="ArduPilotPlugin" filename="libArduPilotPlugin.so">
      <control channel="0"><jointName>prop_joint</jointName><type>COMMAND</type>
      <offset>-0.4</offset><multiplier>100</multiplier></control></plugin>"""
    file = written(tmp_path, control + THRUSTER.replace("{limits}", ""))
    (thruster,) = read(file).thrusters
    assert (thruster.thruster.forward, thruster.thruster.reverse) == (60.0, 40.0)


def test_px4s_plugins_are_read(tmp_path: Path) -> None:
    uuv = """<plugin name="uuv_plugin" filename="libgazebo_uuv_plugin.so">
      <baseLinkName>base</baseLinkName><addedMassLinear>1.1 2.8 2.9</addedMassLinear>
      <dampingLinear>5.39 17.36 17.4</dampingLinear><dampingAngular>0.1 0.2 0.3</dampingAngular>
      <buoyancy><link_name>base</link_name><origin>0 0 0.01</origin>
      <compensation>1.01</compensation></buoyancy></plugin>
      <plugin name="m" filename="libgazebo_motor_model.so"><jointName>prop_joint</jointName>
      <motorConstant>0.001</motorConstant><maxRotVelocity>100</maxRotVelocity>
      <timeConstantUp>0.05</timeConstantUp></plugin>"""
    file = written(tmp_path, uuv + THRUSTER.partition("<plugin")[0], "thrusters: []\n")
    (thruster,) = read(file).thrusters
    assert (thruster.thruster.forward, thruster.thruster.time_constant) == (10.0, 0.05)
    body = hydrodynamics.attached(vehicle_spec(file, computed=False))["hull"]
    # with the mount and the propeller's link, which is on a turning joint, left out: 20 kg
    assert body.volume == pytest.approx(1.01 * 20.0 / 1000.0)
    assert np.diag(body.linear_damping) == pytest.approx([5.39, 17.36, 17.4, 0.1, 0.2, 0.3])


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (
            '<joint name="loop" type="revolute"><parent>base</parent><child>hand</child></joint>',
            "closed loop: joint loop left out, since its child hand is the child of another joint",
        ),
        ('<link name="alone"/>', "links without a joint to the rest, left out: alone"),
        (
            '<link name="cone"><collision name="c"><geometry><cone><radius>1</radius></cone>'
            '</geometry></collision></link><joint name="j" type="fixed"><parent>base</parent>'
            "<child>cone</child></joint>",
            "shapes left out, since they are none of box, cylinder, capsule, sphere, ellipsoid, "
            "mesh: cone of cone",
        ),
        (
            "<include><uri>model://camera</uri></include>",
            "<include> within the model left out: model://camera",
        ),
    ],
)
def test_what_is_left_out_is_said(tmp_path: Path, more: str, said: str) -> None:
    assert said in computed(vehicle_spec(written(tmp_path, more), computed=False)).values()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("<sdf", "<sdf ", None),  # a blank is none of a fault
        ('name="rov"', 'name="rov" gz:odd="1"', None),  # nor a prefix without a declaration
        ("<parent>mount</parent>", "<parent>mont</parent>", "joint 'turn': .*links base, upper"),
        ('relative_to="upper"', 'relative_to="hand"', "frame 'hand' is relative to itself"),
        ("0.1 0.2 0.3 0 0 0.4", "0.1 0.2 0.3", r"pose of base: expected shape \(6,\)"),
        ("<xyz>0 0 1</xyz>", "<xyz>0 0 0</xyz>", "joint 'turn': the axis must be longer than zero"),
        ("<size>0.4 0.5 0.1</size>", "<size>0.4 0 0.1</size>", "lengths of a box must be positive"),
        ("<izz>0.7</izz>", "<izz>1.7</izz>", "link 'base': inertia: the principal moments"),
        ("<model", "<modell", "no XML"),
    ],
)
def test_slips_are_one_line(tmp_path: Path, old: str, new: str, said: str | None) -> None:
    file = written(tmp_path)
    file.write_text(file.read_text().replace(old, new, 1 if old != 'relative_to="upper"' else -1))
    if said is None:
        assert vehicle_spec(file, computed=False).compile().nv == 8
        return
    with pytest.raises(ConfigurationError, match=said):
        vehicle_spec(file, computed=False)


def test_a_volume_of_a_mass_swims_in_the_density_that_it_was_computed_with(tmp_path: Path) -> None:
    file = written(tmp_path, HYDRO.replace("<water_density>1025</water_density>", ""))
    text = file.read_text()
    collision = text[text.index("<collision") : text.index("</collision>") + len("</collision>")]
    file.write_text(text.replace(collision, ""))
    spec = vehicle_spec(file, computed=False)
    body = hydrodynamics.attached(spec)["hull"]
    assert hydrodynamics.density_of(spec) * body.volume == pytest.approx(20.0, rel=1e-12)


@pytest.mark.parametrize(
    ("version", "of_model"),
    [("1.3", True), ("1.4", True), ("1.5", False), ("1.10", False), ("", False)],
)
def test_axes_of_joints_are_those_of_the_model_up_to_version_1_4(
    tmp_path: Path, version: str, of_model: bool, within
) -> None:
    """The joint's frame is rolled by 0.3 in a link that is turned in the base's frame."""
    file = written(tmp_path)
    file.write_text(file.read_text().replace('version="1.7"', f'version="{version}"'))
    axis = vehicle_spec(file, computed=False).joint("turn").axis
    from scipy.spatial.transform import Rotation

    R_MB = Rotation.from_euler("z", 0.4)
    R_MU = R_MB * Rotation.from_euler("xyz", [0.2, 0.1, -0.3])
    expected = (
        R_MU.inv().apply([0.0, 0.0, 1.0])
        if of_model
        else Rotation.from_euler("x", 0.3).apply([0.0, 0.0, 1.0])
    )
    within("axis", np.asarray(axis) - expected, 1e-12)


def test_a_stated_frame_of_an_axis_counts_in_any_version(tmp_path: Path, within) -> None:
    file = written(tmp_path)
    text = file.read_text().replace('version="1.7"', 'version="1.4"')
    own = "<xyz>0 0 1</xyz><use_parent_model_frame>0</use_parent_model_frame>"
    file.write_text(text.replace("<xyz>0 0 1</xyz>", own))
    axis = vehicle_spec(file, computed=False).joint("turn").axis
    within("axis", np.asarray(axis) - [0.0, -np.sin(0.3), np.cos(0.3)], 1e-12)


LAMP = """<link name="lamp"><inertial><mass>0.2</mass></inertial></link>
  <joint name="lamp_joint" type="fixed"><parent>base</parent><child>lamp</child></joint>"""


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (LAMP.replace("0.2", "-2"), r"link 'lamp': <mass> \[kg\]: .*got -2"),
        (LAMP.replace('"lamp"', '"upper"', 1), "two links have the name 'upper'"),
        (LAMP.replace("lamp_joint", "turn"), "two joints have the name 'turn'"),
        (HYDRO.replace("-5.5", "nan"), "<xDotU>: expected a number, got 'nan'"),
        (HYDRO.replace("<yV>-20", "<yV>lots"), "<yV>: expected a number, got 'lots'"),
    ],
)
def test_what_cannot_be_meant_is_named(tmp_path: Path, more: str, said: str) -> None:
    """A coefficient that is no number was left out silently, a negative mass taken for
    none.
    """
    with pytest.raises(ConfigurationError, match=said):
        vehicle_spec(written(tmp_path, more), computed=False)
