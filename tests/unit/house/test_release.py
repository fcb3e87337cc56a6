"""What a tag of this version says of itself is one version, and the image's lines are true."""

import re
import tomllib

import yaml

from source_tree import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_the_version_is_everywhere_the_same():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == PROJECT["version"]
    assert citation["license"] == PROJECT["license"]
    assert citation["title"].startswith(PROJECT["name"])
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.findall(r"^## (\S+)", changelog, flags=re.MULTILINE)[0] == PROJECT["version"]


def test_the_image_installs_the_wheel_with_extras_that_there_are():
    image = (ROOT / "Dockerfile").read_text(encoding="utf-8")
    (extras,) = re.findall(r"\.whl\)\[([\w,]+)\]", image)
    assert set(extras.split(",")) <= set(PROJECT["optional-dependencies"])
    assert "COPY dist/uuv_arm-*.whl" in image
    assert re.search(r"docker run .* uuv-arm run clean-barrel --quick", image)


def test_one_command_builds_what_a_release_has():
    script = (ROOT / ".ci" / "wheel").read_text(encoding="utf-8")
    assert "uvw build" in script
    assert "bash .ci/wheel" in (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    assert "bash .ci/wheel" in (ROOT / ".ci" / "run").read_text(encoding="utf-8")
