"""Soil under a tool as part of a model: MuJoCo's step applies it.

As in pile driving [Smith 1960], the soil yields elastically up to a quake and then flows. Once the
soil flows, the anchor, which is the force-free position of the tool, is dragged along. Along the
tool the resistances are those of pushing and pulling, across the tool that of sideways motion
(`uuv.models.site.soil`). The three resistances depend on the depth only, not on each other or on
speed. A tool that leaves the soil leaves a hole: at that position there is no force until the tool
has entered the soil elsewhere.

The parameters are stored in a custom numeric element. The state belongs to an actuator without
force at the face of the tool, whose dynamics are of MuJoCo's type "user". It is the anchor (3,) [m]
in W, and a flag that is 1 in the soil (`uuv.sim.native.soil_force`).
"""

from types import SimpleNamespace
from typing import Final

import mujoco
import numpy as np

from uuv.models.naming import TIP_SITE, TOOL_FACE_SITE
from uuv.models.site.seabed import Seabed
from uuv.models.site.soil import Soil, SoilTool, pull_resistance, push_resistance, side_resistance
from uuv.models.water.native_mark import mark
from uuv.models.water.thrusters import HEADER, STAMP
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array

NAME: Final = "soil"  # name of the element and the actuator
STAMP_VALUE: Final = 745540.0  # identifies the element and actuator of this module
INSIDE: Final = 3  # index of the flag in the state, after the anchor
STATE: Final = 4  # number of activations

_TABLE = 512  # number of depths at which the resistances are tabulated
_DEEPEST = 0.5  # [m] largest tabulated depth
_RESISTANCES = (push_resistance, pull_resistance, side_resistance)

# Index of each number in the element.
LAYOUT: Final = SimpleNamespace(
    stamp=0,
    nodes=1,  # k, number of nodes of the grid along each axis
    corner=2,  # (3,) [m] least x and y of the grid, and the height that counts as zero
    cell=5,  # [m] spacing of the nodes
    quake=6,  # [m] quake
    columns=7,  # N, number of tabulated resistances
    step=8,  # [m] depth between tabulated resistances
    # (k, k) heights [m] over `corner`, then (3, N) [N] resistances to pushing, pulling, sideways
    # motion
    data=9,
)


def pack(ground: Seabed, soil: Soil, tool: SoilTool) -> Array:
    """Numbers of the soil under `ground` on one tool, as in `LAYOUT`."""
    depth = np.linspace(0.0, _DEEPEST, _TABLE)
    bounds = np.stack([resist(soil, tool, depth) for resist in _RESISTANCES])

    # The edge of the tool meets resistance from depth zero on.
    bounds[0, 0] = soil.tip_factor * tool.edge * soil.cone

    corner = ground.center_W - [ground.half, ground.half, 0.0]
    header = STAMP_VALUE, len(ground.heights), *corner, ground.step, soil.quake, _TABLE, depth[1]
    return np.concatenate([header, ground.heights.ravel(), bounds.ravel()])


def attach(spec: mujoco.MjSpec, ground: Seabed, soil: Soil, tool: SoilTool) -> None:
    """Let the soil under `ground` act on the tool of the vehicle in `spec`, at its face.

    Args:
        spec: scene with one vehicle; changed in place.
        ground: true terrain.
        soil: its resistances.
        tool: the part of the tool that penetrates.

    Raises:
        ConfigurationError: the vehicle has no tool, or the scene already has soil.
    """
    sites = {site.name for site in spec.sites}
    face = TOOL_FACE_SITE if TOOL_FACE_SITE in sites else TIP_SITE
    if face not in sites:
        lacking = f"the vehicle has no site {TOOL_FACE_SITE!r} or {TIP_SITE!r}"
        raise ConfigurationError(f"soil: needs a tool to act on: {lacking}")
    if any(numeric.name == NAME for numeric in spec.numerics):
        raise ConfigurationError(f"the scene has a custom element {NAME!r} already")

    mark(spec)
    numbers = pack(ground, soil, tool)
    spec.add_numeric(name=NAME, data=numbers, size=len(numbers))

    state = spec.add_actuator(name=NAME, target=face, trntype=mujoco.mjtTrn.mjTRN_SITE)
    state.dyntype = mujoco.mjtDyn.mjDYN_USER
    state.actdim = STATE
    state.gainprm[0] = 0.0

    # The row is marked at the same index as that of a thruster, because the callbacks read the mark
    # there.
    row = np.zeros(HEADER)
    row[STAMP] = STAMP_VALUE
    state.userdata = row
    spec.nuser_actuator = max(spec.nuser_actuator, HEADER)


def actuator_of(model: mujoco.MjModel) -> int:
    """The actuator that holds the state of the soil in a compiled model, -1 without soil."""
    rows = np.asarray(model.actuator_user)
    if rows.shape[1] < HEADER:
        return -1
    marked = np.flatnonzero(rows[:, STAMP] == STAMP_VALUE)
    return int(marked[0]) if len(marked) else -1


def numbers_of(model: mujoco.MjModel) -> Array:
    """Parameters of the soil in a compiled model, as `pack` packs them; a live view."""
    numeric = model.numeric(NAME)
    first = int(model.numeric_adr[numeric.id])
    return model.numeric_data[first : first + int(model.numeric_size[numeric.id])]
