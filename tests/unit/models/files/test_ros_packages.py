"""Packages around a file: meshes by their names, xacro with its includes, COLLADA."""

import re
from pathlib import Path

import numpy as np
import pytest

from uuv.models.files.notes import computed
from uuv.models.files.ros_packages import mesh_file, package_folder
from uuv.models.files.urdf import parse
from uuv.own_vehicle import vehicle_spec
from uuv.sim.interfaces.errors import ConfigurationError

trimesh = pytest.importorskip("trimesh")
pytest.importorskip("collada")

URDF = """<robot name="rov"><link name="base">
  <inertial><mass value="20"/><inertia ixx=".5" iyy=".6" izz=".7" ixy="0" ixz="0" iyz="0"/>
  </inertial>
  <collision><origin xyz="0.1 0 0.2"/><geometry>
    <mesh filename="{mesh}" scale="2 1 1"/></geometry></collision></link></robot>"""


def package(folder: Path, *files: str) -> Path:
    """A package of ROS with empty files."""
    folder.mkdir(parents=True)
    (folder / "package.xml").write_text("<package/>")
    for name in files:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("")
    return folder


def test_packages_are_found_above_beside_and_in_the_workspace(tmp_path: Path, monkeypatch) -> None:
    rov = package(tmp_path / "src" / "mine" / "rov_description", "urdf/rov.urdf")
    other = package(tmp_path / "src" / "theirs" / "deep" / "arm_description", "meshes/link.stl")
    assert package_folder("rov_description", rov / "urdf") == rov
    assert package_folder("arm_description", rov / "urdf") == other
    link = other / "meshes" / "link.stl"
    assert mesh_file("package://arm_description/meshes/link.stl", rov / "urdf") == link
    assert mesh_file("package://nowhere/meshes/link.stl", rov / "urdf") is None

    # A file in no package searches no workspace, but the folders that are stated.
    lonely = tmp_path / "lonely"
    lonely.mkdir()
    assert package_folder("arm_description", lonely) is None
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "src"))
    assert package_folder("arm_description", lonely) == other


def test_a_package_that_comes_later_is_there_for_the_next_reading(tmp_path: Path) -> None:
    rov = package(tmp_path / "src" / "mine" / "rov_description", "urdf/rov.urdf")
    file = rov / "urdf" / "rov.urdf"
    file.write_text(URDF.format(mesh="package://hull_description/meshes/hull.stl"))
    without = vehicle_spec(file)
    assert any(line.endswith("hull.stl") for line in computed(without).values())

    hull = package(tmp_path / "src" / "theirs" / "hull_description") / "meshes"
    hull.mkdir()
    trimesh.creation.box((0.4, 0.2, 0.3)).export(hull / "hull.stl")
    assert vehicle_spec(file).compile().ngeom == 1


def test_a_mesh_of_another_vehicle_is_not_taken_for_its_bare_name(tmp_path: Path) -> None:
    urdf = tmp_path / "rov" / "urdf"
    urdf.mkdir(parents=True)
    (tmp_path / "base_link.stl").write_text("")  # of another vehicle
    assert mesh_file("package://arm/meshes/base_link.stl", urdf) is None
    assert mesh_file("base_link.stl", urdf) is None

    # With a folder of its path, or beside the file, it is.
    (urdf / "base_link.stl").write_text("")
    beside = urdf / "base_link.stl"
    assert mesh_file("package://arm/meshes/base_link.stl", urdf) == beside
    (tmp_path / "rov" / "meshes").mkdir()
    below = tmp_path / "rov" / "meshes" / "base_link.stl"
    below.write_text("")
    assert mesh_file("package://arm/meshes/base_link.stl", urdf) == below


def test_a_mesh_of_collada_is_a_shape_in_metres(tmp_path: Path, within) -> None:
    box = trimesh.creation.box((0.4, 0.2, 0.3))
    text = box.export(file_type="dae").decode()
    centimetres, count = re.subn("<up_axis>", '<unit name="cm" meter="0.01"/><up_axis>', text)
    assert count == 1
    (tmp_path / "box.dae").write_text(centimetres)
    (tmp_path / "rov.urdf").write_text(URDF.format(mesh="box.dae"))
    model = vehicle_spec(tmp_path / "rov.urdf").compile()
    assert model.ngeom == 1
    edges = np.sort(2.0 * model.geom_aabb[0, 3:])  # along the mesh's own axes
    within("edges [m]", edges - [0.002, 0.003, 0.008], 1e-7)
    within("place [m]", model.geom_pos[0] - [0.1, 0.0, 0.2], 1e-9)
    assert model.body("hull").mass[0] == 20.0


def test_without_its_package_a_mesh_is_left_out_with_one_line(tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "box.dae").write_text(
        trimesh.creation.box((0.4, 0.2, 0.3)).export(file_type="dae").decode()
    )
    (tmp_path / "rov.urdf").write_text(URDF.format(mesh="box.dae"))
    monkeypatch.setitem(__import__("sys").modules, "collada", None)
    said = computed(vehicle_spec(tmp_path / "rov.urdf"))
    assert [line for line in said.values() if "meshes left out, box.dae" in line] == [
        "meshes left out, box.dae: this needs the package collada: pip install 'uuv-arm[vehicles]'"
    ]


MACRO = """<robot name="rov" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="mass" default="20"/>
  <xacro:include filename="$(find parts_description)/urdf/hull.xacro"/>
  <xacro:hull mass="$(arg mass)"/></robot>"""
HULL = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:macro name="hull" params="mass"><link name="base"><inertial><mass value="${mass}"/>
  <inertia ixx=".5" iyy=".6" izz=".7" ixy="0" ixz="0" iyz="0"/></inertial></link></xacro:macro>
  </robot>"""


def test_xacro_is_expanded_with_the_packages_around_it(tmp_path: Path) -> None:
    pytest.importorskip("xacro")
    parts = package(tmp_path / "parts_description", "urdf/hull.xacro")
    (parts / "urdf" / "hull.xacro").write_text(HULL)
    rov = package(tmp_path / "rov_description", "urdf/rov.xacro") / "urdf" / "rov.xacro"
    rov.write_text(MACRO)
    assert vehicle_spec(rov).compile().body("hull").mass[0] == 20.0
    (rov.parent / "rov.parts.yaml").write_text("xacro: {mass: '31'}\n")
    assert vehicle_spec(rov).compile().body("hull").mass[0] == 31.0

    rov.write_text(MACRO.replace("parts_description", "no_such_package"))
    with pytest.raises(
        ConfigurationError,
        match=r"package 'no_such_package' is not in the folders around.*ROS_PACK",
    ):
        vehicle_spec(rov)
    with pytest.raises(
        ConfigurationError, match=r"the robot has no links; a file with only xacro macros"
    ):
        parse(parts / "urdf" / "hull.xacro")


def test_without_xacro_one_line_says_how_to_go_on(tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "rov.xacro").write_text(MACRO)
    monkeypatch.setitem(__import__("sys").modules, "xacro", None)
    with pytest.raises(ConfigurationError, match=r"xacro FILE > rov.urdf, or .*vehicles"):
        vehicle_spec(tmp_path / "rov.xacro")


def test_two_meshes_of_one_name_stay_two(tmp_path: Path) -> None:
    for folder, width in (("a", 0.4), ("b", 0.1)):
        (tmp_path / folder).mkdir()
        trimesh.creation.box((width, 0.1, 0.1)).export(tmp_path / folder / "part.stl")
    second = '<collision><geometry><mesh filename="b/part.stl"/></geometry></collision></link>'
    text = URDF.format(mesh="a/part.stl").replace("</link>", second)
    (tmp_path / "rov.urdf").write_text(text)
    model = vehicle_spec(tmp_path / "rov.urdf").compile()
    longest = np.max(2.0 * model.geom_aabb[:, 3:], axis=1)
    assert np.sort(longest) == pytest.approx([0.1, 0.8], rel=1e-5)
