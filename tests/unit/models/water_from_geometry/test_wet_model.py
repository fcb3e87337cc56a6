"""Models that get their water from geometry: which geoms count, what is written, what is refused in
one line.
"""

import json
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from untyped import untyped
from uuv import models
from uuv.models import hydrodynamics
from uuv.models.water_from_geometry import wetting
from uuv.models.water_from_geometry.files import read_model, write_model
from uuv.models.water_from_geometry.geoms import Choice, primitive
from uuv.models.water_from_geometry.wetting import wet
from uuv.own_vehicle import vehicle_spec
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, exp_so3, quat_wxyz_from_rotation
from wet_files import INERTIAL, urdf, write_stl

FAST = 800  # panels: at once as fine as need be
BOX = '<{0}><geometry><box size="0.4 0.1 0.1"/></geometry></{0}>'


def mjcf(geoms: str, joint: str = "<freejoint/>") -> str:
    return f'<mujoco><worldbody><body name="a">{joint}{geoms}</body></worldbody></mujoco>'


def spec_of(geoms: str) -> mujoco.MjSpec:
    return mujoco.MjSpec.from_string(mjcf(geoms))


@pytest.fixture
def capsule(tmp_path: Path) -> Path:
    return write_stl(tmp_path / "capsule.stl", *primitive("capsule", np.array([0.08, 0.15, 0.0])))


@pytest.mark.parametrize(
    ("geoms", "choice", "litres"),
    [
        # counted once
        ('<geom type="box" size=".1 .1 .1"/><geom type="box" size=".1 .1 .1"/>', "auto", 8.0),
        (
            '<geom type="box" size=".1 .1 .1"/><geom size=".05" contype="0" conaffinity="0"/>',
            "auto",
            np.pi / 6.0,
        ),
        (
            '<geom type="box" size=".1 .1 .1"/><geom size=".05" contype="0" conaffinity="0"/>',
            "collision",
            8.0,
        ),
        (
            '<geom type="box" size=".1 .1 .1"/><body pos=".2 0 0"><geom type="box" size=".1 .1 '
            '.1"/></body>',
            "auto",
            16.0,
        ),
    ],
)
def test_geoms_that_count(geoms, choice: Choice, litres):
    wetted = wet(spec_of(geoms), geoms=choice, panels=FAST)
    assert list(wetted.bodies) == ["a"]  # what is welded to a body is part of it
    assert 1e3 * wetted.bodies["a"].volume == pytest.approx(litres, rel=1e-6)
    assert hydrodynamics.attached(wetted.spec)["a"].volume == wetted.bodies["a"].volume


def test_every_number_says_where_it_is_from():
    wetted = wet(models.load("bluerov2_heavy_benzon2022"), panels=FAST)
    origins = {o.quantity: o for o in wetted.origins}
    assert list(origins) == ["volume", "centre of buoyancy", "added mass", "drag", "linear damping"]
    assert "3 visual geoms" in origins["volume"].origin
    assert re.search(r"\d+ panels", origins["added mass"].origin)
    assert "C_d" in origins["drag"].origin
    assert origins["drag"].uncertainty == "factor 2"
    assert origins["linear damping"].uncertainty == "unknown"


def test_closed_forms_are_those_of_hydrodynamics():
    wetted = wet(
        spec_of('<geom type="ellipsoid" size=".3 .1 .2" pos=".01 0 0"/>'),
        density=1000.0,
        panels=FAST,
    )
    expected = hydrodynamics.ellipsoid(
        [0.3, 0.1, 0.2], center=[0.01, 0.0, 0.0], water_density=1000.0
    )
    body = wetted.bodies["a"]
    assert body.volume == pytest.approx(expected.volume, rel=1e-12)
    np.testing.assert_allclose(body.added_mass, expected.added_mass, atol=1e-9)
    assert {o.uncertainty for o in wetted.origins if o.quantity in ("volume", "added mass")} == {
        "exact"
    }


def test_slender_and_distant_bodies_are_strips():
    slender = wet(
        spec_of('<geom type="capsule" size=".02" fromto="0 0 0 .5 0 0"/>'), panels=FAST
    ).bodies["a"]
    (strip,) = slender.segments
    np.testing.assert_allclose(np.sort([strip.start[0], strip.end[0]]), [-0.02, 0.52], atol=1e-3)
    assert strip.normal / (0.5 * 1025.0 * 0.04) == pytest.approx(0.83, abs=0.08)  # C_d of L/d 13
    assert not slender.quadratic_damping.any()
    assert wet(spec_of('<geom size=".1" pos=".2 0 0"/>'), panels=FAST).bodies["a"].segments
    assert not wet(spec_of('<geom size=".1"/>'), panels=FAST).bodies["a"].segments


def test_a_tube_too_thin_for_panels_is_its_hull():
    n = 48
    turn = 2.0 * np.pi * np.arange(n) / n
    area = 0.5 * n * np.sin(2.0 * np.pi / n) * (0.1**2 - 0.099**2)
    rings = [
        np.column_stack([r * np.cos(turn), r * np.sin(turn), np.full(n, z)])
        for r, z in ((0.1, -0.25), (0.1, 0.25), (0.099, 0.25), (0.099, -0.25))
    ]
    i, j = np.arange(n), (np.arange(n) + 1) % n
    faces = []
    for k in range(4):
        low, high = k * n, (k + 1) % 4 * n
        faces += [
            np.column_stack([low + i, low + j, high + j]),
            np.column_stack([low + i, high + j, high + i]),
        ]
    spec = mujoco.MjSpec()
    vertices, triangles = np.vstack(rings), np.vstack(faces)
    spec.add_mesh(
        name="tube",
        uservert=vertices.astype(np.float32).ravel(),
        userface=triangles.astype(np.int32).ravel(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )
    body = spec.worldbody.add_body(name="a")
    body.add_freejoint()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="tube", mass=1.0)
    wetted = wet(spec, panels=FAST)
    origin = next(o for o in wetted.origins if o.quantity == "added mass")
    assert "on the convex hull, since the body is too thin" in origin.origin
    assert origin.uncertainty == "factor 2"
    assert wetted.bodies["a"].volume == pytest.approx(0.5 * area, rel=1e-5)


TETRAHEDRON = np.array([[0.1, 0.0, 0.0], [0.4, 0.0, 0.0], [0.1, 0.2, 0.0], [0.1, 0.0, 0.12]])  # [m]
BESIDE = np.array([0.02, -0.3, 0.05])  # [m] mesh in its body
ASKEW = exp_so3([0.5, -0.4, 0.9])


def with_meshes(vertices: Array, triangles: Array, *places: Array) -> mujoco.MjSpec:
    """A body with a mesh, askew, at each of the `places` (3,) [m]."""
    spec = mujoco.MjSpec()
    spec.add_mesh(
        name="part",
        uservert=vertices.astype(np.float32).ravel(),
        userface=triangles.astype(np.int32).ravel(),
    )
    body = spec.worldbody.add_body(name="a")
    body.add_freejoint()
    for place in places:
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname="part",
            pos=place,
            quat=quat_wxyz_from_rotation(ASKEW),
            mass=1.0,
        )
    return spec


def test_a_mesh_is_borne_at_the_centre_of_its_volume():
    """A tetrahedron: a sixth of its box, and the mean of its corners."""
    triangles = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    water = wet(with_meshes(TETRAHEDRON, triangles, BESIDE), panels=FAST).bodies["a"]
    assert water.volume == pytest.approx(0.3 * 0.2 * 0.12 / 6.0, rel=1e-5)
    centre = ASKEW @ TETRAHEDRON.mean(axis=0) + BESIDE
    np.testing.assert_allclose(water.center_of_buoyancy, centre, atol=1e-6)


def test_meshes_that_overlap_are_borne_at_the_centre_of_their_union():
    """Two boxes along their own x that share half of each: one box, half as long again."""
    low, size = np.array([0.1, 0.05, -0.02]), np.array([0.2, 0.12, 0.16])
    vertices = low + size * np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    triangles = np.array([t for a, b, c, d in quads for t in ([a, b, c], [a, c, d])])
    shift = ASKEW @ [0.1, 0.0, 0.0]
    water = wet(with_meshes(vertices, triangles, BESIDE, BESIDE + shift), panels=FAST).bodies["a"]
    assert water.volume == pytest.approx(1.5 * size.prod(), rel=5e-3)
    centre = ASKEW @ (low + 0.5 * size) + BESIDE + 0.5 * shift
    np.testing.assert_allclose(water.center_of_buoyancy, centre, atol=5e-4)


def test_foam_makes_it_neutral():
    spec = spec_of('<geom type="box" size=".2 .15 .1" mass="30"/>')
    wetted = wet(spec, metacentric_height=0.03, panels=FAST)
    water = hydrodynamics.attached(spec)["a"]
    assert water.volume * 1025.0 == pytest.approx(30.0)
    np.testing.assert_allclose(water.center_of_buoyancy, [0.0, 0.0, 0.03], atol=1e-12)
    assert wetted.bodies["a"].volume == water.volume
    assert "5.268 l of foam added" in wetted.origins[0].origin


def test_what_stood_for_the_water_is_switched_off():
    spec = spec_of('<geom type="box" size=".2 .15 .1" mass="30"/>')
    spec.option.density, spec.option.viscosity, spec.body("a").gravcomp = 1025.0, 1e-3, 1.0
    wet(spec, panels=FAST)
    assert (spec.option.density, spec.option.viscosity, spec.body("a").gravcomp) == (0.0, 0.0, 0.0)


def test_visual_meshes_are_not_needed_for_collision_geoms(tmp_path: Path):
    file = tmp_path / "r.urdf"
    with_part, gone = (
        f'<visual><geometry><mesh filename="package://p/x.{e}"/></geometry></visual>'
        for e in ("osg", "stl")
    )
    file.write_text(urdf(with_part + gone + BOX.format("collision")))
    with pytest.raises(ConfigurationError, match=r"x.stl': there is no such file"):
        read_model(file)
    spec, notes = read_model(file, visual=False)
    assert notes[0].startswith("meshes left out, since they were not found or are none of .stl")
    assert notes[0].endswith(": x.osg, x.stl")
    assert 1e3 * wet(spec, geoms="collision", panels=FAST).bodies["arm"].volume == pytest.approx(
        4.0, rel=1e-5
    )


def test_links_of_a_urdf_that_are_welded_are_one(tmp_path: Path):
    file = tmp_path / "r.urdf"
    file.write_text(
        urdf(BOX.format("visual") + BOX.format("collision"), more=BOX.format("collision"))
    )
    spec, notes = read_model(file)
    assert not notes
    wetted = wet(spec, geoms="collision", panels=FAST)
    assert list(wetted.bodies) == ["arm"]
    # 4 l each, of which 1 l is shared
    assert 1e3 * wetted.bodies["arm"].volume == pytest.approx(7.0, rel=1e-5)
    assert wetted.bodies["arm"].center_of_buoyancy[0] == pytest.approx(0.15, abs=1e-6)
    assert wetted.dry == ("base: fixed to the world",)
    floating, _ = read_model(file, free=True)
    assert floating.compile().nq == 8


@pytest.mark.parametrize("with_sidecar", [False, True])
def test_what_is_written_is_read_to_the_bit(tmp_path: Path, capsule: Path, with_sidecar):
    package = tmp_path / "robot_description"
    (package / "meshes").mkdir(parents=True)
    (package / "urdf").mkdir()
    capsule.rename(package / "meshes" / "capsule.stl")
    shape = (
        "<visual><geometry><mesh "
        'filename="package://robot_description/meshes/capsule.stl"/></geometry></visual>'
    )
    osg = '<visual><geometry><mesh filename="x.osg"/></geometry></visual>'
    file = package / "urdf" / "r.urdf"
    file.write_text(urdf(shape + osg + BOX.format("collision")))
    spec, notes = read_model(file)
    assert len(notes) == 1
    assert notes[0].endswith(": x.osg")
    wetted = wet(spec, panels=FAST)
    (tmp_path / "out").mkdir()
    written = write_model(wetted, tmp_path / "out" / "r.wet.xml", with_sidecar=with_sidecar)
    assert len(written) == 1 + with_sidecar
    again = hydrodynamics.attached(vehicle_spec(written[0]))
    assert list(again) == ["arm"]
    for field in ("center_of_buoyancy", "added_mass", "quadratic_damping"):
        assert np.array_equal(getattr(again["arm"], field), getattr(wetted.bodies["arm"], field)), (
            field
        )
    assert again["arm"].volume == wetted.bodies["arm"].volume
    head = written[-1].read_text()[:400]
    assert "arm: volume 8.17" in head


# -- through the command ---------------------------------------------------------------------------


def test_the_command_writes_a_model_and_its_table(verb, capsule: Path, tmp_path: Path):
    run = verb("wet", capsule, "--panels", FAST, "--json")
    printed = json.loads(run.stdout)
    assert printed["files"] == [str(tmp_path / "capsule.wet.xml")]
    assert {o["quantity"] for o in printed["origins"]} >= {"volume", "added mass", "drag"}
    spec = vehicle_spec(tmp_path / "capsule.wet.xml")
    model = spec.compile()
    assert model.body("hull").mass[0] == pytest.approx(
        1025.0 * printed["water"]["bodies"]["capsule"]["volume"]
    )
    run = verb("wet", capsule, "--panels", FAST, "--out", tmp_path / "other.xml", "--sidecar")
    assert (run.returncode, (tmp_path / "other.water.yaml").is_file()) == (0, True)
    assert "one collision geom (1 closed shell)" in run.stdout


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        (
            "r.urdf",
            urdf(BOX.format("visual"), inertial="", tip=""),
            "each link that moves needs an <inertial>",
        ),
        (
            "r.urdf",
            urdf('<visual><geometry><mesh filename="package://p/none.stl"/></geometry></visual>'),
            "link 'arm': mesh 'package://p/none.stl': there is no such file",
        ),
        (
            "r.urdf",
            urdf('<collision><geometry><mesh filename="x.osg"/></geometry></collision>'),
            "link 'arm': mesh 'x.osg': must be of one of the formats .stl, .obj, .msh, .dae",
        ),
        (
            "r.urdf",
            urdf(
                '<visual><geometry><mesh filename="capsule.stl" scale="1e3 1e3 '
                '1e3"/></geometry></visual>'
            ),
            "must be at most 20 m across, got 460 m; if its mesh is in millimetres",
        ),
        (
            "r.urdf",
            urdf(""),
            "no moving body has geoms to displace water: base: fixed to the world; arm: no geom",
        ),
        ("r.urdf", "<robot", "no XML"),
        ("r.urdf", f'<robot name="r"><link name="base">{INERTIAL}</link></robot>', "no body moves"),
        ("m.xml", mjcf('<geom type="plane" size="1 1 1"/>'), "plane only allowed in static bodies"),
        (
            "m.xml",
            '<mujoco><asset><hfield name="h" nrow="4" ncol="4" size="1 1 1 1"/></asset>'
            + mjcf('<geom size=".1"/><geom name="g" type="hfield" hfield="h"/>').removeprefix(
                "<mujoco>"
            ),
            "body 'a': geom 'g': a height field has no volume",
        ),
        (
            "m.xml",
            '<mujoco><worldbody><geom size="1"/></worldbody></mujoco>',
            "no body moves, so none can have hydrodynamics",
        ),
        ("m.xml", "<mujoco", "MuJoCo cannot read this MJCF"),
        ("m.stl", "", "is empty"),
        ("none.stl", None, "there is no such file"),
    ],
)
def test_bad_input_is_one_line(verb, tmp_path: Path, name, content, said):
    write_stl(tmp_path / "capsule.stl", *primitive("capsule", np.array([0.08, 0.15, 0.0])))
    file = tmp_path / name
    if content is not None:
        file.write_text(content)
    run = verb("wet", file)
    assert run.returncode == 2
    assert said in run.stderr
    assert len(run.stderr.strip().splitlines()) == 1
    assert not list(tmp_path.glob("*.wet.xml"))


def test_a_flat_mesh_has_no_volume(verb, tmp_path: Path):
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    write_stl(tmp_path / "flat.stl", corners, np.array([[0, 1, 2], [0, 2, 3]]))
    (tmp_path / "r.urdf").write_text(
        urdf('<visual><geometry><mesh filename="flat.stl"/></geometry></visual>')
    )
    run = verb("wet", tmp_path / "r.urdf")
    assert run.returncode == 2
    assert "encloses no volume (1 flat surface left out)" in run.stderr


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--panels", "10"], "panels: expected a whole number from 400 to 6400, got 10"),
        (["--density", "-1"], "density [kg/m^3]"),
        (["--scale", "0"], "scale"),
        (["--free"], "free: for a URDF only"),
        (["--out", "nowhere/x.xml"], "there is no folder 'nowhere'"),
        (["--geoms", "some"], "geoms"),
        (["--geoms", "visual"], "no visual geom"),
    ],
)
def test_bad_options_are_one_line(verb, capsule: Path, options, said):
    run = verb("wet", capsule, *options)
    assert run.returncode == 2
    assert said in run.stderr


def test_bad_arguments_of_the_function():
    with pytest.raises(ConfigurationError, match="panels: expected a whole number"):
        wet(spec_of('<geom size=".1"/>'), panels=untyped(True))
    with pytest.raises(ConfigurationError, match="geoms: must be one of auto, visual"):
        wet(spec_of('<geom size=".1"/>'), geoms=untyped("some"))
    with pytest.raises(
        ConfigurationError,
        match="neutral: the model must have one floating body with water, got none",
    ):
        wet(
            mujoco.MjSpec.from_string(mjcf('<geom size=".1"/>', '<joint name="j"/>')),
            metacentric_height=0.1,
            panels=FAST,
        )


def test_bodies_of_one_shape_share_their_water_wherever_they_lie(monkeypatch: pytest.MonkeyPatch):
    """Forty alike stones cost as one; a turned geom is another shape."""
    geom = '<geom type="box" size=".1 .2 .07" euler="{2} 0 0"/>'
    stone = '<body name="{0}" pos="{1} 0.3 {1}" euler="{1} 20 3"><freejoint/>' + geom + "</body>"
    many = "".join(stone.format(f"s{k}", 0.37 * k, 0) for k in range(40)) + stone.format(
        "turned", 1.0, 30
    )
    done: list[str] = []
    original = wetting._body
    monkeypatch.setattr(
        wetting, "_body", lambda name, *rest: done.append(name) or original(name, *rest)
    )
    wetted = wet(
        mujoco.MjSpec.from_string(f"<mujoco><worldbody>{many}</worldbody></mujoco>"), panels=400
    )
    assert done == ["s0", "turned"]
    assert all(
        np.array_equal(wetted.bodies[f"s{k}"].added_mass, wetted.bodies["s0"].added_mass)
        for k in range(40)
    )
    assert not np.allclose(wetted.bodies["turned"].added_mass, wetted.bodies["s0"].added_mass)
    assert {o.body for o in wetted.origins} == {"turned", *(f"s{k}" for k in range(40))}
