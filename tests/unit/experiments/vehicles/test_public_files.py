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
    PublicFileCase,
    PublicFileRow,
    PublicVehicle,
)

SOUND = """<robot name="r"><link name="base"><inertial><mass value="{mass}"/>
  <inertia ixx=".5" iyy=".6" izz="{izz}" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""


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
