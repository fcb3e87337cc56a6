"""The truth as an estimate: each field against the truth, and arrays that do not change with it."""

import numpy as np

from uuv import models
from uuv.environments.true_state import TrueState
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.messages import Command
from uuv.sim.interfaces.spatial import exp_so3, pose
from uuv.sim.loop.true_estimate import true_estimate
from uuv.sim.plant.plant import Plant
from uuv.sim.water.current import Current

X_WB = pose(exp_so3([0.4, -0.3, 1.2]), [1.0, -2.0, -3.0])


def test_it_equals_the_truth_and_keeps_no_view():
    plant = Plant(
        hydrodynamics.compile(models.load("uuv_puma")), current=Current([0.3, 0.1, 0.0]), X_WB=X_WB
    )
    rng = np.random.default_rng(3)
    command = Command(
        time=0.0,
        joint_torque=5.0 * rng.normal(size=6),
        thrusters=rng.uniform(-0.5, 0.5, 6),
        scan=False,
    )
    for _ in range(20):
        plant.observe()
        plant.step(command)
    truth = plant.observe()
    estimate = true_estimate(truth)
    exact = TrueState().estimate(truth)

    R_WB = truth.R_WB.copy()
    assert estimate.time == truth.time > 0.0
    np.testing.assert_array_equal(estimate.X_WB, pose(R_WB, truth.p_WB))
    np.testing.assert_allclose(R_WB @ estimate.v_WB_B, truth.v_WB_W, atol=1e-15)
    np.testing.assert_allclose(R_WB @ estimate.a_WB_B, truth.acceleration[:3], atol=1e-15)
    for name in ("q", "qd", "w_WB_B"):
        np.testing.assert_array_equal(getattr(estimate, name), getattr(truth, name))
        assert np.abs(getattr(estimate, name)).max() > 1e-4
    assert not estimate.tau.any()

    # With the torques at the gear outputs.
    lost = truth.armature * truth.qdd + truth.joint_damping * truth.qd
    np.testing.assert_allclose(exact.tau, truth.tau_drive + truth.tau_friction - lost, atol=1e-9)
    np.testing.assert_array_equal(exact.X_WB, estimate.X_WB)

    before = [estimate.X_WB.copy(), estimate.q.copy(), estimate.w_WB_B.copy()]
    plant.step(command)
    plant.observe()
    for before_step, after_step in zip(
        before, (estimate.X_WB, estimate.q, estimate.w_WB_B), strict=True
    ):
        np.testing.assert_array_equal(before_step, after_step)
    assert not np.array_equal(truth.q, estimate.q)
