"""Native look-up of the water's motion: that of a simulation in its data, else the default of its model."""

from typing import Any

from numba import njit

from uuv.models.hydrodynamics import LAYOUT
from uuv.sim.water.mujoco_layout import offset
from uuv.sim.water.native_memory import f64, pointer
from uuv.sim.water.vectors import load3
from uuv.sim.water.water_motion import FLOW

# Fields that it reads; their layout must be verified on live objects.
MODEL_FIELDS = ("nuser_body", "body_user", "nuserdata")
DATA_FIELDS = ("userdata",)


def build_motion() -> Any:
    """Compiled f(m, d) -> velocity [m/s] at z = 0, acceleration [m/s^2], shear [1/s], True; each a tuple of three in W.

    The last is False where the simulation's numbers are of an unknown kind: then the model's default holds.
    """
    nuser_at, user_at, nuserdata_at = (offset("mjModel", name) for name in MODEL_FIELDS)
    userdata_at, wind_at = offset("mjData", "userdata"), offset("mjModel", "opt.wind")
    stamp, size, surge_at, shear_at = LAYOUT.stamp_value, LAYOUT.size, LAYOUT.current_acceleration, LAYOUT.current_shear
    flow_at, flow_size, uniform, kind_at = LAYOUT.flow, FLOW.size, FLOW.uniform, FLOW.kind
    own_velocity_at, own_surge_at, own_shear_at = FLOW.velocity, FLOW.acceleration, FLOW.shear

    @njit(forceinline=True, error_model="numpy", fastmath={"contract"})
    def motion(m: int, d: int) -> Any:
        wind, surge, shear, known = load3(m + wind_at, 0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), True
        user = pointer(m, user_at)
        if pointer(m, nuser_at) < size or f64(user, 0) != stamp:  # as of a model from MJCF
            return wind, surge, shear, known
        surge, shear = load3(user, surge_at), load3(user, shear_at)

        # The current of this simulation, in place of the model's.
        place, reserved = int(f64(user, flow_at)) - 1, int(f64(user, flow_at + 1))
        if place >= 0 and reserved >= flow_size and place + reserved == pointer(m, nuserdata_at):
            row = pointer(d, userdata_at) + 8 * place
            kind = f64(row, kind_at)
            if kind == uniform:
                wind, surge, shear = load3(row, own_velocity_at), load3(row, own_surge_at), load3(row, own_shear_at)
            known = kind == uniform or kind == 0.0
        return wind, surge, shear, known

    return motion
