"""Native actuator force of thrusters: static curve and inflow, as the bias of the actuator.

The thrust belongs to the propeller speed at the end of the step, as with MuJoCo's `actearly`. A
thruster without lag therefore gives the thrust of its command at once. The inflow is the motion of
the thruster's site relative to the water.

Numba compiles the callback to a bare C function, which MuJoCo calls without the GIL.
"""

from typing import Any

from numba import types
from numba.np.numpy_support import carray

from uuv.models.water.thruster_curves import thrust_in_flow
from uuv.models.water.thrusters import COUNT, HEADER, INFLOW_LOSS, SPEED, STAMP, STAMP_VALUE
from uuv.sim.interfaces.kernels import c_function
from uuv.sim.native import native_motion
from uuv.sim.native.mujoco_layout import offsets
from uuv.sim.native.native_memory import f64, i32, numbers_at, pointer
from uuv.sim.native.vectors import cross, dot, load3, minus, plus, scaled

# Fields that the callback reads; their layout must be verified on live objects.
_MODEL = (
    "nuser_actuator",
    "actuator_user",
    "actuator_actadr",
    "actuator_trnid",
    "actuator_gear",
    "site_bodyid",
    "body_rootid",
)
_DATA = ("act", "act_dot", "xpos", "cvel", "subtree_com", "site_xpos", "site_xmat")
MODEL_FIELDS = (*_MODEL, *native_motion.MODEL_FIELDS)
DATA_FIELDS = (*_DATA, *native_motion.DATA_FIELDS)
SYMBOLS = ()


def build() -> Any:
    """Compile `mjcb_act_bias`: thrust [N] of a thruster, zero of any other actuator."""
    of_model = offsets("mjModel", *_MODEL, "opt.timestep")
    of_data = offsets("mjData", *_DATA)
    motion = native_motion.build_motion()

    @c_function(types.float64(types.intp, types.intp, types.int32), error_model="numpy")
    def force(m: int, d: int, i: int) -> float:
        nuser = pointer(m, of_model.nuser_actuator)
        row = pointer(m, of_model.actuator_user) + 8 * nuser * i
        if nuser < HEADER or f64(row, STAMP) != STAMP_VALUE:
            return 0.0
        at = i32(pointer(m, of_model.actuator_actadr), i) + SPEED
        rate = f64(pointer(d, of_data.act_dot), at)
        speed = f64(pointer(d, of_data.act), at) + f64(m + of_model.timestep, 0) * rate
        loss = f64(row, INFLOW_LOSS)
        inflow = 0.0

        # Advance speed: motion of the site relative to the water, along the thrust.
        if loss > 0.0:
            site = i32(pointer(m, of_model.actuator_trnid), 2 * i)
            body = i32(pointer(m, of_model.site_bodyid), site)
            root = i32(pointer(m, of_model.body_rootid), body)
            center_W = load3(pointer(d, of_data.subtree_com), 3 * root)
            lever = minus(load3(pointer(d, of_data.site_xpos), 3 * site), center_W)
            w_W = load3(pointer(d, of_data.cvel), 6 * body)
            v_W = load3(pointer(d, of_data.cvel), 6 * body + 3)
            wind_W, _, shear, _ = motion(m, d)
            current_W = plus(wind_W, scaled(f64(pointer(d, of_data.xpos), 3 * body + 2), shear))
            through_W = minus(plus(v_W, cross(w_W, lever)), current_W)
            axis = load3(pointer(m, of_model.actuator_gear), 6 * i)
            turn = pointer(d, of_data.site_xmat)
            for k in range(3):
                along = dot(load3(turn, 9 * site + 3 * k), axis)
                inflow += along * through_W[k]

        curve = carray(numbers_at(row + 8 * HEADER), (int(f64(row, COUNT)),))
        return thrust_in_flow(curve, loss, inflow, speed)

    return force
