"""What the thrusters must give while the arm stands and pushes, checked by MuJoCo's own inverse
dynamics.
"""

from copy import copy

import mujoco
import numpy as np
import pytest
from numpy.typing import ArrayLike

from uuv import models
from uuv.controllers.hull.thrust_margin import ThrustMargin
from uuv.models import hydrodynamics
from uuv.models.vehicle import Vehicle
from uuv.models.water.thrusters import FORWARD, INFLOW_LOSS, REVERSE
from uuv.sim.hydrodynamics import install
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array


def needed(
    model: mujoco.MjModel, q: Array, f_tip_G: Array, current_W: ArrayLike = (0.0, 0.0, 0.0)
) -> Array:
    """Wrench (6,) of the thrusters on the hull at its origin, level and still: MuJoCo's,
    buoyancies, and drags.

    The drags are those of the plant's passive callback in a current, less those in still water.
    """
    data, vehicle = mujoco.MjData(model), Vehicle.of(model)
    data.qpos[3:7] = [1.0, 0.0, 0.0, 0.0]
    data.qpos[vehicle.qpos] = q
    mujoco.mj_forward(model, data)
    generalized = -data.qfrc_bias.copy()  # weights: nothing moves
    density = hydrodynamics.water_density(model)
    for body in range(1, model.nbody):
        if not hydrodynamics.carries(model.body_user[body]):
            continue
        water = hydrodynamics.unpack(model.body_user[body])
        centre = data.xpos[body] + data.xmat[body].reshape(3, 3) @ water.center_of_buoyancy
        lift = -density * water.volume * model.opt.gravity
        mujoco.mj_applyFT(model, data, lift, np.zeros(3), centre, body, generalized)
    tip = vehicle.tip
    f_W = data.site_xmat[tip].reshape(3, 3) @ f_tip_G
    body = int(model.site_bodyid[tip])
    mujoco.mj_applyFT(model, data, f_W, np.zeros(3), data.site_xpos[tip], body, generalized)
    generalized[:6] += drag(model, q, current_W) - drag(model, q)
    return -generalized[:6]


def drag(model: mujoco.MjModel, q: Array, current_W: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """Passive force (6,) on the free joint of a vehicle at rest in a current, by the plant's
    callback.
    """
    moved = copy(model)
    data = mujoco.MjData(model)
    vehicle = Vehicle.of(model)
    moved.opt.wind[:] = current_W
    data.qpos[3:7] = [1.0, 0.0, 0.0, 0.0]
    data.qpos[vehicle.qpos] = q
    mujoco.mj_forward(moved, data)
    return data.qfrc_passive[:6].copy()


@pytest.mark.parametrize("name", ["uuv_puma", "uuv_puma_side"])
def test_share_of_the_strongest_used_thruster(name, rng, within):
    model = models.load(name).compile()
    vehicle, holding = Vehicle.of(model), ThrustMargin.of(model)
    table = vehicle.thruster_table
    for _ in range(20):
        q = rng.uniform(vehicle.q_limits[:, 0], vehicle.q_limits[:, 1])
        f_tip_G = rng.normal(size=3) * 60.0
        # six thrusters: one way only
        thrust = np.linalg.solve(vehicle.thruster_wrench, needed(model, q, f_tip_G))
        shares = np.where(thrust > 0.0, thrust / table[:, FORWARD], -thrust / table[:, REVERSE])
        within("share", holding.used(q, np.eye(3), f_tip_G) - shares.max(), 1e-9)


@pytest.mark.parametrize("name", ["uuv_puma", "uuv_puma_side"])
def test_share_used_in_a_current(name, rng, within):
    """Drag of hull and arm is that which the plant's callback gives; the inflow takes from the
    strength.
    """
    install()
    model = models.load(name).compile()
    vehicle, holding = Vehicle.of(model), ThrustMargin.of(model)
    table, home = vehicle.thruster_table, vehicle.q_home
    assert holding.in_current([0.0, 0.4, 0.0]).used(home, np.eye(3), np.zeros(3)) > 0.3
    for _ in range(20):
        q = rng.uniform(vehicle.q_limits[:, 0], vehicle.q_limits[:, 1])
        f_tip_G, current_W = rng.normal(size=3) * 60.0, rng.normal(size=3) * 0.3
        thrust = np.linalg.solve(vehicle.thruster_wrench, needed(model, q, f_tip_G, current_W))
        taken = table[:, INFLOW_LOSS] * (vehicle.thruster_wrench[:3].T @ -current_W)
        shares = np.where(
            thrust > 0.0,
            thrust / (table[:, FORWARD] - taken),
            -thrust / (table[:, REVERSE] + taken),
        )
        within(
            "share", holding.in_current(current_W).used(q, np.eye(3), f_tip_G) - shares.max(), 1e-9
        )


@pytest.mark.parametrize("drag", [-0.1, np.nan])
def test_a_friction_that_cannot_be(drag):
    with pytest.raises(ConfigurationError, match="drag"):
        ThrustMargin.of(models.load("uuv_puma").compile(), drag=drag)


@pytest.mark.parametrize("yaw", [0.7, -2.1])
def test_share_used_by_a_turned_hull_in_a_current(yaw, rng, within):
    """A level hull at any heading meets the current turned into its own axes; MuJoCo is asked at
    heading 0.
    """
    install()
    model = models.load("uuv_puma").compile()
    vehicle, holding = Vehicle.of(model), ThrustMargin.of(model)
    table, q = vehicle.thruster_table, vehicle.q_home
    c, s = np.cos(yaw), np.sin(yaw)
    R_WB = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    for _ in range(3):
        f_tip_G, current_W = rng.normal(size=3) * 60.0, rng.normal(size=3) * 0.3
        current_B = R_WB.T @ current_W
        thrust = np.linalg.solve(vehicle.thruster_wrench, needed(model, q, f_tip_G, current_B))
        taken = table[:, INFLOW_LOSS] * (vehicle.thruster_wrench[:3].T @ -current_B)
        shares = np.where(
            thrust > 0.0,
            thrust / (table[:, FORWARD] - taken),
            -thrust / (table[:, REVERSE] + taken),
        )
        within("share", holding.in_current(current_W).used(q, R_WB, f_tip_G) - shares.max(), 1e-9)
