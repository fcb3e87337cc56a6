"""Motions over time with bounded speed and acceleration: of poses, of joints, and along a path."""

from dataclasses import dataclass, replace

import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import ToolPath
from uuv.sim.interfaces.spatial import Array, exp_so3, finite_number, log_so3, readonly

SLOWEST = 1e-4  # [m/s] of a tool along its path
FASTEST = 1.0  # [m/s] of a tool along its path
BEND = 0.05  # [m/s^2] normal acceleration of a tool on its path, by default
# [rad/s] largest turning rate of a tool on its path, since joints near the wrist reach their speed
# limit
TURN = 0.35

# Peak speed and acceleration of the quintic 10 t^3 - 15 t^4 + 6 t^5 for a unit move in unit time.
_PEAK_SPEED = 1.875
_PEAK_ACCELERATION = 10.0 / np.sqrt(3.0)


def _quintic(u: float) -> tuple[float, float]:
    """Completed share of the move at time share `u`, and its derivative with respect to u."""
    u = min(max(u, 0.0), 1.0)
    return u**3 * (10.0 - 15.0 * u + 6.0 * u * u), 30.0 * u * u * (1.0 - u) ** 2


def _duration(distance: float, speed: float, acceleration: float) -> float:
    """Shortest duration [s] of a quintic move over `distance` within speed and acceleration."""
    return max(
        _PEAK_SPEED * distance / speed, np.sqrt(_PEAK_ACCELERATION * distance / acceleration), 1e-3
    )


@dataclass(frozen=True, slots=True, eq=False)
class PoseMove:
    """Rest-to-rest move of the hull pose: straight translation, rotation about one axis."""

    start: float  # [s]
    duration: float  # [s]
    X_from: Array  # (4, 4)
    X_to: Array  # (4, 4)

    @classmethod
    def between(
        cls,
        start: float,
        X_from: Array,
        X_to: Array,
        *,
        speed: float,
        acceleration: float,
        turn_rate: float,
    ) -> "PoseMove":
        """The shortest such move within the limits.

        Args:
            start: [s] beginning of the move.
            X_from: (4, 4) first pose.
            X_to: (4, 4) last pose.
            speed: [m/s] limit.
            acceleration: [m/s^2] limit.
            turn_rate: [rad/s] limit.

        Returns:
            The move.
        """
        distance = float(np.linalg.norm(X_to[:3, 3] - X_from[:3, 3]))
        turn = float(np.linalg.norm(log_so3(X_from[:3, :3].T @ X_to[:3, :3])))
        duration = max(_duration(distance, speed, acceleration), _PEAK_SPEED * turn / turn_rate)
        return cls(start, duration, np.array(X_from), np.array(X_to))

    def at(self, time: float) -> tuple[Array, Array]:
        """Pose (4, 4) and velocity of its origin (3,) [m/s], W, at `time` [s]."""
        share, rate = _quintic((time - self.start) / self.duration)

        X = np.eye(4)
        X[:3, :3] = self.X_from[:3, :3] @ exp_so3(
            share * log_so3(self.X_from[:3, :3].T @ self.X_to[:3, :3])
        )

        travel = self.X_to[:3, 3] - self.X_from[:3, 3]
        X[:3, 3] = self.X_from[:3, 3] + share * travel
        return X, travel * (rate / self.duration)

    def later(self, delay: float) -> "PoseMove":
        """The same move, started `delay` [s] later."""
        return replace(self, start=self.start + delay)

    def done(self, time: float) -> bool:
        """True from the end of the move on; `time` [s]."""
        return time >= self.start + self.duration


@dataclass(frozen=True, slots=True, eq=False)
class JointMove:
    """Rest-to-rest move of all joints on a straight line in joint space."""

    start: float  # [s]
    duration: float  # [s]
    q_from: Array  # (n,) [rad]
    q_to: Array  # (n,) [rad]

    @classmethod
    def between(cls, start: float, q_from: Array, q_to: Array, *, speed: float) -> "JointMove":
        """The shortest such move within the limit.

        Args:
            start: [s] beginning of the move.
            q_from: (n,) [rad] first angles.
            q_to: (n,) [rad] last angles.
            speed: [rad/s] limit of each joint; the same number limits the acceleration [rad/s^2].

        Returns:
            The move.
        """
        most = float(np.abs(q_to - q_from).max())
        return cls(start, _duration(most, speed, speed), np.array(q_from), np.array(q_to))

    def at(self, time: float) -> tuple[Array, Array]:
        """Joint angles (n,) [rad] and speeds (n,) [rad/s] at `time` [s]."""
        share, rate = _quintic((time - self.start) / self.duration)
        travel = self.q_to - self.q_from
        return self.q_from + share * travel, travel * (rate / self.duration)

    def done(self, time: float) -> bool:
        """True from the end of the move on; `time` [s]."""
        return time >= self.start + self.duration


@dataclass(frozen=True, slots=True)
class Progress:
    """Arc length along a path over time: trapezoidal speed, at rest at both ends."""

    length: float  # [m]
    speed: float  # [m/s]
    ramp: float  # [s] from rest to speed

    def __post_init__(self) -> None:
        if not (self.length > 0.0 and self.speed > 0.0 and self.ramp > 0.0):
            raise ConfigurationError(
                f"path progress: length {self.length} m, speed {self.speed} m/s and ramp "
                f"{self.ramp} s must be > 0"
            )

    @property
    def duration(self) -> float:
        """Duration [s] from start to end."""
        if self.length < self.speed * self.ramp:
            return 2.0 * np.sqrt(self.length * self.ramp / self.speed)
        return self.length / self.speed + self.ramp

    def at(self, time: float) -> tuple[float, float]:
        """Arc length [m] and its rate [m/s] at `time` [s] after the start."""
        total = self.duration
        if time <= 0.0:
            return 0.0, 0.0
        if time >= total:
            return self.length, 0.0

        acceleration = self.speed / self.ramp
        ramp = min(self.ramp, 0.5 * total)
        if time <= ramp:
            return 0.5 * acceleration * time**2, acceleration * time
        if time > total - ramp:
            left = total - time
            return self.length - 0.5 * acceleration * left**2, acceleration * left

        return 0.5 * acceleration * ramp**2 + self.speed * (time - ramp), self.speed

    def time(self, s: float) -> float:
        """Time [s] after the start at which arc length `s` [m] is reached: the inverse of `at`."""
        total = self.duration
        acceleration = self.speed / self.ramp
        ramp = min(self.ramp, 0.5 * total)
        risen = 0.5 * acceleration * ramp**2
        s = min(max(s, 0.0), self.length)

        if s <= risen:
            return float(np.sqrt(2.0 * s / acceleration))
        if s > self.length - risen:
            return float(total - np.sqrt(2.0 * (self.length - s) / acceleration))
        return ramp + (s - risen) / self.speed


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpeedLaw:
    """Speed along a path over time, from rest to rest, slower in bends [Konoplin 2019]."""

    time: Array  # (n,) [s] at the path's samples, from 0
    s: Array  # (n,) [m], from 0
    speed: Array  # (n,) [m/s]

    @property
    def duration(self) -> float:
        """Duration [s] from start to end."""
        return float(self.time[-1])

    def at(self, time: float) -> tuple[float, float]:
        """Arc length [m] and speed [m/s] at `time` [s]; at rest before and after."""
        if not self.time[0] < time < self.time[-1]:
            return float(self.s[0] if time <= self.time[0] else self.s[-1]), 0.0

        i = int(np.searchsorted(self.time, time)) - 1
        h = time - self.time[i]
        # constant between two samples
        a = (self.speed[i + 1] - self.speed[i]) / (self.time[i + 1] - self.time[i])
        return float(self.s[i] + self.speed[i] * h + 0.5 * a * h * h), float(self.speed[i] + a * h)


def speed_law(
    path: ToolPath, speed: float, bend: float = BEND, along: float | None = None
) -> SpeedLaw:
    """Fastest motion along a path within limits of speed and of tangential and normal acceleration.

    The normal limit v^2 kappa <= `bend` slows the tool down in bends. The limit TURN slows it down
    where its axes turn, over edges.

    Args:
        path: The tool path.
        speed: [m/s] largest speed.
        bend: [m/s^2] largest acceleration across the path.
        along: [m/s^2] largest acceleration along the path; None: `bend`.

    Returns:
        Time, arc length and speed at the samples of the path.

    Raises:
        ConfigurationError: A limit is out of range.
    """
    speed = finite_number(speed, "speed law: speed [m/s]", least=SLOWEST, most=FASTEST)
    bend = finite_number(
        bend, "speed law: acceleration across the path [m/s^2]", above=0.0, most=1e3
    )
    along = finite_number(
        bend if along is None else along, "speed law: acceleration [m/s^2]", above=0.0, most=1e3
    )
    return _law(path.s - path.s[0], np.minimum(speed, _limit(path, bend)), along)


def progress_along(
    path: ToolPath, begin: float, end: float, *, speed: float, ramp: float, bend: float = BEND
) -> Progress | SpeedLaw:
    """Motion along a path from `begin` to `end` [m], with trapezoidal speed unless bends require a
    slower motion.

    Args:
        path: The tool path.
        begin: [m] arc length at the start.
        end: [m] arc length at the end.
        speed: [m/s] largest speed.
        ramp: [s] from rest to that speed.
        bend: [m/s^2] largest acceleration across the path.

    Returns:
        The motion, with an arc length relative to `begin`.
    """
    inside = (path.s > begin) & (path.s < end)
    limit = _limit(path, bend)
    if not inside.any() or speed <= limit[inside].min():
        return Progress(end - begin, speed, ramp)

    s = np.concatenate([[begin], path.s[inside], [end]])
    return _law(s - begin, np.minimum(speed, np.interp(s, path.s, limit)), speed / ramp)


def _limit(path: ToolPath, bend: float) -> Array:
    """Largest speed (n,) [m/s] at a path's samples, limited by the normal acceleration `bend`
    [m/s^2] and by TURN.
    """
    frame = np.hstack([path.x, np.cross(path.z, path.x), path.z])
    turning = np.sqrt(0.5 * np.sum(np.gradient(frame, path.s, axis=0) ** 2, axis=1))  # [rad/m]
    return np.minimum(
        np.sqrt(bend / np.maximum(_curvature(path), 1e-9)), TURN / np.maximum(turning, 1e-9)
    )


def _curvature(path: ToolPath) -> Array:
    """Curvature (n,) [1/m] at the samples of a path."""
    tangent = np.gradient(path.p, path.s, axis=0)
    return np.linalg.norm(np.gradient(tangent, path.s, axis=0), axis=1)


def _law(s: Array, limit: Array, along: float) -> SpeedLaw:
    """Fastest law from rest to rest at `s` (n,) [m] within `limit` [m/s] and `along` [m/s^2]."""
    v = np.array(limit)
    v[0] = v[-1] = 0.0

    # Accelerate forwards, brake backwards: v^2 changes by at most 2 along ds
    step = np.diff(s)
    for i in range(len(step)):
        v[i + 1] = min(v[i + 1], np.sqrt(v[i] ** 2 + 2.0 * along * step[i]))
    for i in range(len(step) - 1, -1, -1):
        v[i] = min(v[i], np.sqrt(v[i + 1] ** 2 + 2.0 * along * step[i]))

    time = np.concatenate([[0.0], np.cumsum(2.0 * step / (v[:-1] + v[1:]))])
    return SpeedLaw(time=readonly(time), s=readonly(s), speed=readonly(v))
