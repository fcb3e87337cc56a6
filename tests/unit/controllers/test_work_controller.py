"""The controller of contact work, one step at a time: what it makes of exact readings is known to
the last digit.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from uuv import models
from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.mkps import Chain
from uuv.controllers.whole_body.work_controller import WorkController
from uuv.models.naming import ARM_BASE_BODY, TIP_SITE
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import Reference, StateEstimate, WorkState
from uuv.sim.interfaces.spatial import Array, exp_so3, log_so3, pose

OWN = models.load("uuv_puma").compile()
VEHICLE = Vehicle.of(OWN)
N = VEHICLE.joints.size
ARM = ArmDynamics(OWN)
STILL = np.zeros(3)
HELD = np.zeros(N)
AT_REST = {"nu_B": np.zeros(6), "a_B": np.zeros(6), "v_current_W": STILL}


@pytest.fixture(scope="module")
def controller() -> WorkController:
    return WorkController(OWN)


@pytest.fixture(scope="module")
def chain() -> Chain:
    passive = [
        OWN.joint(j).name
        for j in range(OWN.njnt)
        if j not in VEHICLE.joints and OWN.jnt_type[j] != 0
    ]
    return Chain.from_mjcf(OWN, ARM_BASE_BODY, TIP_SITE, exclude=passive)


def estimate(X_WB: Array, q: Array, tau: Array, qd: Array = HELD) -> StateEstimate:
    return StateEstimate(
        time=0.0, X_WB=X_WB, v_WB_B=STILL, w_WB_B=STILL, a_WB_B=STILL, q=q, qd=qd, tau=np.array(tau)
    )


def reference(X_WB: Array, q: Array, X_WG: Array | None = None, force: float = 0.0) -> Reference:
    return Reference.holding(0.0, X_WB, q, state=WorkState.WORK, X_WG=X_WG, set_force=force)


def anywhere(rng: np.random.Generator) -> Array:
    return pose(exp_so3(rng.uniform(-0.4, 0.4, 3)), rng.uniform(-2.0, 2.0, 3))


def begin_anew(state: Any, begun: Any) -> None:
    """Set the arrays of a state, in place, to those of another one."""
    for mine, other in zip(state, begun, strict=True):
        if isinstance(mine, tuple):
            begin_anew(mine, other)
        else:
            mine[...] = other


def test_the_thrusters_cancel_the_arms_wrench_weight_motion_water_and_contact(
    controller, chain, rng, within
):
    """From torques of a moving arm under a known push: the wrench is that of the inverse dynamics
    with that push.
    """
    X_WB = anywhere(rng)
    q = VEHICLE.q_ready + rng.uniform(-0.2, 0.2, N)
    qd = rng.uniform(-0.6, 0.6, N)
    push_G = np.array([*rng.uniform(-25.0, 25.0, 2), -60.0])
    attitude = AT_REST | {"R_WB": X_WB[:3, :3]}
    tau, wrench_B = ARM.inverse(
        q, qd, HELD, wrench_tip_G=np.array([*push_G, 0.0, 0.0, 0.0]), **attitude
    )
    free_B = ARM.inverse(q, qd, HELD, wrench_tip_G=np.zeros(6), **attitude)[1]
    assert np.linalg.norm((wrench_B - free_B)[3:]) > 10.0
    R_WG = (X_WB @ VEHICLE.X_BA @ chain.forward(q))[:3, :3]
    measured = estimate(X_WB, q, tau, qd)
    for force, expected in ((60.0, wrench_B), (0.0, free_B)):
        state = controller.init(measured)
        state, command = controller.step(state, measured, reference(X_WB, q, force=force))
        static_B = controller._hull.station.static_wrench(X_WB[:3, :3])
        left = command.believed["hover_wrench_B"] + command.hull_load.arm_wrench_B + static_B
        within("left for the hull, at the place wanted [N, N m]", left, 1e-9)
        for _ in range(110):  # the filter of the felt force settles to 2e-9
            # The thrusters' lag would be taken for a current.
            begin_anew(state.hull.station, controller.init(measured).hull.station)
            state, command = controller.step(state, measured, reference(X_WB, q, force=force))
        within("arm's wrench on the hull [N, N m]", command.hull_load.arm_wrench_B - expected, 1e-3)
        within("felt force [N]", command.contact.force_W - R_WG @ push_G, 1e-3)


def test_the_tool_stays_where_it_was_asked_to_be_while_the_hull_is_elsewhere(
    controller, chain, rng, within
):
    """The drift correction p*_C = R^T (p*_O - r), for a hull that is off by centimetres and
    degrees.
    """
    X_WB = anywhere(rng)
    drifted = X_WB @ pose(exp_so3(rng.uniform(-0.04, 0.04, 3)), rng.uniform(-0.05, 0.05, 3))
    X_WG = X_WB @ VEHICLE.X_BA @ chain.forward(VEHICLE.q_ready)
    measured = estimate(
        drifted,
        VEHICLE.q_ready,
        ARM.inverse(
            VEHICLE.q_ready, HELD, HELD, R_WB=drifted[:3, :3], wrench_tip_G=np.zeros(6), **AT_REST
        )[0],
    )
    state = controller.init(measured)
    setpoint = reference(X_WB, VEHICLE.q_ready, X_WG)
    for _ in range(2500):  # 5 s: the blend from the held angles has died away
        state, _ = controller.step(state, measured, setpoint)
    reached = drifted @ VEHICLE.X_BA @ chain.forward(state.tool.motion.q)
    within("tool [m]", reached[:3, 3] - X_WG[:3, 3], 2e-6)
    within("tool [rad]", log_so3(reached[:3, :3].T @ X_WG[:3, :3]), 2e-5)


def test_joint_angles_are_found_to_a_micrometre_and_ten_microradians(controller, chain, rng):
    """What the joint servo is asked for may not be off by what the force loop would then feel: 30 N
    on 3e4 N/m a mm.
    """
    worst = np.zeros(2)
    for i in range(200):
        aside = 10.0 ** rng.uniform(-5.0, -0.5) * rng.uniform(-1.0, 1.0, N)
        if i % 2:  # the tool turned about itself: no place tells of it
            aside[:-1] = 0.0
        q = VEHICLE.q_ready + aside
        X_WB = anywhere(rng)
        measured = estimate(X_WB, VEHICLE.q_ready, HELD)
        setpoint = reference(X_WB, VEHICLE.q_ready, X_WB @ VEHICLE.X_BA @ chain.forward(q))
        _, command = controller.step(controller.init(measured), measured, setpoint)
        worst = np.maximum(worst, command.believed["ik_error"])
    assert np.all(worst <= [1e-6, 1e-5]), worst
    assert np.all(worst > [1e-7, 1e-6]), worst  # and they are not idle


def test_what_the_gears_lose_the_motors_give(controller, rng, within):
    """With any friction below stiction the torque beyond the gears is what it is without, one
    filter time later.
    """
    lost = rng.uniform(-1.0, 1.0, N) * VEHICLE.dry_friction.stiction
    X_WB = anywhere(rng)
    q = np.array(VEHICLE.q_ready)
    tau = ARM.inverse(q, HELD, HELD, R_WB=X_WB[:3, :3], wrench_tip_G=np.zeros(6), **AT_REST)[0]
    passed = []
    for friction in (np.zeros(N), lost):
        measured = estimate(X_WB, q, tau)
        state = controller.init(measured)
        for _ in range(60):
            state, command = controller.step(state, measured, reference(X_WB, q))
            measured = replace(measured, tau=command.joint_torque - friction)
        passed.append(measured.tau)
    assert np.abs(lost).max() > 0.5
    within("torque beyond the gears [N m]", passed[1] - passed[0], 1e-6)


def test_an_array_of_the_state_that_was_replaced_is_refused(controller):
    """Before the first step it is bound as it is; after that it may be written into."""
    asked = reference(pose(exp_so3([0.1, -0.2, 0.4]), [1.0, 2.0, -3.0]), VEHICLE.q_ready)
    now = estimate(asked.X_WB, VEHICLE.q_ready, np.zeros(N))
    for part, name in (("", "integral"), ("hull", "stuck_B"), ("tool", "motion"), ("tool", "X_AG")):
        state = controller.init(now)
        owner = getattr(state, part) if part else state

        def replaced(owner: Any = owner, name: str = name) -> None:
            value = getattr(owner, name)
            one_array = isinstance(value, np.ndarray)
            other = value.copy() if one_array else type(value)(*map(np.copy, value))
            setattr(owner, name, other)

        replaced()
        state = controller.step(state, now, asked)[0]
        value = getattr(owner, name)
        (value if isinstance(value, np.ndarray) else value[0])[...] = 0.0
        state = controller.step(state, now, asked)[0]
        replaced()
        with pytest.raises(ConfigurationError, match=rf"State\.{name}: must not be replaced"):
            controller.step(state, now, asked)
