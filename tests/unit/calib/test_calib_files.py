"""Arms and touches from files, and back: what is read is the arm, what is written is the identified
one.
"""

import xml.etree.ElementTree as ET
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from uuv import models
from uuv.calib import Arm, moving_base, results, touches
from uuv.calib.arm_files import read_arm
from uuv.calib.touch_files import read_touches, write_touches
from uuv.models.arms import dh_geometry
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import exp_so3, inverse, pose, readonly


def random_arm(rng: np.random.Generator, types: str = "rrprrr") -> Arm:
    """Joints anywhere and any way round, a base and a flange aside."""
    table = np.column_stack(
        [
            rng.uniform(-3, 3, len(types)),
            rng.uniform(-0.5, 0.5, (len(types), 2)),
            rng.uniform(-2, 2, len(types)),
            rng.uniform(-0.1, 0.1, len(types)),
        ]
    )
    arm = Arm.from_dh(table[:, :4], types, beta=table[:, 4])
    places = [
        readonly(pose(exp_so3(rng.uniform(-1, 1, 3)), rng.uniform(-1, 1, 3))) for _ in range(2)
    ]
    return replace(arm, X_base_0=places[0], X_n_flange=places[1])


def off(arm: Arm, rng: np.random.Generator) -> Arm:
    """The arm as identified: every number of every row a little else."""
    return arm.with_table(arm.table + 3e-3 * rng.standard_normal(arm.table.shape))


def by_mujoco(text: str, arm: Arm, q: np.ndarray) -> np.ndarray:
    """Tips (m, 3) of the site `tip` in the body `arm_base`."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    base = data.body("arm_base")
    out = []
    for angles in q:
        data.qpos[:] = angles
        mujoco.mj_kinematics(model, data)
        X = inverse(pose(base.xmat.reshape(3, 3), base.xpos))
        out.append(X[:3, :3] @ data.site("tip").xpos + X[:3, 3])
    assert len(arm.table) == model.nq
    return np.array(out)


def test_any_arm_goes_out_as_urdf_and_mjcf_and_comes_back(rng, tmp_path, within):
    arm = random_arm(rng)
    tcp = rng.uniform(-0.2, 0.2, 3)
    arm = replace(
        arm,
        limits=np.tile([-2.0, 2.0], (arm.n, 1)),
        joint_names=tuple(f"j{k}" for k in range(arm.n)),
    )
    q = rng.uniform(-1, 1, (20, arm.n))
    (tmp_path / "a.urdf").write_text(results.urdf(arm, tcp))
    back = read_arm(tmp_path / "a.urdf")
    assert back.arm.joint_names == arm.joint_names
    assert back.arm.joint_types == arm.joint_types
    np.testing.assert_array_equal(back.arm.limits, arm.limits)
    # 1.4e-11: twelve digits
    within("URDF [m]", back.arm.tips(q, np.zeros(3)) - arm.tips(q, tcp), 1.5e-10)
    within("MJCF [m]", by_mujoco(results.mjcf(arm, tcp), arm, q) - arm.tips(q, tcp), 1e-10)  # 8e-12


URDF = """<robot name="r">
<link name="b"/><link name="l1"/><link name="f"/><link name="l2"/><link name="l3"/>
<link name="t"/><link name="side"/>
<joint name="A" type="revolute"><parent link="b"/><child link="l1"/>
  <origin xyz=".1 0 .3" rpy=".1 .2 .3"/>
<axis xyz="0 1 0"/><limit lower="-1" upper="2" effort="1" velocity="1"/></joint>
<joint name="F" type="fixed"><parent link="l1"/><child link="f"/><origin xyz="0 .2 .1" rpy="0 0 1"/>
  </joint>
<joint name="B" type="continuous"><parent link="f"/><child link="l2"/><origin xyz=".4 0 0"/>
  <axis xyz="0 .6 .8"/>
</joint>
<joint name="C" type="prismatic"><parent link="l2"/><child link="l3"/><origin rpy="1 0 0"/>
  <axis xyz="1 0 0"/></joint>
<joint name="S" type="fixed"><parent link="l2"/><child link="side"/><origin xyz="0 0 .1"/></joint>
<joint name="T" type="fixed"><parent link="l3"/><child link="t"/>
  <origin xyz="0 .1 .2" rpy=".3 0 0"/></joint></robot>"""


@pytest.mark.parametrize("tip", ["t", "l3"])
def test_corrected_urdf_is_the_identified_arm(rng, tip, tmp_path, within):
    (tmp_path / "a.urdf").write_text(URDF)
    source = read_arm(tmp_path / "a.urdf", tip=tip)
    assert source.arm.joint_types == "rrp"
    arm = off(source.arm, rng)
    tcp = rng.uniform(-0.1, 0.1, 3)
    (tmp_path / "b.urdf").write_text(results.corrected_urdf(source, arm, tcp))
    q = rng.uniform(-1, 1, (20, 3))
    moved = source.arm.tips(q, np.zeros(3)) - arm.tips(q, tcp)
    assert np.abs(moved).max() > 1e-3
    for name in ("touch_tip", "t") if tip == "t" else ("touch_tip",):
        back = read_arm(tmp_path / "b.urdf", tip=name).arm
        within(f"{name} [m]", back.tips(q, np.zeros(3)) - arm.tips(q, tcp), 1e-11)  # 8e-13

    # A second calibration from the result moves the frame, and adds none.
    second = read_arm(tmp_path / "b.urdf", tip=tip)
    (tmp_path / "c.urdf").write_text(results.corrected_urdf(second, second.arm, tcp))
    assert (tmp_path / "c.urdf").read_text().count('<link name="touch_tip"') == 1
    back = read_arm(tmp_path / "c.urdf", tip="touch_tip").arm
    within("second [m]", back.tips(q, np.zeros(3)) - second.arm.tips(q, tcp), 1e-11)


def test_a_link_that_has_the_name_of_the_touched_point_is_refused(tmp_path):
    (tmp_path / "a.urdf").write_text(URDF.replace('"l1"', '"touch_tip"'))
    source = read_arm(tmp_path / "a.urdf", tip="t")
    with pytest.raises(ConfigurationError, match="must be fixed and carry no other link"):
        results.corrected_urdf(source, source.arm, np.zeros(3))


def test_mjcf_patch_is_the_identified_arm(rng, tmp_path, within):
    (tmp_path / "v.xml").write_text(models.load("uuv_puma").to_xml())
    source = read_arm(tmp_path / "v.xml")
    arm = off(source.arm, rng)
    tcp = rng.uniform(-0.01, 0.01, 3)
    patch = ET.fromstring(results.mjcf_patch(source, arm, tcp))
    spec = mujoco.MjSpec.from_file(str(tmp_path / "v.xml"))
    for entry in patch:
        element = (
            spec.body(entry.get("name")) if entry.tag == "body" else spec.site(entry.get("name"))
        )
        element.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
        element.pos, element.quat = (
            [float(x) for x in entry.get(key, "").split()] for key in ("pos", "quat")
        )
    moved = dh_geometry.read(spec.compile(), "arm_base", "tip", exclude=["pad"])
    q = rng.uniform(-1, 1, (20, 6))
    within("patched MJCF [m]", moved.tips(q, np.zeros(3)) - arm.tips(q, tcp), 1e-11)  # 8e-13


@pytest.mark.parametrize(
    "text",
    [
        "0,0.3,0,90\n0,0,-0.6,0\n10,0.1,0,-90\n",
        "theta_deg;d_mm;a_mm;alpha_deg\n0;300;0;90\n0;0;-600;0\n10;100;0;-90\n",
        "alpha [deg],a [m],d [m],theta [deg],name\n90,0,.3,0,p\n0,-.6,0,0,q\n-90,0,.1,10,r\n",
        "0 300 0 90\n0 0 -600 0\n10 100 0 -90\n",
    ],
)
def test_dh_table_in_any_unit(text, tmp_path):
    (tmp_path / "dh.csv").write_text(text)
    arm = read_arm(tmp_path / "dh.csv").arm
    want = [[0, 0.3, 0, np.pi / 2, 0], [0, 0, -0.6, 0, 0], [np.deg2rad(10), 0.1, 0, -np.pi / 2, 0]]
    np.testing.assert_allclose(arm.table, want, atol=1e-12)


def test_dh_table_as_yaml(tmp_path):
    (tmp_path / "a.yaml").write_text(
        "units: {angle: deg, length: mm}\njoint_types: rp\ntcp: [0, 0, 0.1]\nlimits: [[-1, 1], "
        "[null, null]]\n"
        "dh:\n- {theta: 1, d: 20, a: 3, alpha: 4}\n- [0, 5, 6, 7]\n"
    )
    source = read_arm(tmp_path / "a.yaml")
    np.testing.assert_allclose(source.arm.table[0, :4], [np.deg2rad(1), 0.02, 0.003, np.deg2rad(4)])
    assert source.arm.joint_types == "rp"
    np.testing.assert_array_equal(source.arm.limits, [[-1, 1], [-np.inf, np.inf]])
    np.testing.assert_array_equal(source.tcp, [0, 0, 0.1])


ROWS = "dh:\n- [0, 0.1, 0.2, 1.5]\n- {theta: 0, d: 0, a: 3e-1, alpha: 0}\n"


def test_what_a_yaml_of_an_arm_may_hold(tmp_path):
    """Numbers with an exponent, names that are numbers, no limits, a key that is not read."""
    (tmp_path / "a.yaml").write_text(
        ROWS + "joint_names: [1, two]\nlimits: [[-.inf, 1], [null, null]]\nlimts: []\n"
    )
    source = read_arm(tmp_path / "a.yaml")
    assert source.arm.table[1, 2] == 0.3
    assert source.arm.joint_names == ("1", "two")
    np.testing.assert_array_equal(source.arm.limits, [[-np.inf, 1], [-np.inf, np.inf]])
    assert any(
        "the entry 'limts' is ignored (did you mean limits?)" in note for note in source.notes
    )
    joint = "{x: 1e-1, y: 0, z: 2e-05, roll: 0, pitch: 0, yaw: 0, more: 1}"
    (tmp_path / "ur.yaml").write_text(f"kinematics:\n  a: {joint}\n  b: {joint}\n  hash: 12e4\n")
    assert read_arm(tmp_path / "ur.yaml").arm.joint_names == ("a", "b")


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.csv", "", "empty"),
        ("a.csv", "1,2,3\n", "lacks alpha"),
        ("a.csv", "0,nan,0,0\n", "finite"),
        ("a.csv", "theta,d,a,alpha\n0,x,0,0\n", "must be a number"),
        ("a.yaml", "dh: [1, 2]\n", r"dh\[0\]: must be theta, d, a, alpha"),
        ("a.yaml", "{", "cannot be read"),
        ("a.yaml", ROWS + "limits: [[.nan, 1], [0, 1]]", r"limits\[0\]\[0\]: must not be NaN"),
        ("a.yaml", ROWS + "limits: [[0, 1]]", r"limits: must have 2 pairs of numbers, got"),
        (
            "a.yaml",
            ROWS + "limits: [[0, 1, 2], [0, 1]]",
            r"limits\[0\]: must be 2 values, got "
            r"\[0, 1, 2\]",
        ),
        ("a.yaml", ROWS + "units: {angel: deg}", r"\[units\] has no 'angel'; .*did you mean angle"),
        (
            "a.yaml",
            ROWS + "units: deg",
            r"units: must be \{angle: rad or deg, length: m or mm\}, "
            r"got 'deg'",
        ),
        ("a.yaml", ROWS + "units: {angle: grad}", r"units.angle: allowed rad, deg, got 'grad'"),
        ("a.yaml", ROWS + "joint_types: rx", r"joint_types: must be letters r \(hinge\) and p"),
        (
            "a.yaml",
            ROWS + "joint_names: [[1], [2]]",
            r"joint_names\[0\]: must be text or a whole "
            r"number, got \[1\]",
        ),
        ("a.yaml", ROWS + "base: [a]", r"base: must be text, got \['a'\]"),
        ("a.yaml", ROWS + "base: a\nbase: b", r"the key 'base' occurs twice .*line 5"),
        ("a.yaml", ROWS + "tcp: [0, 0, up]", r"tcp\[2\] \[m\]: must be a number, got 'up'"),
        (
            "a.yaml",
            "dh: [[1, 2, 3]]",
            r"dh\[0\]: must be theta, d, a, alpha.*got \[1.0, 2.0, 3.0\]",
        ),
        ("a.yaml", "dhh: [[1, 2, 3, 4]]", r"rows under 'dh' .*got \['dhh'\] \(did you mean dh\?\)"),
        (
            "a.yaml",
            "kinematics: {a: {x: 1}}",
            r"\[kinematics.a\]: y, z, roll, pitch, yaw are "
            r"missing",
        ),
        (
            "a.yaml",
            "kinematics: {a: {x: true, y: 0, z: 0, roll: 0, pitch: 0, yaw: 0}}",
            "kinematics.a.x: must be a number",
        ),
        ("a.urdf", "<robot", "no XML"),
        ("a.urdf", URDF, "--tip"),
        ("a.xml", "<mujoco><worldbody/></mujoco>", "no body named 'arm_base'"),
        ("a.step", "x", "must be one of .csv"),
    ],
)
def test_bad_arm_is_refused_in_a_sentence(name, text, said, tmp_path):
    (tmp_path / name).write_text(text)
    with pytest.raises(ConfigurationError, match=said):
        read_arm(tmp_path / name)


@pytest.mark.parametrize("units", ["rad", "deg"])
def test_touches_in_all_their_forms(units, tmp_path):
    rng = np.random.default_rng(0)
    series = [rng.uniform(-2.5, 2.5, (4, 3)) for _ in range(2)]
    scale = 180.0 / np.pi if units == "deg" else 1.0
    rows = [[",".join(f"{scale * x:.12f}" for x in q) for q in series_q] for series_q in series]
    texts = {
        "folder": None,
        "label.csv": "time,point,a,b,c\n"
        + "\n".join(f"0.1,p{i},{r}" for i in range(2) for r in rows[i]),
        "number.csv": "\n".join(f"{i},{r}" for i in range(2) for r in rows[i]),
        "unit.csv": f"nr,c_{units},point,a_{units},b_{units}\n"
        + "\n".join(
            "{0},{3},p{4},{1},{2}".format(k, *r.split(","), i)
            for i in range(2)
            for k, r in enumerate(rows[i])
        ),
        "gap.csv": "\n\n".join("\n".join(block) for block in rows),
        "order.csv": "c;a;b\n"
        + "\n\n".join(
            "\n".join(";".join(np.roll(r.split(","), 1)) for r in block) for block in rows
        ),
        "decimal.csv": "\n\n".join(
            "\n".join(r.replace(",", ";").replace(".", ",") for r in block) for block in rows
        ),
    }
    for name, text in texts.items():
        if text is None:
            write_touches(tmp_path / name, ["p0", "p1"], [scale * block for block in series], "abc")
        else:
            (tmp_path / name).write_text(text)
        read = read_touches(tmp_path / name, joint_types="rrr", joint_names="abc")
        assert len(read.series) == 2, name
        for got, want in zip(read.series, series, strict=True):
            np.testing.assert_allclose(got, want, atol=1e-9, err_msg=name)
        assert any("degrees" in note for note in read.notes) == (units == "deg"), name
        assert len(read.sha256) == 64


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "the file is empty"),
        ("a,b,c\n", "must have at least one touch"),
        ("1,2,3\n1,2\n", "the arm's 3 joints, got 2"),
        ("1,2,3,4,5\n", "the arm's 3 joints, got 5"),
        (
            "nr,a,b_deg,q [deg]\n1,1,2,3\n",
            r"got 4; not joints of the arm: nr, q \[deg\]; ignored: time, t, stamp",
        ),
        ("nr,u,v,w\n1,1,2,3\n", "got 4: nr, u, v, w; its joints are a, b, c; ignored: time"),
        ("1,2,3\n1,nan,3\n", ":2: every joint value must be finite"),
        ("1,2,3\n1,oops,3\n", "must be a number"),
    ],
)
def test_bad_touches_are_refused_in_a_sentence(text, said, tmp_path):
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(ConfigurationError, match=said):
        read_touches(tmp_path / "t.csv", joint_types="rrr", joint_names="abc")


def test_degrees_beside_radians_are_refused(tmp_path):
    (tmp_path / "a.csv").write_text("0.1,0.2\n0.3,0.4\n")
    (tmp_path / "b.csv").write_text("10,20\n30,40\n")
    with pytest.raises(ConfigurationError, match="b looks like degrees"):
        read_touches(tmp_path, joint_types="rr")
    with pytest.raises(ConfigurationError, match="no such file"):
        read_touches(tmp_path / "c")
    turns = read_touches(tmp_path / "b.csv", joint_types="rr", units="rad")
    np.testing.assert_array_equal(turns.series[0], [[10, 20], [30, 40]])


def test_touches_of_more_than_a_turn_are_degrees_only_where_they_fit_far_better_so():
    """Angles between one turn and two: as degrees the tips must lie three times closer together,
    over all touches.
    """
    rng = np.random.default_rng(1)
    ratios = []
    refused = []
    arm = random_arm(rng, "rrrrrr")
    tcp = np.array([0.05, -0.02, 0.1])
    for sigma in np.geomspace(3e-3, 0.1, 24):
        series = []
        for _ in range(2):
            q = rng.uniform(-1.0, 1.0, (5, 6))
            goal = arm.tips(q[:1], tcp) + sigma * rng.normal(size=(5, 3))
            for _ in range(20):  # the same point from five hands, touched as badly as that
                p, J = arm.tips_and_jacobian(q, tcp)
                slopes = J[:, [5 * k for k in range(6)]].transpose(0, 2, 1)
                q = q + np.einsum("mij,mj->mi", np.linalg.pinv(slopes, rcond=1e-2), goal - p)
            series.append(np.angle(np.exp(1j * q)))
        series[0][0, 0] += np.copysign(2.0 * np.pi, series[0][0, 0])
        tips = []
        for readings in (series, [np.deg2rad(q) for q in series]):
            tcp_first = touches.first_tcp(arm, readings)
            off = np.concatenate(
                [p - p.mean(axis=0) for p in (arm.tips(q, tcp_first) for q in readings)]
            )
            tips.append(np.sqrt(np.mean(np.sum(off**2, axis=1))))
            assert touches.spread(arm, tcp_first, readings) == pytest.approx(tips[-1], rel=1e-12)
        ratios.append(tips[0] / tips[1])
        try:
            touches.checked_series(series, arm)
        except ConfigurationError:
            refused.append(True)
        else:
            refused.append(False)
    print(np.round(np.sort(ratios), 2))
    assert min(ratios) < 1.0
    assert any(1.1 < ratio < 2.9 for ratio in ratios)
    assert max(ratios) > 3.1
    assert refused == [ratio > 3.0 for ratio in ratios]


def test_arm_on_a_moving_base(rng, within):
    arm = random_arm(rng, "rrrrrr")
    X_BA = pose(exp_so3(rng.uniform(-1, 1, 3)), rng.uniform(-1, 1, 3))
    longer = moving_base.on_moving_base(arm, X_BA)
    q = rng.uniform(-1, 1, (10, 6))
    X_WB = np.array([pose(exp_so3(rng.uniform(-0.4, 0.4, 3)), rng.uniform(-1, 1, 3)) for _ in q])
    want = np.array(
        [(X @ X_BA @ flange)[:3, 3] for X, flange in zip(X_WB, arm.flange(q), strict=True)]
    )
    tips = longer.tips(moving_base.with_base(q, X_WB), np.zeros(3))
    within("tips [m]", tips - want, 2e-13)  # 1e-15, more where rows are long
    # 1e-15
    within("own arm [m]", moving_base.own_arm(longer, X_BA).flange(q) - arm.flange(q), 2e-13)
