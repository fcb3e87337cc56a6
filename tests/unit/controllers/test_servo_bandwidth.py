"""The joint servo on hulls that give way to the arm: no arm of the registry chatters."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from uuv import models
from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.hull.station_keeping import hull_inertia
from uuv.controllers.tuning import ArmTuning
from uuv.controllers.whole_body.servo_bandwidth import yielding_ratio
from uuv.controllers.whole_body.work_controller import WorkController
from uuv.models.vehicle import Vehicle
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.messages import Reference, StateEstimate, WorkState
from uuv.sim.interfaces.spatial import Array, exp_so3, pose

STEP = 0.002  # [s]
STEADY = ("uuv_puma", "bluerov2_alpha5", "rexrov_oberon7")


def inertias(model: mujoco.MjModel, vehicle: Vehicle, q: Array) -> tuple[Array, Array]:
    """Inertia (6 + n, 6 + n) of hull and joints by MuJoCo, with added mass, and that of the joints
    (n, n) if the hull is held.
    """
    data = mujoco.MjData(model)
    data.qpos[vehicle.qpos] = q
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_crb(model, data)
    whole = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, whole)
    whole += hydrodynamics.added_inertia(model, data)

    dofs = np.r_[vehicle.hull_dof : vehicle.hull_dof + 6, vehicle.dof]
    return whole[np.ix_(dofs, dofs)], whole[np.ix_(vehicle.dof, vehicle.dof)]


@pytest.mark.parametrize("name", ["girona500_arm4", "uuv_puma"])
def test_the_ratio_is_that_of_mujocos_inertias(name: str, rng):
    """The free inertia is the inverse of the joints' block of the inverse of the whole inertia."""
    model = models.load(name).compile()
    vehicle = Vehicle.of(model)
    q = rng.uniform(vehicle.q_limits[:, 0], vehicle.q_limits[:, 1])
    whole, held = inertias(model, vehicle, q)
    of_joints = np.linalg.inv(whole)[6:, 6:]
    expected = np.linalg.eigvals(of_joints @ held).real.max()

    ratio = yielding_ratio(
        ArmDynamics(model), hull_inertia(model, vehicle.hull, 1.0), vehicle.armature, q
    )
    assert ratio == pytest.approx(expected, rel=1e-9)  # measured 2e-15
    assert ratio > 1.2


@pytest.mark.parametrize("name", STEADY)
def test_arms_that_are_light_for_their_hull_keep_their_bandwidth(name: str):
    controller = WorkController(models.load(name).compile())
    assert controller.tuning == ArmTuning()


def shaken(controller: WorkController, model: mujoco.MjModel, q: Array, ticks: int) -> Array:
    """Speeds (ticks, n) [rad/s] of joints that hold the tool in place after a jerk of the first,
    on a free vehicle with MuJoCo's inertias.

    Args:
        controller: of the arm.
        model: compiled model of the vehicle.
        q: (n,) [rad] joint angles at the start.
        ticks: number of periods of the drives.
    """
    vehicle = Vehicle.of(model)
    n = vehicle.joints.size
    whole, _ = inertias(model, vehicle, q)
    damping = np.diag(np.r_[np.zeros(6), vehicle.joint_damping])
    X_WB = np.eye(4)
    X_BG, _ = ArmDynamics(model).tip(q)
    motion = np.zeros(6 + n)

    def seen(time: float) -> StateEstimate:
        return StateEstimate(
            time=time,
            X_WB=X_WB.copy(),
            v_WB_B=motion[:3].copy(),
            w_WB_B=motion[3:6].copy(),
            a_WB_B=np.zeros(3),
            q=q.copy(),
            qd=motion[6:].copy(),
            tau=np.zeros(n),
        )

    state = controller.init(seen(0.0))
    reference = Reference.holding(0.0, X_WB, q, state=WorkState.WORK, X_WG=X_BG)
    speeds = np.empty((ticks, n))
    borne = None  # [N m] by the servo at rest, in balance with weight and buoyancy
    for tick in range(ticks):
        # The reference is stated anew, so that it is not extrapolated
        now = replace(reference, time=tick * STEP)
        state, command = controller.step(state, seen(tick * STEP), now)
        borne = command.joint_torque.copy() if borne is None else borne

        push = np.r_[np.zeros(6), command.joint_torque - borne] - damping @ motion
        motion += STEP * np.linalg.solve(whole + STEP * damping, push)
        motion[6] += 1e-3 if tick == 0 else 0.0
        X_WB = X_WB @ pose(exp_so3(STEP * motion[3:6]), STEP * motion[:3])
        q = q + STEP * motion[6:]
        speeds[tick] = motion[6:]
    return speeds


STRETCHED = np.array([0.04, 0.135, 1.9, -0.486])  # [rad] of the Girona's arm, as beside a barrel


@pytest.mark.parametrize(
    ("name", "q"), [("girona500_arm4", STRETCHED), ("bluerov2_alpha5", None), ("uuv_puma", None)]
)
def test_joints_that_hold_the_tool_do_not_chatter_on_the_free_hull(name: str, q: Array | None):
    """A jerk of the Girona's slew joint by 1 mrad/s grew to 0.1 rad/s in a second, with another
    sign in each sample.
    """
    model = models.load(name).compile()
    q = np.array(Vehicle.of(model).q_ready) if q is None else q
    speeds = shaken(WorkController(model), model, q, 500)
    assert abs(np.diff(speeds[250:], axis=0)).max() < 5e-4  # [rad/s] measured 2e-5 to 1.2e-4
