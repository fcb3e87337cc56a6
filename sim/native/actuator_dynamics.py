"""Native actuator dynamics: slew rate and lag of thrusters, and the state of the soil.

MuJoCo adds `act_dot` times the time step to the activations. The callback returns the rate that
leads to the exact response of the lag to a command that is constant during the step, so that the
lag may be shorter than the step. RK4 evaluates rates within the step; there, a lag longer than the
step gives the rate of its differential equation.

Numba compiles the callback to a bare C function, which MuJoCo calls without the GIL. It has no
state: the two activations of a thruster are in `data.act` (`uuv.models.water.thrusters`).
"""

import math
from typing import Any

import mujoco
from numba import types

from uuv.models.site import soil_bed
from uuv.models.water.thrusters import (
    HEADER,
    PASSED,
    SLEW_RATE,
    SPEED,
    STAMP,
    STAMP_VALUE,
    TIME_CONSTANT,
)
from uuv.sim.interfaces.kernels import c_function
from uuv.sim.native import soil_force
from uuv.sim.native.mujoco_layout import offsets
from uuv.sim.native.native_memory import f64, i32, pointer, put

# Fields that the callback reads or writes; their layout must be verified on live objects.
_MODEL = "nuser_actuator", "actuator_user", "actuator_actadr"
_DATA = "ctrl", "act", "act_dot"
MODEL_FIELDS = (*_MODEL, *soil_force.MODEL_FIELDS)
DATA_FIELDS = (*_DATA, *soil_force.DATA_FIELDS)
SYMBOLS = ()


def build() -> Any:
    """Compile `mjcb_act_dyn`: rates of activations of thrusters and soil, zero of others."""
    of_model = offsets("mjModel", *_MODEL, "opt.timestep", "opt.integrator")
    of_data = offsets("mjData", *_DATA)
    amid_steps = int(mujoco.mjtIntegrator.mjINT_RK4)

    advance_soil = soil_force.build_rates()
    of_soil = soil_bed.STAMP_VALUE

    @c_function(types.float64(types.intp, types.intp, types.int32), error_model="numpy")
    def dynamics(m: int, d: int, i: int) -> float:
        nuser = pointer(m, of_model.nuser_actuator)
        row = pointer(m, of_model.actuator_user) + 8 * nuser * i
        if nuser >= HEADER and f64(row, STAMP) == of_soil:
            advance_soil(m, d, i)
            return 0.0
        if nuser < HEADER or f64(row, STAMP) != STAMP_VALUE:
            return 0.0
        dt = f64(m + of_model.timestep, 0)
        lag = f64(row, TIME_CONSTANT)
        slew = f64(row, SLEW_RATE)
        first = i32(pointer(m, of_model.actuator_actadr), i)
        act = pointer(d, of_data.act)
        act_dot = pointer(d, of_data.act_dot)

        # The drive follows the command within its slew rate.
        command = min(max(f64(pointer(d, of_data.ctrl), i), -1.0), 1.0)
        passed = f64(act, first + PASSED)
        speed = f64(act, first + SPEED)
        if slew > 0.0:
            command = min(max(command, passed - slew * dt), passed + slew * dt)
        put(act_dot, first + PASSED, (command - passed) / dt)

        # The propeller follows the drive with its lag.
        if lag > dt and i32(m + of_model.integrator, 0) == amid_steps:
            put(act_dot, first + SPEED, (command - speed) / lag)
            return 0.0
        decay = math.exp(-dt / lag) if lag > 0.0 else 0.0
        put(act_dot, first + SPEED, (command + (speed - command) * decay - speed) / dt)
        return 0.0

    return dynamics
