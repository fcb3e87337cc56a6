"""Native actuator force of thrusters: static curve and inflow inside MuJoCo's step, as the bias of the actuator.

The thrust is that of the propeller speed at the end of the step, as with MuJoCo's `actearly`: a thruster without lag
gives the thrust of its command at once. The inflow is the motion of the thruster's site through the water.

Numba compiles it to a bare C function, which MuJoCo calls without the GIL.
"""

from typing import Any

from numba import carray, types

from uuv.models.water.thruster_curves import thrust_in_flow
from uuv.models.water.thrusters import COUNT, HEADER, INFLOW_LOSS, SPEED, STAMP, STAMP_VALUE
from uuv.sim.interfaces.kernels import c_function
from uuv.sim.water import native_motion
from uuv.sim.water.mujoco_layout import offset
from uuv.sim.water.native_memory import f64, i32, numbers_at, pointer
from uuv.sim.water.vectors import cross, dot, load3, minus, plus, scaled

# Fields that the callback reads; their layout must be verified on live objects.
# fmt: off
_MODEL = (
    "nuser_actuator", "actuator_user", "actuator_actadr", "actuator_trnid", "actuator_gear", "site_bodyid",
    "body_rootid",
)
_DATA = ("act", "act_dot", "xpos", "cvel", "subtree_com", "site_xpos", "site_xmat")
MODEL_FIELDS = (*_MODEL, *native_motion.MODEL_FIELDS)
DATA_FIELDS = (*_DATA, *native_motion.DATA_FIELDS)
# fmt: on
SYMBOLS = ()


def build() -> Any:
    """Compile `mjcb_act_bias`: thrust [N] of a thruster. Zero for any other actuator of type user."""
    places = [offset("mjModel", name) for name in _MODEL]
    nuser_at, user_at, address_at, target_at, gear_at, body_at, root_at = places
    act_at, rate_at, xpos_at, cvel_at, com_at, site_xpos_at, site_xmat_at = (offset("mjData", name) for name in _DATA)
    timestep_at, motion = offset("mjModel", "opt.timestep"), native_motion.build_motion()

    @c_function(types.float64(types.intp, types.intp, types.int32), error_model="numpy")
    def force(m: int, d: int, i: int) -> float:
        nuser = pointer(m, nuser_at)
        row = pointer(m, user_at) + 8 * nuser * i
        if nuser < HEADER or f64(row, STAMP) != STAMP_VALUE:
            return 0.0
        at = i32(pointer(m, address_at), i) + SPEED
        speed = f64(pointer(d, act_at), at) + f64(m + timestep_at, 0) * f64(pointer(d, rate_at), at)
        loss, inflow = f64(row, INFLOW_LOSS), 0.0

        # Advance speed: motion of the site through the water, along the thrust.
        if loss > 0.0:
            site = i32(pointer(m, target_at), 2 * i)
            body = i32(pointer(m, body_at), site)
            root = i32(pointer(m, root_at), body)
            lever = minus(load3(pointer(d, site_xpos_at), 3 * site), load3(pointer(d, com_at), 3 * root))
            w_W, v_W = load3(pointer(d, cvel_at), 6 * body), load3(pointer(d, cvel_at), 6 * body + 3)
            wind_W, _, shear, _ = motion(m, d)
            current_W = plus(wind_W, scaled(f64(pointer(d, xpos_at), 3 * body + 2), shear))
            through_W = minus(plus(v_W, cross(w_W, lever)), current_W)
            axis, turn = load3(pointer(m, gear_at), 6 * i), pointer(d, site_xmat_at)
            for k in range(3):
                along = dot(load3(turn, 9 * site + 3 * k), axis)
                inflow += along * through_W[k]

        curve = carray(numbers_at(row + 8 * HEADER), (int(f64(row, COUNT)),))
        return thrust_in_flow(curve, loss, inflow, speed)

    return force
