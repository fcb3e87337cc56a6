"""Native look-up of the motion of the water, from the simulation or, if it has none, from the
model.
"""

from collections import namedtuple
from typing import Any

from numba import njit

from uuv.models.hydrodynamics import LAYOUT
from uuv.sim.native.mujoco_layout import offsets
from uuv.sim.native.native_memory import f64, pointer
from uuv.sim.native.vectors import load3
from uuv.sim.water.water_motion import FLOW

# Fields that this look-up reads; their layout must be verified on live objects.
MODEL_FIELDS = ("nuser_body", "body_user", "nuserdata")
DATA_FIELDS = ("userdata",)


def build_motion() -> Any:
    """Compiled f(m, d) -> velocity at z = 0, acceleration, shear, three numbers each, and True.

    The last value is False if the simulation's numbers are of an unknown kind; the result is then
    the model's default.
    """
    of_model = offsets("mjModel", *MODEL_FIELDS, "opt.wind")
    of_data = offsets("mjData", *DATA_FIELDS)
    row_of_world = namedtuple("Row", vars(LAYOUT))(**vars(LAYOUT))
    in_data = namedtuple("InData", vars(FLOW))(**vars(FLOW))

    @njit(forceinline=True, error_model="numpy", fastmath={"contract"})
    def motion(m: int, d: int) -> Any:
        wind = load3(m + of_model.wind, 0)
        surge = shear = (0.0, 0.0, 0.0)
        known = True
        user = pointer(m, of_model.body_user)
        is_row = pointer(m, of_model.nuser_body) >= row_of_world.size
        if not is_row or f64(user, 0) != row_of_world.stamp_value:  # value for a model from MJCF
            return wind, surge, shear, known
        surge = load3(user, row_of_world.current_acceleration)
        shear = load3(user, row_of_world.current_shear)

        # The current of this simulation replaces the model's.
        first = int(f64(user, row_of_world.flow)) - 1
        reserved = int(f64(user, row_of_world.flow + 1))
        ends = first + reserved == pointer(m, of_model.nuserdata)
        if first >= 0 and reserved >= in_data.size and ends:
            row = pointer(d, of_data.userdata) + 8 * first
            kind = f64(row, in_data.kind)
            if kind == in_data.uniform:
                wind = load3(row, in_data.velocity)
                surge = load3(row, in_data.acceleration)
                shear = load3(row, in_data.shear)
            known = kind == in_data.uniform or kind == 0.0
        return wind, surge, shear, known

    return motion
