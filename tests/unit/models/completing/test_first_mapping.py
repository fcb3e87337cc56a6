"""A first mapping names what a file tells, asks for the rest, and can be read."""

from pathlib import Path

import pytest

from uuv.models.completing.first_mapping import first_mapping
from uuv.models.files.parts_file import read_parts
from uuv.models.files.vehicle_file import read
from uuv.models.vehicle import Vehicle
from uuv.own_vehicle import vehicle_spec
from uuv.sim.interfaces.errors import ConfigurationError

LINK = """<link name="{0}"><inertial><mass value="{1}"/>
  <inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial></link>"""


def joint(name: str, parent: str, child: str, kind: str = "revolute", effort: str = "7") -> str:
    return f"""<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
      <origin xyz="0.1 0.02 0.1" rpy="0.1 0 0.2"/><axis xyz="0 1 0"/>
      <limit lower="-1" upper="1" effort="{effort}" velocity="1"/></joint>"""


def robot(*more: str, mass: str = "30", effort: str = "7") -> str:
    links = [LINK.format("rov/hull", mass)]
    links += [LINK.format(name, "1") for name in ("a", "b", "c", "jaw_1", "jaw_2")]
    frames = "".join(f'<link name="{name}"/>' for name in ("mount", "cam", "cam_optical"))
    joints = [
        joint("fix", "rov/hull", "mount", "fixed"),
        joint("turn", "mount", "a", effort=effort),
        joint("lift", "a", "b", effort=effort),
        joint("roll", "b", "c", effort=effort),
        joint("open_1", "c", "jaw_1"),
        joint("open_2", "c", "jaw_2"),
        joint("eye", "rov/hull", "cam", "fixed"),
        joint("see", "cam", "cam_optical", "fixed"),
    ]
    return f'<robot name="rov">{"".join(links)}{frames}{"".join(joints)}{"".join(more)}</robot>'


PROPELLER = '<link name="prop_1"/>' + joint("spin", "rov/hull", "prop_1", "continuous")


def mapped(folder: Path, text: str) -> tuple[Path, str, list[str]]:
    file = folder / "rov.urdf"
    file.write_text(text)
    written, questions = first_mapping(read(file))
    (folder / "rov.parts.yaml").write_text(written)
    return file, written, questions


def test_the_arm_the_camera_and_the_thrusters_are_told_by_the_file(tmp_path: Path) -> None:
    file, text, questions = mapped(tmp_path, robot(PROPELLER))
    parts = read_parts(tmp_path / "rov.parts.yaml")
    assert (parts.hull, parts.arm_base) == ("rov/hull", "mount")
    assert parts.torque_limits == {"turn": 7, "lift": 7, "roll": 7}  # without the fingers
    assert "camera: {body: cam_optical, z: [0, 0, 1]}" in text
    assert [thruster.body for thruster in parts.thrusters] == ["prop_1"]
    assert parts.thrusters[0].axis == pytest.approx([0.0, 1.0, 0.0])
    assert sum(question.startswith("tip:") for question in questions) == 1

    vehicle = Vehicle.of(vehicle_spec(file, computed=False).compile())
    assert vehicle.joint_names == ("turn", "lift", "roll")
    assert vehicle.thruster_names == ("prop_1",)


def test_what_the_file_does_not_tell_is_asked(tmp_path: Path) -> None:
    bare = robot(mass="0", effort="0")
    file, text, questions = mapped(
        tmp_path, bare.replace('<link name="mount"/>', LINK.format("mount", 0))
    )
    asked = "\n".join(questions)
    assert "mass of rov/hull [kg]" in asked
    assert "torque limit of joint turn [N m]" in asked
    assert "thrusters: positions, directions and thrust" in asked
    assert "masses: {rov/hull: 30}   # guessed" in text
    assert vehicle_spec(file, computed=False).compile().body("hull").mass[0] == 30.0


def test_the_command_writes_it_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from uuv.cli.skeletons import main

    file = tmp_path / "rov.urdf"
    file.write_text(robot(PROPELLER))
    assert main("new", ["mapping", str(file)]) == 0
    said = capsys.readouterr().out
    assert "rov.parts.yaml" in said
    assert "? tip: where on c does the tool end" in said
    with pytest.raises(ConfigurationError, match="exists already"):
        main("new", ["mapping", str(file)])
