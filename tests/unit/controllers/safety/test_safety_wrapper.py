"""The guard: a sound run passes untouched, and whatever else comes, what goes out are numbers."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from uuv import models
from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.safety.blind_departure import BlindDeparture, HeldHull, follow
from uuv.controllers.safety.safety_wrapper import SafetyWrapper
from uuv.controllers.tuning import SAFETY, FaultLimits
from uuv.models.vehicle import Vehicle
from uuv.models.water.thrusters import curves
from uuv.sim.interfaces.kernels.control import commanded
from uuv.sim.interfaces.messages import (
    AbortCode,
    Command,
    ContactEstimate,
    Fault,
    FaultKind,
    Reference,
    StateEstimate,
    WorkState,
)
from uuv.sim.interfaces.records import reference_record
from uuv.sim.interfaces.spatial import Array

DT = 0.002
MODEL = models.load("uuv_puma").compile()
VEHICLE = Vehicle.of(MODEL)
N, M = len(VEHICLE.joints), len(VEHICLE.thruster_names)
REFERENCE = Reference.holding(0.0, np.eye(4), np.zeros(N), state=WorkState.WORK)


@dataclass
class Inner:
    """A controller that commands what it counts, and no numbers from its `breaks`-th step on."""

    period: float = DT
    breaks: int = 10**9
    seen: Any = None

    def init(self, estimate: StateEstimate) -> int:
        self.seen = estimate
        return 0

    def step(
        self, state: int, estimate: StateEstimate, reference: Reference
    ) -> tuple[int, Command]:
        self.seen = estimate
        assert reference is REFERENCE
        value = np.nan if state + 1 >= self.breaks else 0.01 * state
        return state + 1, Command(
            time=estimate.time,
            joint_torque=np.full(N, value),
            thrusters=np.full(M, 0.5),
            scan=False,
            contact=ContactEstimate(normal=7.0),
        )


def estimate(i: int, **changed: Any) -> StateEstimate:
    rng = np.random.default_rng(i)
    sound = StateEstimate(
        time=i * DT,
        X_WB=np.eye(4),
        v_WB_B=np.zeros(3),
        w_WB_B=np.zeros(3),
        a_WB_B=np.zeros(3),
        q=np.array(VEHICLE.q_home) + 1e-5 * rng.standard_normal(N),
        qd=1e-3 * rng.standard_normal(N),
        tau=rng.standard_normal(N),
    )
    return replace(sound, **changed)


def run(estimates: list[StateEstimate], inner: Inner | None = None) -> list[Command]:
    guarded = SafetyWrapper(inner or Inner(), MODEL)
    state = guarded.init(estimates[0])
    commands = []
    for one in estimates:
        state, command = guarded.step(state, one, REFERENCE)
        assert np.isfinite(command.joint_torque).all()
        assert np.isfinite(command.thrusters).all()
        assert np.all(np.abs(command.joint_torque) <= VEHICLE.torque_limits)
        commands.append(command)
    return commands


def kinds(command: Command) -> list[FaultKind]:
    return [fault.kind for fault in command.faults]


def departing() -> Array:
    """Thrusters (m,) of a departure, after commands of `Inner`."""
    departure = BlindDeparture(MODEL, VEHICLE, ArmDynamics(MODEL))
    command = Inner().step(0, estimate(0), REFERENCE)[1]
    held, seen = HeldHull.start(M), commanded(N, M)
    seen.thrusters[:] = command.thrusters
    thrust = curves(VEHICLE.thruster_table)
    follow(thrust, SAFETY.balance_time, seen, reference_record(N), 0.0, held)
    return departure.stages(held, estimate(0), ())[0].thrusters


def test_a_sound_run_passes_untouched():
    commands = run([estimate(i) for i in range(50)])
    assert [c.joint_torque[0] for c in commands] == [0.01 * i for i in range(50)]
    assert all(c.faults == () and c.contact.normal == 7.0 for c in commands)


@pytest.mark.parametrize("name", ["X_WB", "v_WB_B", "w_WB_B", "a_WB_B", "q", "qd", "time"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_no_numbers_anywhere_in_the_estimate_end_in_brakes_and_a_departure(name: str, value: float):
    broken = np.array(getattr(estimate(0), name))
    broken[(0,) * broken.ndim] = value
    bad = {name: broken if broken.ndim else float(broken)}
    commands = run([estimate(i) if i < 20 else estimate(i, **bad) for i in range(60)])
    for command in commands[20:30]:  # patience: the last sound command again
        assert command.joint_torque[0] == 0.01 * 19
        assert command.thrusters[0] == 0.5
    assert kinds(commands[-1]) == [FaultKind.ESTIMATE]
    assert commands[-1].faults[0].time == pytest.approx(20 * DT + 0.03, abs=2 * DT)
    assert np.array_equal(commands[-1].thrusters, departing())
    assert commands[-1].contact.normal == 0.0


def test_a_few_missing_numbers_are_passed_over():
    commands = run(
        [estimate(i, q=np.full(N, np.nan)) if 20 <= i < 30 else estimate(i) for i in range(60)]
    )
    assert all(c.faults == () for c in commands)
    assert commands[-1].joint_torque[0] == pytest.approx(0.01 * 49)  # ten steps were left out


def test_a_drive_without_its_encoder_bears_the_weight_and_no_more():
    """Whatever the controller makes of an angle that stands still; the other drives do as it
    says.
    """
    joint, limits = 1, FaultLimits(warm_up=0.1)

    def frozen(i: int) -> StateEstimate:
        now, then = estimate(i), estimate(min(i, 100))
        stuck = np.arange(N) == joint
        return replace(now, q=np.where(stuck, then.q, now.q), qd=np.where(stuck, then.qd, now.qd))

    guarded, commands = SafetyWrapper(Inner(), MODEL, limits=limits), []
    state = guarded.init(estimate(0))
    for i in range(150):
        state, command = guarded.step(state, frozen(i), REFERENCE)
        commands.append(command)
    found = next(i for i, command in enumerate(commands) if command.faults)
    assert 0.0 < (found - 100) * DT - limits.frozen_encoder_time < 3.0 * DT
    assert [fault.index for fault in commands[-1].faults] == [joint]
    rest = np.zeros(N)
    borne = ArmDynamics(MODEL).inverse(
        frozen(149).q,
        rest,
        rest,
        R_WB=np.eye(3),
        nu_B=np.zeros(6),
        a_B=np.zeros(6),
        v_current_W=np.zeros(3),
        wrench_tip_G=np.zeros(6),
    )[0]
    assert abs(borne[joint]) > 5.0
    assert commands[-1].joint_torque[joint] == borne[joint]
    assert np.all(np.delete(commands[-1].joint_torque, joint) == 0.01 * 149)


def test_an_estimate_whose_time_stands_still_is_lost():
    commands = run([estimate(min(i, 20)) for i in range(60)])
    assert kinds(commands[-1]) == [FaultKind.ESTIMATE]
    assert np.array_equal(commands[-1].thrusters, departing())


def test_an_estimate_without_its_inertial_unit_is_lost():
    commands = run([estimate(i, imu_age=max(i - 20, 0) * DT) for i in range(100)])
    assert commands[69].faults == ()
    assert kinds(commands[-1]) == [FaultKind.ESTIMATE]


def test_a_slower_estimator_is_not():
    assert run([estimate(4 * (i // 4)) for i in range(100)])[-1].faults == ()


def test_a_controller_of_no_numbers_is_replaced_for_good():
    commands = run([estimate(i) for i in range(60)], Inner(breaks=20))
    assert kinds(commands[-1]) == [FaultKind.CONTROLLER]
    assert np.array_equal(commands[-1].thrusters, departing())


def test_brakes_act_against_the_motion_and_bear_the_weight():
    still = run(
        [
            estimate(i) if i < 20 else estimate(i, a_WB_B=np.full(3, np.nan), qd=np.zeros(N))
            for i in range(60)
        ]
    )
    fast = np.array([0.1, -0.1, 0.1, -0.1, 0.1, -0.1])
    moving = run(
        [
            estimate(i) if i < 20 else estimate(i, a_WB_B=np.full(3, np.nan), qd=fast)
            for i in range(60)
        ]
    )
    brake = moving[-1].joint_torque - still[-1].joint_torque
    assert np.allclose(brake, -0.5 * VEHICLE.torque_limits * fast / 0.4, rtol=0.0, atol=1e-9)
    assert np.abs(still[-1].joint_torque).max() > 1.0  # the arm is heavy in water


def test_a_torque_that_is_no_number_is_its_sensors_fault_alone():
    inner = Inner()
    tau = np.ones(N)
    tau[2] = np.nan
    commands = run([estimate(i) if i < 20 else estimate(i, tau=tau) for i in range(60)], inner)
    assert [(f.kind, f.index) for f in commands[-1].faults] == [(FaultKind.TORQUE_SENSOR, 2)]
    assert commands[-1].joint_torque[0] == 0.01 * 59
    assert np.isfinite(inner.seen.tau).all()


def test_a_torque_sensor_found_wrong_is_replaced_by_its_motor():
    inner = Inner()
    guarded = SafetyWrapper(inner, MODEL)
    state = guarded.init(estimate(0))
    state, command = guarded.step(state, estimate(0), REFERENCE)
    tau = estimate(0).tau
    for i in range(1, 2600):
        # what the motors were asked for, and an offset
        tau = estimate(i).tau + 0.01 * max(i - 1, 0) + 3.0
        state, command = guarded.step(state, estimate(i, tau=np.array(tau)), REFERENCE)
    assert command.faults == ()
    assert state.health is not None
    state.health.faults.append(Fault(kind=FaultKind.TORQUE_SENSOR, part="", index=1, time=0.0))
    wrong = np.array(tau)
    wrong[1] = -400.0
    guarded.step(state, estimate(2600, tau=wrong), REFERENCE)
    assert np.array_equal(np.delete(inner.seen.tau, 1), np.delete(wrong, 1))
    # Its noise of 1 N m, averaged, is what remains.
    assert inner.seen.tau[1] == pytest.approx(0.01 * 2599 + 3.0, abs=0.5)
    # A rotor that is being accelerated, and its gear, take their share of what the motor gives.
    steady, faster = inner.seen.tau[1], np.array(estimate(2601).qd)
    faster[1] += 0.2
    taken = VEHICLE.armature[1] / FaultLimits().torque_time + VEHICLE.joint_damping[1]
    guarded.step(state, estimate(2601, tau=wrong, qd=faster), REFERENCE)
    assert steady - inner.seen.tau[1] == pytest.approx(0.2 * taken, abs=0.05 * taken)


def test_the_arm_gives_way_once_the_work_is_broken_off(within):
    """Beyond the arm's weight each drive bears what 50 N at the tip need of it, whatever the
    controller asks for.
    """
    most, arm = SAFETY.gentle_force, ArmDynamics(MODEL)
    one = estimate(0, qd=np.zeros(N))

    class Strong(Inner):
        def step(
            self, state: int, estimate: StateEstimate, reference: Reference
        ) -> tuple[int, Command]:
            command = Command(
                time=estimate.time, joint_torque=1e4 * np.ones(N), thrusters=np.zeros(M), scan=False
            )
            return state, command

    guarded = SafetyWrapper(Strong(), MODEL)
    torque = {
        abort: guarded.step(guarded.init(one), one, replace(REFERENCE, abort=abort))[1].joint_torque
        for abort in (None, AbortCode.THRUSTER)
    }
    assert np.all(torque[None] == 1e4)
    J = arm.tip(one.q)[1][:3]
    rest, none = np.zeros(N), np.zeros(6)
    borne = arm.inverse(
        one.q,
        rest,
        rest,
        R_WB=np.eye(3),
        nu_B=none,
        a_B=none,
        v_current_W=none[:3],
        wrench_tip_G=none,
    )[0]
    excess = torque[AbortCode.THRUSTER] - borne
    lever = np.maximum(np.linalg.norm(J, axis=0), 0.1)
    within(
        "torque over what the force needs", float(np.abs(excess / (most * lever) - 1.0).max()), 1e-9
    )
