"""Keys of a mapping beside names: postures, rotors, axes, masses; and what is doubted of a file."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from uuv.models import hydrodynamics
from uuv.models.files.notes import computed
from uuv.models.naming import CAMERA_SITE, HOME_KEY, READY_KEY
from uuv.own_vehicle import vehicle_spec
from uuv.sim import hydrodynamics as water
from uuv.sim.interfaces.errors import ConfigurationError

FLIP = np.diag([1.0, -1.0, -1.0])  # z down in z up, x ahead


def row(numbers) -> str:
    return " ".join(repr(float(entry)) for entry in np.ravel(numbers))


def urdf(sign: float = 1.0, upper: str = "1") -> str:
    """A hull with an arm; `sign` -1: its file has y and z turned round, as NED has."""
    s = sign
    roll = "3.141592653589793" if s < 0.0 else "0"
    return f"""<robot name="rov"><link name="base">
      <inertial><origin xyz="0.01 {row([s * 0.02, s * 0.03])}"/><mass value="30"/>
        <inertia ixx=".5" iyy=".6" izz=".7" ixy="{s * 0.02}" ixz="{s * 0.03}" iyz="0.01"/>
        </inertial>
      <collision><origin xyz="0 0 {s * 0.05}"/><geometry><box size="0.5 0.4 0.3"/></geometry>
        </collision></link>
      <link name="mount"/>
      <joint name="fix" type="fixed"><origin xyz="0.3 {row([s * 0.1, s * -0.2])}" rpy="{roll} 0 0"/>
        <parent link="base"/><child link="mount"/></joint>
      <link name="upper"><inertial><origin xyz="0 0 0.1"/><mass value="{upper}"/>
        <inertia ixx="1e-3" iyy="1e-3" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="turn" type="revolute"><parent link="mount"/><child link="upper"/>
        <axis xyz="0 1 0"/><limit lower="-1" upper="1.2" effort="9" velocity="3"/></joint>
      </robot>"""


def mapping(sign: float = 1.0, more: str = "") -> str:
    s = sign
    return f"""
arm_base: mount
tip: {{body: upper, pos: [0, 0, 0.2]}}
camera: {{body: base, pos: [0.3, {s * 0.1}, {s * 0.1}], z: [1, 0, {s * -0.3}]}}
joints: {{turn: 9}}
thrusters:
  - {{name: side, pos: [0.1, {s * 0.2}, {s * 0.05}], direction: [0.3, {s * 1.0}, {s * 0.2}]}}
{more}"""


def sidecar(sign: float = 1.0) -> str:
    s = sign
    coupled = np.diag([20.0, 30.0, 40.0, 1.0, 2.0, 3.0])
    coupled[0, 4] = coupled[4, 0] = 2.0 * s
    coupled[1, 3] = coupled[3, 1] = -1.5 * s
    strip = f"{{start: [0, 0, 0], end: [0.1, {s * 0.2}, 0], normal: 3.0}}"
    return (
        f"bodies: {{base: {{volume: 0.031, center_of_buoyancy: [0, 0, {s * 0.04}], "
        f"added_mass: {coupled.tolist()}, linear_damping: [4, 5, 6, 1, 2, 3], "
        f"quadratic_damping: [30, 40, 50, 3, 4, 5], strips: [{strip}]}}}}"
    )


def spec_of(folder: Path, text: str, parts: str, wet: str = "") -> mujoco.MjSpec:
    folder.mkdir(exist_ok=True)
    (folder / "rov.urdf").write_text(text)
    (folder / "rov.parts.yaml").write_text(parts)
    if wet:
        (folder / "rov.water.yaml").write_text(wet)
    return vehicle_spec(folder / "rov.urdf", computed=False)


def test_a_hull_with_z_down_is_turned_with_all_that_it_has(tmp_path: Path, within) -> None:
    upright = spec_of(tmp_path / "up", urdf(), mapping(), sidecar())
    down = spec_of(tmp_path / "down", urdf(-1.0), mapping(-1.0, "up: -z"), sidecar(-1.0))
    assert "axes turned, since -z of the file points up" in computed(down).values()

    states = []
    for spec in (upright, down):
        model = water.compile(spec.copy())
        data = mujoco.MjData(model)
        data.qpos[3:7] = [0.8, 0.3, -0.2, 0.4]
        data.qpos[7] = 0.5
        data.qvel[:] = [0.3, -0.2, 0.4, 0.5, -0.6, 0.2, 0.3]
        data.ctrl[:] = 0.7
        mujoco.mj_step(model, data, nstep=50)
        camera = data.site(CAMERA_SITE)
        states.append([data.qpos, data.qvel, camera.xpos, camera.xmat, model.body("hull").ipos])
    assert np.linalg.norm(states[0][1]) > 0.1
    for name, a, b in zip(("qpos", "qvel", "camera", "axes", "mass"), *states, strict=True):
        within(name, np.array(a) - b, 1e-11)


def test_a_file_that_seems_upside_down_is_doubted(tmp_path: Path) -> None:
    spec = spec_of(tmp_path, urdf(), mapping(), sidecar().replace("0.04]", "-0.04]"))
    line = "the hull's centre of buoyancy is 70 mm below its centre of mass;"
    assert any(text.startswith(line) for text in computed(spec).values())
    upright = spec_of(tmp_path / "up", urdf(), mapping(), sidecar())
    assert not any("z down" in text for text in computed(upright).values())


def test_postures_of_the_mapping_are_keyframes(tmp_path: Path) -> None:
    spec = spec_of(tmp_path, urdf(), mapping(more="home: [-0.9]\nready: {turn: 0.4}"))
    model = spec.compile()
    assert model.key(HOME_KEY).qpos[7] == -0.9
    assert model.key(READY_KEY).qpos[7] == 0.4


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("home: [0.1, 0.2]", "home: must have 1 joint values, for turn; got 2"),
        ("home: {tun: 0.1}", "home: unknown joint 'tun'; the arm has turn .did you mean turn"),
        ("ready: [1.5]", "ready: joint 'turn' must be within its range -1 to 1.2, got 1.5"),
        ("armature: -1", "armature .*: must be at least 0"),
        ("armature: {turm: 0.5}", "armature: unknown joint 'turm'; the arm has turn .did you mean"),
        ("up: down", "up: "),
        ("masses: {nowhere: 3}", "masses: the model has no body 'nowhere'"),
        ("masses: {base: 0}", "masses.base .*must be above 0"),
    ],
)
def test_slips_in_keys_are_one_line(tmp_path: Path, more: str, said: str) -> None:
    with pytest.raises(ConfigurationError, match=said):
        spec_of(tmp_path, urdf(), mapping(more=more))


def test_a_light_joint_gets_the_rotor_of_its_effort_and_speed(tmp_path: Path) -> None:
    light = urdf(upper="0.001").replace("1e-3", "1e-6").replace("1e-4", "1e-6")
    spec = spec_of(tmp_path / "prior", light, mapping())
    assert spec.compile().dof_armature[6] == pytest.approx(9.0 * 2e-3 / 3.0)
    assert any("assumed rotor inertia of light joints" in s for s in computed(spec).values())
    stated = spec_of(tmp_path / "stated", light, mapping(more="armature: {turn: 0.02}"))
    assert stated.compile().dof_armature[6] == 0.02
    heavy = spec_of(tmp_path / "heavy", urdf(upper="4"), mapping())
    assert heavy.compile().dof_armature[6] == 0.0


def test_masses_of_the_mapping_stand_for_those_that_a_file_lacks(tmp_path: Path, within) -> None:
    bare = '<robot name="rov"><link name="base"/></robot>'
    with pytest.raises(ConfigurationError, match=r"moves and has no mass.*masses: \{hull: 30\}"):
        spec_of(tmp_path / "a", bare, "{}")
    spec = spec_of(tmp_path / "b", bare, "masses: {base: 30}")
    assert any("sphere of water: base 30 kg" in line for line in computed(spec).values())
    radius = np.cbrt(0.75 * 30.0 / (np.pi * 1025.0))
    model = spec.compile()
    assert model.body("hull").mass[0] == 30.0
    within("inertia", model.body("hull").inertia - 0.4 * 30.0 * radius**2, 1e-12)
    assert spec_of(tmp_path / "d", bare, "masses: {hull: 7}").compile().body_mass[1] == 7.0

    # Shapes give the inertia where there are some.
    box = bare.replace(
        '<link name="base"/>',
        '<link name="base"><collision><geometry><box size="0.4 0.3 0.2"/></geometry></collision>'
        "</link>",
    )
    model = spec_of(tmp_path / "c", box, "masses: {base: 12}").compile()
    within("mass", model.body("hull").mass[0] - 12.0, 1e-9)
    exact = np.array([0.09 + 0.04, 0.16 + 0.04, 0.16 + 0.09])
    within("box", np.sort(model.body("hull").inertia) - exact, 1e-9)


def test_a_thruster_on_a_turning_link_is_named(tmp_path: Path) -> None:
    pod = """<link name="pod"/><joint name="azimuth" type="continuous"><axis xyz="0 0 1"/>
      <origin xyz="-0.3 0 -0.2"/><parent link="base"/><child link="pod"/></joint></robot>"""
    text = urdf().replace("</robot>", pod)
    across = "  - {name: az, body: pod, pos: [0, 0, 0], direction: [1, 0, 0]}\n"
    said = "thruster az turns with joint 'azimuth', which is held, so its direction is fixed"
    assert said in computed(spec_of(tmp_path, text, mapping(more=across))).values()
    along = across.replace("[1, 0, 0]", "[0, 0, 1]")  # as a propeller turns
    assert said not in computed(spec_of(tmp_path, text, mapping(more=along))).values()


def test_a_bare_arm_is_named_with_what_mounts_it(tmp_path: Path) -> None:
    link = '<link name="{0}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" '
    link += 'ixz="0" iyz="0"/></inertial></link>'
    joint = '<joint name="{0}{1}" type="revolute"><parent link="{0}"/><child link="{1}"/>'
    joint += '<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="3" velocity="1"/></joint>'
    text = "".join(link.format(name) for name in "abcd")
    text += "".join(joint.format(a, b) for a, b in ("ab", "bc", "cd"))
    (tmp_path / "arm.urdf").write_text(f'<robot name="arm">{text}</robot>')
    said = computed(vehicle_spec(tmp_path / "arm.urdf", computed=False)).values()
    assert any("it looks like a bare arm" in line and "mount_arm" in line for line in said)


def test_the_rest_of_the_water_is_turned_by_quarters() -> None:
    from uuv.models.completing.axes import UP, turned_water

    water = hydrodynamics.BodyHydrodynamics(
        volume=1.0, quadratic_damping=np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    )
    for up, turned in (("y", [1, 3, 2, 4, 6, 5]), ("-z", [1, 2, 3, 4, 5, 6])):
        assert turned_water(water, UP[up], "hull").quadratic_damping == pytest.approx(turned)
        axis = {"y": [0, 1, 0], "-z": [0, 0, -1]}[up]
        assert UP[up] @ np.array(axis, dtype=float) == pytest.approx([0, 0, 1])


def test_a_mass_of_the_mapping_is_taken_where_shapes_have_none(tmp_path: Path, within) -> None:
    """As in a file that draws its shapes with mass 0 and forgot the body's inertia."""
    (tmp_path / "rov.xml").write_text("""<mujoco><worldbody><body name="base">
        <geom type="box" size="0.2 0.15 0.1" mass="0"/></body></worldbody></mujoco>""")
    (tmp_path / "rov.parts.yaml").write_text("hull: base\nmasses: {base: 30}\n")
    model = vehicle_spec(tmp_path / "rov.xml").compile()
    within("mass", model.body("hull").mass[0] - 30.0, 1e-9)
    radius = np.cbrt(0.75 * 30.0 / (np.pi * 1025.0))
    within("inertia", model.body("hull").inertia - 0.4 * 30.0 * radius**2, 1e-12)
