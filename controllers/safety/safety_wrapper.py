"""A controller between two doors: what goes in is sound as far as can be known, what comes out are numbers.

Wraps any controller (`sim.interfaces.protocols.Controller`):
- every step the vehicle's health is looked at (`controllers.safety.fault_detection`), and what is wrong goes out with
  the command;
- a torque sensor found wrong, or that shows no number, is replaced by its motor: what the drive is asked for, less
  rotor inertia and friction, with the offset that the sensor had against it while it was sound;
- a drive whose encoder is found wrong cannot be servoed: it only bears the arm's weight, so that it gives way to what
  the tool touches, and its gear's friction holds it;
- an estimate with numbers that are none, or whose time stands still, never reaches the controller. For `patience` the
  last command is repeated; after that the arm is braked and the thrusters are stopped, for good. The same holds for
  a controller whose own commands are not numbers.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from controllers.arm.inverse_dynamics import ArmDynamics
from controllers.safety.fault_detection import FaultDetection, FaultDetectionState, Limits, finite
from models.vehicle import Vehicle
from sim.interfaces.messages import Command, Fault, FaultKind, Reference, StateEstimate
from sim.interfaces.protocols import Controller
from sim.interfaces.spatial import Array

_LEFT_OUT = 1e3  # [N m] of doubt: nothing is felt through that joint
_OLD_IMU = 0.1  # [s] without the inertial unit after which an estimate of the hull is a guess
_BRAKING_SPEED = 0.4  # [rad/s] at which a drive brakes
_BRAKING_SHARE = 0.5  # with this share of its torque limit


@dataclass(slots=True, eq=False)
class SafetyWrapperState:
    """Memory of the guard; `inner` is the controller's own."""

    inner: Any
    health: FaultDetectionState | None  # from the first sound estimate on
    time: float  # [s] of the last estimate
    sound: StateEstimate  # the last one that was
    command: Command  # the last one that was
    blind_for: float = 0.0  # [s] without a sound estimate, or command
    stopped: Fault | None = None


class SafetyWrapper:
    """A controller with its guard (`sim.interfaces.protocols.Controller`)."""

    def __init__(
        self, controller: Controller, model: mujoco.MjModel, *, patience: float = 0.03, limits: Limits | None = None
    ) -> None:
        """Take the controller, its own model of the vehicle, and the time [s] for which it may be blind."""
        self.period = controller.period
        self._controller, self._patience = controller, patience
        vehicle = Vehicle.of(model)
        self._limits = np.array(vehicle.torque_limits)
        self._armed = vehicle.joints.size > 0
        self._arm = ArmDynamics(model) if self._armed else None
        self._armature, self._damping = np.array(vehicle.armature), np.array(vehicle.joint_damping)
        self._health = FaultDetection(model, period=controller.period, limits=limits)
        self._thrusters = len(vehicle.thruster_names)

    def init(self, estimate: StateEstimate) -> SafetyWrapperState:
        n = len(self._limits)
        still = Command(
            time=estimate.time,
            joint_torque=np.zeros(n),
            thrusters=np.zeros(self._thrusters),
            scan=False,
            felt_normal=0.0,
        )
        return SafetyWrapperState(
            inner=self._controller.init(estimate), health=None, time=-np.inf, sound=estimate, command=still
        )

    def step(
        self, state: SafetyWrapperState, estimate: StateEstimate, reference: Reference
    ) -> tuple[SafetyWrapperState, Command]:
        """As the controller's; what is no number neither raises here nor is commanded."""
        e = estimate
        if state.stopped is not None or not finite(e.X_WB, e.v_WB_B, e.w_WB_B, e.a_WB_B, e.q, e.qd, e.time):
            return state, self._without(state, estimate, FaultKind.ESTIMATE)
        if e.imu_age > _OLD_IMU:
            return state, self._without(state, estimate, FaultKind.ESTIMATE)
        fresh = e.time > state.time
        if not fresh and state.blind_for + self.period > self._patience:
            return state, self._without(state, estimate, FaultKind.ESTIMATE)
        state.time = e.time
        if state.health is None:
            state.health = self._health.init(replace(estimate, tau=np.nan_to_num(e.tau, posinf=0.0, neginf=0.0)))
        estimate = self._replaced(state.health, estimate)
        state.inner, command = self._controller.step(state.inner, estimate, reference)
        if not (_numbers(command.joint_torque) and _numbers(command.thrusters)):
            return state, self._without(state, estimate, FaultKind.CONTROLLER)
        faults = self._health.step(state.health, estimate, command) if fresh else tuple(state.health.faults)
        state.sound, state.command, state.blind_for = estimate, command, 0.0 if fresh else state.blind_for + self.period
        if not faults:
            return state, command
        return state, replace(
            command, joint_torque=self._servoed(command.joint_torque, estimate, faults), faults=faults
        )

    def _replaced(self, health: FaultDetectionState, estimate: StateEstimate) -> StateEstimate:
        """The estimate with the motors' word in place of torque sensors that were found wrong, and told to be doubted.

        What a motor gives and a gear passes on differ by the gear's stiction, tens of newtons at the tool: the force is
        felt through the other joints.
        """
        missing = not _numbers(estimate.tau)
        if not missing and not health.faults:
            return estimate
        if missing:
            self._health.blame_torque_sensors(health, ~np.isfinite(estimate.tau), estimate.time)
        wrong = [fault.index for fault in health.faults if fault.kind is FaultKind.TORQUE_SENSOR]
        if not wrong:
            return estimate
        tau, doubt = np.array(estimate.tau), np.zeros(len(estimate.tau))
        for j in wrong:
            doubt[j] = _LEFT_OUT
            acceleration = (estimate.qd[j] - health.qd_slow[j]) / self._health.limits.torque_time
            motor = health.tau_motor[j] - self._armature[j] * acceleration - self._damping[j] * estimate.qd[j]
            tau[j] = motor + health.usual[j]
        return replace(estimate, tau=tau, tau_doubt=doubt)

    def _servoed(self, torque: Array, estimate: StateEstimate, faults: Sequence[Fault]) -> Array:
        """`torque` (n,) [N m], but no more than the arm's weight where an encoder is wrong."""
        wrong = [fault.index for fault in faults if fault.kind is FaultKind.ENCODER]
        if not wrong:
            return torque
        torque = np.array(torque)
        torque[wrong] = self._borne(estimate.q, estimate.X_WB[:3, :3])[wrong]
        return torque

    def _without(self, state: SafetyWrapperState, estimate: StateEstimate, kind: FaultKind) -> Command:
        """What to command without a controller: the same again, and after a while nothing but brakes."""
        state.blind_for += self.period
        faults = tuple(state.health.faults) if state.health is not None else ()
        if state.stopped is None and state.blind_for > self._patience:
            state.stopped = Fault(kind=kind, part="", index=-1, time=state.sound.time + state.blind_for)
        if state.stopped is None:
            return replace(state.command, faults=faults)
        return replace(
            state.command,
            joint_torque=self._brake(state, estimate),
            thrusters=np.zeros(self._thrusters),
            scan=False,
            felt_normal=0.0,
            faults=(*faults, state.stopped),
        )

    def _brake(self, state: SafetyWrapperState, estimate: StateEstimate) -> Array:
        """Torques (n,) [N m] that bear the arm's weight in the last sound attitude and brake it where it moves."""
        q, qd = estimate.q, estimate.qd
        if not (np.isfinite(q).all() and np.isfinite(qd).all()):
            q, qd = state.sound.q, np.zeros(len(self._limits))
        borne = self._borne(q, state.sound.X_WB[:3, :3])
        braked = borne - self._limits * np.clip(_BRAKING_SHARE * qd / _BRAKING_SPEED, -_BRAKING_SHARE, _BRAKING_SHARE)
        return np.clip(braked, -self._limits, self._limits)

    def _borne(self, q: Array, R_WB: Array) -> Array:
        """Torques (n,) [N m] that bear the arm at rest, in still water."""
        if self._arm is None:
            return np.zeros(0)
        rest = np.zeros(len(q))
        return self._arm.inverse(
            q,
            rest,
            rest,
            R_WB=R_WB,
            nu_B=np.zeros(6),
            a_B=np.zeros(6),
            v_current_W=np.zeros(3),
            wrench_tip_G=np.zeros(6),
        )[0]


def _numbers(values: Array) -> bool:
    """Whether all of `values` (n,) are finite. Asked thrice a step, so without numpy where their sum says yes."""
    return math.isfinite(sum(values.tolist())) or bool(np.isfinite(values).all())
