"""What docs/own_vehicle.md says of mapping, tools and a URDF arm on a BlueROV2 is so."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuv.models.files.parts_file import read_parts
from uuv.models.tools.tools import TOOLS


def blocks(root: Path, kind: str) -> list[str]:
    """Fenced blocks of the page."""
    page = (root / "docs" / "own_vehicle.md").read_text(encoding="utf-8")
    return re.findall(rf"^```{kind}\n(.*?)^```", page, flags=re.M | re.S)


def test_the_mapping_of_the_page_is_read(root: Path, tmp_path: Path) -> None:
    text = next(block for block in blocks(root, "yaml") if "arm_base" in block)
    (tmp_path / "rov.parts.yaml").write_text(text, encoding="utf-8")
    parts = read_parts(tmp_path / "rov.parts.yaml")
    assert parts.hull == "base_link"
    assert dict(parts.torque_limits or {}) == {
        "turn": 10.0,
        "lift": 10.0,
        "elbow": 10.0,
        "roll": 2.0,
    }
    assert [part.thruster.forward for part in parts.thrusters] == pytest.approx([51.44, 50.0])


def test_the_urdf_arm_of_the_page_hovers(
    root: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.chdir(root)
    code = next(block for block in blocks(root, "python") if "mount_arm" in block)
    names: dict[str, Any] = {}
    exec(compile(code, "own_vehicle.md", "exec"), names)
    assert "keyframe home: not in the file" in capsys.readouterr().out
    check = names["check"]
    assert all(verdict.promised for verdict in check.jobs)
    assert not [finding for finding in check.findings if finding.level == "fault"]
    assert names["links"] == [
        "arm_base",
        "arm_shoulder",
        "arm_upper_arm",
        "arm_forearm",
        "arm_wrist",
    ]


def test_the_tools_of_the_page_are_those_that_there_are(root: Path) -> None:
    page = (root / "docs" / "own_tool.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \| [^|]*? \| (\d+) \| ([\d.]+) \| (\d+) \|$", page, flags=re.M)
    assert sorted(name for name, *_ in rows) == list(TOOLS.names())
    for name, length, mass, force in rows:
        contact = TOOLS.load(name).contact
        np.testing.assert_allclose(
            [float(length), float(mass), float(force)],
            [1e3 * contact.length, contact.mass, contact.most_force],
        )
