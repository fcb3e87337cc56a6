"""Soil resistance against its closed form, and the soil's force on a tool that is led through
it.
"""

from itertools import pairwise

import numpy as np
import pytest

from led_tool import LedTool
from uuv.models.site.seabed import KINDS, Seabed, seabed
from uuv.models.site.soil import (
    SOILS,
    Soil,
    SoilTool,
    box,
    core_tube,
    cutting_factor,
    depth_for,
    mud,
    pull_resistance,
    push_resistance,
    rankine,
    sand,
    side_resistance,
)
from uuv.sim.interfaces.errors import ConfigurationError

TUBE = core_tube(0.018, 0.002)
DOWN = np.array([0.0, 0.0, -1.0])
FLAT = Seabed(
    kind="flat",
    heights=np.zeros((41, 41)),
    half=1.0,
    center_W=np.array([0.3, -0.2, -5.0]),
    rocks=np.zeros((0, 3)),
)


@pytest.mark.parametrize("soil", [*map(SOILS.load, SOILS.names())], ids=SOILS.names())
def test_resistance_is_the_integral_of_the_cone_resistance(within, soil):
    d = 0.13
    z = np.linspace(0.0, d, 20_001)
    cone = soil.cone + soil.cone_growth * z
    friction = soil.side_factor * TUBE.skin * np.trapezoid(cone, z)
    within("pull [N]", pull_resistance(soil, TUBE, d) - friction, 1e-9)
    within(
        "push [N]",
        push_resistance(soil, TUBE, d) - friction - soil.tip_factor * TUBE.edge * cone[-1],
        1e-9,
    )
    pressure = (soil.passive + soil.passive_growth * z) * TUBE.breadth * soil.narrow
    within("side [N]", side_resistance(soil, TUBE, d) - np.trapezoid(pressure, z), 1e-9)
    assert push_resistance(soil, TUBE, 0.0) == pull_resistance(soil, TUBE, -0.1) == 0.0


@pytest.mark.parametrize("push", [10.0, 60.0, 140.0])
@pytest.mark.parametrize("soil", [*map(SOILS.load, SOILS.names()), mud(growth=0.0)])
def test_depth_for_a_push_bears_it(within, soil, push):
    depth = depth_for(soil, TUBE, push)
    assert depth > 0.0
    within("push [N]", push_resistance(soil, TUBE, depth) - push, 1e-9 * push)


def test_figures_of_a_tube(within):
    """Outer and inner diameter 36 and 32 mm."""
    within("edge [m^2]", TUBE.edge - 0.25 * np.pi * (0.036**2 - 0.032**2), 1e-15)
    within("skin [m]", TUBE.skin - np.pi * (0.036 + 0.032), 1e-15)


def test_figures_of_a_box(within):
    """80 x 60 mm outside, 77 x 57 mm inside."""
    tool = box(0.08, 0.06, 0.0015, rake=1.2)
    within("edge [m^2]", tool.edge - (0.08 * 0.06 - 0.077 * 0.057), 1e-15)
    within("skin [m]", tool.skin - 2.0 * (0.08 + 0.06 + 0.077 + 0.057), 1e-15)


@pytest.mark.parametrize("degrees", [20.0, 32.0, 40.0])
def test_a_smooth_upright_blade_bears_rankines_pressure(within, degrees):
    smooth = Soil(
        cone=0.0,
        cone_growth=1e6,
        tip_factor=0.3,
        side_factor=0.0,
        passive=0.0,
        passive_growth=1e4,
        narrow=3.0,
        friction=float(np.radians(degrees)),
    )
    # the steps of the slip angle
    within("of Rankine's in sand", cutting_factor(smooth, 0.5 * np.pi) - 1.0, 1e-5)
    within("of Rankine's in clay", cutting_factor(mud(), 0.5 * np.pi) - 1.0, 1e-5)
    within(
        "K_p",
        rankine(smooth.friction) - (1 + np.sin(smooth.friction)) / (1 - np.sin(smooth.friction)),
        1e-12,
    )


@pytest.mark.parametrize("rake", [0.6, 1.2, 0.5 * np.pi])
def test_the_wedge_before_a_blade_is_in_equilibrium(within, rake):
    """Forces on the wedge at many slip angles solved as a plane triangle: blade, failure plane and
    weight.
    """
    soil = sand()
    phi, delta = soil.friction, soil.wall_friction
    level = []
    for b in np.linspace(0.02, 1.0, 4000):
        # Level and upwards: of the blade's force P, delta off its normal, and the plane's R, phi
        # off its own.
        A = np.array(
            [[np.sin(rake + delta), -np.sin(b + phi)], [np.cos(rake + delta), np.cos(b + phi)]]
        )
        P, R = np.linalg.solve(A, [0.0, 0.5 / np.tan(rake) + 0.5 / np.tan(b)])
        if P > 0.0 and R > 0.0:
            level.append(P * np.sin(rake + delta))
    within("level force", cutting_factor(soil, rake) - min(level) / (0.5 * rankine(phi)), 1e-5)


def lead(force: LedTool, way: np.ndarray, axis=DOWN) -> np.ndarray:
    """Forces (N, 3) [N] on a tool led along `way` (N, 3) [m]."""
    return np.array([force.step(p, axis).copy() for p in way])


def straight(start, end, steps=4000) -> np.ndarray:
    return np.linspace(start, end, steps)


def at(depth: float, x: float = 0.3) -> np.ndarray:
    return np.array([x, -0.2, -5.0 - depth])


@pytest.mark.parametrize("soil", [*map(SOILS.load, SOILS.names())], ids=SOILS.names())
def test_a_tool_pushed_in_and_drawn_out_feels_the_resistances(within, soil):
    force = LedTool(FLAT, soil, TUBE)
    down = lead(force, straight(at(-0.02), at(0.1)))
    depth = np.linspace(-0.02, 0.1, len(down))
    deep = depth > 2.0 * soil.quake
    within("above [N]", down[depth <= 0.0], 0.0)
    # the table's steps
    within("in [N]", down[deep, 2] - push_resistance(soil, TUBE, depth[deep]), 5e-3)
    within("aside [N]", down[:, :2], 1e-12)
    up = lead(force, straight(at(0.1), at(-0.02)))
    rising = np.linspace(0.1, -0.02, len(up))
    drawn = (rising < 0.1 - 2.0 * soil.quake) & (rising > 0.0)
    within("out [N]", -up[drawn, 2] - pull_resistance(soil, TUBE, rising[drawn]), 5e-3)
    within("free again [N]", up[rising < 0.0], 0.0)


def test_within_the_quake_it_is_a_spring(within):
    soil = sand()
    force = LedTool(FLAT, soil, TUBE)
    lead(force, straight(at(-0.01), at(0.08)))
    # some way back, but not sliding yet
    lead(force, straight(at(0.08), at(0.08 - 1.05 * soil.quake)))
    here = at(0.08 - 1.05 * soil.quake)
    deeper = here - [0.0, 0.0, 0.2 * soil.quake]
    first = lead(force, straight(here, deeper))[-1]
    back = lead(force, straight(deeper, here))[-1]
    again = lead(force, straight(here, deeper))[-1]
    within("returns [N]", again - first, 1e-2)
    slope = (back - again)[2] / (deeper - here)[2]
    within("N/m, relative", slope * soil.quake / push_resistance(soil, TUBE, 0.079) - 1.0, 0.02)


def test_a_tool_dragged_sideways(within):
    soil = mud()
    blade = SoilTool(edge=3e-4, skin=0.2, breadth=0.1, rake=0.5 * np.pi)
    force = LedTool(FLAT, soil, blade)
    lead(force, straight(at(-0.01), at(0.03)))
    dragged = lead(force, straight(at(0.03), at(0.03, 0.6)))
    within("against the motion [N]", dragged[-1, 0] + side_resistance(soil, blade, 0.03), 1e-2)
    within("across it [N]", dragged[:, 1], 1e-9)
    turned = lead(force, straight(at(0.03, 0.6), at(0.03, 0.6) + np.array([0.0, 0.1, 0.0])))
    within("then the other way [N]", turned[-1, 1] + side_resistance(soil, blade, 0.03), 1e-2)


def test_it_never_gives_work_back():
    """Round any closed way the tool loses energy."""
    rng = np.random.default_rng(3)
    soil = sand()
    for _ in range(5):
        force = LedTool(FLAT, soil, TUBE)
        corners = np.array(
            [at(-0.01), *(at(0.05) + rng.uniform(-0.03, 0.03, 3) for _ in range(6)), at(-0.01)]
        )
        way = np.concatenate([straight(a, b, 3000) for a, b in pairwise(corners)])
        axis = DOWN + rng.uniform(-0.2, 0.2, 3)
        f = lead(force, way, axis / np.linalg.norm(axis))
        assert np.sum(0.5 * (f[1:] + f[:-1]) * np.diff(way, axis=0)) < -0.1


@pytest.mark.parametrize("kind", KINDS)
def test_the_surface_is_that_of_the_terrain(within, kind):
    """Just above it there is no force, just below it there is."""
    ground = seabed(kind, np.random.default_rng(2), center_W=(1.0, 2.0, -8.0), half=1.0)
    rng = np.random.default_rng(4)
    xy = ground.center_W[:2] + rng.uniform(-0.99, 0.99, (200, 2))
    force = LedTool(ground, mud(), TUBE)
    for x, y, z in np.column_stack([xy, ground.height(xy)]):
        force.reset()
        within("above", force.step(np.array([x, y, z + 1e-9]), DOWN), 0.0)
        force.step(np.array([x, y, z - 1e-9]), DOWN)
        assert force.step(np.array([x, y, z - 1e-4]), DOWN)[2] > 0.0
    within(
        "beside the terrain", force.step(ground.center_W + np.array([1.01, 0.0, -5.0]), DOWN), 0.0
    )


def test_what_cannot_be_is_refused():
    with pytest.raises(ConfigurationError, match="wall must be above 0 and below radius"):
        core_tube(0.018, 0.02)
    with pytest.raises(ConfigurationError, match="breadth must be > 0"):
        SoilTool(edge=1e-4, skin=0.1, breadth=0.0)
    with pytest.raises(ConfigurationError, match="rake must lie in"):
        box(0.08, 0.06, 0.0015, rake=2.0)
    with pytest.raises(ConfigurationError, match="below half of width and length"):
        box(0.08, 0.06, 0.04, rake=1.0)
    with pytest.raises(
        ConfigurationError, match="soil cone_growth: must be finite and >= 0, got nan"
    ):
        sand(growth=float("nan"))
    with pytest.raises(ConfigurationError, match="quake"):
        Soil(
            cone=0.0,
            cone_growth=1e6,
            tip_factor=0.3,
            side_factor=0.0,
            passive=0.0,
            passive_growth=0.0,
            narrow=1.0,
            quake=0.0,
        )


@pytest.mark.parametrize(
    ("rake", "ok"), [(None, True), (1.2, True), (0.5 * np.pi, True), (0.0, False), (1.6, False)]
)
def test_a_blade_leans_or_stands(rake, ok):
    if ok:
        assert SoilTool(edge=1e-4, skin=0.1, breadth=0.05, rake=rake).rake == rake
        return
    with pytest.raises(ConfigurationError, match="rake must lie in"):
        SoilTool(edge=1e-4, skin=0.1, breadth=0.05, rake=rake)


@pytest.mark.parametrize("name", ["edge", "skin", "breadth"])
def test_a_tool_in_soil_has_a_size(name):
    with pytest.raises(ConfigurationError, match="edge, skin and breadth"):
        SoilTool(**({"edge": 1e-4, "skin": 0.1, "breadth": 0.05} | {name: 0.0}))
