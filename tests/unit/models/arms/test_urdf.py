"""URDF reader: chains, serial arms, MuJoCo models, and refusals of bad files."""

import re
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from uuv.controllers.mkps import Chain, Method, solve
from uuv.models.files import urdf as urdf_files
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, exp_so3, pose

METHODS: tuple[Method, ...] = ("hybrid", "jacobian_free", "plain")

CRANE = """
<robot name="crane">
  <link name="pad"><visual><geometry><mesh filename="package://nowhere/pad.stl"/></geometry></visual></link>
  <link name="turret"/> <link name="boom"/> <link name="hanger"/> <link name="trolley"/>
    <link name="flange"/>
  <link name="hook"/> <link name="eye"/>
  <joint name="yaw" type="continuous"><parent link="pad"/><child link="turret"/>
    <origin xyz="0.1 0 0.3" rpy="0.1 0.2 0.3"/><axis xyz="0 0 1"/></joint>
  <joint name="lift" type="revolute"><parent link="turret"/><child link="boom"/>
    <origin xyz="0 0.1 0.2" rpy="0 0.4 0"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1.2" effort="1" velocity="1"/></joint>
  <joint name="level" type="revolute"><parent link="boom"/><child link="hanger"/>
    <origin xyz="0.8 0 0"/><axis xyz="0 1 0"/>
      <mimic joint="lift" multiplier="{multiplier}" offset="0.1"/>
    <limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="run" type="prismatic"><parent link="hanger"/><child link="trolley"/>
    <origin xyz="0 0 -0.1" rpy="0.5 0 0"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="0.6" effort="1" velocity="1"/></joint>
  <joint name="bolts" type="fixed"><parent link="trolley"/><child link="flange"/>
    <origin xyz="0.05 0.02 0.01" rpy="0.3 -0.2 0.1"/></joint>
  <joint name="roll" type="revolute"><parent link="flange"/><child link="hook"/>
    <origin xyz="0 0 0.1"/><axis xyz="0.6 0 0.8"/>
      <limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
  <joint name="float" type="floating"><parent link="hook"/><child link="eye"/></joint>
</robot>
"""


def rpy(roll: float, pitch: float, yaw: float) -> Array:
    return exp_so3([0, 0, yaw]) @ exp_so3([0, pitch, 0]) @ exp_so3([roll, 0, 0])


def crane_tip(yaw: float, lift: float, run: float, roll: float) -> Array:
    """The hook in the frame of the pad, by the definition of URDF."""
    steps = [
        pose(rpy(0.1, 0.2, 0.3), [0.1, 0, 0.3]),
        pose(exp_so3([0, 0, yaw])),
        pose(rpy(0, 0.4, 0), [0, 0.1, 0.2]),
        pose(exp_so3([0, lift, 0])),
        pose(None, [0.8, 0, 0]),
        pose(exp_so3([0, 0.1 - lift, 0])),
        pose(rpy(0.5, 0, 0), [0, 0, -0.1]),
        pose(None, [run, 0, 0]),
        pose(rpy(0.3, -0.2, 0.1), [0.05, 0.02, 0.01]),
        pose(None, [0, 0, 0.1]),
        pose(exp_so3(roll * np.array([0.6, 0, 0.8]))),
    ]
    X = np.eye(4)
    for step in steps:
        X = X @ step
    return X


def test_a_chain_from_urdf_is_the_robot(tmp_path: Path) -> None:
    """Continuous, revolute, prismatic, fixed and mimicking joints; meshes need not exist."""
    text = CRANE.format(multiplier=-1)
    (tmp_path / "crane.urdf").write_text(text)
    rng = np.random.default_rng(8)
    for urdf in (text, tmp_path / "crane.urdf"):
        chain = Chain.from_urdf(urdf, "pad", "hook")
        assert chain.joint_types == "ropr"
        assert chain.names == ("yaw", "lift", "run", "roll")
        np.testing.assert_allclose(chain.limits, [[-np.inf, np.inf], [-1, 1.2], [0, 0.6], [-3, 3]])
        for q in rng.uniform([-3, -1, 0, -3], [3, 1.2, 0.6, 3], (5, 4)):
            difference = chain.forward(q) - crane_tip(*q)
            assert np.abs(difference).max() < 2e-14  # measured 1e-15
    part = Chain.from_urdf(text, "hanger", "flange")
    assert part.joint_types == "p"
    assert Chain.from_urdf(text, "turret", "hook").joint_types == "opr"


@pytest.mark.parametrize("method", METHODS)
def test_a_robot_from_urdf_is_solved(method: Method) -> None:
    chain = Chain.from_urdf(CRANE.format(multiplier=-1), "pad", "hook")
    q_goal = np.array([0.4, 0.5, 0.3, -0.7])
    solution = solve(chain, crane_tip(*q_goal), q_goal + 0.05, method=method)
    assert solution.converged
    np.testing.assert_allclose(solution.q, q_goal, atol=5e-3)


# A mast of three stages: the second follows the first, the third follows the second at half speed
# and aslant; then a wrist of three hinges.
MAST = """<robot name="mast"><link name="pad"/><link name="m1"/><link name="m2"/><link name="m3"/>
<link name="w1"/><link name="w2"/><link name="hand"/>
<joint name="lift" type="prismatic"><parent link="pad"/><child link="m1"/><axis xyz="0 0 1"/>
<limit lower="0" upper="0.3"/></joint>
<joint name="lift2" type="prismatic"><parent link="m1"/><child link="m2"/>
<origin xyz="0 0 0.1"/><axis xyz="0 0 1"/><limit lower="0" upper="0.25"/>
<mimic joint="lift" offset="0.02"/></joint>
<joint name="lift3" type="prismatic"><parent link="m2"/><child link="m3"/>
<origin xyz="0 0 0.1"/><axis xyz="0.6 0 0.8"/><limit lower="-1" upper="1"/>
<mimic joint="lift2" multiplier="{ratio}"/></joint>
<joint name="a" type="revolute"><parent link="m3"/><child link="w1"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2"/></joint>
<joint name="b" type="revolute"><parent link="w1"/><child link="w2"/><origin xyz="0.2 0 0"/>
<axis xyz="0 1 0"/><limit lower="-2" upper="2"/></joint>
<joint name="c" type="revolute"><parent link="w2"/><child link="hand"/><origin xyz="0.2 0 0"/>
<axis xyz="1 0 0"/><limit lower="-2" upper="2"/></joint></robot>"""


def mast_tip(lift: float, a: float, b: float, c: float) -> np.ndarray:
    """Pose of the hand, by hand."""
    second = lift + 0.02
    third = 0.5 * second
    foot = pose(None, [0.6 * third, 0.0, lift + 0.1 + second + 0.1 + 0.8 * third])
    turns = [exp_so3([0.0, 0.0, a]), exp_so3([0.0, b, 0.0]), exp_so3([c, 0.0, 0.0])]
    step = pose(None, [0.2, 0.0, 0.0])
    return foot @ pose(turns[0]) @ step @ pose(turns[1]) @ step @ pose(turns[2])


@pytest.mark.parametrize("method", METHODS)
def test_slides_that_mimic_a_slide_are_one(method: Method, within) -> None:
    chain = Chain.from_urdf(MAST.format(ratio=0.5), "pad", "hand")
    assert (chain.names, chain.joint_types) == (("lift", "a", "b", "c"), "prrr")
    # the second stage ends at 0.25 m, 0.02 m ahead of the first
    np.testing.assert_allclose(chain.limits[0], [0.0, 0.23], atol=1e-12)

    rng = np.random.default_rng(5)
    small = 1e-6
    for q in rng.uniform(chain.limits[:, 0], chain.limits[:, 1], (5, 4)):
        X, J = chain.kinematics(q)
        within("hand [m, 1]", X - mast_tip(*q), 1e-14)  # measured 1e-15
        moved = mast_tip(q[0] + small, *q[1:])[:3, 3] - mast_tip(q[0] - small, *q[1:])[:3, 3]
        within("column of the mast", J[:3, 0] - moved / (2.0 * small), 1e-8)  # measured 1e-10

    q = np.array([0.15, 0.4, 0.5, -0.7])
    solution = solve(chain, mast_tip(*q), q + 0.05, method=method)
    assert solution.converged
    np.testing.assert_allclose(chain.forward(solution.q), mast_tip(*q), atol=2e-3)


def test_a_telescope_that_stands_still_is_refused() -> None:
    text = MAST.format(ratio=0).replace(
        '<axis xyz="0 0 1"/><limit lower="0" upper="0.25"/>',
        '<axis xyz="0 0 -1"/><limit lower="0" upper="0.25"/>',
    )
    text = text.replace('<mimic joint="lift2" multiplier="0"/>', "")
    with pytest.raises(ConfigurationError, match="'lift': its followers cancel its motion"):
        Chain.from_urdf(text, "pad", "hand")


@pytest.mark.parametrize(
    ("urdf", "base", "tip", "names"),
    [
        (CRANE.format(multiplier=-1), "pad", "crook", "tip_link.*hook.*'crook'"),
        (CRANE.format(multiplier=-1), "bad", "hook", "base_link.*turret.*'bad'"),
        (CRANE.format(multiplier=-1), "hook", "turret", "beyond"),
        (CRANE.format(multiplier=-1), "trolley", "flange", "no joint"),
        (CRANE.format(multiplier=-1), "pad", "eye", "'float'.*got type floating"),
        (CRANE.format(multiplier=-2), "pad", "hook", "'lift' and 'level'"),
        (
            CRANE.replace('type="fixed"', 'type="glued"'),
            "pad",
            "hook",
            "'bolts'.*must be one of.*fixed",
        ),
        ("<robot><link name='a'/><link name='b'/></robot>", "a", "b", "one tree"),
        ("<mujoco/>", "a", "b", "<robot>"),
        ("<robot>", "a", "b", "XML"),
        ("nowhere.urdf", "a", "b", "nowhere.urdf"),
    ],
)
def test_bad_robots_are_refused(urdf: str, base: str, tip: str, names: str) -> None:
    with pytest.raises(ConfigurationError, match=names):
        Chain.from_urdf(urdf, base, tip)


def test_the_urdf_reader_is_mujocos() -> None:
    """The same joints through MuJoCo's own forward kinematics."""
    # which MuJoCo itself does not read
    visual = re.compile("<visual>.*</visual>|<joint name=.float.*</joint>")
    text = visual.sub("", CRANE.format(multiplier=-1)).replace('<link name="eye"/>', "")
    chain = Chain.from_urdf(text, "pad", "trolley")
    q = np.array([0.3, -0.4, 0.2])
    extension = (
        '<mujoco><compiler fusestatic="false" boundmass="1" boundinertia="1"/></mujoco></robot>'
    )
    model = mujoco.MjModel.from_xml_string(text.replace("</robot>", extension))
    data = mujoco.MjData(model)
    data.qpos[:4] = [q[0], q[1], 0.1 - q[1], q[2]]
    mujoco.mj_kinematics(model, data)
    trolley = data.body("trolley")
    np.testing.assert_allclose(
        chain.forward(q), pose(trolley.xmat.reshape(3, 3), trolley.xpos), atol=1e-14
    )


def test_the_serial_arm_is_the_chain(within) -> None:
    """Where no joint mimics another: the arm by our reader, the chain by MuJoCo's; and the default
    links.
    """
    text = re.sub("<mimic[^>]*>|<joint name=.float.*</joint>|<link name=.eye./>", "", CRANE)
    robot = urdf_files.parse(text.encode(), "crane")
    assert robot.root == "pad"
    rng = np.random.default_rng(9)
    for base, tip, branch in (
        ("pad", "hook", robot.chain()),
        ("turret", "flange", robot.chain("turret", "flange")),
    ):
        assert (branch.base, branch.tip) == (base, tip)
        arm = branch.arm()
        chain = Chain.from_urdf(text, base, tip)
        assert (arm.joint_types, arm.joint_names) == (chain.joint_types, chain.names)
        np.testing.assert_array_equal(arm.limits, chain.limits)
        for q in rng.uniform(-1, 1, (5, arm.n)):
            within("flange [m, 1]", arm.flange([q])[0] - chain.forward(q), 1e-14)  # 7e-16


def hinge(
    ends: str, kind: str = "revolute", xyz: str = "0 0 1", axis: str = "1 0 0", more: str = ""
) -> str:
    """A joint between two links of one letter each, named by both."""
    parent, child = ends
    return (
        f"<joint name='{ends}' type='{kind}'><parent link='{parent}'/><child link='{child}'/>"
        f"<origin xyz='{xyz}'/><axis xyz='{axis}'/>{more}</joint>"
    )


@pytest.mark.parametrize(
    ("joints", "tip", "said"),
    [
        (
            hinge("ab") + hinge("ac"),
            None,
            "^arm: --tip: state which link is the tip, one of the leaves b, c",
        ),
        (hinge("ab") + hinge("ac"), "d", "^--tip: must be a link of the robot .a, b, c., got 'd'"),
        (
            hinge("bc") + hinge("cb"),
            "b",
            "^arm: the links of a URDF must form one tree, but these form a loop",
        ),
        (
            hinge("ab") + hinge("cb"),
            "b",
            "^arm: joint 'cb': must join a parent link to a child link that is the child of no "
            "other",
        ),
        (hinge("ab") + hinge("bd"), "b", "^arm: joint 'bd': must join"),
        (hinge("ab") + hinge("bc", "planar"), "c", "^arm: joint 'bc' .*got type planar"),
        (hinge("ab") + hinge("bc", more="<mimic joint='ab'/>"), "c", "^arm: joint 'bc' .*mimic"),
        (
            hinge("ab", "fixed") + hinge("bc", "fixed"),
            "c",
            "^arm: no driven joint between links 'a' and 'c'",
        ),
        (
            hinge("ab") + hinge("bc", xyz="0 x 1"),
            "c",
            "^arm: joint 'bc': expected three numbers, got '0 x 1'",
        ),
        (hinge("ab") + hinge("bc", xyz="0 1"), "c", "^arm: joint 'bc': expected shape"),
        (hinge("ab") + hinge("bc", xyz="0 0 1e5"), "c", "^arm: joint 'bc': must be within 10000"),
        (
            hinge("ab") + hinge("bc", axis="0 0 0"),
            "c",
            "^arm: joint 'bc': the axis must be longer than zero",
        ),
        (
            hinge("ab") + hinge("bc", more="<limit lower='x'/>"),
            "c",
            "^arm: joint 'bc': limits must be numbers",
        ),
    ],
)
def test_arms_that_are_none_are_refused_by_joint(joints: str, tip: str | None, said: str) -> None:
    text = f"<robot><link name='a'/><link name='b'/><link name='c'/>{joints}</robot>"
    with pytest.raises(ConfigurationError, match=said):
        urdf_files.parse(text, "arm").chain(None, tip, ("--base", "--tip")).arm()


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"<robot", "^arm: no XML"),
        (b"<mujoco/>", "^arm: .*<robot>"),
        (7, "^arm: expected a file or its text, got 7"),
    ],
)
def test_what_is_no_urdf_is_refused(content: Any, said: str) -> None:
    with pytest.raises(ConfigurationError, match=said):
        urdf_files.parse(content, "arm")
