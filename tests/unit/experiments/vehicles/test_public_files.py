"""Public files: what is read, read with an addition, refused with a way on, and not there."""

from pathlib import Path

import pytest

from experiments.vehicles import public_files
from experiments.vehicles.public_files import (
    ABSENT,
    ADDED,
    READ,
    REFUSED,
    WAY,
    WAYS,
    PublicFileCase,
    PublicFileRow,
    PublicVehicle,
)
from uuv.sim.interfaces.errors import ConfigurationError

SOUND = """<robot name="r"><link name="base"><inertial><mass value="{mass}"/>
  <inertia ixx=".5" iyy=".6" izz="{izz}" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""
CROSSED = """<sdf version="1.9"><model name="r">
  <link name="base"><inertial><mass>20</mass></inertial></link>
  <link name="hand"><inertial><mass>1</mass></inertial></link>
  <joint name="k" type="revolute"><parent>base</parent><child>hand</child>
  <axis><xyz>0 1 0</xyz><limit><lower>1</lower><upper>-1</upper></limit></axis></joint>
  </model></sdf>"""
XACRO = """<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">{}</robot>"""
# By the word of the message that says how to go on: a file, its name, and a mapping.
ON: dict[str, tuple[str, str, str]] = {
    "masses:": ('<robot name="r"><link name="base"/></robot>', "r.urdf", ""),
    "balanceinertia": (SOUND.format(mass=20, izz=9), "r.urdf", ""),
    "ROS_PACKAGE_PATH": (
        XACRO.format('<xacro:include filename="$(find nowhere)/a.xacro"/>'),
        "r.urdf.xacro",
        "",
    ),
    "exchange them": (CROSSED, "r.sdf", ""),
    "xacro:": (
        XACRO.format('<xacro:property name="a" value="${unknown}"/><link name="${a}"/>'),
        "r.urdf.xacro",
        "",
    ),
}


@pytest.mark.parametrize("word", WAYS)
def test_each_word_of_a_way_on_is_in_a_message(tmp_path: Path, monkeypatch, word: str) -> None:
    text, name, added = ON[word]
    if name.endswith(".xacro"):
        pytest.importorskip("xacro")
    monkeypatch.setitem(public_files.VEHICLES, "rov", PublicVehicle("a/rov", (name,), added))
    (tmp_path / "rov").mkdir()
    (tmp_path / "rov" / name).write_text(text)
    row = public_files.public_files(PublicFileCase(name="rov", folder=tmp_path))
    assert isinstance(row, PublicFileRow)
    assert row.outcome == WAY
    assert [way for way in WAYS if way in row.refusal] == [word]
    assert row.seconds is not None


def test_a_name_that_is_none_is_refused(tmp_path: Path) -> None:
    experiment = public_files.public_files
    options = experiment.options_with({"folder": tmp_path, "names": ("rexrof",)})
    with pytest.raises(ConfigurationError, match=r"--names: allowed .*rexrof"):
        experiment.study(options)


@pytest.mark.parametrize(
    ("texts", "added", "outcome"),
    [
        ([SOUND.format(mass=20, izz=0.7)], "", READ),
        ([SOUND.format(mass=20, izz=0.7), SOUND.format(mass=20, izz=9)], "", WAY),
        (['<robot name="r"><link name="base"/></robot>'], "", WAY),
        (['<robot name="r"><link name="base"/></robot>'], "masses: {hull: 30}", ADDED),
        (["<robot"], "", REFUSED),
        ([], "", ABSENT),
    ],
)
def test_a_row_is_as_good_as_the_worst_of_its_files(
    tmp_path: Path, monkeypatch, texts, added, outcome
) -> None:
    files = tuple(f"urdf/{i}.urdf" for i in range(max(len(texts), 1)))
    vehicle = PublicVehicle("somebody/rov", files, added)
    monkeypatch.setitem(public_files.VEHICLES, "rov", vehicle)
    folder = tmp_path / "somebody+rov" / "urdf"
    folder.mkdir(parents=True)
    for name, text in zip(files, texts, strict=False):
        (folder.parent / name).write_text(text)
    row = public_files.public_files(PublicFileCase(name="rov", folder=tmp_path))
    assert isinstance(row, PublicFileRow)
    assert row.outcome == outcome
    assert (row.mass is not None) == (outcome in (READ, ADDED))
    assert (row.seconds is None) == (outcome == ABSENT)
