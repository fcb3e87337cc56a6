"""Friction identification of the arm's gears, in water, from motions of the joints free of contact.

    motion = FrictionMotion(vehicle, X_WB)       # planner: the joints swing, slowly, then fast
    qd, qdd = over_steps(qd_encoders, period)    # recorded while it ran
    result = identify_friction(qd, qdd, tau_motor[1:], tau_gear[1:], armature)
    WorkController(model, estimator=TorqueSensors(model, friction=result.dry))

With torque sensors at the gear outputs, the torque lost in a gear is measured: tau_motor - I_rotor
qdd - tau_gear. Without them tau_gear comes from the arm's inverse dynamics, and model errors enter.
Per joint, at the moving samples,

    lost = b + viscous qd + sign(qd) (coulomb + (stiction - coulomb) exp(-(qd / stribeck_speed)^2))

is linear except for the Stribeck speed, which is found by a search (variable projection [Golub
1973]). b is the sensor's bias. If the stiction of a gear would be below its Coulomb friction, the
gear is fitted without stiction, and the variance of its Stribeck speed is infinite. The covariance
is the heteroscedasticity-consistent one [White 1980], since the noise of a torque sensor grows with
its reading.
"""

from dataclasses import dataclass

import numpy as np

from uuv.models.arms.gear_friction import DryFriction
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import Command, Reference, StateEstimate, Target, WorkState
from uuv.sim.interfaces.spatial import Array, checked, readonly

_LEAST_SPEED = 2e-3  # [rad/s] slower samples may belong to a joint at rest and are dropped
_FEWEST = 200  # minimal number of moving samples of a joint; a tenth of that in each direction
_NAMES = ("bias", "viscous", "coulomb", "stiction", "stribeck_speed")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class IdentifiedFriction:
    """Identified friction of all gears with its uncertainty; arrays (n,), read-only."""

    viscous: Array  # [N m s/rad] viscous friction
    dry: DryFriction  # Coulomb friction, stiction, Stribeck speed
    bias: Array  # [N m] bias of the torque sensors
    covariance: Array  # (n, 5, 5) of bias, viscous, coulomb, stiction, stribeck_speed
    residual: Array  # [N m] standard deviation of the residual

    def sigma(self, name: str) -> Array:
        """Standard deviation (n,) of bias, viscous, coulomb, stiction or stribeck_speed.

        Raises:
            ConfigurationError: `name` is none of these.
        """
        if name not in _NAMES:
            raise ConfigurationError(
                f"identified friction: allowed {', '.join(_NAMES)}, got {name!r}"
            )
        at = _NAMES.index(name)
        return np.sqrt(self.covariance[:, at, at])


def over_steps(qd: Array, period: float) -> tuple[Array, Array]:
    """Mean speed and acceleration of the joints over each step, from the speeds at its ends.

    A motor torque is held over a step, and these means belong to the same step. Speeds at the end
    of the step, or central differences, are half a step late or early, which biases the friction of
    a vibrating joint.

    Args:
        qd: (N + 1, n) [rad/s] joint speeds, one sample per step.
        period: [s] of the steps.

    Returns:
        Speed (N, n) [rad/s] and acceleration (N, n) [rad/s^2].
    """
    return 0.5 * (qd[1:] + qd[:-1]), np.diff(qd, axis=0) / period


def identify_friction(
    qd: Array, qdd: Array, tau_motor: Array, tau_gear: Array, armature: Array
) -> IdentifiedFriction:
    """Identify each gear's friction from a recorded motion by least squares.

    Args:
        qd: (N, n) [rad/s] joint speeds.
        qdd: (N, n) [rad/s^2] joint accelerations.
        tau_motor: (N, n) [N m] motor torques.
        tau_gear: (N, n) [N m] torques at the gear outputs, measured or modelled.
        armature: (n,) [kg m^2] rotor inertias at the joints.

    Returns:
        The friction of all gears with its uncertainty.

    Raises:
        ConfigurationError: shapes do not match, or a joint moved too little in either direction.
    """
    qd = np.asarray(qd, dtype=np.float64)
    shape = qd.shape
    if len(shape) != 2:
        raise ConfigurationError(f"friction qd: must be (N, n), got {shape}")

    qd = checked(qd, shape, "friction qd")
    qdd = checked(qdd, shape, "friction qdd")
    tau_motor = checked(tau_motor, shape, "friction tau_motor")
    tau_gear = checked(tau_gear, shape, "friction tau_gear")
    armature = checked(armature, shape[1:], "friction armature")

    lost = tau_motor - armature * qdd - tau_gear
    fits = [_fit(j, qd[:, j], lost[:, j]) for j in range(shape[1])]
    best = np.array([fit[0] for fit in fits])
    coulomb = np.maximum(best[:, 2], 0.0)

    return IdentifiedFriction(
        viscous=readonly(best[:, 1]),
        dry=DryFriction(
            coulomb=readonly(coulomb),
            stiction=readonly(np.maximum(best[:, 3], coulomb)),
            stribeck_speed=readonly(best[:, 4]),
        ),
        bias=readonly(best[:, 0]),
        covariance=readonly(np.stack([fit[1] for fit in fits])),
        residual=readonly(np.array([fit[2] for fit in fits])),
    )


def _fit(joint: int, qd: Array, lost: Array) -> tuple[Array, Array, float]:
    """Parameters (5,) of one joint, their covariance, and the residual's standard deviation."""
    moving = np.abs(qd) > _LEAST_SPEED
    qd = qd[moving]
    lost = lost[moving]
    fewest = min(int(np.sum(qd > 0.0)), int(np.sum(qd < 0.0)))
    if len(qd) < _FEWEST or fewest < _FEWEST // 10:
        raise ConfigurationError(
            f"friction of joint {joint + 1}: must have at least {_FEWEST} samples faster than "
            f"{_LEAST_SPEED} rad/s, and {_FEWEST // 10} in each direction, got {len(qd)} and "
            f"{fewest}"
        )

    def columns(over: float) -> Array:
        share = np.exp(-((qd / over) ** 2))
        return np.column_stack(
            [np.ones_like(qd), qd, np.sign(qd) * (1.0 - share), np.sign(qd) * share]
        )

    def left(over: float) -> float:
        A = columns(over)
        return float(np.sum((lost - A @ np.linalg.lstsq(A, lost, rcond=None)[0]) ** 2))

    # Stribeck speed by a search, with the linear parameters by least squares
    grid = np.geomspace(2.0 * _LEAST_SPEED, np.quantile(np.abs(qd), 0.9), 24)
    for _ in range(3):  # finer grids about the minimum
        at = int(np.argmin([left(over) for over in grid]))
        grid = np.geomspace(grid[max(at - 1, 0)], grid[min(at + 1, len(grid) - 1)], 12)
    over = float(grid[int(np.argmin([left(speed) for speed in grid]))])

    # Linear parameters at that speed
    A = columns(over)
    x = np.linalg.lstsq(A, lost, rcond=None)[0]

    # Covariance, with the derivative with respect to the Stribeck speed; without stiction that is
    # unknown
    if x[3] > x[2]:
        slope = (x[3] - x[2]) * np.sign(qd) * np.exp(-((qd / over) ** 2)) * 2.0 * qd**2 / over**3
        residual = lost - A @ x
        covariance = _robust_covariance(np.column_stack([A, slope]), residual)
    else:
        A = np.column_stack([np.ones_like(qd), qd, np.sign(qd)])
        x = np.linalg.lstsq(A, lost, rcond=None)[0]
        residual = lost - A @ x
        same = [0, 1, 2, 2]
        covariance = np.zeros((5, 5))
        covariance[:4, :4] = _robust_covariance(A, residual)[np.ix_(same, same)]
        covariance[4, 4] = np.inf
        x = x[same]

    return np.append(x, over), covariance, float(np.sqrt(np.sum(residual**2) / max(len(qd) - 5, 1)))


def _robust_covariance(A: Array, residual: Array) -> Array:
    """Heteroscedasticity-consistent covariance (k, k) from columns (N, k) and residual (N,)."""
    scale = np.linalg.norm(A, axis=0)
    scale[scale == 0.0] = 1.0
    scaled = A / scale
    inverse = np.linalg.pinv(scaled.T @ scaled, hermitian=True)

    scores = scaled * residual[:, None]
    freedom = max(len(A) - A.shape[1], 1)
    return len(A) / freedom * inverse @ (scores.T @ scores) @ inverse / np.outer(scale, scale)


class FrictionMotion:
    """Planner of the excitation motion, in which the joints swing while the hull keeps station."""

    def __init__(
        self,
        vehicle: Vehicle,
        X_WB: Array,
        *,
        swing: float = 0.25,
        slow: float = 20.0,
        fast: float = 5.0,
        period: float = 0.01,
    ) -> None:
        """Swing each joint about the ready posture: one slow turn, then two fast turns.

        The rates differ by 5 % from joint to joint, so that no two joints have the same motion.

        Args:
            vehicle: the vehicle with its arm.
            X_WB: (4, 4) hull pose to keep.
            swing: [rad] amplitude of each joint; smaller if the joint's limits require it.
            slow: [s] duration of the slow turn.
            fast: [s] duration of a fast turn.
            period: [s] of the planner's steps.

        Raises:
            ConfigurationError: a number is not finite or not > 0.
        """
        for name, number in (("swing", swing), ("slow", slow), ("fast", fast), ("period", period)):
            if not (np.isfinite(number) and number > 0.0):
                raise ConfigurationError(
                    f"friction motion {name}: must be finite and > 0, got {number}"
                )

        self.period = period
        limits = vehicle.q_limits
        room = np.minimum(vehicle.q_ready - limits[:, 0], limits[:, 1] - vehicle.q_ready)
        self._middle = np.array(vehicle.q_ready)
        self._swing = np.minimum(swing, np.maximum(0.9 * room, 0.0))

        self._home = np.array(vehicle.q_home)
        self._X_WB = np.array(X_WB)
        self._slow = slow
        self._fast = fast
        self._rate = 1.0 + 0.05 * np.arange(len(self._middle), dtype=np.float64)
        self._unfold = 4.0  # [s]

    @property
    def recorded(self) -> tuple[float, float]:
        """Beginning and end of the swings [s], since the start of the motion."""
        return self._unfold, self._unfold + self._slow + 2.0 * self._fast

    def init(self, estimate: StateEstimate) -> float:
        """Initial state: the time [s] at which the motion begins."""
        return estimate.time

    def _phase(self, since: float) -> tuple[Array, Array]:
        """Phase (n,) [rad] of each joint and its rate [rad/s], `since` [s] after the swings
        began.
        """
        if since <= self._slow:
            rate = 2.0 * np.pi / self._slow * self._rate
            return rate * since, rate

        rate = 2.0 * np.pi / self._fast * self._rate
        return rate * (since - self._slow) + 2.0 * np.pi * self._rate, rate

    def step(
        self, state: float, estimate: StateEstimate, target: Target | None, last: Command | None
    ) -> tuple[float, Reference]:
        """Reference of the joints at the time of `estimate`.

        Args:
            state: [s] of `init`.
            estimate: the vehicle's state now.
            target: not used.
            last: not used.

        Returns:
            The state, unchanged, and the reference; its work state is WORK during the swings, DONE
            after them.
        """
        del target, last
        time = estimate.time - state
        begin, end = self.recorded
        if time < begin:
            work = WorkState.CLOSE_IN
            s = time / begin
            way = self._middle - self._home
            q = self._home + s**3 * (10.0 - 15.0 * s + 6.0 * s * s) * way
            qd = 30.0 * s * s * (1.0 - s) ** 2 / begin * way
        elif time < end:
            work = WorkState.WORK
            phase, rate = self._phase(time - begin)
            q = self._middle + self._swing * np.sin(phase)
            qd = self._swing * (rate * np.cos(phase))
        else:
            work = WorkState.DONE
            phase = 2.0 * np.pi * 3.0 * self._rate
            q = self._middle + self._swing * np.sin(phase)
            qd = np.zeros(len(self._middle))

        speeds = np.array(qd, dtype=np.float64)
        return state, Reference.holding(estimate.time, self._X_WB, q, qd=speeds, state=work)
