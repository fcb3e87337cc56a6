"""Water and thrusters of UUV Simulator's blocks are the same numbers put in by hand."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from uuv.models import hydrodynamics
from uuv.models.files.vehicle_file import read
from uuv.models.water import thrusters
from uuv.models.water.thruster_curves import thrust_at
from uuv.own_vehicle import vehicle_spec
from uuv.sim import hydrodynamics as water
from uuv.sim.interfaces.errors import ConfigurationError

# In axes x ahead, y to starboard, z down: symmetric, positive, with every product.
ADDED = np.diag([30.0, 50.0, 70.0, 2.0, 3.0, 4.0])
ADDED[0, 4] = ADDED[4, 0] = -3.0
ADDED[1, 3] = ADDED[3, 1] = 2.5
ADDED[1, 5] = ADDED[5, 1] = 1.5
ADDED[0, 2] = ADDED[2, 0] = 4.0
LINEAR = np.array([5.0, 6.0, 7.0, 0.8, 0.9, 1.1])
QUADRATIC = np.array([40.0, 60.0, 80.0, 3.0, 4.0, 5.0])
FLIP = np.diag([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])

PRIOR = 2.35 * (9.81 * 20.002) ** (2.0 / 3.0)  # [N] of each thruster of the vehicle below


def row(numbers) -> str:
    return " ".join(repr(float(entry)) for entry in np.ravel(numbers))


def thruster(number: int, conversion: str, more: str = "") -> str:
    return f"""<gazebo><plugin name="t{number}" filename="libuuv_thruster_ros_plugin.so">
      <linkName>rov/thruster_{number}</linkName><jointName>rov/thruster_{number}_joint</jointName>
      <thrusterID>{number}</thrusterID>{more}
      <dynamics><type>FirstOrder</type><timeConstant>0.2</timeConstant></dynamics>
      <conversion>{conversion}</conversion></plugin></gazebo>"""


def propeller(number: int, rpy: str) -> str:
    return f"""<link name="rov/thruster_{number}"><inertial><mass value="0.001"/>
      <inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="rov/thruster_{number}_joint" type="continuous"><axis xyz="0 1 0"/>
      <origin xyz="-0.3 0.1 0.2" rpy="{rpy}"/><parent link="rov/base_link"/>
      <child link="rov/thruster_{number}"/></joint>"""


BASIC = "<type>Basic</type><rotorConstant>0.02</rotorConstant>"
BESSA = (
    "<type>Bessa</type><rotorConstantL>0.03</rotorConstantL><rotorConstantR>0.02</rotorConstantR>"
    "<deltaL>-100</deltaL><deltaR>200</deltaR>"
)
TABLE = (
    "<type>LinearInterp</type><inputValues>-10 -1 1 10</inputValues>"
    "<outputValues>-20 0 0 30</outputValues>"
)


def urdf(coefficients: str, *blocks: str, volume: str = "<volume>0.021</volume>") -> str:
    return f"""<robot name="rov"><link name="rov/base_link">
      <inertial><mass value="20"/>
        <inertia ixx=".5" iyy=".6" izz=".7" ixy="0" ixz="0" iyz="0"/></inertial>
      <collision><geometry><box size="0.4 0.3 0.2"/></geometry></collision></link>
      {propeller(0, "0 0 -1.5707963267948966")}{propeller(1, "0.3 0 0")}
      <gazebo><plugin name="uuv_plugin" filename="libuuv_underwater_object_ros_plugin.so">
        <fluid_density>1028.0</fluid_density><link name="rov/base_link">{volume}
        <center_of_buoyancy>0.01 -0.02 0.05</center_of_buoyancy>
        <hydrodynamic_model>{coefficients}</hydrodynamic_model></link></plugin></gazebo>
      {"".join(blocks)}</robot>"""


FOSSEN = f"""<type>fossen</type><added_mass>{row(ADDED)}</added_mass>
  <linear_damping>{row(-LINEAR)}</linear_damping>
  <quadratic_damping>{row(-QUADRATIC)}</quadratic_damping>"""


def spec_of(folder: Path, text: str) -> mujoco.MjSpec:
    (folder / "rov.urdf").write_text(text)
    return vehicle_spec(folder / "rov.urdf", computed=False)


def test_the_water_of_a_block_is_that_put_in_by_hand(tmp_path: Path, within) -> None:
    spec = spec_of(tmp_path, urdf(FOSSEN, thruster(0, BASIC)))
    by_hand = spec.copy()
    flip = np.diag(FLIP)
    hydrodynamics.attach(
        by_hand,
        {
            "hull": hydrodynamics.BodyHydrodynamics(
                volume=0.021,
                center_of_buoyancy=np.array([0.01, -0.02, 0.05]),
                added_mass=flip[:, None] * ADDED * flip,
                linear_damping=LINEAR,
                quadratic_damping=QUADRATIC,
            )
        },
        1028.0,
    )
    assert hydrodynamics.density_of(spec) == 1028.0

    # The same accelerations at any motion, which is not that of dry bodies.
    accelerations = []
    for vehicle in (spec, by_hand):
        model = water.compile(vehicle.copy())
        data = mujoco.MjData(model)
        data.qpos[3:7] = [0.9, 0.1, -0.3, 0.2]
        data.qvel[:] = [0.3, -0.2, 0.4, 0.5, -0.6, 0.2]
        mujoco.mj_forward(model, data)
        accelerations.append(np.array(data.qacc))
    assert np.abs(accelerations[0]).max() > 0.1
    within("acceleration", accelerations[0] - accelerations[1], 1e-12)


def test_a_sidecar_takes_the_place_of_the_block(tmp_path: Path) -> None:
    (tmp_path / "rov.water.yaml").write_text("bodies: {rov/base_link: {volume: 0.05}}\n")
    spec = spec_of(tmp_path, urdf(FOSSEN))
    assert hydrodynamics.attached(spec)["hull"].volume == 0.05


def test_thrusters_push_along_their_joints_by_their_curves(tmp_path: Path, within) -> None:
    limits = "<thrustMin>-45</thrustMin><thrustMax>50</thrustMax>"
    spec = spec_of(tmp_path, urdf(FOSSEN, thruster(0, BASIC, limits), thruster(1, TABLE)))
    model = spec.compile()
    rows, table = thrusters.read(model)
    assert [model.actuator(int(a)).name for a in rows] == ["thruster_0", "thruster_1"]
    first, second = (thrusters.unpack(line) for line in table)
    assert (first.forward, first.reverse, first.time_constant) == (50.0, 45.0, 0.2)
    assert (second.forward, second.reverse) == pytest.approx((30.0, 20.0))

    # y of the link, turned by -90 deg about z, is x of the hull; the place is the link's.
    data = mujoco.MjData(model)
    data.act[:] = 0.0
    mujoco.mj_kinematics(model, data)
    site = data.site("thruster_0")
    axis = site.xmat.reshape(3, 3) @ model.actuator_gear[rows[0], :3]
    within("axis", axis - [1.0, 0.0, 0.0], 1e-12)
    within("place", site.xpos - data.body("hull").xpos - [-0.3, 0.1, 0.2], 1e-12)


@pytest.mark.parametrize(
    ("conversion", "limits", "ends", "between"),
    [
        # beyond x|x| = 200 ahead, 100 astern, up to x = 40; at half the command
        (BESSA, "<clampMin>-40</clampMin><clampMax>40</clampMax>", (28.0, 45.0), (4.0, -9.0)),
        (BASIC, "<clampMax>50</clampMax><clampMin>-50</clampMin>", (50.0, 50.0), (12.5, -12.5)),
        (BASIC, "<clampMax>5</clampMax><clampMin>-5</clampMin><gain>10</gain>", (50, 50), None),
        (BASIC, "<thrustMax>50</thrustMax><thrustMin>-50</thrustMin>", (50.0, 50.0), None),
    ],
)
def test_a_curve_of_a_command_becomes_that_of_a_share(
    tmp_path: Path, conversion, limits, ends, between, within
) -> None:
    (tmp_path / "rov.urdf").write_text(urdf(FOSSEN, thruster(0, conversion, limits)))
    (mapped,) = read(tmp_path / "rov.urdf").thrusters
    kind = mapped.thruster
    assert (kind.forward, kind.reverse) == pytest.approx(ends, rel=1e-9)
    if between is None:
        return
    spec = spec_of(tmp_path, urdf(FOSSEN, thruster(0, conversion, limits)))
    curve = thrusters.curves(thrusters.read(spec.compile())[1])[0]
    within("thrust at half [N]", thrust_at(curve, 0.5) - between[0], 0.05)
    within("thrust at minus half [N]", thrust_at(curve, -0.5) - between[1], 0.05)


@pytest.mark.parametrize(
    ("limits", "ends", "entries"),
    [
        (  # 0.02 N 50^2 ahead
            "<clampMin>0</clampMin><clampMax>50</clampMax>",
            (50.0, 0.5),
            [
                "the other way 0.5 N, guessed (the file allows thrust ahead only",
                "read (its limits)",
            ],
        ),
        (
            "<clampMin>-50</clampMin><clampMax>0</clampMax>",
            (0.5, 50.0),
            ["the file allows thrust astern only", "read (its limits)"],
        ),
        (
            "<thrustMin>0</thrustMin><thrustMax>40</thrustMax>",
            (40.0, 0.4),
            ["the file allows thrust ahead only", "thrust 40 and -0.4 N, read (its limits)"],
        ),
        (
            "<thrustMin>0</thrustMin>",
            (PRIOR, 0.01 * PRIOR),
            ["the file allows thrust ahead only", "guessed (no limit in the file"],
        ),
        (
            "<thrustMin>-40</thrustMin><thrustMax>40</thrustMax><gain>0</gain>",
            (PRIOR, PRIOR),
            ["guessed (the file's limits allow no thrust"],
        ),
    ],
)
def test_a_stated_zero_counts_one_way_is_next_to_nothing_the_other(
    tmp_path: Path, limits, ends, entries
) -> None:
    (tmp_path / "rov.urdf").write_text(urdf(FOSSEN, thruster(0, BASIC, limits)))
    file = read(tmp_path / "rov.urdf")
    kind = file.thrusters[0].thruster
    assert (kind.forward, kind.reverse) == pytest.approx(ends, rel=1e-9)
    text = "\n".join(entry.line() for entry in file.entries)
    assert all(entry in text for entry in entries)


def test_what_is_fixed_to_a_link_weighs_once(tmp_path: Path) -> None:
    # 20 kg fixed to a link without mass
    text = urdf(FOSSEN, thruster(0, BASIC)).replace(
        '<link name="rov/base_link">',
        '<link name="rov/foot"/><joint name="rov/foot_joint" type="fixed">'
        '<origin xyz="0.1 -0.2 0.3" rpy="0.1 0.2 -0.3"/><parent link="rov/foot"/>'
        '<child link="rov/base_link"/></joint><link name="rov/base_link">',
    )
    (tmp_path / "rov.urdf").write_text(text)
    (mapped,) = read(tmp_path / "rov.urdf").thrusters
    assert mapped.thruster.forward == pytest.approx(PRIOR, rel=1e-9)


def test_what_is_guessed_and_left_out_is_told_with_its_reason(tmp_path: Path) -> None:
    fin = '<gazebo><plugin name="f" filename="libuuv_fin_ros_plugin.so"><linkName>fin0</linkName>'
    block = f"{fin}</plugin></gazebo>"
    neutral = "<neutrally_buoyant>1</neutrally_buoyant><volume>9</volume>"
    (tmp_path / "rov.urdf").write_text(urdf(FOSSEN, thruster(0, BASIC), block, volume=neutral))
    lines = [entry.line() for entry in read(tmp_path / "rov.urdf").entries]
    text = "\n".join(lines)
    assert "rov/base_link: volume 0.0194553 m^3, read (neutrally_buoyant)" in text
    assert f"thrust {PRIOR:.4g} and -{PRIOR:.4g} N, guessed (no limit in the file" in text
    assert "fin0: fin, left out (fins are held still, without lift)" in text


@pytest.mark.parametrize(
    ("shape", "added", "drag"),
    [
        # 2/3 pi rho r^3, and 1/2 rho 0.5 pi r^2
        (
            "<type>sphere</type><radius>0.1</radius>",
            [2.15303814] * 3 + [0.0] * 3,
            [8.0739] * 3 + [0.0] * 3,
        ),
        # along z: of its plugin no length along, and nothing about the axis
        (
            "<type>cylinder</type><radius>0.1</radius><length>1</length><axis>k</axis>",
            [32.2956, 32.2956, 32.2956, 2.6913, 2.6913, 0.0],
            [38.036, 38.036, 15.9863, 0.0, 0.0, 0.0],
        ),
    ],
)
def test_shapes_are_those_of_the_plugin(tmp_path: Path, shape, added, drag) -> None:
    body = hydrodynamics.attached(spec_of(tmp_path, urdf(shape)))["hull"]
    assert np.diag(body.added_mass) == pytest.approx(added, rel=1e-4)
    assert body.quadratic_damping == pytest.approx(drag, rel=1e-3)


def test_water_that_would_feed_energy_in_is_reduced_and_said(tmp_path: Path) -> None:
    wrong = FOSSEN.replace(row(-LINEAR), row(LINEAR)).replace(row(ADDED), row(ADDED - 60.0))
    (tmp_path / "rov.urdf").write_text(urdf(wrong))
    text = "\n".join(entry.line() for entry in read(tmp_path / "rov.urdf").entries)
    assert (
        "added mass, guessed (its diagonal only, since the whole matrix is not positive "
        "semidefinite)" in text
    )
    assert (
        "linear damping, guessed (magnitudes only, since the signs of the file would add energy)"
        in text
    )
    body = hydrodynamics.attached(spec_of(tmp_path, urdf(wrong)))["hull"]
    assert np.diag(body.linear_damping) == pytest.approx(LINEAR)


def test_a_number_that_is_none_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="<fluid_density>: must be positive and finite"):
        spec_of(tmp_path, urdf(FOSSEN).replace("1028.0", "0"))
    with pytest.raises(ConfigurationError, match="water of link 'rov/base_link': <volume>: expect"):
        spec_of(tmp_path, urdf(FOSSEN, volume="<volume>much</volume>"))
    with pytest.raises(ConfigurationError, match="<added_mass>: expected 36 numbers"):
        spec_of(tmp_path, urdf("<type>fossen</type><added_mass>1 2</added_mass>"))


@pytest.mark.parametrize("axis", ["x", "ij", "-k"])
def test_a_cylinder_lies_along_i_j_or_k(tmp_path: Path, axis: str) -> None:
    shape = f"<type>cylinder</type><radius>0.1</radius><length>1</length><axis>{axis}</axis>"
    with pytest.raises(ConfigurationError, match=f"<axis>: allowed i, j, k, got '{axis}'"):
        spec_of(tmp_path, urdf(shape))
