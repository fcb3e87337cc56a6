"""docs/licences.md lists every dependency of the package and its extras, with the licence that its
metadata states.
"""

import re
import tomllib
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
PAGE = ROOT / "docs" / "licences.md"
NEEDED = "always"  # brings what needs no extra
PHRASES = {  # of a licence's text, and its SPDX identifier; the first that is found counts
    "license agreement for matplotlib": "matplotlib",
    "lgplv3": "LGPL-3.0",
    "apache license": "Apache-2.0",
    "apache 2.0": "Apache-2.0",
    "neither the name": "BSD-3-Clause",
    "redistribution and use in source and binary forms": "BSD-2-Clause",
    "permission is hereby granted, free of charge": "MIT",
    "mit": "MIT",
}


UNSTATED = {"mcap": "MIT"}  # its wheel states none: the licence of its repository, foxglove/mcap


def table() -> dict[str, tuple[str, str]]:
    """Licence, and what brings it, of each package of the page."""
    rows = re.findall(
        r"^\| \[([\w-]+)\]\(\S+\) \| (.+?) \| (.+?) \|$",
        PAGE.read_text(encoding="utf-8"),
        flags=re.M,
    )
    return {name: (licence, brought_by) for name, licence, brought_by in rows}


def required() -> dict[str, str]:
    """What brings each package that pyproject.toml names: its extras, or NEEDED."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    brought: dict[str, list[str]] = {}
    for extra, lines in {
        NEEDED: project["dependencies"],
        **project["optional-dependencies"],
    }.items():
        for line in lines:
            name = re.split(r"[^\w-]", line)[0]
            if name != project["name"] and extra not in brought.setdefault(name, []):
                brought[name].append(extra)
    return {
        name: NEEDED if NEEDED in extras else ", ".join(extras) for name, extras in brought.items()
    }


def licence_of(package: Distribution) -> str:
    """SPDX expression of a package: its own, or that of its licence's text."""
    stated = package.metadata
    if "License-Expression" in stated:
        return stated["License-Expression"]
    if package.name in UNSTATED:
        return UNSTATED[package.name]
    own = [
        file
        for file in package.files or []
        if re.match(r"(licen[cs]e|copying)(\.|$)", file.name, flags=re.I)
    ]
    texts = [file.read_text() for file in own if ".dist-info" in str(file)][:1]
    text = " ".join((*texts, *(stated.get_all("License") or ()))).lower()
    return next(licence for phrase, licence in PHRASES.items() if phrase in " ".join(text.split()))


def locked() -> dict[str, str]:
    """Version of each package in uv.lock."""
    return {
        each["name"]: each["version"]
        for each in tomllib.loads((ROOT / "uv.lock").read_text())["package"]
    }


def test_every_dependency_is_listed_with_what_brings_it():
    assert {name: brought_by for name, (_, brought_by) in table().items()} == required()


def test_every_data_file_has_a_row():
    rows = PAGE.read_text(encoding="utf-8").partition("## Data")[2]
    places = re.findall(r"`([\w./-]+)`", rows)
    assert all((ROOT / place).exists() for place in places if "/" in place)

    kinds = {".csv", ".json", ".npz", ".npy", ".parquet", ".stl", ".pcd", ".ply", ".gz", ".BIN"}
    folders = (ROOT / name for name in ("docs", "models", "scripts", "sim", "uuv", "calib"))
    data = [file for folder in folders for file in folder.rglob("*") if file.suffix in kinds]
    own = re.compile(r"/schemas/|first_start\.json$")
    for file in data:
        name = file.relative_to(ROOT).as_posix()
        assert own.search(name) or any(name.startswith(place) for place in places), name
    assert len(data) > 20


def test_licences_are_those_that_packages_state():
    stated, versions, compared = table(), locked(), 0
    for name in required():
        try:
            package = distribution(name)
        except PackageNotFoundError:  # of an extra, or of another platform
            continue
        if package.version == versions[name]:
            assert stated[name][0] == licence_of(package), name
            compared += 1
    if not compared:
        pytest.skip("no package here has the version of uv.lock")


@pytest.mark.parametrize(
    ("text", "licence"),
    [
        (
            "Redistribution and use in source\nand binary forms, ... Neither the name of",
            "BSD-3-Clause",
        ),
        ("Redistribution and use in source\nand binary forms, ...", "BSD-2-Clause"),
        ("Permission is hereby granted,\nfree of charge, to any person", "MIT"),
    ],
)
def test_a_licence_is_known_by_its_text(tmp_path, text: str, licence: str):
    folder = tmp_path / "thing-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: thing\nVersion: 1.0\n")
    (folder / "LICENSE.txt").write_text(text)
    (folder / "RECORD").write_text(
        "thing-1.0.dist-info/METADATA,,\nthing-1.0.dist-info/LICENSE.txt,,\n"
    )
    assert licence_of(Distribution.at(folder)) == licence
