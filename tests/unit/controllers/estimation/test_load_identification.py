"""Load identification: torques of MuJoCo's own model of the arm with a body at its tip."""

import mujoco
import numpy as np
import pytest

from uuv import models
from uuv.controllers.arm.inverse_dynamics import ArmDynamics, JointMotion
from uuv.controllers.estimation.load_identification import LoadIdentification
from uuv.models import hydrodynamics
from uuv.models.naming import TIP_SITE
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.messages import HeldLoad
from uuv.sim.interfaces.spatial import Array, rotation_from_quat_wxyz

WATER = 1025.0  # [kg/m^3]
RADIUS = 0.04  # [m] of the ball at the tip
PLACE = np.array([0.01, -0.005, 0.02])  # [m] its middle from the tip, tool axes
EXPECTED = np.array([0.0, 0.0, 0.02])  # [m] where it is thought to be
LEVEL = np.concatenate([np.eye(3).ravel(), np.zeros(15)])


def ball(mass: float) -> mujoco.MjModel:
    """The vehicle with a ball fixed to its tip, which displaces its volume."""
    spec = models.load("uuv_puma")
    tip = spec.site(TIP_SITE)
    at = tip.pos + rotation_from_quat_wxyz(np.array(tip.quat)) @ PLACE
    held = tip.parent.add_body(name="load", pos=at, quat=tip.quat)
    held.mass = mass
    held.ipos = np.zeros(3)
    held.inertia = [0.4 * mass * RADIUS**2] * 3
    held.explicitinertial = True
    water = hydrodynamics.BodyHydrodynamics(
        volume=displaced() / WATER,
        added_mass=0.5 * displaced() * np.diag([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]),
    )
    hydrodynamics.attach(spec, {"load": water})
    return spec.compile()


def displaced() -> float:
    """Water [kg] that the ball displaces."""
    return WATER * 4.0 / 3.0 * np.pi * RADIUS**3


def torques(arm: ArmDynamics, q: Array, *, qd: Array | None = None) -> Array:
    """(n,) [N m] of an arm on a level hull at rest."""
    rest = np.zeros(arm.n)
    none = np.zeros(6)
    return arm.inverse(
        q,
        rest if qd is None else qd,
        rest,
        R_WB=np.eye(3),
        nu_B=none,
        a_B=none,
        v_current_W=none[:3],
        wrench_tip_G=none,
    )[0]


@pytest.mark.parametrize("mass", [0.05, 0.2, displaced(), 1.0, 5.0])
def test_a_ball_heavier_or_lighter_than_water_is_identified(mass: float, rng, within) -> None:
    believed = models.load("uuv_puma").compile()
    arm = ArmDynamics(believed)
    true = ArmDynamics(ball(mass))
    q = np.array(Vehicle.of(believed).q_ready)
    expected = HeldLoad(
        mass=displaced(), displaced=displaced(), center_G=EXPECTED, buoyancy_G=EXPECTED
    )

    sought = LoadIdentification(arm, expected, np.full(arm.n, 0.3))
    for _ in range(100):
        tau = torques(true, q) + 0.1 * rng.normal(size=arm.n)
        joints = JointMotion(q, np.zeros(arm.n), np.zeros(arm.n))
        sought.add(joints, LEVEL, torques(arm, q) - tau)
    load = sought.load

    within("mass", load.mass - mass, 0.05)  # measured up to 23 g, at 5 kg
    assert load.weight == pytest.approx(9.81 * (mass - displaced()), abs=0.5)
    if mass > 0.5:  # across gravity, where it turns the joints
        wrong = torques(arm.bearing(load), q) - torques(true, q)
        within("torques", np.abs(wrong).max(), 0.6)  # measured up to 0.32 N m


def test_an_arm_that_bears_a_load_is_that_of_mujoco_with_the_body(within) -> None:
    true = ArmDynamics(ball(2.0))
    arm = ArmDynamics(models.load("uuv_puma").compile())
    load = HeldLoad(
        mass=2.0,
        displaced=displaced(),
        center_G=PLACE,
        buoyancy_G=PLACE,
        radius=np.sqrt(0.4) * RADIUS,
    )
    bears = arm.bearing(load)
    rng = np.random.default_rng(3)
    for _ in range(5):
        q, qd = rng.uniform(-1.0, 1.0, (2, arm.n))
        within("torques", torques(bears, q, qd=qd) - torques(true, q, qd=qd), 1e-10)
        within("inertia", bears.inertia(q) - true.inertia(q), 1e-10)
