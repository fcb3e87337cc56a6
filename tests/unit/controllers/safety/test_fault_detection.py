"""What the monitor finds in readings made up for it, how soon, and what it lets pass."""

import re
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
import pytest

from at_rest import at_rest
from uuv import models
from uuv.controllers.hull.station_keeping import hull_inertia
from uuv.controllers.hull.thruster_lead import ThrusterLead, static_commands
from uuv.controllers.safety import sensor_checks
from uuv.controllers.safety.safety_wrapper import SafetyWrapper, SafetyWrapperState
from uuv.controllers.safety.sensor_checks import SensorCheck, SensorFinding
from uuv.controllers.tuning import FaultLimits
from uuv.models import hydrodynamics
from uuv.models.vehicle import Vehicle
from uuv.models.water.thruster_curves import thrust_at, thrust_in_flow
from uuv.models.water.thrusters import INFLOW_LOSS, curves, inflow_levers
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import (
    Command,
    Fault,
    FaultKind,
    HullLoad,
    Reference,
    StateEstimate,
    WorkState,
)
from uuv.sim.interfaces.spatial import Array, exp_so3, pose

DT = 0.002
SOUND = 10.0  # [s]
MODEL = models.load("uuv_puma").compile()
VEHICLE = Vehicle.of(MODEL)
N, M = len(VEHICLE.joints), len(VEHICLE.thruster_names)
COMMAND = np.array([0.7, -0.75, 0.65, 0.8, 0.7, -0.75])  # of the thrusters


REFERENCE = Reference.holding(
    0.0, pose(exp_so3([0.3, -0.2, 0.9]), [1.0, 2.0, -8.0]), np.zeros(N), state=WorkState.WORK
)


class Watch:
    """Fault detection in its safety wrapper, around a controller whose commands are given."""

    period = DT

    def __init__(self, limits: FaultLimits | None = None) -> None:
        self._wrapper = SafetyWrapper(self, MODEL, limits=limits)
        self._state: SafetyWrapperState | None = None
        self._command: Command | None = None

    def init(self, estimate: StateEstimate) -> None:
        """No state."""

    def step(
        self, state: None, estimate: StateEstimate, reference: Reference
    ) -> tuple[None, Command]:
        """The command that is given."""
        assert self._command is not None
        return None, self._command

    def take(self, estimate: StateEstimate, command: Command) -> tuple[Fault, ...]:
        """All faults after one more sample, and the command that followed from it."""
        self._command = command
        self._state = self._state or self._wrapper.init(estimate)
        return self._wrapper.step(self._state, estimate, REFERENCE)[1].faults

    @property
    def missing(self) -> Array:
        """Wrench (6,) [N, N m] that is missing on the hull."""
        assert self._state is not None
        assert self._state.health is not None
        return self._state.health.hull.missing


@dataclass
class Begun:
    """What a run goes on from: the watch, the generator of its noise, the motors' last torques."""

    watch: Watch
    rng: np.random.Generator
    motor: Array


@cache
def begun_soundly(command: bytes, seed: int) -> Begun:
    """The first SOUND seconds, which all runs under the same command of the thrusters share."""
    rig = Rig(seed=seed, command=np.frombuffer(command))
    begun = Begun(Watch(), np.random.default_rng(seed), np.zeros(N))
    assert rig.go_on(begun, 0.0, SOUND) == ()
    return begun


@dataclass
class Rig:
    """A vehicle at rest whose joints swing, with sensors of 1 % noise; readings pass through
    `torque` and `encoder`, from `since` [s] on.
    """

    torque: Callable[[float, Array], Array] = lambda _, tau: tau
    encoder: Callable[[float, Array, Array], tuple[Array, Array]] = lambda _, q, qd: (q, qd)
    velocity: Callable[[float], Array] = lambda _: np.zeros(6)  # of the hull (6,)
    seed: int = 1
    command: Array = field(default_factory=COMMAND.copy)  # of the thrusters
    since: float = SOUND  # [s] until when nothing is wrong

    def run(self, duration: float) -> tuple[Fault, ...]:
        if self.since < SOUND:
            return self.go_on(
                Begun(Watch(), np.random.default_rng(self.seed), np.zeros(N)), 0.0, duration
            )
        begun = deepcopy(begun_soundly(self.command.tobytes(), self.seed))
        return self.go_on(begun, SOUND, duration)

    def go_on(self, begun: Begun, begin: float, end: float) -> tuple[Fault, ...]:
        """All faults at the end of the samples from `begin` to `end` [s]."""
        watch, rng, motor = begun.watch, begun.rng, begun.motor
        thrust = np.array(
            [
                thrust_at(c, u)
                for c, u in zip(curves(VEHICLE.thruster_table), self.command, strict=True)
            ]
        )
        faults: tuple[Fault, ...] = ()
        phase = np.arange(N)
        for i in range(round(begin / DT), round(end / DT)):
            t = i * DT
            q, qd = 0.3 * np.sin(0.5 * t + phase), 0.15 * np.cos(0.5 * t + phase)
            qdd = -0.075 * np.sin(0.5 * t + phase)
            tau = motor - VEHICLE.armature * qdd - VEHICLE.joint_damping * qd
            tau = self.torque(t, tau * (1.0 + 0.01 * rng.standard_normal(N)) + 0.3)
            q, qd = self.encoder(t, np.round(q * 2**19) / 2**19, qd + 2e-4 * rng.standard_normal(N))
            nu = self.velocity(t)
            X = np.eye(4)
            estimate = StateEstimate(
                time=t,
                X_WB=X,
                v_WB_B=nu[:3],
                w_WB_B=nu[3:],
                a_WB_B=np.zeros(3),
                q=q,
                qd=qd,
                tau=tau,
            )
            motor = 0.3 * VEHICLE.torque_limits * np.sin(
                0.7 * t + phase
            ) + 0.01 * rng.standard_normal(N)
            # the thrusters bear it, the hull rests
            load = HullLoad(arm_wrench_B=-VEHICLE.thruster_wrench @ thrust)
            if i % 10:
                load = None
            command = Command(
                time=t, joint_torque=motor, thrusters=self.command, scan=False, hull_load=load
            )
            faults = watch.take(estimate, command)
        begun.motor = motor
        return faults


def stuck(since: float, joint: int) -> Callable[[float, Array], Array]:
    """Torque readings of which one stands still from `since` [s] on."""
    errors: list[float] = []

    def change(t: float, tau: Array) -> Array:
        tau = np.array(tau)
        if t >= since:
            errors.append(tau[joint])
            tau[joint] = errors[0]
        return tau

    return change


@pytest.mark.seeds(1)
def test_sound_readings_are_let_pass(seed: int):
    assert Rig(seed=seed).run(40.0) == ()


@pytest.mark.parametrize("joint", range(N))
def test_a_frozen_torque_sensor_is_found_after_the_time_that_it_may_stand_still(joint: int):
    (fault,) = Rig(torque=stuck(10.0, joint)).run(11.0)
    assert (fault.kind, fault.index, fault.part) == (
        FaultKind.TORQUE_SENSOR,
        joint,
        VEHICLE.joint_names[joint],
    )
    assert 0.0 < fault.time - 10.0 - FaultLimits().frozen_time < 3.0 * DT


def test_a_sensor_of_coarse_steps_is_not_taken_for_frozen():
    """Steps of 2 N m: it stands still for long while it is sound, and that is learned."""
    assert Rig(torque=lambda _, tau: 2.0 * np.round(0.5 * tau), since=0.0).run(40.0) == ()


def test_a_drifting_torque_sensor_is_found_when_it_is_out_of_bounds():
    joint, rate, limits = 1, 5.0, FaultLimits()

    def drift(t: float, tau: Array) -> Array:
        return tau + (np.arange(N) == joint) * rate * max(t - 10.0, 0.0)

    (fault,) = Rig(torque=drift).run(20.0)
    assert (fault.kind, fault.index) == (FaultKind.TORQUE_SENSOR, joint)
    least = limits.torque_floor * VEHICLE.torque_limits[joint]
    least += limits.friction * VEHICLE.dry_friction.stiction[joint]
    most = least + limits.torque_share * (0.3 * VEHICLE.torque_limits[joint] + rate * 10.0)
    # Learning takes part of the drift for usual, up to half the bound; then filter and
    # confirmation.
    assert (
        least / rate
        < fault.time - 10.0
        < 1.6 * most / rate + limits.torque_time + limits.torque_confirm
    )


def test_an_encoder_whose_angle_stands_still_is_found_by_its_speed():
    joint, errors = 2, []

    def encoder(t: float, q: Array, qd: Array) -> tuple[Array, Array]:
        q = np.array(q)
        if t >= 10.0:
            errors.append((q[joint], qd[joint]))
            q[joint] = errors[0][0]
        return q, qd

    (fault,) = Rig(encoder=encoder).run(12.0)
    assert (fault.kind, fault.index) == (FaultKind.ENCODER, joint)
    run = np.cumsum([abs(speed) * DT for _, speed in errors])  # what the joint has moved unseen
    expected = 10.0 + DT * int(np.argmax(run > FaultLimits().encoder_slip))
    assert expected - DT <= fault.time < expected + 0.05  # the comparison forgets, a little


def test_an_encoder_that_stands_still_whole_is_found():
    errors = []

    def encoder(t: float, q: Array, qd: Array) -> tuple[Array, Array]:
        q, qd = np.array(q), np.array(qd)
        if t >= 10.0:
            errors.append((q[2], qd[2]))
            q[2], qd[2] = errors[0]
        return q, qd

    faults = Rig(encoder=encoder).run(11.0)
    assert (faults[0].kind, faults[0].index) == (FaultKind.ENCODER, 2)
    assert faults[0].time - 10.0 < FaultLimits().frozen_encoder_time + 3.0 * DT


def accelerated(
    force_B: Array, since: float = 10.0, rise: float = 0.15
) -> Callable[[float], Array]:
    """Velocity of the hull alone that a wrench (6,) begins to push at `since` with a first-order
    lag, without drag.
    """
    gained = np.linalg.solve(hull_inertia(MODEL, VEHICLE.hull, 1.0), force_B)

    def velocity(t: float) -> Array:
        s = max(t - since, 0.0)
        return gained * (s - rise * (1.0 - np.exp(-s / rise)))

    return velocity


def in_flow(thruster: int, command: float, nu_r_B: Array) -> float:
    """Thrust [N] at a steady command while the hull moves through the water."""
    table = VEHICLE.thruster_table
    inflow = float(inflow_levers(table, VEHICLE.thruster_wrench)[:, thruster] @ nu_r_B)
    return float(
        thrust_in_flow(curves(table)[thruster], table[thruster, INFLOW_LOSS], inflow, command)
    )


def test_thrust_is_predicted_in_the_inflow(rng: np.random.Generator, within: Any):
    """What the controller asks for on top, so that a current takes nothing, is not a thrust that is
    missing.
    """
    current, thrust, w = (
        rng.uniform(-0.6, 0.6, 3),
        rng.uniform(-60.0, 60.0, M),
        rng.uniform(-0.2, 0.2, 3),
    )
    X_WB = pose(exp_so3(rng.uniform(-1.0, 1.0, 3)))
    nu_r_B = np.concatenate([-X_WB[:3, :3].T @ current, w])
    static = static_commands(ThrusterLead(VEHICLE).propellers, thrust, nu_r_B)

    def missing(commands: Array, arm_wrench_B: Array) -> Array:
        watch = Watch()
        for t in np.arange(0.0, 3.0, 0.02):
            load = HullLoad(arm_wrench_B=arm_wrench_B, current_W=current)
            command = Command(
                time=t, joint_torque=np.zeros(N), thrusters=commands, scan=False, hull_load=load
            )
            watch.take(at_rest(time=float(t), X_WB=X_WB, w_WB_B=w), command)
        return watch.missing

    drag = missing(np.zeros(M), np.zeros(6))
    within("missing [N, N m]", missing(static, -VEHICLE.thruster_wrench @ thrust) - drag, 1e-3)


def test_what_is_missing_is_the_balance_of_momentum(rng: np.random.Generator, within: Any):
    """A hull that flies a steady curve askew through a current: Kirchhoff's equations with drag, in
    vectors.
    """
    X_WB, current_W = pose(exp_so3(rng.uniform(-1.0, 1.0, 3))), rng.uniform(-0.4, 0.4, 3)
    v, w, arm_B = rng.uniform(-0.5, 0.5, 3), rng.uniform(-0.3, 0.3, 3), rng.uniform(-20.0, 20.0, 6)
    watch = Watch()
    for t in np.arange(0.0, 6.0, 0.02):
        load = HullLoad(arm_wrench_B=arm_B, current_W=current_W)
        command = Command(
            time=t, joint_torque=np.zeros(N), thrusters=np.zeros(M), scan=False, hull_load=load
        )
        watch.take(at_rest(time=float(t), X_WB=X_WB, v_WB_B=v, w_WB_B=w), command)

    water = hydrodynamics.unpack(MODEL.body_user[VEHICLE.hull])
    nu, flow = np.concatenate([v, w]), np.concatenate([X_WB[:3, :3].T @ current_W, np.zeros(3)])
    nu_r = nu - flow
    momentum = hull_inertia(MODEL, VEHICLE.hull, 1.0) @ nu - water.added_mass @ flow
    turned = np.concatenate(
        [np.cross(w, momentum[:3]), np.cross(w, momentum[3:]) + np.cross(nu_r[:3], momentum[:3])]
    )
    drag = water.linear_damping @ nu_r + water.quadratic_damping * np.abs(nu_r) * nu_r
    thrust = np.array([in_flow(i, 0.0, nu_r) for i in range(M)])
    residual = turned + drag - arm_B - VEHICLE.thruster_wrench @ thrust
    assert np.linalg.norm(turned) > 1.0
    within("missing [N, N m]", watch.missing - residual, 1e-5)


@pytest.mark.parametrize("thruster", range(M))
def test_a_lost_thruster_is_found_and_named_later_where_it_does_not_turn_the_hull(thruster: int):
    thrust = thrust_at(curves(VEHICLE.thruster_table)[thruster], COMMAND[thruster])
    column = VEHICLE.thruster_wrench[:, thruster]
    alone = np.where(np.arange(M) == thruster, COMMAND, 0.3 * COMMAND)
    velocity = accelerated(-thrust * column)
    (fault,) = Rig(velocity=velocity, command=alone).run(12.0)
    assert (fault.kind, fault.index) == (FaultKind.THRUSTER, thruster)
    limits, turns = FaultLimits(), np.linalg.norm(column[3:]) > 0.1 * np.linalg.norm(column[:3])
    if not turns:  # it is probed
        (missing,) = (float(word) for word in re.findall(r"([-\d]+)%", fault.figures))
        assert missing == pytest.approx(100.0, abs=15.0)
        assert (
            2.0 * limits.probe_time
            < fault.time - 10.0 - limits.current_confirm
            < 2.0 * limits.probe_time + 0.65
        )
        return
    gave, expected = (float(word) for word in re.findall(r"([-\d]+) N", fault.figures))
    assert expected == pytest.approx(
        in_flow(thruster, COMMAND[thruster], velocity(fault.time)), abs=1.0
    )
    assert abs(gave) < 0.5 * abs(expected)  # what is left, as it was judged then
    assert limits.thruster_confirm < fault.time - 10.0 < limits.thruster_confirm + 0.65


@pytest.mark.parametrize("end", [-1.0, 1.0])
@pytest.mark.parametrize("name", ["surge_left", "heave_front", "heave_right"])
def test_a_thruster_stuck_at_full_thrust_is_found_with_what_it_gives(name: str, end: float, within):
    thruster = VEHICLE.thruster_names.index(name)
    curve = curves(VEHICLE.thruster_table)[thruster]
    gives, expected = thrust_at(curve, end), thrust_at(curve, 0.3 * COMMAND[thruster])
    pushed = accelerated((gives - expected) * VEHICLE.thruster_wrench[:, thruster])
    (fault,) = Rig(velocity=pushed, command=0.3 * COMMAND).run(12.0)
    assert (fault.kind, fault.index) == (FaultKind.THRUSTER, thruster)
    within("time to find it [s]", fault.time - 10.0, 1.0)
    # as it has grown through the filter till then
    within("share of its thrust", fault.thrust / gives - 1.0, 0.35)


def test_a_push_that_is_learnt_for_a_current_is_no_lost_thruster():
    """As large as the sway thruster's own, and gone after 0.3 s."""
    sway = VEHICLE.thruster_names.index("sway")
    thrust = thrust_at(curves(VEHICLE.thruster_table)[sway], COMMAND[sway])
    pushed = accelerated(-thrust * VEHICLE.thruster_wrench[:, sway])
    alone = np.where(np.arange(M) == sway, COMMAND, 0.3 * COMMAND)
    assert Rig(velocity=lambda t: pushed(min(t, 10.3)), command=alone).run(12.0) == ()


@pytest.mark.parametrize("axis", range(3))
def test_a_push_on_the_hull_is_no_lost_thruster(axis: int):
    assert Rig(velocity=accelerated(80.0 * np.eye(6)[axis])).run(11.5) == ()
    assert Rig(velocity=accelerated(-80.0 * np.eye(6)[axis])).run(11.5) == ()


def test_old_vision_is_a_fault_until_it_is_new_again():
    watch = Watch()
    command = Command(time=0.0, joint_torque=np.zeros(N), thrusters=np.zeros(M), scan=False)

    def look(k: int, age: float) -> list[FaultKind]:
        estimate = at_rest(time=k * DT, vision_age=age)
        return [fault.kind for fault in watch.take(estimate, command)]

    ages = (0.3, 1.1, 2.0, 0.2, float("nan"))
    samples = [look(k, age) for k, age in enumerate(ages)]
    assert samples == [[], [FaultKind.VISION], [FaultKind.VISION], [], []]


def test_a_jump_of_the_accelerometer_is_told_once_at_its_time_and_stays():
    watch, ages = Watch(), (np.nan, np.inf, 0.5, 1.5)
    faults = []
    for k, age in enumerate(ages):
        load = HullLoad(arm_wrench_B=np.zeros(6))
        command = Command(
            time=float(k),
            joint_torque=np.zeros(N),
            thrusters=np.zeros(M),
            scan=False,
            hull_load=load,
        )
        faults.append(watch.take(at_rest(time=float(k), imu_jump_age=age), command))
    assert faults[:2] == [(), ()]
    (fault,) = faults[2]
    assert (fault.kind, fault.part, fault.time) == (FaultKind.IMU, "accelerometer", 1.5)
    assert faults[3] == faults[2]


def test_limits_are_positive():
    with pytest.raises(ConfigurationError, match="torque_time"):
        FaultLimits(torque_time=0.0)
    with pytest.raises(ConfigurationError, match="lever"):
        FaultLimits(lever=float("nan"))


@pytest.mark.parametrize("field", ["position_sigma", "gyro_off_B", "attitude_off_B"])
@pytest.mark.parametrize("axis", range(3))
def test_an_entry_of_any_row_makes_the_tick_ask_for_faults(monkeypatch, field: str, axis: int):
    """A row of one's own, quiet at 0.5, that finds a fault whenever it is asked."""
    check = SensorCheck(
        FaultKind.IMU,
        lambda now: iter([SensorFinding("asked", -1, now.time, "")]),
        lambda record: record.position_sigma,
        quiet=0.5,
    )
    monkeypatch.setattr(sensor_checks, "SENSOR_CHECKS", (check, *sensor_checks.SENSOR_CHECKS[1:]))
    watch, named = Watch(), []
    for k in range(3):
        load = HullLoad(arm_wrench_B=np.zeros(6))
        command = Command(
            time=0.02 * k,
            joint_torque=np.zeros(N),
            thrusters=np.zeros(M),
            scan=False,
            hull_load=load,
        )
        entries = {"position_sigma": np.full(3, 0.5), "gyro_off_B": np.zeros(3)}
        entries["attitude_off_B"] = np.zeros(3)
        entries[field][axis] += 0.1 if k == 2 else 0.0
        faults = watch.take(at_rest(time=0.02 * k, **entries), command)
        named.append([fault.part for fault in faults if fault.kind is FaultKind.IMU])
    assert named == [[], [], ["asked"]]
