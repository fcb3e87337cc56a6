"""Tool force from joint torques: the paper's closed form and the least squares, against J^T and
each other.
"""

import mujoco
import numpy as np
import pytest

from uuv import models
from uuv.controllers.estimation.force_from_torques import (
    force_covariance,
    tip_force,
    tip_force_closed_form,
    tip_wrench,
)
from uuv.controllers.estimation.tip_force_kernels import Tare, add_to_tare, force_sigma
from uuv.models.naming import TIP_SITE
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array

LENGTHS = (0.6, 0.5, 0.22)  # [m] l2, l3, wrist to tip of the default arm


def paper_arm(q: Array) -> tuple[Array, Array]:
    """Axes (3, 3) of the paper's G, columns x y z, and the tip's Jacobian (3, 4): yaw, then three
    pitches upward.
    """

    def tip(q):  # complex, for a derivative without cancellation
        elevation = np.cumsum(q[1:])
        radius, height = np.dot(LENGTHS, np.cos(elevation)), np.dot(LENGTHS, np.sin(elevation))
        return np.array([radius * np.cos(q[0]), radius * np.sin(q[0]), height])

    J = np.column_stack([np.imag(tip(q + 1e-30j * unit)) / 1e-30 for unit in np.eye(4)])
    c = np.cos(q[0])
    s = np.sin(q[0])
    up = np.sum(q[1:])
    x = np.array([np.cos(up) * c, np.cos(up) * s, np.sin(up)])
    z = np.array([-np.sin(up) * c, -np.sin(up) * s, np.cos(up)])
    return np.column_stack([x, [-s, c, 0.0], z]), J


def test_closed_form_turns_the_transposed_jacobian_round(within):
    """[Konoplin 2022, eq. 5] in 2000 random poses."""
    rng = np.random.default_rng(1)
    worst = 0.0
    tried = 0
    while tried < 2000:
        q = rng.uniform(-np.pi, np.pi, 4)
        f_G = rng.uniform(-100.0, 100.0, 3)
        axes, J = paper_arm(q)
        tip_radius = np.dot(LENGTHS, np.cos(np.cumsum(q[1:])))
        if abs(np.sin(q[3])) < 0.05 or abs(tip_radius) < 0.05:
            continue
        tried += 1
        worst = max(
            worst, float(np.max(np.abs(tip_force_closed_form(J.T @ axes @ f_G, q, LENGTHS) - f_G)))
        )
    within("force [N]", worst, 1e-11)  # measured 1e-12


def test_closed_form_holds_on_the_default_arm(within):
    """Its wrist at zero, the default vehicle has the paper's arm: MuJoCo gives the Jacobian and the
    torques.
    """
    model = models.load("uuv_puma").compile()
    data = mujoco.MjData(model)
    tip = model.site(TIP_SITE).id
    rng = np.random.default_rng(2)
    dofs = [int(model.joint(f"joint{i}").dofadr[0]) for i in range(1, 7)]
    for _ in range(50):
        q = np.concatenate([rng.uniform(-2.0, 2.0, 3), rng.uniform(0.3, 2.0, 1), np.zeros(2)])
        for i in range(6):
            data.joint(f"joint{i + 1}").qpos = q[i]
        mujoco.mj_forward(model, data)
        J = np.zeros((3, model.nv))
        mujoco.mj_jacSite(model, data, J, None, tip)
        base = data.body("arm_base").xmat.reshape(3, 3)
        axes = base @ paper_arm(q[:4])[0]
        f_G = rng.uniform(-100.0, 100.0, 3)
        tau_e = J[:, dofs].T @ axes @ f_G
        # measured 2e-12
        within("eq. (5) [N]", tip_force_closed_form(tau_e, q, LENGTHS) - f_G, 2e-11)
        f_W, covariance = tip_force(tau_e, J[:, dofs], np.full(6, 0.5))
        # The weak prior of 1 kN takes its share, no more.
        assert (
            np.linalg.norm(f_W - axes @ f_G)
            <= 1.01e-6 * np.linalg.norm(covariance) * np.linalg.norm(f_G) + 1e-9
        )


@pytest.mark.parametrize(
    "q", [(0.3, 0.4, 0.5, 0.0), (0.3, 0.4, 0.5, np.pi), (0.3, np.pi / 2, 0.0, 1e-8)]
)
def test_closed_form_refuses_a_straight_wrist(q):
    with pytest.raises(ConfigurationError, match="singular"):
        tip_force_closed_form(np.ones(4), np.array(q), LENGTHS)


def test_closed_form_refuses_the_tip_over_the_yaw_axis():
    # Upper arm upright, forearm and tool as far forward as back.
    forward = np.arccos(LENGTHS[2] / LENGTHS[1])
    q = np.array([0.3, np.pi / 2, forward - np.pi / 2, np.pi - forward])
    with pytest.raises(ConfigurationError, match="yaw axis"):
        tip_force_closed_form(np.ones(4), q, LENGTHS)


def test_least_squares_knows_where_the_closed_form_loses_its_grip():
    """Standard deviation of Fx with 0.5 N m of noise on each torque: 20, 6.6 and 1.9 N, against 1.0
    to 1.5 N.
    """
    closed, squares = [], []
    for degrees in (10.0, 30.0, 90.0):
        q = np.array([0.0, 0.6, 1.0, np.radians(degrees)])
        axes, J = paper_arm(q)
        gain = np.column_stack([tip_force_closed_form(unit, q, LENGTHS) for unit in np.eye(4)])
        closed.append(0.5 * float(np.linalg.norm(gain[0])))
        covariance = tip_force(np.zeros(4), J, np.full(4, 0.5))[1]
        squares.append(float(np.sqrt(axes[:, 0] @ covariance @ axes[:, 0])))
    assert closed == sorted(closed, reverse=True)
    assert closed[0] > 15.0
    assert max(squares) < 2.0


def test_covariance_grows_as_the_arm_stretches_and_stays_finite():
    sigma = np.full(4, 0.5)
    traces = []
    for bend in (1.0, 0.3, 0.1, 0.03, 0.0):
        J = paper_arm(np.array([0.2, 0.3, bend, bend]))[1]
        force, covariance = tip_force(np.full(4, 0.5), J, sigma)
        assert np.all(np.isfinite(force))
        traces.append(float(np.trace(covariance)))
    assert traces == sorted(traces)
    assert traces[-1] > 1e3 * traces[0]
    assert traces[-1] < 3.1e6  # the prior: three times (1 kN)^2


def test_covariance_is_what_repeated_measurements_show():
    rng = np.random.default_rng(3)
    J = paper_arm(np.array([0.2, 0.6, 1.0, 0.7]))[1]
    sigma = np.array([1.5, 2.0, 1.2, 0.6])
    force = np.array([20.0, -30.0, 60.0])
    noisy = [
        tip_force(J.T @ force + sigma * rng.standard_normal(4), J, sigma)[0] for _ in range(4000)
    ]
    stated = tip_force(np.zeros(4), J, sigma)[1]
    covariance = np.cov(np.array(noisy).T)
    assert np.allclose(np.mean(noisy, axis=0), force, atol=4.0 * np.sqrt(np.diag(stated) / 4000))
    assert np.abs(covariance - stated).max() < 0.1 * np.abs(stated).max()  # 4.5 standard deviations


def test_tare_is_a_mean():
    tare, bias = Tare.start(2), np.zeros(2)
    for sample in ([1.0, 2.0], [3.0, -2.0], [5.0, 6.0]):
        add_to_tare(tare, np.array(sample), bias)
    assert bias.tolist() == [3.0, 2.0]


def test_covariance_of_torques_weighed_wrongly_is_what_repeated_measurements_show():
    rng = np.random.default_rng(4)
    J = paper_arm(np.array([0.2, 0.6, 1.0, 0.7]))[1]
    weighed = np.full(4, 0.3)
    true = np.array([1.5, 2.0, 0.2, 0.6])
    covariance = np.cov(
        np.array([tip_force(true * rng.standard_normal(4), J, weighed)[0] for _ in range(4000)]).T
    )
    stated = force_covariance(J, weighed, np.diag(true**2))
    assert np.abs(covariance - stated).max() < 0.1 * np.abs(stated).max()  # 4.5 standard deviations
    right = tip_force(np.zeros(4), J, true)[1]
    assert force_covariance(J, true, np.diag(true**2)) == pytest.approx(right, rel=1e-3)
    assert np.trace(right) < np.trace(stated)


def test_the_compiled_sigma_is_that_of_the_covariance():
    rng = np.random.default_rng(5)
    for _ in range(20):
        X_BG = np.eye(4)
        J_B = rng.standard_normal((6, 6))
        X_BG[:3, :3] = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        weighed, variance = rng.uniform(0.1, 1.0, 6), rng.uniform(0.0, 1.0, 6)
        plain = force_covariance(X_BG[:3, :3].T @ J_B[:3], weighed, np.diag(variance))
        assert force_sigma(X_BG, J_B, weighed, variance) == pytest.approx(
            np.sqrt(np.diag(plain)), rel=1e-9
        )


@pytest.mark.parametrize("joints", [3, 5, 6, 7, 9])
def test_force_and_moment_are_found_as_far_as_the_joints_see_them(joints, within):
    """Any number of joints: errors as stated, drawn from the prior itself, and a full arm without
    noise exact.
    """
    rng = np.random.default_rng([5, joints])
    J = rng.normal(size=(6, joints))
    sigma = np.full(joints, 0.1)
    squared = []
    prior = np.repeat([50.0, 5.0], 3)
    wrenches = prior * rng.standard_normal((800, 6))
    for wrench in wrenches:
        tau_e = J.T @ wrench + sigma * rng.standard_normal(joints)
        estimate = tip_wrench(tau_e, J, sigma, force_prior=50.0, moment_prior=5.0)
        error = estimate.wrench - wrench
        squared.append(float(error @ np.linalg.solve(estimate.covariance, error)))
    assert np.mean(squared) == pytest.approx(6.0, abs=4.5 * np.sqrt(12.0 / 800))
    wrench = wrenches[-1]
    estimate = tip_wrench(J.T @ wrench, J, sigma, force_prior=50.0, moment_prior=5.0)
    assert np.all(estimate.seen >= 0.0)
    if joints >= 6:
        assert estimate.seen.min() > 0.9
        exact = tip_wrench(J.T @ wrench, J, 1e-6 * sigma)
        within("wrench", (exact.wrench - wrench) / prior, 1e-8)
    else:
        unseen = J.T @ (prior * estimate.blind)
        within("torque of what is not seen", unseen / np.linalg.norm(J.T * prior), 1e-6)


def test_without_moment_a_small_prior_of_it_gives_the_force_alone(within):
    rng = np.random.default_rng(6)
    J = rng.normal(size=(6, 6))
    sigma = rng.uniform(0.1, 1.0, 6)
    tau_e = 20.0 * rng.normal(size=6)
    force, covariance = tip_force(tau_e, J[:3], sigma)
    estimate = tip_wrench(tau_e, J, sigma, moment_prior=1e-6)
    within("force [N]", estimate.wrench[:3] - force, 1e-6)
    within(
        "covariance", (estimate.covariance[:3, :3] - covariance) / np.abs(covariance).max(), 1e-6
    )
