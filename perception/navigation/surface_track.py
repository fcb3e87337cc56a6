"""Track over the object, of a camera on the arm or a tool at rest, whose readings are fixes of the
hull.

Each message gives the camera's motion since a key picture. Keys chained without a gap form a track.
The origin of a track in W is the estimated position of the camera when the track began. The filter
keeps the error of that estimate as the track's offset, so a track measures the motion of the hull
since then, and not its position.

A direction that a picture does not observe has zero information. If the track continues from such a
picture, the filter's own position replaces the reading in that direction.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from uuv.models.arms.serial_arm import SerialArm
from uuv.perception.navigation.filter_kernel import (
    AT_TRACK,
    ATTITUDE,
    BEGUN,
    INFORMATION,
    ORIGIN,
    PLACE,
    READ,
    TRACK,
    compare_track,
    replay,
    row_at,
)
from uuv.sim.interfaces.messages import SurfaceMotionMeasurement, ToolAtRest
from uuv.sim.interfaces.spatial import Array

_MOST_REFUSED = 5  # number of consecutive refused readings, after which a new track begins
_SHARE = 1e-9  # share of the largest information, below which a direction is not observed


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackMount:
    """Camera on the arm, or tip of a tool at rest, at the mounting pose that the vehicle
    assumes.
    """

    arm: SerialArm  # arm from its base to the tool frame G
    X_BA: Array  # (4, 4) base of the arm on the hull
    X_GC: Array  # (4, 4) camera in tool axes; the identity for the tip

    def pose(self, q: Array) -> Array:
        """Pose X_BC (4, 4) of the camera in the hull at joint angles q (n,)."""
        return self.X_BA @ self.arm.flange(q[None])[0] @ self.X_GC


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Reading:
    """A message, with the pose of the camera from the track."""

    message: SurfaceMotionMeasurement
    R_WC: Array  # (3, 3)
    lever_W: Array  # (3,) [m] from the hull's origin to the camera
    place_W: Array  # (3,) [m] hull's origin from the track
    information_W: Array  # (3, 3) [1/m^2] information on the hull's origin since the key


@dataclass(slots=True, eq=False)
class SurfaceTrack:
    """The present track, and the validation of its readings."""

    memory: np.ndarray  # (1,) of `filter_kernel.FILTER`, changed in place
    gate: float  # [-] chi-square with 3 degrees of freedom beyond which a reading is refused
    mount: TrackMount
    key_time: float = math.nan  # [s] of the present key K
    R_WK: Array = field(default_factory=lambda: np.eye(3))
    p_WK: Array = field(default_factory=lambda: np.zeros(3))  # (3,) [m] by the track
    last: _Reading | None = None  # newest reading that was used
    refused_in_row: int = 0
    refused: int = 0  # number of readings not used since the start, for the log
    begun: int = 0  # number of tracks begun since the start, for the log
    broken: int = 0  # number of tracks that did not continue the previous one
    # (3,) [m] sum of the changes of position at these
    carried_W: Array = field(default_factory=lambda: np.zeros(3))
    # (3,) [m^2] variance of the present key since the track broke off
    variance_W: Array = field(default_factory=lambda: np.zeros(3))

    def take(self, m: SurfaceMotionMeasurement) -> None:
        """Update the filter by a valid message at the message's step, and withhold the
        correction.
        """
        parts = (m.time, m.p_KC, m.R_KC, m.information_K, m.q)
        sound = all(np.isfinite(part).all() for part in parts) and m.key_time <= m.time

        at = row_at(self.memory, m.time)[0] if sound else -1
        if at < 0 or (self.last is not None and m.time <= self.last.message.time):
            self.refused += 1
            return

        # A new key continues the track or begins one, and so do many refused readings
        if m.key_time != self.key_time and not self._goes_on(m.key_time):
            self._begin(m, at)
        elif self._used(m, at):
            self.refused_in_row = 0
        else:
            self.refused += 1
            self.refused_in_row += 1
            if self.refused_in_row >= _MOST_REFUSED:
                self._begin(m, at, anew=True)

    def take_rest(self, m: ToolAtRest) -> None:
        """Process a message on a tool at rest as the reading of a camera that has not moved."""
        known = np.eye(3) / max(m.slip_sigma, 1e-6) ** 2
        still = SurfaceMotionMeasurement(
            time=m.time,
            key_time=m.since,
            p_KC=np.zeros(3),
            R_KC=np.eye(3),
            information_K=known,
            q=m.q,
        )
        self.take(still)

    def place_at(self, time: float) -> Array | None:
        """Position (3,) [m] in W of the hull's origin, up to a constant, at `time` [s]; None if
        unknown.

        The time must be near that of the newest reading. The position is computed from all readings
        since the track last broke off, including those that the filter refused. The filter's own
        motion between the two times is added.
        """
        if self.last is None:
            return None

        at = row_at(self.memory, time)[0]
        then = row_at(self.memory, self.last.message.time)[0]
        if at < 0 or then < 0:
            return None

        past = self.memory["past_x"][0]
        return self.last.place_W + self.carried_W + past[at, :3] - past[then, :3]

    def variance_at_last(self) -> Array:
        """Variance (3,) [m^2] of the newest reading since the track broke; inf if unobserved."""
        last = self.last
        return (
            np.full(3, np.inf) if last is None else self.variance_W + _variance(last.information_W)
        )

    def _goes_on(self, key_time: float) -> bool:
        """Use the last reading as key if it has that time; False if the track breaks off."""
        last = self.last
        at = (
            row_at(self.memory, key_time)[0]
            if last is not None and last.message.time == key_time
            else -1
        )
        if last is None or at < 0:
            return False

        self.variance_W = self.variance_at_last()
        self.key_time = key_time
        self.R_WK = last.R_WC
        self.p_WK = last.place_W + last.lever_W
        self._replay(at, origin=last.place_W)
        return True

    def _used(self, m: SurfaceMotionMeasurement, at: int) -> bool:
        """Update the filter by a reading relative to the present key; False if the gate refuses the
        reading.
        """
        # Hull's origin by the track, with its information
        R_WC, lever = self._camera(m, at)
        p_WB = self.p_WK + self.R_WK @ m.p_KC - lever
        information = self.R_WK @ m.information_K @ self.R_WK.T

        # Gate
        row = np.zeros(TRACK)
        f = self.memory[0]
        row[READ] = 1.0
        row[PLACE : PLACE + 3] = p_WB
        row[INFORMATION : INFORMATION + 9] = information.ravel()
        innovation, _, weight = compare_track(
            row, int(f["layout"][AT_TRACK]), f["past_x"][at], f["past_P"][at]
        )
        if float(innovation @ weight @ innovation) > self.gate:
            return False

        # An unobserved direction keeps the filter's position
        p_WB_observed = p_WB - _unobserved(information) @ innovation
        self.last = _Reading(
            message=m, R_WC=R_WC, lever_W=lever, place_W=p_WB_observed, information_W=information
        )

        f["past_track"][at, :BEGUN] = row[:BEGUN]
        self._replay(at)
        return True

    def _begin(self, m: SurfaceMotionMeasurement, at: int, *, anew: bool = False) -> None:
        """Begin a track at the estimated position of the hull; `anew` after refused readings."""
        x = self.memory[0]["past_x"][at]
        first = int(self.memory[0]["layout"][AT_TRACK])
        R_WC, lever = self._camera(m, at)

        p_WB = x[:3] + x[first : first + 3]

        # After refused readings the motion that they show is continued
        if anew:
            parted = self.p_WK + self.R_WK @ m.p_KC - lever - p_WB
            unseen = _unobserved(self.R_WK @ m.information_K @ self.R_WK.T)
            self.carried_W = self.carried_W + parted - unseen @ parted
            self.variance_W = self.variance_at_last()
        else:
            self.carried_W = np.zeros(3)
            self.variance_W = np.zeros(3)
            self.broken += 1

        # The key is placed such that this reading is at the estimated position
        self.key_time = m.key_time
        self.R_WK = R_WC @ m.R_KC.T
        self.p_WK = p_WB + lever - self.R_WK @ m.p_KC
        known = self.R_WK @ m.information_K @ self.R_WK.T
        self.last = _Reading(message=m, R_WC=R_WC, lever_W=lever, place_W=p_WB, information_W=known)

        self.refused_in_row = 0
        self.begun += 1
        self._replay(at, origin=p_WB)

    def _camera(self, m: SurfaceMotionMeasurement, at: int) -> tuple[Array, Array]:
        """Rotation R_WC (3, 3) of the camera, and lever (3,) [m] in W from the hull's origin."""
        R_WB = self.memory[0]["past_input"][at, ATTITUDE : ATTITUDE + 9].reshape(3, 3)
        X_BC = self.mount.pose(m.q)
        return R_WB @ X_BC[:3, :3], R_WB @ X_BC[:3, 3]

    def _replay(self, at: int, origin: Array | None = None) -> None:
        """Run the filter forward from a step of the past; if `origin` (3,) [m] is given, a track
        begins there.
        """
        if origin is not None:
            row = self.memory[0]["past_track"][at]
            row[BEGUN] = 1.0
            row[ORIGIN : ORIGIN + 3] = origin
        replay(self.memory, at)


def _unobserved(information: Array) -> Array:
    """Projector (3, 3) on the directions in which `information` (3, 3) is zero."""
    eigenvalues, axes = np.linalg.eigh(information)
    return (axes * (eigenvalues <= _SHARE * max(float(eigenvalues[-1]), 1.0))) @ axes.T


def _variance(information: Array) -> Array:
    """Variance (3,) of each axis by `information` (3, 3); inf where an axis is not observed."""
    eigenvalues, axes = np.linalg.eigh(information)
    with np.errstate(divide="ignore"):
        spread = np.where(
            eigenvalues > _SHARE * max(float(eigenvalues[-1]), 1.0),
            1.0 / np.maximum(eigenvalues, 1e-300),
            np.inf,
        )

    share = np.where(np.abs(axes) > 1e-6, axes**2, 0.0)
    return np.array([np.sum(spread[row > 0.0] * row[row > 0.0]) for row in share])
