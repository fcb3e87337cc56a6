"""The published closed form of the tip force in the loop: against a known force, and where it is
singular.
"""

from dataclasses import replace

import numpy as np
import pytest

from uuv import models
from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.estimation.closed_form_force import JOINTS, ClosedFormForce
from uuv.controllers.estimation.force_from_torques import tip_force_closed_form
from uuv.controllers.estimation.tip_force_estimator import ContactState, DriveState, TorqueSensors
from uuv.controllers.estimation.tip_force_kernels import force_sigma
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.messages import StateEstimate

OWN = models.load("uuv_puma").compile()
VEHICLE = Vehicle.of(OWN)
ARM = ArmDynamics(OWN)
N = VEHICLE.joints.size
STILL = np.zeros(3)
BENT = np.array([0.4, -0.5, 0.9, 1.1, 0.0, 0.0])
DRIVES = DriveState(tau=np.zeros(N), qd_wanted=np.zeros(N), current_W=STILL)


def pressed(q: np.ndarray, f_G: np.ndarray) -> StateEstimate:
    """A resting vehicle with the torques of a force (3,) [N] of the world on the tip, tool axes."""
    at_rest = {"R_WB": np.eye(3), "nu_B": np.zeros(6), "a_B": np.zeros(6), "v_current_W": STILL}
    tau = ARM.inverse(q, np.zeros(N), np.zeros(N), wrench_tip_G=np.append(f_G, STILL), **at_rest)[0]
    return StateEstimate(
        time=0.0,
        X_WB=np.eye(4),
        v_WB_B=STILL,
        w_WB_B=STILL,
        a_WB_B=STILL,
        q=q,
        qd=np.zeros(N),
        tau=tau,
    )


def felt(kind: type[TorqueSensors], estimate: StateEstimate, steps: int = 400) -> ContactState:
    estimator = kind(OWN, arm=ARM)
    state = estimator.init(estimate)
    for _ in range(steps):
        estimator.sense(state, estimate, DRIVES)
    return state


def test_a_pure_force_is_found(within):
    rng = np.random.default_rng(3)
    for _ in range(10):
        q = BENT + rng.uniform(-0.2, 0.2, N)
        f_G = rng.uniform(-80.0, 80.0, 3)
        state = felt(ClosedFormForce, pressed(q, f_G))
        # measured 3e-12; the filter has come to rest
        within("force [N]", state.sensed.f_G - f_G, 1e-9)
        assert state.estimate.normal == pytest.approx(-f_G[2])


def test_it_is_the_formula_of_the_paper(within):
    """With joints 5 and 6 at zero, whatever the torques, a moment on the tip included."""
    estimate = pressed(BENT, np.array([5.0, -8.0, -60.0]))
    estimate = replace(estimate, tau=estimate.tau + np.array([0.5, -0.4, 0.3, 0.2, -0.6, 0.1]))
    state = felt(ClosedFormForce, estimate)
    paper_G = tip_force_closed_form(state.sensed.tau_e, BENT, (0.6, 0.5, 0.22))
    within(
        "length of the force [N]", np.linalg.norm(state.sensed.f_G) - np.linalg.norm(paper_G), 1e-9
    )


def test_only_its_three_joints_count(within):
    estimate = pressed(BENT, np.array([5.0, -8.0, -60.0]))
    others = [j for j in range(N) if j not in JOINTS]
    tau = np.array(estimate.tau)
    tau[others] += 3.0
    changed = felt(ClosedFormForce, replace(estimate, tau=tau))
    within("force [N]", changed.sensed.f_G - felt(ClosedFormForce, estimate).sensed.f_G, 1e-12)
    assert (
        np.abs(
            felt(TorqueSensors, replace(estimate, tau=tau)).sensed.f_G - changed.sensed.f_G
        ).max()
        > 1.0
    )


def test_the_force_is_held_where_the_wrist_is_straight():
    estimator = ClosedFormForce(OWN, arm=ARM)
    bent = pressed(BENT, np.array([0.0, 0.0, -60.0]))
    straight = BENT * [1, 1, 1, 0, 1, 1]
    state = estimator.init(bent)
    for _ in range(400):
        estimator.sense(state, bent, DRIVES)
    held = state.sensed.f_B.copy()
    for _ in range(10):
        estimator.sense(state, pressed(straight, np.array([0.0, 0.0, -90.0])), DRIVES)
    assert np.array_equal(state.sensed.f_B, held)


def test_its_sigma_is_that_of_its_own_errors(within):
    """Against the spread over drawn torques; larger than that of least squares."""
    rng = np.random.default_rng(4)
    f_G = np.array([0.0, 0.0, -60.0])
    estimator = ClosedFormForce(OWN, arm=ARM)
    estimate = pressed(BENT, f_G)
    state = felt(ClosedFormForce, estimate)
    forces = []
    sigma_G = estimator._sigma_G(state, np.full(N, 0.25))
    for _ in range(100):
        drawn = replace(estimate, tau=estimate.tau + rng.normal(0.0, 0.5, N))
        forces.append(felt(ClosedFormForce, drawn, 150).sensed.f_G.copy())
    within("sigma over spread", np.std(forces, axis=0) / sigma_G - 1.0, 0.15)  # 100 draws: 7 %
    usual = force_sigma(state.sensed.X_BG, state.sensed.J_B, np.ones(N), np.full(N, 0.25))
    assert np.all(sigma_G > usual - 1e-9)
