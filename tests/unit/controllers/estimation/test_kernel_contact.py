"""Contact estimator of one's own as a kernel: its force by hand, within the controller's tick and
by itself.
"""

from dataclasses import replace

import numpy as np
import pytest

from uuv import models
from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.estimation.kernel_contact import KernelContact
from uuv.controllers.estimation.tip_force_estimator import DriveState, TorqueSensors
from uuv.controllers.whole_body.work_controller import WorkController
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import Reference, StateEstimate, WorkState
from uuv.sim.interfaces.spatial import exp_so3, pose

OWN = models.load("uuv_puma").compile()
VEHICLE = Vehicle.of(OWN)
ARM = ArmDynamics(OWN)
N = VEHICLE.joints.size
STILL = np.zeros(3)
X_WB = pose(exp_so3([0.2, -0.1, 0.7]), [1.0, -2.0, -8.0])


def by_three_joints(memory, joints, torques, J_B, f_B, friction, dt):
    """The force that the first three joints show, and a friction that counts the time."""
    memory[0] += dt
    f_B[:] = np.linalg.solve(J_B[:, :3].T.copy(), torques[2, :3].copy())
    for j in range(friction.shape[0]):
        friction[j] = memory[0] + joints[1, j] + 0.01 * (torques[1, j] - torques[0, j])


def pressed(rng: np.random.Generator) -> StateEstimate:
    """A resting arm under a force on its tip; its speeds are noise."""
    q = VEHICLE.q_ready + rng.uniform(-0.2, 0.2, N)
    f_G = rng.uniform(-80.0, 80.0, 3)
    rest = np.zeros(N)
    none = np.zeros(6)
    still = {"R_WB": X_WB[:3, :3], "nu_B": none, "a_B": none, "v_current_W": STILL}
    tau = ARM.inverse(q, rest, rest, wrench_tip_G=np.append(f_G, STILL), **still)[0]
    qd = 1e-3 * rng.standard_normal(N)
    return StateEstimate(
        time=0.0, X_WB=X_WB, v_WB_B=STILL, w_WB_B=STILL, a_WB_B=STILL, q=q, qd=qd, tau=tau
    )


def test_its_force_and_friction_are_those_of_the_function(rng, within):
    estimator = KernelContact(OWN, by_three_joints, arm=ARM)
    estimate = pressed(rng)
    usual = TorqueSensors(OWN, arm=ARM)
    drives = DriveState(tau=rng.standard_normal(N), qd_wanted=np.zeros(N), current_W=STILL)
    state, other = estimator.init(estimate), usual.init(estimate)
    state.bias[:] = other.bias[:] = rng.standard_normal(N)
    for step in range(3):
        estimator.sense(state, estimate, drives)
        usual.sense(other, estimate, drives)
        f_B = np.linalg.solve(other.sensed.J_B[:3, :3].T, (other.sensed.tau_e - other.bias)[:3])
        f_W = X_WB[:3, :3] @ f_B
        f_G = other.sensed.X_BG[:3, :3].T @ f_B
        within("force [N]", state.estimate.force_W - f_W, 1e-10)
        within("normal force [N]", state.estimate.normal + f_G[2], 1e-10)
        friction = 0.002 * (step + 1) + estimate.qd + 0.01 * (drives.tau - estimate.tau)
        within("friction [N m]", state.friction - friction, 1e-13)
    assert np.linalg.norm(state.sensed.f_B) > 1.0
    assert not np.allclose(state.estimate.force_W, other.estimate.force_W, atol=1.0)


def test_the_tick_of_the_controller_calls_it(rng):
    """The command's force is what `sense` makes of the same readings; the parts in Python do not
    name it.
    """
    estimate = pressed(rng)
    controller = WorkController(OWN, estimator=KernelContact(OWN, by_three_joints, arm=ARM))
    held = Reference.holding(0.0, X_WB, estimate.q, state=WorkState.WORK)
    alone = KernelContact(OWN, by_three_joints, arm=ARM)
    state, other, tau = controller.init(estimate), alone.init(estimate), np.zeros(N)
    for k in range(4):
        sample = replace(estimate, time=0.002 * k, tau=estimate.tau + 0.1 * rng.standard_normal(N))
        alone.sense(other, sample, DriveState(tau=tau, qd_wanted=np.zeros(N), current_W=STILL))
        state, command = controller.step(state, sample, held)
        assert np.array_equal(command.contact.force_W, other.estimate.force_W)
        assert command.contact.normal == other.estimate.normal
        assert np.array_equal(state.contact.friction, other.friction)
        tau = command.joint_torque
    assert controller.slow == ()


def test_what_cannot_be_compiled_is_refused_in_one_line():
    def opens(*_):
        print(open)

    with pytest.raises(
        ConfigurationError,
        match=r"^contact estimator opens: numba cannot compile "
        r"the function: [^\n]*$",
    ):
        KernelContact(OWN, opens)
    with pytest.raises(ConfigurationError, match="at least 1, got 0"):
        KernelContact(OWN, by_three_joints, numbers=0)
