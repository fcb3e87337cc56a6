"""Water without Python: sidecar and custom elements equal the Python API to the last bit, both
ways; their refusals.
"""

import errno
import re
import warnings
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import yaml

from uuv import models
from uuv.models import hydrodynamics
from uuv.models.files import sidecar
from uuv.models.hydrodynamics import BodyHydrodynamics, StripDrag
from uuv.models.water import thrusters
from uuv.models.water.forms import CrossTerms, FadingDamping, LiftDrag, MunkFactor, PlanarStrip
from uuv.models.water.thrusters import Thruster
from uuv.own_vehicle import vehicle_spec
from uuv.sim.interfaces.errors import ConfigurationError

BARE = """<mujoco><worldbody>
  <body name="hull"><freejoint/><geom type="box" size=".3 .2 .15" mass="30"/><site name="bow"/>
    <site name="stern"/>
    <body name="arm/link" pos=".3 0 0"><joint name="j"/><geom size=".05" mass="1"/></body>
  </body></worldbody>
  <actuator><motor name="bow" site="bow" gear="1 0 0 0 0 0"/>
    <motor name="stern" site="stern" gear="0 1 0 0 0 0"/>
  </actuator>{custom}</mujoco>"""
YAML = """
water_density: 1010.5
bodies:
  hull:
    volume: 0.03
    center_of_buoyancy: [0.01, 0, 0.1]
    added_mass: [15.1, 20, 25, 0.4, 0.8, 0.9]
    linear_damping: [1, 2, 3, 0.1, 0.2, 0.3]
    quadratic_damping: [30, 60, 80, 1, 2, 3.3]
    strips: [{start: [0, 0, 0], end: [0.3, 0, 0], normal: 3.1, stations: 5}]
  arm/link: {cylinder: {radius: 0.03, start: [0, 0, 0], end: [0.3, 0.1, 0]}}
thrusters:
  bow: {forward: 50, reverse: 40.5, time_constant: 0.1}
  stern: {t200: {handedness: -1}}
"""
ELEMENTS = {
    "water/water_density": "1010.5",
    "water/hull/volume": "0.03",
    "water/hull/center_of_buoyancy": "0.01 0 0.1",
    "water/hull/added_mass": "15.1 0 0 0 0 0  20 0 0 0 0  25 0 0 0  0.4 0 0  0.8 0  0.9",
    "water/hull/linear_damping": "1 2 3 0.1 0.2 0.3",
    "water/hull/quadratic_damping": "30 60 80 1 2 3.3",
    "water/hull/strips/0/start": "0 0 0",
    "water/hull/strips/0/end": "0.3 0 0",
    "water/hull/strips/0/normal": "3.1",
    "water/hull/strips/0/stations": "5",
    "water/arm/link/cylinder/radius": "0.03",
    "water/arm/link/cylinder/start": "0 0 0",
    "water/arm/link/cylinder/end": "0.3 0.1 0",
    "thruster/bow/forward": "50",
    "thruster/bow/reverse": "40.5",
    "thruster/bow/time_constant": "0.1",
    "thruster/stern/t200/handedness": "-1",
}


def mjcf(elements: dict[str, str]) -> str:
    lines = "".join(mjcf_line(name, data) for name, data in elements.items())
    return BARE.format(custom=f"<custom>{lines}</custom>")


def by_python() -> mujoco.MjSpec:
    spec = mujoco.MjSpec.from_string(BARE.format(custom=""))
    hull = BodyHydrodynamics(
        volume=0.03,
        center_of_buoyancy=np.array([0.01, 0.0, 0.1]),
        added_mass=np.diag([15.1, 20.0, 25.0, 0.4, 0.8, 0.9]),
        linear_damping=np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3]),
        quadratic_damping=np.array([30.0, 60.0, 80.0, 1.0, 2.0, 3.3]),
        strips=StripDrag(start=np.zeros(3), end=np.array([0.3, 0.0, 0.0]), normal=3.1, stations=5),
    )
    link = hydrodynamics.cylinder(0.03, [0.0, 0.0, 0.0], [0.3, 0.1, 0.0], water_density=1010.5)
    hydrodynamics.attach(spec, {"hull": hull, "arm/link": link}, 1010.5)
    thrusters.attach(
        spec,
        {"bow": Thruster(forward=50, reverse=40.5, time_constant=0.1), "stern": thrusters.t200(-1)},
    )
    return spec


def assert_same(found: mujoco.MjSpec, wanted: mujoco.MjSpec) -> None:
    """Rows and gears have the same bits, signs of zeros included."""
    pairs = [
        (found.worldbody.userdata, wanted.worldbody.userdata),
        *((found.body(b.name).userdata, b.userdata) for b in wanted.bodies[1:]),
        *((found.actuator(a.name).userdata, a.userdata) for a in wanted.actuators),
        *((found.actuator(a.name).gear, a.gear) for a in wanted.actuators),
    ]
    for here, returned in pairs:
        assert np.array(here).tobytes() == np.array(returned).tobytes()
    assert found.compile().body_user.shape == wanted.compile().body_user.shape


def test_a_sidecar_equals_python(tmp_path: Path) -> None:
    file = tmp_path / "rov.xml"
    file.write_text(BARE.format(custom=""))
    assert sidecar.beside(file) == tmp_path / "rov.water.yaml"
    sidecar.beside(file).write_text(YAML)
    assert_same(vehicle_spec(file), by_python())
    other = tmp_path / "named.yaml"
    sidecar.beside(file).rename(other)
    assert not hydrodynamics.attached(vehicle_spec(file))
    assert_same(vehicle_spec(file, water=other), by_python())


def test_elements_equal_python_and_are_taken_out(tmp_path: Path) -> None:
    file = tmp_path / "rov.xml"
    file.write_text(mjcf({"mine": "7", **ELEMENTS}))
    spec = vehicle_spec(file)
    assert_same(spec, by_python())
    assert [element.name for element in spec.numerics] == ["mine"]


def random_vehicle(rng: np.random.Generator) -> mujoco.MjSpec:
    """One with every field, in digits that six do not hold, with zeros of both signs, and with all
    kinds of curve.
    """
    spec = mujoco.MjSpec.from_string(BARE.format(custom=""))
    root = rng.normal(size=(6, 6))
    added = root @ root.T
    damping = root.T @ root + 0.1 * (rng.normal(size=(6, 6)) @ np.eye(6))
    strips = tuple(
        StripDrag(
            start=rng.normal(size=3),
            end=rng.normal(size=3),
            normal=float(rng.uniform(1, 2)),
            tangential=1e-7 / 3,
        )
        for _ in range(2)
    )
    skewed = 0.5 * (damping + damping.T) + 0.01 * (damping - damping.T)
    skewed += max(0.0, -float(np.linalg.eigvalsh(0.5 * (skewed + skewed.T))[0])) * np.eye(6)
    hull = BodyHydrodynamics(
        volume=float(rng.uniform()),
        center_of_buoyancy=np.array([-0.0, 1.0 / 3.0, 1e-300]),
        added_mass=added,
        linear_damping=skewed,
        quadratic_damping=rng.uniform(size=6),
        strips=strips,
        forms=(
            MunkFactor(factor=rng.uniform(size=3)),
            FadingDamping(linear=rng.uniform(size=6), rate=1.0 / 3.0),
            LiftDrag.of_wing(
                area=0.1 / 3.0, span=0.3, drag_0=0.1, stall=0.3, sweep=-2, point=rng.normal(size=3)
            ),
            LiftDrag(
                area=0.1,
                lift_slope=2.0,
                forward=np.array([1.0, 2.0, 0.0]),
                upward=np.array([-2.0, 1.0, 0.0]),
            ),
            CrossTerms.of_gz({"xUabsV": -1.0 / 3.0, "nUV": 0.1}),
            CrossTerms(terms=np.array([[0.0, 1.0, 2.0, 1.0, 1.0 / 7.0]])),
            PlanarStrip(
                start=rng.normal(size=3),
                end=np.zeros(3),
                direction=rng.normal(size=3),
                drag=2.0 / 3.0,
            ),
        ),
    )
    link = hydrodynamics.cylinder(
        float(rng.uniform(0.01, 0.1)), rng.normal(size=3), rng.normal(size=3)
    )
    hydrodynamics.attach(spec, {"hull": hull, "arm/link": link}, float(rng.uniform(990, 1030)))
    curves = [
        thrusters.t200(),
        Thruster.of_polynomial(
            [float(rng.uniform(10, 50))], [3.0, float(rng.uniform(10, 50))], slew_rate=1.0 / 3.0
        ),
    ]
    thrusters.attach(spec, dict(zip(("bow", "stern"), curves, strict=True)))
    return spec


def test_writing_keeps_every_bit(rng: np.random.Generator, tmp_path: Path) -> None:
    for _ in range(5):
        original = random_vehicle(rng)
        file = tmp_path / "rov.xml"
        file.write_text(sidecar.xml_without_water(original))
        sidecar.write_sidecar(original, sidecar.beside(file))
        assert_same(vehicle_spec(file), original)
        sidecar.beside(file).unlink()
        file.write_text(sidecar.xml_with_elements(original))
        assert_same(vehicle_spec(file), original)


@pytest.mark.parametrize("name", ["uuv_puma", "bluerov2_heavy_alpha5", "phoenix_smart3s"])
def test_stock_vehicles_survive_both_files(name: str, tmp_path: Path) -> None:
    """The rows of bodies and thrusters to the last bit, and the compiled masses and inertias
    too.
    """
    original = models.load(name)
    file = tmp_path / "rov.xml"
    for text in (sidecar.xml_with_elements(original), sidecar.xml_without_water(original)):
        file.write_text(text)
        if text.find("water/") < 0:
            sidecar.write_sidecar(original, sidecar.beside(file))
        read_back = vehicle_spec(file)
        assert_same(read_back, original)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("bodies: {hul: {volume: 1}}", r"unknown body 'hul' \(did you mean hull\?\)"),
        (
            "bodies: {hull: {volme: 1}}",
            r"\[bodies.hull\] has no 'volme'; .*\(did you mean "
            r"volume\?\)",
        ),
        ("bodies: {hull: {volume: [1, 2]}}", r"bodies.hull.volume: must be a number, got \[1, 2\]"),
        ("bodies: {hull: {volume: .nan}}", "bodies.hull.volume: must not be NaN"),
        (
            "bodies: {hull: {volume: 1, added_mass: [1, 2]}}",
            "added_mass: must be 6, 21 .* or 6 x 6 numbers",
        ),
        (
            "bodies: {hull: {volume: 1, added_mass: [a, b]}}",
            r"added_mass\[0\]: must be a number, "
            r"got 'a'",
        ),
        ("bodies: {hull: {volume: '1e-3'}}", "got '1e-3'; it is text: leave out the quotes"),
        ("bodies: {hull: {volume: true}}", "must be a number, got True"),
        (
            "bodies: {hull: {volume: 1, center_of_buoyancy: [1, 2]}}",
            r"center_of_buoyancy.*expected shape "
            r"\(3,\)",
        ),
        ("bodies: {hull: {linear_damping: [1, 1, 1, 1, 1, 1]}}", "volume or a shape .* is missing"),
        (
            "bodies: {hull: {box: {size: [1, 1, 1]}, sphere: {radius: 1}}}",
            "must have one shape, got box and sphere",
        ),
        (
            "bodies: {hull: {cylinder: {radius: 1, start: [0, 0, 0]}}}",
            r"cylinder\]: end is missing",
        ),
        (
            "bodies: {hull: {cylinder: {radus: 1}}}",
            r"cylinder\] has no 'radus'; .*\(did you mean "
            r"radius\?\)",
        ),
        (
            "bodies: {hull: {volume: 1, strips: [{start: [0, 0, 0]}]}}",
            r"strips\[0\]: end, normal are missing",
        ),
        (
            "bodies: {hull: {volume: 1, forms: [{munk: {}}]}}",
            r"forms\[0\] has no 'munk'; it has "
            r"munk_factor",
        ),
        (
            "bodies: {hull: {volume: 1, forms: [{lift_drag: {aera: 1}}]}}",
            r"lift_drag has no 'aera'; .*\(did you mean area\?\)",
        ),
        (
            "bodies: {hull: {volume: 1, forms: [{wing: {area: 1, span: 1}}]}}",
            "wing: drag_0 is missing",
        ),
        (
            "bodies: {hull: {volume: 1, forms: [{munk_factor: {factor: [0, 2, 0]}}]}}",
            "must be in 0 to 1",
        ),
        ("bodies: [hull]", r"bodies: must be a table, got \['hull'\]"),
        ("body: {}", r"the file has no 'body'; it has .*\(did you mean bodies\?\)"),
        ("water_density: wet", r"water_density \[kg/m\^3\]: must be a number, above 0"),
        ("water_density: -1\nbodies: {hull: {volume: 1}}", r"water_density .*must be above 0"),
        (
            "thrusters: {bou: {forward: 1, reverse: 1}}",
            r"unknown actuator 'bou' \(did you mean "
            r"bow\?\)",
        ),
        (
            "thrusters: {bow: {forwad: 1, reverse: 1}}",
            r"\[thrusters.bow\] has no 'forwad'; .*\(did you mean forward\?\)",
        ),
        (
            "thrusters: {bow: {forward: -1, reverse: 1}}",
            "thrusters.bow: thruster forward and reverse",
        ),
        ("thrusters: {bow: {t200: {}, forward: 1}}", "t200 must be the only key"),
        (
            "thrusters: {bow: {of_table: {command: [-1, 0, 1], thrust: [-1, 0, 1], forward: 1}}}",
            "thrusters.bow.of_table: thruster forward: must be left out, since the curve "
            "determines it",
        ),
        (
            "bodies: {hull: {volume: 1, forms: [{wing: {area: 0.1, span: 1e-320, drag_0: 0.1}}]}}",
            r"forms\[0\].wing: wing span \[m\]: must be at least 1e-15, got 1e-320",
        ),
        (
            "thrusters: {bow: {of_polynomial: {ahead: [1e300, 1]}}}",
            r"polynomial: must not exceed 1e\+15",
        ),
        ("bodies: {hull: {volume: 1}}\nbodies: {}", "the key 'bodies' occurs twice in one table"),
        ("bodies: {hull: {volume: 1, volume: 2}}", "the key 'volume' occurs twice in one table"),
        (
            "bodies: {hull: {volume: 1, strips: {start: [0, 0, 0], end: [1, 0, 0], normal: 1, "
            "stations: 2.5}}}",
            "strips.stations: must be a whole number, at least 1 and at most 8, got 2.5",
        ),
        (
            "bodies: {hull: {volume: 1, forms: [{}]}}",
            r"forms\[0\]: must be one of munk_factor, "
            r".*, got \[\]",
        ),
        (
            "thrusters: {bow: {forward: 1, reverse: 1, table: 4}}",
            r"thrusters.bow.table: must be two rows of numbers, got \[\[4\]\]",
        ),
        ("bodies: {hull: {volume: [", "cannot be read .*at line 2"),
        ("[1, 2]", r"the file: must be a table, got \[1, 2\]"),
    ],
)
def test_a_wrong_sidecar_is_one_clear_line(text: str, said: str, tmp_path: Path) -> None:
    file = tmp_path / "rov.xml"
    file.write_text(BARE.format(custom=""))
    sidecar.beside(file).write_text(text)
    with pytest.raises(ConfigurationError, match=said) as caught:
        vehicle_spec(file)
    assert "rov.water.yaml" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("elements", "said"),
    [
        ({"water/hul/volume": "1"}, r"no body 'hul' .*\(did you mean hull\?\)"),
        ({"water/hull": "1"}, "no body 'hull' with a field behind it"),
        ({"water/hull/volme": "1"}, r"\[water.hull\] has no 'volme'; .*\(did you mean volume\?\)"),
        ({"water/hull/volume": "nan"}, "'water/hull/volume': must not be NaN"),
        ({"water/hull/volume": "1", "water/hull/added_mass": "1 2"}, "added_mass: must be 6, 21"),
        (
            {"water/hull/volume": "1", "water/hull/volume/0": "1"},
            "'volume' is a number in another element",
        ),
        ({"water/hull/volume/0": "1", "water/hull/volume": "1"}, "stated twice"),
        ({"thruster/bou/forward": "1"}, r"no actuator 'bou'"),
    ],
)
def test_wrong_elements_are_one_clear_line(
    elements: dict[str, str], said: str, tmp_path: Path
) -> None:
    file = tmp_path / "rov.xml"
    file.write_text(mjcf(elements))
    with pytest.raises(ConfigurationError, match=said):
        vehicle_spec(file)


def test_a_row_of_one_number_is_a_row(tmp_path: Path) -> None:
    """A custom element of one number cannot say that it is a row."""
    elements = {"thruster/bow/forward": "20"}
    elements |= {
        "thruster/bow/reverse": "10",
        "thruster/bow/polynomial/0": "20",
        "thruster/bow/polynomial/1": "10",
    }
    elements |= {
        "thruster/stern/of_polynomial/ahead": "20",
        "thruster/stern/of_polynomial/astern": "4 6 1e-300",
    }
    file = tmp_path / "rov.xml"
    file.write_text(mjcf(elements))
    spec = vehicle_spec(file)
    bow, stern = (
        thrusters.unpack(np.array(spec.actuator(name).userdata)) for name in ("bow", "stern")
    )
    assert (bow.polynomial, stern.polynomial) == (((20.0,), (10.0,)), ((20.0,), (4.0, 6.0, 1e-300)))


def test_water_stated_twice_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "rov.xml"
    file.write_text(mjcf(ELEMENTS))
    sidecar.beside(file).write_text("bodies: {hull: {volume: 0.03}}")
    with pytest.raises(ConfigurationError, match="bodies hull are also stated by custom elements"):
        vehicle_spec(file)
    sidecar.beside(file).write_text("water_density: 1000")
    with pytest.raises(
        ConfigurationError, match="water_density is also stated by a custom element"
    ):
        vehicle_spec(file)
    file.write_text(by_python().to_xml())
    sidecar.beside(file).write_text("bodies: {hull: {volume: 0.03}}")
    with pytest.raises(
        ConfigurationError, match="'hull' has hydrodynamic data already, in user data"
    ):
        vehicle_spec(file)
    sidecar.beside(file).write_text("thrusters: {bow: {forward: 1, reverse: 1}}")
    with pytest.raises(ConfigurationError, match="'bow' has a table already"):
        vehicle_spec(file)
    with pytest.raises(ConfigurationError, match="has its own water"):
        vehicle_spec("uuv_puma", water=file)


def test_the_page_shows_a_sidecar_that_can_be_read(root: Path) -> None:
    """The one in docs/own_vehicle.md, on a vehicle with the names that it has."""
    page = (root / "docs" / "own_vehicle.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```yaml\n(.*?)^```", page, flags=re.M | re.S)
    (text,) = [block for block in blocks if "water_density" in block]
    xml = BARE.format(custom="").replace("arm/link", "link1")
    spec = mujoco.MjSpec.from_string(xml)
    sidecar.attach_tree(spec, yaml.safe_load(text), "page")
    assert set(hydrodynamics.attached(spec)) == {"hull", "link1"}
    assert all(thrusters.carries(np.array(actuator.userdata)) for actuator in spec.actuators)
    for name, data in re.findall(r'<numeric name="(.*?)" data="(.*?)"/>', page):
        element = mujoco.MjSpec.from_string(
            xml.replace("</mujoco>", f"<custom>{mjcf_line(name, data)}</custom></mujoco>")
        )
        assert sidecar.elements_of(element)


def mjcf_line(name: str, data: str) -> str:
    return f'<numeric name="{name}" data="{data}"/>'


def test_a_bomb_of_aliases_is_refused(tmp_path: Path) -> None:
    """Nine levels of nine aliases would be 4e8 numbers."""
    lines = ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 9)]
    file = tmp_path / "rov.xml"
    file.write_text(BARE.format(custom=""))
    sidecar.beside(file).write_text("bodies: {hull: {volume: {" + ", ".join(lines) + "}}}")
    with pytest.raises(ConfigurationError, match="aliases unfold to more than"):
        vehicle_spec(file)
    sidecar.beside(file).write_text("\n".join([*lines, "bodies: {hull: {volume: *a8}}"]))
    with pytest.raises(ConfigurationError, match="aliases unfold to more than"):
        vehicle_spec(file)


BAD = (
    None,
    True,
    "x",
    "1e-3",
    float("nan"),
    float("inf"),
    -1.0,
    0,
    10**400,
    1e300,
    [],
    {},
    [[]],
    [1, "a"],
    [[1, 2], [3]],
    {"a": 1},
    [None],
    {1: 2},
    "\x00",
    [1.0] * 600,
)


def spoilt(tree: Any, rng: np.random.Generator) -> Any:
    """`tree` with one place, at any depth, replaced by something bad, renamed, or taken away."""
    if not isinstance(tree, dict | list) or not tree or rng.uniform() < 0.15:
        return BAD[int(rng.integers(len(BAD)))]
    keys = list(tree) if isinstance(tree, dict) else list(range(len(tree)))
    key: Any = keys[int(rng.integers(len(keys)))]
    copied: Any = tree.copy()
    if isinstance(tree, dict) and rng.uniform() < 0.1:
        copied[f"{key}x"] = copied.pop(key)
    elif rng.uniform() < 0.1:
        del copied[key]
    else:
        copied[key] = spoilt(tree[key], rng)
    return copied


def test_whatever_is_spoilt_is_refused_or_read(rng: np.random.Generator) -> None:
    """No other error, and no number that is not finite."""
    original = random_vehicle(rng)
    refused = 0
    tree = sidecar.tree_of(original)
    for _ in range(150):
        spec = mujoco.MjSpec.from_string(BARE.format(custom=""))
        bad = spoilt(tree, rng)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                sidecar.attach_tree(spec, sidecar.checked_tree(bad, "file"), "file")
        except ConfigurationError:
            refused += 1
            continue
        rows = [np.array(body.userdata) for body in spec.bodies] + [
            np.array(actuator.userdata) for actuator in spec.actuators
        ]
        assert all(np.all(np.isfinite(row)) for row in rows)
    assert 75 < refused < 150


def test_a_water_file_that_cannot_be_written_whole_leaves_the_old_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = models.load("bluerov2_heavy")
    file = sidecar.write_sidecar(spec, tmp_path / "rov.water.yaml")
    before = file.read_text()
    write = Path.write_text

    def full(path: Path, text: str, **more: Any) -> int:
        write(path, text[: len(text) // 2], **more)
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(ConfigurationError, match=r"cannot be written \(No space left"):
        sidecar.write_sidecar(spec, file)
    assert file.read_text() == before
    assert [path.name for path in tmp_path.iterdir()] == [file.name]
