"""Every description of a vehicle is read into one value, under its own names, and mapped from
there.
"""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from uuv import models
from uuv.models import hydrodynamics
from uuv.models.completing.mapping import mapped
from uuv.models.completing.mounting import mount_arm
from uuv.models.files.notes import computed, forget, note
from uuv.models.files.vehicle_file import read
from uuv.own_vehicle import vehicle_spec
from uuv.sim.interfaces.errors import ConfigurationError

BASE = """<link name="base"><inertial><origin xyz="0.01 0 0.02"/><mass value="20"/>
  <inertia ixx="0.5" iyy="0.6" izz="0.7" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
PROPELLER = """<link name="propeller"/><joint name="spin" type="continuous"><axis xyz="1 0 0"/>
  <origin xyz="-0.3 0.1 0.02" rpy="0.1 0 0.2"/><parent link="base"/><child link="propeller"/>
    </joint>"""
ARM = """<link name="link"><inertial><mass value="1"/>
  <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="lift" type="revolute"><origin xyz="0.2 0 -0.1" rpy="0.3 0 0"/><axis xyz="0 1 0"/>
  <parent link="base"/><child link="link"/><limit lower="-1" upper="1" effort="7" velocity="1"/>
    </joint>"""
DRONE = """<mujoco><worldbody><body name="drone" pos="0.1 0.2 0.3"><freejoint/>
  <geom type="box" size="0.3 0.2 0.1" mass="24"/></body></worldbody></mujoco>"""


def urdf(folder: Path, *parts: str, mapping: str = "") -> Path:
    """A URDF of these parts, and its mapping."""
    file = folder / "rov.urdf"
    file.write_text(f'<robot name="rov">{"".join(parts)}</robot>', encoding="utf-8")
    if mapping:
        (folder / "rov.parts.yaml").write_text(mapping, encoding="utf-8")
    return file


def test_a_file_is_read_under_its_own_names(tmp_path: Path) -> None:
    file = urdf(tmp_path, BASE, ARM, mapping="trim: 0.04\n")
    (tmp_path / "rov.water.yaml").write_text("bodies: {base: {sphere: {radius: 0.2}}}")
    vehicle = read(file)
    assert [body.name for body in vehicle.spec.bodies] == ["world", "base", "link"]
    assert (vehicle.bare, vehicle.trim, list(vehicle.spec.actuators)) == (True, 0.04, [])
    assert list(hydrodynamics.attached(vehicle.spec)) == ["base"]

    spec = mapped(vehicle)
    model = spec.compile()
    # no arm by the contract: the mapping names none, and nothing drives a joint
    assert [model.joint(j).name for j in range(model.njnt)] == ["hull"]
    assert "joints held at 0, which no actuator drives: lift" in computed(spec).values()
    assert model.nu == 0


def test_what_cannot_be_a_vehicle_is_named(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigurationError,
        match=r"unknown vehicle 'uuv_pumma'.*did you mean "
        r"uuv_puma",
    ):
        read("uuv_pumma")
    with pytest.raises(ConfigurationError, match="vehicle: expected a name or a file, got 3"):
        read(3)  # type: ignore[arg-type]  # as a user may
    file = urdf(tmp_path, BASE)
    water = tmp_path / "rov.water.yaml"
    water.write_text("bodies: {base: {sphere: {radius: 0.2}}}")
    assert hydrodynamics.attached(read(file, water=water).spec)
    for source in ("uuv_puma", read(file).spec):
        with pytest.raises(
            ConfigurationError, match="has its own water, so a water file is refused"
        ):
            read(source, water=water)


def test_a_function_and_a_spec_go_the_way_of_a_file(tmp_path: Path, monkeypatch) -> None:
    """A floating body of another name is the hull, whoever describes it."""
    (tmp_path / "my_drone.py").write_text(
        f"import mujoco\ndef build():\n    return mujoco.MjSpec.from_string('''{DRONE}''')\n"
    )
    (tmp_path / "drone.xml").write_text(DRONE)
    monkeypatch.syspath_prepend(tmp_path)
    spec = mujoco.MjSpec.from_string(DRONE)
    for described in (tmp_path / "drone.xml", "my_drone:build", spec):
        vehicle = vehicle_spec(described)
        assert vehicle.bodies[1].name == "hull"
        assert computed(vehicle) == {
            "note_1": "body hull: 'drone', since it is the only body on the world"
        }
    assert spec.bodies[1].name == "drone"  # it is left as it is
    assert not spec.texts


def test_a_link_without_mass_that_the_mapping_locks_is_part_of_its_parent(
    tmp_path: Path, within
) -> None:
    """As the propellers and sensors of UUV Simulator's URDFs are."""
    (tmp_path / "plain").mkdir()
    mapping = "arm_base: base_mount\ntip: {body: link, pos: [0, 0, 0.1]}\njoints: {lift: 7}\n"
    mount = (
        '<link name="base_mount"/><joint name="m" type="fixed"><parent link="base"/><child '
        'link="base_mount"/></joint>'
    )
    arm = ARM.replace('parent link="base"', 'parent link="base_mount"')
    turning = vehicle_spec(urdf(tmp_path, BASE, mount, PROPELLER, arm, mapping=mapping)).compile()
    plain = vehicle_spec(urdf(tmp_path / "plain", BASE, mount, arm, mapping=mapping)).compile()
    assert [turning.joint(j).name for j in range(turning.njnt)] == ["hull", "lift"]
    data = [mujoco.MjData(model) for model in (turning, plain)]
    for state in data:
        state.ctrl[0] = 0.4
    for model, state in zip((turning, plain), data, strict=True):
        mujoco.mj_step(model, state, nstep=100)
    assert abs(data[0].qvel[6]) > 0.05
    within("with and without the propeller: qvel", data[0].qvel - data[1].qvel, 1e-12)


def test_a_hull_that_another_body_carries_is_refused(tmp_path: Path) -> None:
    fixed = '<joint name="f" type="fixed"><parent link="base"/><child link="pod"/></joint>'
    file = urdf(tmp_path, BASE, BASE.replace("base", "pod"), fixed, mapping="hull: pod\n")
    with pytest.raises(
        ConfigurationError, match=r"hull: 'pod' is carried by another body.*: base$"
    ):
        vehicle_spec(file)


def test_an_arm_whose_root_hangs_on_the_world_of_ros_is_mounted(tmp_path: Path) -> None:
    world = (
        '<link name="world"/><joint name="w" type="fixed"><parent link="world"/><child '
        'link="base"/></joint>'
    )
    rov = models.load("bluerov2_heavy")
    mounting = {"p": [0.2, 0.0, -0.15], "rpy": [np.pi, 0.0, 0.0]}
    links = mount_arm(
        rov, urdf(tmp_path, world, BASE, ARM), **mounting, tip="link", tip_p=[0.0, 0.0, 0.1]
    )
    assert links == ["arm_base", "arm_link"]
    assert rov.compile().actuator("arm_lift").ctrlrange.tolist() == [-7.0, 7.0]


def test_notes_are_kept_counted_and_forgotten() -> None:
    spec = mujoco.MjSpec.from_string(DRONE)
    spec.add_text(name="of_the_user", data="stays")
    note(spec, ["a", "b"])
    note(spec, ["c"])
    spec.add_text(name="computed_home", data="folded")
    assert computed(spec) == {"note_1": "a", "note_2": "b", "note_3": "c", "home": "folded"}
    forget(spec, "home")
    assert "home" not in computed(spec)
    forget(spec)
    assert [text.name for text in spec.texts] == ["of_the_user"]


def test_the_water_that_wet_makes_shares_the_mapping_of_its_file(tmp_path: Path) -> None:
    """NAME.wet.xml takes NAME.parts.yaml, unless it has a mapping of its own."""
    body = '<body name="h"><freejoint/><geom size=".1"/></body>'
    xml = f"<mujoco><worldbody>{body}</worldbody></mujoco>"
    (tmp_path / "rov.wet.xml").write_text(xml, encoding="utf-8")
    (tmp_path / "rov.parts.yaml").write_text("hull: h\ntrim: 0.02\n", encoding="utf-8")
    assert read(tmp_path / "rov.wet.xml").trim == 0.02
    (tmp_path / "rov.wet.parts.yaml").write_text("hull: h\ntrim: 0.03\n", encoding="utf-8")
    assert read(tmp_path / "rov.wet.xml").trim == 0.03
