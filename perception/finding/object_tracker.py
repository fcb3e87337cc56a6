"""Object tracker: follows an identified object over frames in the world, and detects its motion."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtri

from uuv.models.objects.targets import TargetModel
from uuv.perception.clouds.scan import Scan, SensorModel
from uuv.perception.registration.identification import identify
from uuv.perception.registration.model_surface import ModelSurface
from uuv.perception.registration.tracking import FrameFit, follow
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import DepthImage, Measurement, ObjectMotion, StateEstimate, Target
from uuv.sim.interfaces.spatial import (
    Array,
    checked_pose,
    finite_number,
    inverse,
    log_so3,
    readonly,
    transform_points,
)

_SETTLING = 3  # number of first frames whose mean defines the object's initial pose
_ASTRAY = 0.1  # [m] error of the last pose, above which a fit has lost the object
_SURE = 1e-3  # probability of a false alarm in a frame, if errors have the stated covariance
_IN_A_ROW = 2  # number of frames that must indicate motion: one false alarm in a million


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrackerState:
    """State of an ObjectTracker."""

    X_WT: Array  # (6, 6) [1/m^2] information of the mean of the first frames
    information: Array  # (6, 6) [1/m^2] of the mean of the first frames
    # (6,) [1/m] information times the twist from the given pose, summed over the first frames
    weighted: Array
    frames: int = 0
    alarms: int = 0  # number of consecutive frames that indicate that the object has moved
    last: FrameFit | None = None  # None: the object was not in view


class ObjectTracker:
    """Follows one known object in depth frames, from a pose at which it was found."""

    def __init__(
        self,
        target: TargetModel | ModelSurface,
        X_WT: ArrayLike,
        *,
        sensor: SensorModel | None = None,
        drift: float = 0.001,
    ) -> None:
        """Prepare to follow `target`.

        Args:
            target: Model of the object.
            X_WT: (4, 4) pose at which the object was found.
            sensor: Accuracy of the depth sensor; None: `SensorModel()`.
            drift: [m] standard deviation of the drift of the vehicle's own estimate while it
                follows the object.

        Raises:
            ConfigurationError: The pose or drift is malformed.
            MissingLibraryError: There is no ray caster.
        """
        self._surface = target if isinstance(target, ModelSurface) else ModelSurface.of(target)
        self._X_WT = checked_pose(X_WT, "X_WT")
        self._sensor = sensor or SensorModel()
        self._drift = finite_number(drift, "drift [m]", least=0.0)

    def init(self) -> TrackerState:
        """Return the initial state, with the object at the pose at which it was found."""
        return TrackerState(X_WT=self._X_WT, information=np.zeros((6, 6)), weighted=np.zeros(6))

    def step(
        self, state: TrackerState, estimate: StateEstimate, image: Measurement
    ) -> tuple[TrackerState, ObjectMotion | None]:
        """Follow the object in one depth frame.

        Args:
            state: State from the last call, or from `init`.
            estimate: State of the vehicle at the time of the frame.
            image: The frame.

        Returns:
            The new state, and the motion of the object; None while the object is out of view or
                hidden, or during the first frames.

        Raises:
            ConfigurationError: `image` is not a depth frame.
        """
        if not isinstance(image, DepthImage):
            raise ConfigurationError(
                f"object tracker: expected a DepthImage, got {type(image).__name__}"
            )

        X_WS = estimate.X_WB @ image.X_BC
        fit = self._fitted(image, X_WS, state)
        if fit is None or fit.covariance is None:
            return replace(state, frames=state.frames + 1, last=None, alarms=0), None

        # Twist from the first pose, and its information
        X_WT = X_WS @ fit.X_ST
        twist = self._moved(X_WT)
        information = self._information(fit, X_WS[:3, :3])
        state = replace(state, X_WT=readonly(X_WT), frames=state.frames + 1, last=fit)

        # The first frames form the reference
        if state.frames <= _SETTLING:
            state = replace(
                state,
                information=state.information + information,
                weighted=state.weighted + information @ twist,
            )
            return state, None

        # Difference from the reference, along the twists that both observe
        P, at_first = _common(information, state.information)
        mean = at_first @ state.weighted
        difference = P @ (twist - mean)
        covariance = (
            P
            @ (np.linalg.pinv(information, hermitian=True) + at_first + self._drift**2 * np.eye(6))
            @ P
        )

        # Alarm: a difference that its covariance does not explain
        excess = difference @ np.linalg.pinv(covariance, rcond=1e-9, hermitian=True) @ difference
        alarms = state.alarms + 1 if excess > chdtri(round(np.trace(P)), _SURE) else 0

        motion = ObjectMotion(
            time=image.time,
            X_WT=readonly(X_WT),
            twist_W=readonly(difference),
            covariance_W=readonly(covariance),
            radius=self._surface.radius,
            moved=alarms >= _IN_A_ROW,
        )
        return replace(state, alarms=alarms), motion

    def _fitted(self, image: DepthImage, X_WS: Array, state: TrackerState) -> FrameFit | None:
        """Pose in a frame, by a fit that starts at the last pose, or by a new identification."""
        sensor = replace(self._sensor, focal=float(image.K[0, 0]))
        scan = Scan.from_depth(image)
        X_ST = inverse(X_WS) @ state.X_WT
        fit = follow(scan, self._surface, X_ST, sensor)

        # A fit with more unobserved directions than the reference is not trusted
        if fit is not None and state.frames >= _SETTLING and self._looser(fit, state):
            return self._found_again(scan, X_ST, sensor) or fit
        return fit

    @staticmethod
    def _looser(fit: FrameFit, state: TrackerState) -> bool:
        """True if a fit observes fewer directions than the first frames did, which shows that it
        has slid off the object.
        """
        held = int(np.linalg.matrix_rank(state.information, rtol=1e-9, hermitian=True))
        return fit.covariance is None or fit.covariance.degrees < held

    def _found_again(self, scan: Scan, X_ST: Array, sensor: SensorModel) -> FrameFit | None:
        """Identify the object near its expected pose; None if the result is not accepted."""
        center = transform_points(X_ST, self._surface.center)
        identified = identify(
            scan, self._surface, center, X_ST[:3, :3], sensor=sensor, approach_error=_ASTRAY
        )

        if not identified.accepted or identified.covariance is None:
            return None
        return FrameFit(
            X_ST=identified.X_sensor_target, covariance=identified.covariance, residual=0.0
        )

    def _moved(self, X_WT: Array) -> Array:
        """Twist (6,) [m] from the first pose: translation of the centre, and rotation vector times
        radius.
        """
        # Of all poses equivalent by symmetry, the one nearest to the first
        nearest = self._surface.symmetry.nearest_pose(X_WT, self._X_WT[:3, :3])
        center = self._surface.center
        off = transform_points(nearest, center) - transform_points(self._X_WT, center)
        return np.concatenate(
            [off, self._surface.radius * log_so3(nearest[:3, :3] @ self._X_WT[:3, :3].T)]
        )

    @staticmethod
    def _information(fit: FrameFit, R_WS: Array) -> Array:
        """Information (6, 6) [1/m^2] of a frame, in W; 0 along free twists."""
        assert fit.covariance is not None
        turn = np.zeros((6, 6))
        turn[:3, :3] = turn[3:, 3:] = R_WS
        return turn @ np.linalg.pinv(fit.covariance.matrix, rcond=1e-9, hermitian=True) @ turn.T


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FollowerState:
    """State of a FoundObjectFollower."""

    tracker: ObjectTracker | None = None  # None: nothing has been found yet
    state: TrackerState | None = None


class FoundObjectFollower:
    """Follows the object of the target finder, from the first accepted identification on.

    Implements `uuv.sim.interfaces.protocols.TargetFollower`.
    """

    def __init__(
        self,
        target: TargetModel | ModelSurface,
        *,
        sensor: SensorModel | None = None,
        drift: float = 0.001,
        period: float = 0.2,
    ) -> None:
        """Prepare to follow `target`.

        Args:
            target: Model of the object.
            sensor: Accuracy of the depth sensor; None: `SensorModel()`.
            drift: [m] standard deviation of the drift of the vehicle's own estimate while it
                follows the object.
            period: [s] between frames.

        Raises:
            ConfigurationError: A number is out of range.
            MissingLibraryError: There is no ray caster.
        """
        self.period = finite_number(period, "period [s]", above=0.0)
        self._surface = target if isinstance(target, ModelSurface) else ModelSurface.of(target)
        self._sensor = sensor
        self._drift = finite_number(drift, "drift [m]", least=0.0)

    def init(self) -> FollowerState:
        """Return the initial state, in which nothing has been found yet."""
        return FollowerState()

    def step(
        self,
        state: FollowerState,
        estimate: StateEstimate,
        target: Target,
        measurement: Measurement,
    ) -> tuple[FollowerState, ObjectMotion | None]:
        """Follow the object in one depth frame.

        If the object went out of view, or moved farther than the fit of a frame can follow, it is
        searched for where the finder identified it last. Its motion is still relative to its first
        pose.

        Args:
            state: State from the last call, or from `init`.
            estimate: State of the vehicle at the time of the frame.
            target: Last accepted identification.
            measurement: The frame.

        Returns:
            The new state, and the motion of the object; None while it is unknown.

        Raises:
            ConfigurationError: `measurement` is not a depth frame.
        """
        tracker = state.tracker
        of_tracker = state.state
        if tracker is None or of_tracker is None:
            tracker = ObjectTracker(
                self._surface, target.X_WT, sensor=self._sensor, drift=self._drift
            )
            of_tracker = tracker.init()
        elif of_tracker.last is None:
            of_tracker = replace(of_tracker, X_WT=target.X_WT)

        of_tracker, motion = tracker.step(of_tracker, estimate, measurement)
        return FollowerState(tracker=tracker, state=of_tracker), motion


def _common(one: Array, other: Array) -> tuple[Array, Array]:
    """Projection (6, 6) on the twists that both information matrices observe, and the inverse of
    `other` there.
    """
    held = np.eye(6)
    for information in (one, other):
        eigenvalues, vectors = np.linalg.eigh(information)
        free = vectors[:, eigenvalues <= 1e-9 * eigenvalues[-1]]
        held = held - held @ free @ np.linalg.pinv(held @ free)

    return np.asarray(held, dtype=np.float64), np.asarray(
        np.linalg.pinv(other, rcond=1e-9, hermitian=True), dtype=np.float64
    )
