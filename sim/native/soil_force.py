"""Native force of the soil on a tool, from the parameters in the model and the state in its data.

The force depends on the pose of the tool and on the state at the start of the step. The passive
callback applies the force, and the actuator dynamics advance the state. Both evaluate the same
kernel at the same pose.
"""

from typing import Any

import numpy as np
from numba import njit
from numba.np.numpy_support import carray

from uuv.models.site import soil_bed
from uuv.models.site.soil_bed import INSIDE, STATE
from uuv.models.water.thrusters import HEADER, STAMP
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.native.mujoco_layout import offsets
from uuv.sim.native.native_memory import f64, i32, numbers_at, pointer, put
from uuv.sim.native.vectors import cross, dot, load3, minus, plus

# Fields that the callbacks use for the soil; their layout must be verified on live objects.
MODEL_FIELDS = (
    "nu",
    "nuser_actuator",
    "actuator_user",
    "actuator_actadr",
    "actuator_trnid",
    "site_bodyid",
    "body_rootid",
    "body_parentid",
    "body_dofnum",
    "body_dofadr",
    "nnumeric",
    "numeric_adr",
    "numeric_size",
    "numeric_data",
)
DATA_FIELDS = ("act", "act_dot", "site_xpos", "site_xmat", "subtree_com", "cdof", "qfrc_passive")

_NODES = soil_bed.LAYOUT.nodes
_CORNER = soil_bed.LAYOUT.corner
_CELL = soil_bed.LAYOUT.cell
_QUAKE = soil_bed.LAYOUT.quake
_COLUMNS = soil_bed.LAYOUT.columns
_STEP = soil_bed.LAYOUT.step
_FIRST = soil_bed.LAYOUT.data
_STAMP_VALUE = soil_bed.STAMP_VALUE


@kernel
def press(numbers, p, axis, state):
    """Force of the soil on the face of a tool, and the state that follows.

    Args:
        numbers: Parameters of the soil (`uuv.models.site.soil_bed`).
        p: (3,) [m] face of the tool, W.
        axis: (3,) unit axis out of the tool, W.
        state: (4,) anchor [m] in W, and 1 while the tool is in the soil.

    Returns:
        Force (3,) [N] in W, and the state (4,) after it.
    """
    force = np.zeros(3)
    after = np.zeros(STATE)
    depth = _height(numbers, p[0], p[1]) - p[2]
    if not depth > 0.0:  # also for NaN, outside the grid
        return force, after
    after[INSIDE] = 1.0
    anchor = p if state[INSIDE] < 0.5 else state
    quake = numbers[_QUAKE]

    # Resistances at this depth.
    step = numbers[_STEP]
    columns = int(numbers[_COLUMNS])
    nodes = int(numbers[_NODES])
    bounds = numbers[_FIRST + nodes * nodes :]
    i = min(int(depth / step), columns - 2)
    share = min(depth / step - i, 1.0)
    push = bounds[i] + share * (bounds[i + 1] - bounds[i])
    pull = bounds[columns + i] + share * (bounds[columns + i + 1] - bounds[columns + i])
    side = bounds[2 * columns + i] + share * (bounds[2 * columns + i + 1] - bounds[2 * columns + i])

    # Along the tool, with the same stiffness in both directions. Displacement beyond the quake
    # drags the anchor.
    along = 0.0
    for k in range(3):
        along += (p[k] - anchor[k]) * axis[k]
    least = -quake * pull / push if push > 0.0 else 0.0
    held = min(max(along, least), quake)

    # Across the tool.
    across = 0.0
    for k in range(3):
        across += (p[k] - anchor[k] - along * axis[k]) ** 2
    across = np.sqrt(across)
    fraction = min(1.0, quake / across) if across > 0.0 else 0.0
    for k in range(3):
        aside = fraction * (p[k] - anchor[k] - along * axis[k])
        force[k] = -(push * held * axis[k] + side * aside) / quake
        after[k] = p[k] - held * axis[k] - aside
    return force, after


@kernel
def _height(numbers, x, y):
    """Height at one point, as `Seabed.height` computes it; NaN outside the grid."""
    nodes = int(numbers[_NODES])
    last = nodes - 1
    u = (x - numbers[_CORNER]) / numbers[_CELL]
    v = (y - numbers[_CORNER + 1]) / numbers[_CELL]
    if not (0.0 <= u <= last and 0.0 <= v <= last):
        return np.nan
    i, j = min(int(u), last - 1), min(int(v), last - 1)
    u, v = u - i, v - j
    at = _FIRST + j * nodes + i
    a = numbers[at]
    b = numbers[at + 1]
    c = numbers[at + nodes + 1]
    d = numbers[at + nodes]
    z = a + u * (b - a) + v * (c - b) if v <= u else a + v * (d - a) + u * (c - d)
    return z + numbers[_CORNER + 2]


def build_state() -> Any:
    """Compiled f(m, d, i) -> force (3,), state (4,) after, of the soil of actuator `i`."""
    of_model = offsets("mjModel", *MODEL_FIELDS)
    of_data = offsets("mjData", *DATA_FIELDS)

    @njit(error_model="numpy")
    def state_of(m: int, d: int, i: int) -> Any:
        site = i32(pointer(m, of_model.actuator_trnid), 2 * i)
        p = carray(numbers_at(pointer(d, of_data.site_xpos) + 24 * site), (3,))
        turn = pointer(d, of_data.site_xmat) + 72 * site
        axis = np.array([f64(turn, 2), f64(turn, 5), f64(turn, 8)])
        first = i32(pointer(m, of_model.actuator_actadr), i)
        state = carray(numbers_at(pointer(d, of_data.act) + 8 * first), (STATE,))

        # The soil's parameters are in the custom element with its stamp.
        numeric = pointer(m, of_model.numeric_data)
        for n in range(pointer(m, of_model.nnumeric)):
            at = i32(pointer(m, of_model.numeric_adr), n)
            if f64(numeric, at) == _STAMP_VALUE:
                size = i32(pointer(m, of_model.numeric_size), n)
                return press(carray(numbers_at(numeric + 8 * at), (size,)), p, axis, state)
        return np.zeros(3), np.zeros(STATE)

    return state_of


def build_rates() -> Any:
    """Compiled f(m, d, i): write the rates of the state of actuator `i`."""
    state_of = build_state()
    of_model = offsets("mjModel", "actuator_actadr", "opt.timestep")
    of_data = offsets("mjData", "act", "act_dot")

    @njit(error_model="numpy")
    def rates(m: int, d: int, i: int) -> None:
        _, after = state_of(m, d, i)
        first = i32(pointer(m, of_model.actuator_actadr), i)
        act = pointer(d, of_data.act)
        act_dot = pointer(d, of_data.act_dot)
        for k in range(STATE):
            change = after[k] - f64(act, first + k)
            put(act_dot, first + k, change / f64(m + of_model.timestep, 0))

    return rates


def build_push() -> Any:
    """Compiled f(m, d): add the force of the soil, if a model has any, to `qfrc_passive`."""
    state_of = build_state()
    of_model = offsets("mjModel", *MODEL_FIELDS)
    of_data = offsets("mjData", *DATA_FIELDS)

    @njit(error_model="numpy")
    def push(m: int, d: int) -> None:
        nuser = pointer(m, of_model.nuser_actuator)
        if nuser < HEADER:
            return
        user = pointer(m, of_model.actuator_user)
        for i in range(pointer(m, of_model.nu)):
            if f64(user, nuser * i + STAMP) != _STAMP_VALUE:
                continue
            force, _ = state_of(m, d, i)
            f_W = force[0], force[1], force[2]

            # Moment arm of the force from the centre of mass to which `cdof` refers.
            site = i32(pointer(m, of_model.actuator_trnid), 2 * i)
            body = i32(pointer(m, of_model.site_bodyid), site)
            root = i32(pointer(m, of_model.body_rootid), body)
            center_W = load3(pointer(d, of_data.subtree_com), 3 * root)
            lever = minus(load3(pointer(d, of_data.site_xpos), 3 * site), center_W)

            # Virtual work of the force at each joint between tool and world.
            cdof = pointer(d, of_data.cdof)
            qfrc = pointer(d, of_data.qfrc_passive)
            while body > 0:
                first = i32(pointer(m, of_model.body_dofadr), body)
                for j in range(first, first + i32(pointer(m, of_model.body_dofnum), body)):
                    moved = plus(load3(cdof, 6 * j + 3), cross(load3(cdof, 6 * j), lever))
                    put(qfrc, j, f64(qfrc, j) + dot(moved, f_W))
                body = i32(pointer(m, of_model.body_parentid), body)

    return push
