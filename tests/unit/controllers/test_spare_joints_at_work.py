"""Joints to spare of an arm at work: it leaves a singular posture while its tool stays."""

from dataclasses import replace

import numpy as np

from uuv import models
from uuv.controllers.ik.entries import entry
from uuv.controllers.mkps import Chain
from uuv.controllers.tuning import ArmTuning
from uuv.controllers.whole_body.work_controller import WorkController
from uuv.models.naming import ARM_BASE_BODY, TIP_SITE
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.messages import Reference, StateEstimate, WorkState
from uuv.sim.interfaces.spatial import Array, exp_so3, pose

MODEL = models.load("rexrov2_arm7").compile()
VEHICLE = Vehicle.of(MODEL)
CHAIN = Chain.from_mjcf(MODEL, ARM_BASE_BODY, TIP_SITE)
X_WB = pose(exp_so3([0.05, -0.1, 0.7]), [1.0, -2.0, -5.0])
STILL = np.zeros(3)
TICKS = 5000  # 5 s


def clearance(q: Array) -> float:
    """That of `uuv.controllers.ik.spare_joints`."""
    return entry("spare")(CHAIN.memory(), q, np.zeros((6, 6)), np.empty(CHAIN.n))


def followed(q: Array, tuning: ArmTuning) -> Array:
    """Joint angles wanted (TICKS, n) [rad] while the tool is to stay where it is at `q`."""
    controller = WorkController(MODEL, tuning=tuning)
    X_WG = X_WB @ VEHICLE.X_BA @ CHAIN.forward(q)
    estimate = StateEstimate(
        time=0.0,
        X_WB=X_WB,
        v_WB_B=STILL,
        w_WB_B=STILL,
        a_WB_B=STILL,
        q=q,
        qd=np.zeros(CHAIN.n),
        tau=np.zeros(CHAIN.n),
    )
    state = controller.init(estimate)
    rows = []
    for k in range(TICKS):
        time = k * controller.period
        reference = Reference.holding(time, X_WB, q, state=WorkState.WORK, X_WG=X_WG)
        state, _ = controller.step(state, replace(estimate, time=time), reference)
        rows.append(state.tool.motion.q.copy())
    return np.array(rows)


def test_an_arm_of_seven_joints_leaves_a_singular_posture_while_its_tool_stays(within):
    q = np.array(VEHICLE.q_ready)
    q[4] = 0.5 * np.pi
    q[5] = 0.08  # rad from the wrist's lock
    tuning = ArmTuning()
    rows = followed(q, tuning)
    tips = np.array([CHAIN.forward(row) for row in rows[::50]])
    off = np.abs(tips[:, :3, 3] - CHAIN.forward(q)[:3, 3]).max(axis=1)
    within("tip off while the motion begins [m]", off.max(), 2e-5)
    within("tip off after a second [m]", off[20:].max(), 1e-5)
    within("tip turned [-]", np.abs(tips[20:, :3, :3] - CHAIN.forward(q)[:3, :3]).max(), 1e-4)
    assert clearance(rows[-1]) > 1.5 * clearance(q)

    rates = np.diff(rows[::4], axis=0) / tuning.task_period
    assert np.abs(rates).max() < 2.0 * tuning.spare_joint_speed
    still = followed(q, replace(tuning, spare_joint_speed=0.0))
    assert clearance(still[-1]) < 1.1 * clearance(q)
