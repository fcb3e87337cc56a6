"""Joints of a URDF mean the same to the reader of arms, to inverse kinematics and to a vehicle."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from uuv.controllers.mkps import Chain
from uuv.models.files import urdf as urdf_files
from uuv.models.files.notes import computed
from uuv.own_vehicle import vehicle_spec
from uuv.sim.interfaces.errors import ConfigurationError

INERTIAL = (
    '<inertial><mass value="{mass}"/><inertia ixx=".3" iyy=".3" izz=".3" ixy="0" ixz="0" '
    'iyz="0"/></inertial>'
)
MAPPING = "arm_base: mount\ntip: {body: hand, pos: [0, 0, 0.1]}\njoints: {turn: 9, bend: 5}\n"


def robot(turn: str, extra: str = "") -> str:
    """A hull with an arm of two joints, the first as stated."""
    links = "".join(
        f'<link name="{name}">{INERTIAL.format(mass=mass)}</link>'
        for name, mass in (("hull_link", 30), ("upper", 1), ("hand", 0.5))
    )
    return f"""<robot name="r">{links}<link name="mount"/>
      <joint name="fix" type="fixed"><origin xyz="0.3 0.1 -0.2" rpy="0.2 0.1 -0.3"/>
        <parent link="hull_link"/><child link="mount"/></joint>
      <joint name="turn" {turn}<parent link="mount"/><child link="upper"/>
        <origin xyz="0 0.1 0.2" rpy="0.1 0 0"/><axis xyz="0 0 2"/></joint>
      <joint name="bend" type="revolute"><parent link="upper"/><child link="hand"/>
        <origin xyz="0.2 0 0"/><axis xyz="0 1 0"/>
        <limit lower="-1" upper="1.2" effort="5" velocity="1"/></joint>{extra}</robot>"""


def limit(lower: str, upper: str) -> str:
    return f'<limit lower="{lower}" upper="{upper}" effort="9" velocity="1"/>'


def vehicle_of(folder: Path, text: str, mapping: str = MAPPING) -> mujoco.MjSpec:
    (folder / "r.urdf").write_text(text)
    (folder / "r.parts.yaml").write_text(mapping)
    return vehicle_spec(folder / "r.urdf", computed=False)


@pytest.mark.parametrize(
    ("turn", "limits"),
    [
        (f'type="continuous">{limit("-0.5", "0.7")}', (-0.5, 0.7)),
        ('type="continuous"><limit effort="9" velocity="1"/>', (-np.inf, np.inf)),
        (f'type="continuous">{limit("0", "0")}', (-np.inf, np.inf)),
        (f'type="continuous">{limit("2", "-2")}', (-np.inf, np.inf)),
        ('type="revolute"><limit effort="9" velocity="1"/>', (-np.inf, np.inf)),
        (f'type="revolute">{limit("-1e12", "1e12")}', (-np.inf, np.inf)),
        ('type="revolute"><limit upper="1.5" effort="9" velocity="1"/>', (0.0, 1.5)),
        (f'type="prismatic">{limit("-0.1", "0.4")}', (-0.1, 0.4)),
    ],
)
def test_limits_are_the_same_at_every_door(tmp_path: Path, turn, limits) -> None:
    text = robot(turn)
    chain = Chain.from_urdf(text, "mount", "hand")
    arm = urdf_files.parse(text).chain("mount", "hand").arm()
    assert tuple(chain.limits[0]) == tuple(arm.limits[0]) == limits

    # A vehicle's arm has a range: one turn where there is none.
    spec = vehicle_of(tmp_path, text)
    joint = spec.compile().joint("turn")
    assert joint.range == pytest.approx(np.clip(limits, -np.pi, np.pi))
    assert any("turn without end get" in line for line in computed(spec).values()) == np.isinf(
        limits[0]
    )


@pytest.mark.parametrize("endless", ["-1", "inf"])
def test_a_rating_below_zero_or_without_end_is_none(tmp_path: Path, endless: str) -> None:
    text = robot(f'type="revolute">{limit("-0.5", "0.7")}')
    text = text.replace('effort="9" velocity="1"', f'effort="{endless}" velocity="{endless}"')
    robot_read = urdf_files.parse(text)
    assert robot_read.speeds == {"bend": 1.0}
    assert vehicle_of(tmp_path, text).compile().actuator("turn").ctrlrange[1] == 9.0
    with pytest.raises(ConfigurationError, match="joint 'turn' has no torque limit"):
        vehicle_of(tmp_path, text, MAPPING.partition("joints")[0])


def test_what_is_not_taken_as_it_stands_is_said(tmp_path: Path) -> None:
    spec = vehicle_of(tmp_path, robot(f'type="continuous">{limit("-0.5", "0.7")}'))
    assert (
        "continuous joints keep the limits that are stated for them: turn"
        in computed(spec).values()
    )


def test_crossed_limits_are_refused_at_every_door(tmp_path: Path) -> None:
    text = robot(f'type="revolute">{limit("1.5", "-1.5")}')
    said = r"joint 'turn': its lower limit 1\.5 is above its upper limit -1\.5"
    with pytest.raises(ConfigurationError, match=said):
        Chain.from_urdf(text, "mount", "hand")
    with pytest.raises(ConfigurationError, match=said):
        urdf_files.parse(text).chain("mount", "hand").arm()
    with pytest.raises(ConfigurationError, match=said):
        vehicle_of(tmp_path, text)
    assert Chain.from_urdf(text, "upper", "hand").names == ("bend",)  # none of this chain


def test_a_joint_that_its_limits_hold_is_fixed_there(within) -> None:
    held = robot(f'type="revolute">{limit("0.4", "0.4")}')
    free = robot(f'type="revolute">{limit("-1", "1")}')
    chain = Chain.from_urdf(held, "mount", "hand")
    whole = Chain.from_urdf(free, "mount", "hand")
    assert chain.names == ("bend",)
    for bend in (-0.8, 0.3):
        within("tip", chain.forward([bend]) - whole.forward([0.4, bend]), 1e-14)  # 2e-16


JAW = f"""<link name="jaw">{INERTIAL.format(mass=0.2)}</link>
  <link name="jaw_b">{INERTIAL.format(mass=0.1)}</link>
  <link name="jaw_c">{INERTIAL.format(mass=0.1)}</link>
  <joint name="open" type="revolute"><parent link="hand"/><child link="jaw"/>
    <origin xyz="0 0.05 0.1" rpy="0.3 0 0"/><axis xyz="1 0 0"/>{limit("0.5", "1.5")}</joint>
  <joint name="open_b" type="revolute"><parent link="hand"/><child link="jaw_b"/>
    <origin xyz="0 -0.05 0.1"/><axis xyz="1 0 0"/>{limit("-2", "2")}
    <mimic joint="open" multiplier="-1" offset="0.4"/></joint>
  <joint name="slide" type="prismatic"><parent link="jaw_b"/><child link="jaw_c"/>
    <axis xyz="0 1 0"/>{limit("-1", "1")}<mimic joint="open_b" multiplier="0.5"/></joint>"""


def test_what_nothing_drives_is_held_within_its_range_and_by_its_leader(
    tmp_path: Path, within
) -> None:
    spec = vehicle_of(tmp_path, robot(f'type="revolute">{limit("-1", "1")}', JAW))
    line = (
        "joints held within their range, which the mapping does not list: open at 0.5 rad, "
        "open_b at -0.1 rad, slide at -0.05 m"
    )
    assert line in computed(spec).values()
    model = spec.compile()
    assert [model.joint(j).name for j in range(model.njnt)] == ["hull", "turn", "bend"]
    assert model.neq == 0

    # Where URDF's definition puts them.
    quat = np.empty(4)
    mujoco.mju_axisAngle2Quat(quat, np.array([1.0, 0.0, 0.0]), 0.3 + 0.5)
    within("jaw", model.body("jaw").quat - quat, 1e-12)
    mujoco.mju_axisAngle2Quat(quat, np.array([1.0, 0.0, 0.0]), -0.1)
    within("jaw_b", model.body("jaw_b").quat - quat, 1e-12)
    within("jaw_c", model.body("jaw_c").pos - [0.0, -0.05, 0.0], 1e-12)


def test_a_follower_in_the_arm_is_refused(tmp_path: Path) -> None:
    text = robot(f'type="revolute">{limit("-1", "1")}').replace(
        '<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><mimic joint="turn"/>'
    )
    with pytest.raises(ConfigurationError, match=r"joint 'bend' between .* follows 'turn'"):
        vehicle_of(tmp_path, text)


@pytest.mark.parametrize(
    ("mimic", "said"),
    [
        ('<mimic joint="nowhere"/>', "the robot has no joint 'nowhere'"),
        ('<mimic joint="turn" offset="x"/>', "offset: expected a number, got 'x'"),
        ('<mimic joint="bend"/>', "joints follow each other in a loop: bend"),
    ],
)
def test_a_slip_in_a_mimic_is_named(mimic: str, said: str) -> None:
    text = robot(f'type="revolute">{limit("-1", "1")}').replace(
        '<axis xyz="0 1 0"/>', f'<axis xyz="0 1 0"/>{mimic}'
    )
    with pytest.raises(ConfigurationError, match=said):
        urdf_files.parse(text)


def test_an_inertia_that_no_body_has_names_its_link_and_a_way_out(tmp_path: Path) -> None:
    text = robot(f'type="revolute">{limit("-1", "1")}').replace('izz=".3"', 'izz="0.7"', 1)
    with pytest.raises(ConfigurationError, match=r"link 'hull_link': inertia: .*balanceinertia"):
        vehicle_of(tmp_path, text)
    way = '<mujoco><compiler balanceinertia="true"/></mujoco></robot>'
    spec = vehicle_of(tmp_path, text.replace("</robot>", way))
    assert spec.compile().body("hull").inertia == pytest.approx([1.3 / 3] * 3)

    # What rounding alone has made impossible is mended, and said.
    spec = vehicle_of(tmp_path, text.replace('izz="0.7"', 'izz="0.60001"'))
    assert any("inertias raised slightly" in line for line in computed(spec).values())
    inertia = np.sort(spec.compile().body("hull").inertia)
    assert inertia[0] + inertia[1] >= inertia[2]


def test_what_is_stated_twice_counts_once(tmp_path: Path) -> None:
    text = robot(f'type="revolute">{limit("-1", "1")}').replace(
        '<origin xyz="0.2 0 0"/>', '<origin xyz="0.2 0 0"/><origin xyz="9 9 9"/>'
    )
    spec = vehicle_of(tmp_path, text)
    assert "stated twice, only the first is used: bend <origin>" in computed(spec).values()
    assert spec.compile().body("hand").pos == pytest.approx([0.2, 0.0, 0.0])


def test_limits_that_look_like_degrees_are_asked_about(tmp_path: Path) -> None:
    spec = vehicle_of(tmp_path, robot(f'type="revolute">{limit("-97", "97")}'))
    assert any(line.endswith("degrees were meant?: turn") for line in computed(spec).values())
    spec = vehicle_of(tmp_path, robot(f'type="revolute">{limit("-6.28", "6.28")}'))
    assert not any("degrees" in line for line in computed(spec).values())


@pytest.mark.parametrize("mass", ["nan", "-30", "30 kg", "${m}"])
def test_a_mass_that_no_link_can_have_is_named(tmp_path: Path, mass: str) -> None:
    """The vehicle was taken to have the mass of its arm's mount, and trimming was refused."""
    text = robot(f'type="revolute">{limit("-1", "1")}').replace('value="30"', f'value="{mass}"')
    with pytest.raises(ConfigurationError, match=r"link 'hull_link': mass \[kg\]"):
        vehicle_of(tmp_path, text)


def test_a_hull_without_moments_of_inertia_is_refused(tmp_path: Path) -> None:
    text = robot(f'type="revolute">{limit("-1", "1")}')
    zero = text.replace('ixx=".3" iyy=".3" izz=".3"', 'ixx="0" iyy="0" izz="0"', 1)
    with pytest.raises(ConfigurationError, match=r"link 'hull_link': inertia: .* all zero; state"):
        vehicle_of(tmp_path, zero)


def test_a_joint_that_moves_shares_its_name_with_none(tmp_path: Path) -> None:
    again = (
        '<link name="lamp"/><joint name="{}" type="fixed"><parent link="hull_link"/>'
        '<child link="lamp"/></joint>'
    )
    turn = f'type="revolute">{limit("-1", "1")}'
    with pytest.raises(ConfigurationError, match="joint 'turn': the name is that of another"):
        vehicle_of(tmp_path, robot(turn, again.format("turn")))
    vehicle_of(tmp_path, robot(turn, again.format("fix")))
