"""Strapdown navigation filter: hull pose and motion from IMU, DVL, vision and joint sensors.

Position, velocity and accelerometer bias are estimated by one Kalman filter driven by the
accelerometer at the IMU's rate (`uuv.perception.navigation.filter_kernel`). The tilt error of the
attitude reference couples gravity into the acceleration and cannot be separated from the bias. The
bias is therefore kept in hull axes, where both stay constant when the hull turns.

**Noise.** The noise that the maker of a sensor states travels with the measurement. Without it the
filter uses its own values for that sensor. Innovations larger than the noise explains increase the
assumed variance of the sensor, never decrease it (`fixes.FixMonitor.scale`). While the
accelerometer's bias is constant, the DVL's innovations are white. A significant mean innovation
shows that the bias has jumped; it is then estimated again.

**Delay.** Vision arrives late, and not always in order. The filter goes back to the step at which
the picture was taken, processes it there and runs forward again over the stored IMU samples and all
later fixes. The result equals that of a filter that received every measurement without delay.
[Larsen 1998] calls this recalculation.

**Wander.** A slowly varying error of vision, called wander (`VisionNoise.wander`), has a state of
its own. With this state the motion of the hull since a given moment is observable as far as IMU and
DVL allow. The position in the world is not observable, because a wander that is present from the
start looks like another position. The object is located with the same cameras, so the error at that
moment shifts object and hull equally, and the tool stays in place on the object. The change of the
wander since then does move the tool on the object. For a wander of 5 mm with a time constant of 20
s, this change since the scan is 4.5 mm if the wander is stated, 5.8 mm if it is not.
`StateEstimate.position_sigma` refers to the position in the world and contains both parts.

**Tilt.** The constant error of the attitude reference couples gravity into the acceleration. While
the hull keeps its tilt, this is a part of the accelerometer's bias. A hull without thrusters for
pitch is tilted by the tool's force, by 16 deg from that before contact on a BlueROV2; the bias is
then wrong by 1 mm/s^2, which moved the estimated position by 5 mm. Beyond 3 deg from the usual tilt
the filter therefore adds this uncertainty to the bias.

**Camera on the arm.** A camera on the arm measures the motion of tool and hull relative to the
object (`surface_track`), at 10 to 20 Hz and with an error of a tenth of a millimetre. The position
at which its track began is as uncertain as the filter was at that moment. If vision states no
wander, the estimate is the position in the world; the track keeps it steady, and the mean of vision
improves it. If vision states a wander, the position in the world is of no use to the tool, and the
estimate is the position relative to the object as located when the first track began. A motion of
the object is interpreted as a motion of the hull, up to the gate, until `object_watch` detects that
track and vision diverge.

**Tool at rest.** While a pressed tool is at rest (`ToolAtRest`), its tip is treated as a camera
that has not moved. Two messages measure the motion of the hull between them to a tenth of a
millimetre, which makes its speed and the accelerometer's bias observable.

**Smooth output.** A tool in contact needs a smooth estimate: on a surface of 3e4 N/m a jump of 0.2
mm is 6 N. Corrections are therefore withheld and released gradually, by d'' = -sqrt(2) f d' - f^2
d. This is the linear-quadratic optimum between the remaining error and the acceleration added to
the motion. The output position and velocity have no steps, and the velocity is the derivative of
the position. The frequency f follows the bandwidth of the filter.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from uuv.perception.navigation.filter_kernel import (
    AT_DVL_BIAS,
    AT_TRACK,
    AT_WANDER,
    ATTITUDE,
    DVL,
    FILTER,
    STATES,
    TIME,
    VISION,
    put_out,
    take_imu,
    take_sample,
)
from uuv.perception.navigation.first_measurements import first_of
from uuv.perception.navigation.fixes import Fixes, FixMonitor
from uuv.perception.navigation.object_watch import ObjectWatch
from uuv.perception.navigation.surface_track import SurfaceTrack, TrackMount
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import (
    DvlMeasurement,
    DvlNoise,
    EncoderMeasurement,
    ImuMeasurement,
    ImuNoise,
    Measurement,
    StateEstimate,
    SurfaceMotionMeasurement,
    ToolAtRest,
    TorqueMeasurement,
    VisionMeasurement,
    VisionNoise,
)
from uuv.sim.interfaces.records import (
    EstimateRecord,
    ImuRecord,
    JointRecord,
    estimate_record,
    imu_record,
    joint_record,
    state_estimate,
)
from uuv.sim.interfaces.spatial import GRAVITY, Array


@dataclass(slots=True, eq=False)
class NavigationState:
    """State of the filter, as arrays that are changed in place."""

    memory: np.ndarray  # (1,) of `filter_kernel.FILTER`
    sample: ImuRecord  # newest IMU sample
    joints: JointRecord  # newest readings of encoders and torque sensors, finite or not
    estimate: EstimateRecord  # the last one
    fixes: Fixes
    track: SurfaceTrack | None = None  # of a camera on the arm, or of a tool that stands
    # pose of the object that the camera tracks; None: there is no track, or vision has wander
    watch: ObjectWatch | None = None
    # the three records as plain tuples, faster to pass to a kernel
    packed: tuple[tuple[Array, ...], ...] = ()

    def __post_init__(self) -> None:
        self.packed = tuple(self.sample), tuple(self.joints), tuple(self.estimate)

    @property
    def x(self) -> Array:
        """Mean (18,) of the states; a view."""
        return self.memory["x"][0]

    @property
    def P(self) -> Array:
        """Covariance (18, 18) of the states; a view."""
        return self.memory["P"][0]


Fix = VisionMeasurement | DvlMeasurement | SurfaceMotionMeasurement | ToolAtRest
_IMU = ImuNoise(
    acceleration=2.5e-3,
    acceleration_bias=6e-3,
    rate=2e-4,
    rate_bias=1e-4,
    attitude=5e-5,
    attitude_bias=5e-4,
)
_DVL, _VISION = DvlNoise(white=3e-3), VisionNoise(white=2e-3)


@dataclass(frozen=True, slots=True, kw_only=True)
class Navigation:
    """Strapdown navigation filter with delayed fixes, adaptive noise and smooth output.

    Implements `uuv.sim.interfaces.protocols.Estimator`. The fields `imu`, `dvl` and `vision` are
    the noise of a sensor that states none.
    """

    period: float = 0.002  # [s]
    imu: ImuNoise = _IMU
    dvl: DvlNoise = _DVL
    vision: VisionNoise = _VISION
    bias_walk: float = 5e-6  # [m/s^2/sqrt(s)] random walk of the accelerometer bias
    rate_bias_walk: float = 1e-7  # [rad/s/sqrt(s)] random walk of the gyro bias
    # True: raise a sensor's variance on large innovations, and re-estimate an accelerometer bias
    # that jumped
    adapt: bool = True
    # True: compare gyro and attitude of each message, as far as `adapt` allows
    check_gyro: bool = True
    # [-] chi-square with 3 degrees of freedom: a valid fix is refused 4 times in a million
    gate: float = 27.9
    release: tuple[float, float, float, float] = (16.0, 2.0, 12.0, 5e-3)
    """Spring of withheld corrections: ratio of its frequency to the filter's, lowest and highest
    frequency [rad/s], distance [m] beyond which the force no longer grows.
    """
    acceleration_time: float = 0.02  # [s] time constant of the output acceleration
    arm_camera: TrackMount | None = None  # camera on the arm; None: there is none
    standing: TrackMount | None = None  # tip of a tool that stops on its path; None: it does not

    def __post_init__(self) -> None:
        if self.arm_camera is not None and self.standing is not None:
            raise ConfigurationError(
                "navigation: arm_camera and standing: only one of the two is allowed, since there "
                "is one track"
            )

    def init(self, first: Sequence[Measurement]) -> NavigationState:
        """Initial state from the first measurements of every sensor; velocity zero without a DVL.

        Raises:
            ConfigurationError: An IMU, vision, encoder or torque measurement is missing or not
                finite.
        """
        imu = first_of(ImuMeasurement, first)
        vision = first_of(VisionMeasurement, first)
        encoders = first_of(EncoderMeasurement, first)
        torque = first_of(TorqueMeasurement, first)
        speeds = [m for m in first if isinstance(m, DvlMeasurement)][-1:]
        speed = speeds[0] if speeds and _sound(speeds[0].v_WB_B) else None

        _check_finite(imu, (imu.specific_force_B, imu.w_WB_B, imu.R_WB))
        _check_finite(vision, (vision.p_WB,))
        _check_finite(encoders, (encoders.q, encoders.qd))
        _check_finite(torque, (torque.tau,))

        # Noise as the sensors state it, else as set in the fields
        stated = (
            imu.noise or self.imu,
            vision.noise or self.vision,
            speed.noise or self.dvl if speed else self.dvl,
        )

        # Memory of the kernels
        memory = np.zeros(1, FILTER)
        mount = self.arm_camera or self.standing
        f = memory[0]
        self._set_constants(f, *stated)
        _set_states(f, first=(imu, vision, speed), stated=stated)

        last_dvl = (
            FixMonitor(speed.v_WB_B, speed.time) if speed else FixMonitor(np.zeros(3), -math.inf)
        )
        n = len(encoders.q)

        state = NavigationState(
            memory=memory,
            sample=imu_record(),
            joints=joint_record(n),
            estimate=estimate_record(n),
            fixes=Fixes(
                memory, self.gate, self.adapt, (FixMonitor(vision.p_WB, vision.time), last_dvl)
            ),
            track=SurfaceTrack(memory, self.gate, mount) if mount else None,
            watch=ObjectWatch() if self.arm_camera and not stated[1].wander else None,
        )

        # Joints at the first readings
        for record in (state.joints, state.estimate):
            record.q[:] = encoders.q
            record.qd[:] = encoders.qd
            record.tau[:] = torque.tau
        state.estimate.attitude_sigma[0] = stated[0].attitude_bias
        return state

    def _set_constants(
        self, f: np.record, imu: ImuNoise, vision: VisionNoise, dvl: DvlNoise
    ) -> None:
        """Write the constants of a run into the filter's record `f`."""
        n = 9
        f.layout[:] = -1

        # Optional states, each a triple
        if dvl.bias > 0.0:
            f.layout[AT_DVL_BIAS] = n
            n += 3
        if vision.wander > 0.0:
            f.layout[AT_WANDER] = n
            n += 3
        if self.arm_camera is not None or self.standing is not None:
            f.layout[AT_TRACK] = n
            n += 3
            f.by_track = self.arm_camera is not None and vision.wander > 0.0
        f.layout[STATES] = n

        # Noise, output, and check of the gyro
        f.walks[:] = self.bias_walk**2, vision.wander**2, vision.wander_time
        f.acceleration = imu.acceleration
        f.rate = imu.rate**2
        f.attitude = imu.attitude**2
        f.rate_walk = self.rate_bias_walk**2
        f.tilt = 2.0 * (GRAVITY * imu.attitude) ** 2
        f.coupled = (GRAVITY * imu.attitude_bias) ** 2
        f.release[:] = self.release
        f.smooth = self.acceleration_time
        f.check.on = self.adapt and self.check_gyro
        f.check.misaligned = 3.0 * imu.attitude_bias

    @staticmethod
    def _watch(state: NavigationState, time: float, p_WB: Array, white: float) -> None:
        """Compare a fix of vision with the track, and store the detected motion of the object."""
        watch = state.watch
        if watch is None or state.track is None:
            return

        place_W = state.track.place_at(time)
        if place_W is None:
            state.estimate.object_moved_W[:] = 0.0
        else:
            sigma = white * math.sqrt(state.fixes.watches[VISION].scale)
            variance_W = state.track.variance_at_last()
            watch.take(time, p_WB - place_W, sigma, variance_W)
            state.estimate.object_moved_W[:] = watch.moved_W

    def records(self, state: NavigationState) -> NavigationState:
        """The arrays of the state on which `take_sample` and `put_out` work."""
        return state

    def step(
        self, state: NavigationState, measurements: Sequence[Measurement]
    ) -> tuple[NavigationState, StateEstimate]:
        """Process the measurements that have arrived, in any order; return the present estimate.

        Measurements that are not finite, were processed before or repeat a frozen reading are
        ignored. The ages in the estimate then grow.

        Args:
            state: State from the last call, or from `init`; changed in place.
            measurements: All measurements that have arrived since.
        """
        memory = state.memory
        sample = state.sample
        joints = state.joints
        packed_sample, packed_joints, packed_estimate = state.packed
        fixes: list[Fix] = []
        newest = -math.inf
        sampled = False

        # Newest readings into the records of the kernels
        for m in measurements:  # the frequent types first
            if isinstance(m, EncoderMeasurement):
                joints.q[:] = m.q
                joints.qd[:] = m.qd
            elif isinstance(m, TorqueMeasurement):
                joints.tau[:] = m.tau
            elif isinstance(m, ImuMeasurement):
                if sampled:  # a slow estimator gets several
                    take_imu(memory, packed_sample)
                sample.time[0] = m.time
                sampled = True
                sample.specific_force_B[:] = m.specific_force_B
                sample.w_WB_B[:] = m.w_WB_B
                sample.R_WB[:] = m.R_WB
            elif isinstance(
                m, (VisionMeasurement, DvlMeasurement, SurfaceMotionMeasurement, ToolAtRest)
            ):
                fixes.append(m)
                # fixes do not advance the clock, so that a wrong time stamp of a picture does no
                # harm
                continue

            if m.time > newest:
                newest = m.time

        # IMU up to now
        clock = memory["clock"]
        if newest > clock[0]:
            clock[0] = newest
        if not sampled:
            sample.time[0] = -math.inf
        take_sample(memory, packed_sample)

        # Fixes
        for m in fixes:  # after the IMU, so that their step exists
            self._take_fix(state, m)

        put_out(memory, packed_joints, packed_estimate)
        return state, state_estimate(state.estimate)

    def _take_fix(self, state: NavigationState, m: Fix) -> None:
        """Process one fix; those of a camera or tool that is not mounted are ignored."""
        if isinstance(m, VisionMeasurement):
            white = (m.noise or self.vision).white
            used = state.fixes.take(VISION, m.time, m.p_WB, white)
            if used and state.watch is not None:
                self._watch(state, m.time, m.p_WB, white)
        elif isinstance(m, SurfaceMotionMeasurement):
            if state.track is not None and self.arm_camera is not None:
                broken = state.track.broken
                state.track.take(m)
                if state.watch is not None and state.track.broken > broken:
                    state.watch.begin(m.time)
                    state.estimate.object_moved_W[:] = 0.0
        elif isinstance(m, ToolAtRest):
            if state.track is not None and self.standing is not None:
                state.track.take_rest(m)
        else:
            state.fixes.take(DVL, m.time, m.v_WB_B, (m.noise or self.dvl).white)


def _set_states(
    f: np.record,
    first: tuple[ImuMeasurement, VisionMeasurement, DvlMeasurement | None],
    stated: tuple[ImuNoise, VisionNoise, DvlNoise],
) -> None:
    """Write clocks, mean, covariance and the first row of the past into the filter's record.

    Args:
        f: Record of `filter_kernel.FILTER` with its constants.
        first: First valid measurements of IMU, vision and, if there is one, DVL.
        stated: Noise of the three sensors.
    """
    (imu, vision, speed), (of_imu, of_vision, of_dvl) = first, stated
    R = np.array(imu.R_WB, dtype=np.float64)
    x = f.x
    P = f.P

    # Position, velocity, attitude
    x[:3] = vision.p_WB
    P[:3, :3] = (of_vision.white**2 + of_vision.wander**2) * np.eye(3)
    P[3:6, 3:6] = 0.1**2 * np.eye(3)

    # Accelerometer bias
    up = R[2]  # the tilt error of the attitude reference couples gravity in, across `up`
    P[6:9, 6:9] = of_imu.acceleration_bias**2 * np.eye(3)
    P[6:9, 6:9] += (GRAVITY * of_imu.attitude_bias) ** 2 * (np.eye(3) - np.outer(up, up))

    # DVL: its bias, and the velocity
    _, dvl_bias, wander, _ = (slice(at, at + 3) for at in f.layout)
    if of_dvl.bias > 0.0:
        P[dvl_bias, dvl_bias] = of_dvl.bias**2 * np.eye(3)
    if speed:
        x[3:6] = R @ speed.v_WB_B
        P[3:6, 3:6] = (of_dvl.white**2 + of_dvl.bias**2) * np.eye(3)
        if of_dvl.bias > 0.0:
            P[3:6, dvl_bias] = -(of_dvl.bias**2) * R
            P[dvl_bias, 3:6] = P[3:6, dvl_bias].T

    # A wander of vision looks like another position
    if of_vision.wander > 0.0:
        P[wander, wander] = of_vision.wander**2 * np.eye(3)
        P[:3, wander] = P[wander, :3] = -(of_vision.wander**2) * np.eye(3)

    # Clocks
    f.time = f.clock = f.given = f.imu_time = imu.time
    f.jumped = -math.inf
    f.interval = math.inf
    f.used[:] = (vision.time, speed.time if speed else -math.inf)

    # Attitude and last sample
    f.R_WB[:] = R
    f.up[:] = up
    f.gyro[:] = (of_imu.attitude**2, 0.0, of_imu.rate_bias**2)
    f.force[:] = f.seen_force[:] = imu.specific_force_B
    f.w_B[:] = f.seen_w[:] = imu.w_WB_B

    # Past: its first row is the present
    f.past_input[:] = -np.inf
    f.past_input[0, TIME] = imu.time
    f.past_input[0, ATTITUDE : ATTITUDE + 9] = R.ravel()
    f.past_x[0] = x
    f.past_P[0] = P


def _check_finite(m: Measurement, readings: tuple[Array, ...]) -> None:
    """Refuse a first measurement with a time or with `readings` that are not finite."""
    if not (math.isfinite(m.time) and all(_sound(v) for v in readings)):
        raise ConfigurationError(
            f"navigation: the first {type(m).__name__} must be finite, got {readings}"
        )


def _sound(values: Array) -> bool:
    """True if all of `values` (n,) or (n, n) are finite."""
    return bool(np.isfinite(values).all())
