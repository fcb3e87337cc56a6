"""What the thrusters must give while the arm stands and pushes, checked by MuJoCo's own inverse dynamics."""

import mujoco
import numpy as np
import pytest

import models
from controllers.hull.thrust_margin import ThrustMargin
from models import hydrodynamics
from models.vehicle import Vehicle
from models.water.thrusters import FORWARD, REVERSE
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array


def needed(model: mujoco.MjModel, q: Array, f_tip_G: Array) -> Array:
    """Wrench (6,) of the thrusters on the hull at its origin, level and still: MuJoCo's, and buoyancies."""
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
    return -generalized[:6]


@pytest.mark.parametrize("name", ["uuv_puma", "uuv_puma_side"])
def test_share_of_the_strongest_used_thruster(name, rng, within):
    model = models.load(name).compile()
    vehicle, holding = Vehicle.of(model), ThrustMargin.of(model)
    table = vehicle.thruster_table
    for _ in range(20):
        q = rng.uniform(vehicle.q_limits[:, 0], vehicle.q_limits[:, 1])
        f_tip_G = rng.normal(size=3) * 60.0
        thrust = np.linalg.solve(vehicle.thruster_wrench, needed(model, q, f_tip_G))  # six thrusters: one way only
        shares = np.where(thrust > 0.0, thrust / table[:, FORWARD], -thrust / table[:, REVERSE])
        within("share", holding.used(q, np.eye(3), f_tip_G) - shares.max(), 1e-9)


@pytest.mark.parametrize("drag", [-0.1, np.nan])
def test_a_friction_that_cannot_be(drag):
    with pytest.raises(ConfigurationError, match="drag"):
        ThrustMargin.of(models.load("uuv_puma").compile(), drag=drag)
