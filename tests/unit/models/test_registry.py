"""Names of things: ours, aliases, and what other packages add by entry points."""

import re
from pathlib import Path

import pytest

from uuv.kinds import SENSORS
from uuv.models import VEHICLES, describe
from uuv.models.registry import Registry
from uuv.models.site.soil import SOILS
from uuv.models.tools.tools import TOOLS
from uuv.sim.interfaces.errors import ConfigurationError

BOXES = Registry("box", {"small": lambda size=1: size, "large": lambda: 10}, {"big": "large"})


@pytest.fixture
def boxes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Registry[int]:
    """BOXES, in an environment with a package that adds some of its own."""
    (tmp_path / "far_away.py").write_text(
        "huge = lambda size=100: size\nnumber = 3\n\ndef broken():\n    raise OSError('no disk')\n"
    )
    about = tmp_path / "far_away-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: far-away\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(
        "[uuv_arm.box]\nhuge = far_away:huge\nsmall = far_away:huge\nbroken = far_away:broken\n"
        "number = far_away:number\nlost = far_away:nothing\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    return Registry("box", {"small": lambda size=1: size, "large": lambda: 10}, {"big": "large"})


def test_ours_by_name_and_alias():
    assert BOXES.names() == ("big", "large", "small")
    assert (BOXES.load("small", size=3), BOXES.load("big"), BOXES.resolve("big")) == (
        3,
        10,
        "large",
    )
    assert "small" in BOXES
    assert 3 not in BOXES


def test_what_is_copied_is_made_once_for_the_same_options_and_each_copy_is_ones_own():
    made: list[int] = []

    def maker(size: int = 1) -> list[int]:
        made.append(size)
        return [size]

    registry = Registry("box", {"box": maker}, copied=lambda box: box.copy())
    first = registry.load("box")
    first.append(7)
    assert (registry.load("box"), registry.load("box", size=2)) == ([1], [2])
    assert (registry.load("box", size=2), made) == ([2], [1, 2])


@pytest.mark.parametrize("name", VEHICLES._built_in)
def test_a_vehicle_is_the_one_that_its_maker_makes_whatever_was_done_to_another(name: str):
    changed = VEHICLES.load(name)
    changed.bodies[1].mass = 7.0
    changed.delete(changed.bodies[-1])
    (content, made) = (spec.to_xml() for spec in (VEHICLES.load(name), VEHICLES.maker(name)()))
    assert content == made


def test_another_packages(boxes):
    assert boxes.names() == ("big", "broken", "huge", "large", "lost", "number", "small")
    assert (boxes.load("huge"), boxes.load("huge", size=7)) == (100, 7)
    assert boxes.load("small") == 1  # ours comes first


@pytest.mark.parametrize("name", ["tiny", 3, None, "x" * 1000])
def test_a_name_that_is_none(name):
    with pytest.raises(ConfigurationError, match=r"unknown box .* there are big, large, small"):
        BOXES.load(name)


def test_an_option_that_is_none():
    with pytest.raises(
        ConfigurationError,
        match=r"box 'small' has no \['colour'\]; it has "
        r"\['size'\]",
    ):
        BOXES.load("small", colour="red")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("broken", "box 'broken': OSError: no disk"),
        ("lost", "box 'lost' of far-away: cannot import far_away:nothing; AttributeError"),
        ("number", "box 'number' of far-away: far_away:number must be callable"),
    ],
)
def test_what_goes_wrong_in_another_package_is_told_with_its_name(boxes, name, said):
    with pytest.raises(ConfigurationError, match=said):
        boxes.load(name)


@pytest.mark.parametrize(
    ("registry", "form"),
    [
        (TOOLS, "a Head, Jaws, Gripper, HandleSocket, Tube or Box of uuv.models.tools"),
        (SOILS, "a uuv.models.site.soil.Soil"),
        (VEHICLES, "a mujoco.MjSpec"),
        (SENSORS, "a sensor and its uuv.perception.SensorModel or None"),
    ],
    ids=lambda value: getattr(value, "kind", ""),
)
def test_what_a_users_function_returns_is_checked(registry, form, tmp_path, monkeypatch):
    (tmp_path / "returns_anything.py").write_text("def thing(*given):\n    return {}\n")
    monkeypatch.syspath_prepend(tmp_path)
    message = f"{registry.kind} 'returns_anything:thing': must return {form}, got dict"
    with pytest.raises(ConfigurationError, match=re.escape(message)):
        registry.load("returns_anything:thing")


def test_a_vehicle_shows_itself_as_a_card():
    about = describe("bluerov2_heavy")
    card = about._repr_html_()
    assert f"{about.mass:.1f}" in card
    assert f"{1e3 * about.volume:.1f}" in card
    assert about.source in card
