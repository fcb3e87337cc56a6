"""Native force of the soil on a tool: inside MuJoCo's step, from the numbers and the state in the model.

The force depends on the place of the tool and on the state, which is that at the start of the step. So the passive
callback, which applies it, and the actuator dynamics, which advance the state, evaluate one kernel at one place.
"""

from typing import Any

import numpy as np
from numba import carray, njit

from uuv.models.site import soil_bed
from uuv.models.site.soil_bed import INSIDE, STATE
from uuv.models.water.thrusters import HEADER, STAMP
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.water.mujoco_layout import offset
from uuv.sim.water.native_memory import f64, i32, numbers_at, pointer, put
from uuv.sim.water.vectors import cross, dot, load3, minus, plus

# Fields that the callbacks reach for the soil; their layout must be verified on live objects.
# fmt: off
MODEL_FIELDS = (
    "nu", "nuser_actuator", "actuator_user", "actuator_actadr", "actuator_trnid", "site_bodyid", "body_rootid",
    "body_parentid", "body_dofnum", "body_dofadr", "nnumeric", "numeric_adr", "numeric_size", "numeric_data",
)
DATA_FIELDS = ("act", "act_dot", "site_xpos", "site_xmat", "subtree_com", "cdof", "qfrc_passive")
# fmt: on

_NODES, _CORNER, _CELL, _QUAKE = (getattr(soil_bed.LAYOUT, name) for name in ("nodes", "corner", "cell", "quake"))
_COLUMNS, _STEP, _FIRST = (getattr(soil_bed.LAYOUT, name) for name in ("columns", "step", "data"))
_STAMP_VALUE = soil_bed.STAMP_VALUE


@kernel
def press(numbers, p, axis, state):
    """Force of the soil on the face of a tool, and the state that follows.

    Args:
        numbers: of the soil (`uuv.models.site.soil_bed`).
        p: (3,) [m] face of the tool, W.
        axis: (3,) unit axis out of the tool, W.
        state: (4,) anchor [m] in W, and 1 in the soil.

    Returns:
        Force (3,) [N] in W, and the state (4,) after it.
    """
    force, after = np.zeros(3), np.zeros(STATE)
    depth = _height(numbers, p[0], p[1]) - p[2]
    if not depth > 0.0:  # also NaN, outside the grid
        return force, after
    after[INSIDE] = 1.0
    anchor = p if state[INSIDE] < 0.5 else state
    quake, step, columns = numbers[_QUAKE], numbers[_STEP], int(numbers[_COLUMNS])

    # Resistances at this depth.
    nodes = int(numbers[_NODES])
    bounds = numbers[_FIRST + nodes * nodes :]
    i = min(int(depth / step), columns - 2)
    share = min(depth / step - i, 1.0)
    push = bounds[i] + share * (bounds[i + 1] - bounds[i])
    pull = bounds[columns + i] + share * (bounds[columns + i + 1] - bounds[columns + i])
    side = bounds[2 * columns + i] + share * (bounds[2 * columns + i + 1] - bounds[2 * columns + i])

    # Along the tool, with the same stiffness in both directions; what exceeds the quake drags the anchor.
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
    kept = min(1.0, quake / across) if across > 0.0 else 0.0
    for k in range(3):
        aside = kept * (p[k] - anchor[k] - along * axis[k])
        force[k] = -(push * held * axis[k] + side * aside) / quake
        after[k] = p[k] - held * axis[k] - aside
    return force, after


@kernel
def _height(numbers, x, y):
    """Height at one point, as `uuv.models.site.seabed.Seabed.height` computes it; NaN outside the grid."""
    nodes = int(numbers[_NODES])
    last = nodes - 1
    u, v = (x - numbers[_CORNER]) / numbers[_CELL], (y - numbers[_CORNER + 1]) / numbers[_CELL]
    if not (0.0 <= u <= last and 0.0 <= v <= last):
        return np.nan
    i, j = min(int(u), last - 1), min(int(v), last - 1)
    u, v = u - i, v - j
    at = _FIRST + j * nodes + i
    a, b = numbers[at], numbers[at + 1]
    c, d = numbers[at + nodes + 1], numbers[at + nodes]
    z = a + u * (b - a) + v * (c - b) if v <= u else a + v * (d - a) + u * (c - d)
    return z + numbers[_CORNER + 2]


def build_state() -> Any:
    """Compiled f(m, d, i) -> force (3,), state (4,) after: the soil of actuator `i` of raw MuJoCo objects."""
    address_at, target_at = offset("mjModel", "actuator_actadr"), offset("mjModel", "actuator_trnid")
    count_at, first_at = offset("mjModel", "nnumeric"), offset("mjModel", "numeric_adr")
    size_at, data_at = offset("mjModel", "numeric_size"), offset("mjModel", "numeric_data")
    act_at, place_at, turn_at = offset("mjData", "act"), offset("mjData", "site_xpos"), offset("mjData", "site_xmat")

    @njit(error_model="numpy")
    def state_of(m: int, d: int, i: int) -> Any:
        site = i32(pointer(m, target_at), 2 * i)
        p = carray(numbers_at(pointer(d, place_at) + 24 * site), (3,))
        turn = pointer(d, turn_at)
        axis = np.array([f64(turn, 9 * site + 2), f64(turn, 9 * site + 5), f64(turn, 9 * site + 8)])
        state = carray(numbers_at(pointer(d, act_at) + 8 * i32(pointer(m, address_at), i)), (STATE,))

        # The soil's numbers are those of the custom element with its stamp.
        numeric = pointer(m, data_at)
        for n in range(pointer(m, count_at)):
            first = i32(pointer(m, first_at), n)
            if f64(numeric, first) == _STAMP_VALUE:
                size = i32(pointer(m, size_at), n)
                return press(carray(numbers_at(numeric + 8 * first), (size,)), p, axis, state)
        return np.zeros(3), np.zeros(STATE)

    return state_of


def build_rates() -> Any:
    """Compiled f(m, d, i): write the rates of the state of actuator `i`."""
    state_of = build_state()
    address_at, timestep_at = offset("mjModel", "actuator_actadr"), offset("mjModel", "opt.timestep")
    act_at, rate_at = offset("mjData", "act"), offset("mjData", "act_dot")

    @njit(error_model="numpy")
    def rates(m: int, d: int, i: int) -> None:
        _, after = state_of(m, d, i)
        first, dt = i32(pointer(m, address_at), i), f64(m + timestep_at, 0)
        act, act_dot = pointer(d, act_at), pointer(d, rate_at)
        for k in range(STATE):
            put(act_dot, first + k, (after[k] - f64(act, first + k)) / dt)

    return rates


def build_push() -> Any:
    """Compiled f(m, d): add the force of the soil, if a model has any, to `qfrc_passive`."""
    state_of = build_state()
    of_actuators = "nu", "nuser_actuator", "actuator_user", "actuator_trnid"
    nu_at, nuser_at, user_at, target_at = (offset("mjModel", name) for name in of_actuators)
    of_bodies = "site_bodyid", "body_rootid", "body_parentid", "body_dofnum", "body_dofadr"
    body_at, root_at, parent_at, dofnum_at, dofadr_at = (offset("mjModel", name) for name in of_bodies)
    of_data = "site_xpos", "subtree_com", "cdof", "qfrc_passive"
    place_at, com_at, cdof_at, passive_at = (offset("mjData", name) for name in of_data)

    @njit(error_model="numpy")
    def push(m: int, d: int) -> None:
        nuser, user = pointer(m, nuser_at), pointer(m, user_at)
        if nuser < HEADER:
            return
        for i in range(pointer(m, nu_at)):
            if f64(user, nuser * i + STAMP) != _STAMP_VALUE:
                continue
            force, _ = state_of(m, d, i)
            f_W = force[0], force[1], force[2]
            site = i32(pointer(m, target_at), 2 * i)
            body = i32(pointer(m, body_at), site)
            com = load3(pointer(d, com_at), 3 * i32(pointer(m, root_at), body))
            lever = minus(load3(pointer(d, place_at), 3 * site), com)
            cdof, qfrc = pointer(d, cdof_at), pointer(d, passive_at)
            while body > 0:
                first = i32(pointer(m, dofadr_at), body)
                for j in range(first, first + i32(pointer(m, dofnum_at), body)):
                    s_w, s_v = load3(cdof, 6 * j), load3(cdof, 6 * j + 3)
                    put(qfrc, j, f64(qfrc, j) + dot(plus(s_v, cross(s_w, lever)), f_W))
                body = i32(pointer(m, parent_at), body)

    return push
