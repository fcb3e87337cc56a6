"""Gear friction inside MuJoCo's step: bounds of its friction constraints by Stribeck's curve.

MuJoCo makes the constraints before it calls the passive callback and solves them after it, within
one forward pass. The bound therefore belongs to the joint speed at the same time, and the model
does not change. The curves are rows of `jnt_user` (`uuv.models.arms.gear_friction`).
"""

import math
from collections.abc import Callable
from typing import Any

import mujoco
from numba import njit

from uuv.models.arms.gear_friction import ROUNDED, ROW, STAMP
from uuv.sim.native.mujoco_layout import offset
from uuv.sim.native.native_memory import f64, i32, pointer, put

# Fields that the kernel reads or writes; their layout must be verified on live objects.
MODEL_FIELDS = ("nuser_jnt", "jnt_user", "dof_jntid", "dof_frictionloss")
DATA_FIELDS = ("ne", "nf", "nisland", "qvel", "efc_type", "efc_id", "efc_frictionloss")
ISLAND_FIELDS = ("map_efc2iefc", "iefc_frictionloss")


# A kernel inherits `fastmath` from its caller unless it has its own; here no multiply and add may
# be fused.
@njit(error_model="numpy", fastmath=False)
def stribeck(coulomb: float, stiction: float, over: float, speed: float) -> float:
    """Greatest dry friction [N m] at `speed` [rad/s]."""
    share = math.exp(-((speed / over) ** 2))
    return coulomb + (stiction - coulomb) * share


def build() -> Callable[[int, int], Any]:
    """Kernel f(mjModel*, mjData*) that sets the bounds for the running MuJoCo.

    It returns True if the model has a curve on any of the friction constraints.
    """
    width_at = offset("mjModel", "nuser_jnt")
    rows_at = offset("mjModel", "jnt_user")
    joint_at = offset("mjModel", "dof_jntid")
    loss_at = offset("mjModel", "dof_frictionloss")
    qvel_at = offset("mjData", "qvel")

    # Constraints: equalities come first, then friction.
    ne_at = offset("mjData", "ne")
    nf_at = offset("mjData", "nf")
    kind_at = offset("mjData", "efc_type")
    id_at = offset("mjData", "efc_id")
    bound_at = offset("mjData", "efc_frictionloss")
    of_dof = int(mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF)

    # The same for the constraints of islands, which MuJoCo has copied before.
    islands_at = offset("mjData", "nisland")
    map_at = offset("mjData", "map_efc2iefc")
    island_bound_at = offset("mjData", "iefc_frictionloss")

    @njit(error_model="numpy", fastmath=False)
    def set_bounds(m: int, d: int) -> bool:
        width = pointer(m, width_at)
        if width < ROW:
            return False
        rows = pointer(m, rows_at)
        joint = pointer(m, joint_at)
        kind = pointer(d, kind_at)
        number = pointer(d, id_at)
        split = i32(d + islands_at, 0) > 0
        curved = False

        first = i32(d + ne_at, 0)
        for k in range(first, first + i32(d + nf_at, 0)):
            if i32(kind, k) != of_dof:
                continue
            dof = i32(number, k)
            row = rows + 8 * width * i32(joint, dof)
            if f64(row, 0) != STAMP:
                continue
            curved = True

            # A `frictionloss` that differs from the curve's is taken as Coulomb friction only.
            coulomb = f64(row, 1)
            stiction = f64(row, 2)
            off = abs(f64(pointer(m, loss_at), dof) - coulomb) > ROUNDED * coulomb
            if stiction <= coulomb or off:
                continue
            most = stribeck(coulomb, stiction, f64(row, 3), f64(pointer(d, qvel_at), dof))
            put(pointer(d, bound_at), k, most)
            if split:
                in_island = i32(pointer(d, map_at), k)
                if in_island >= 0:
                    put(pointer(d, island_bound_at), in_island, most)
        return curved

    return set_bounds
