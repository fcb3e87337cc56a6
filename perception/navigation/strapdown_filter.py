"""Strapdown navigation filter: hull pose, velocity and acceleration from IMU, DVL, delayed vision and joint sensors.

Position, velocity and accelerometer bias are estimated by one Kalman filter driven by the accelerometer at the IMU's
rate (`perception.navigation.filter_kernel`). The tilt error of the attitude reference couples gravity into the
acceleration and cannot be separated from the bias. The bias is therefore kept in hull axes, where both stay constant
when the hull turns.

**Noise.** The noise that the maker of a sensor states travels with the measurement. Without it the filter uses its own
values for that sensor. Innovations larger than the noise explains increase the assumed variance of the sensor, never
decrease it (`FixMonitor.scale`). While the accelerometer's bias is constant, the DVL's innovations are white. A mean
innovation beyond noise shows a bias that jumped, which is then estimated anew.

**Delay.** Vision arrives late, and not always in order. The filter goes back to the step at which the picture was
taken, processes it there and runs forward again over the stored IMU samples and all later fixes. The result equals that
of a filter which had every measurement in time, called recalculation in [Larsen 1998].

**Wander.** A slowly varying error of vision (`VisionNoise.wander`) has a state of its own. The motion of the hull since
some moment is then observable as far as IMU and DVL allow. The place in the world is not, because a wander present from
the start looks like another place. The object is located with the same cameras, so the error of that moment shifts
object and hull alike, and the tool stays in place on the object. The wander since then does move the tool on the
object. With 5 mm and a time constant of 20 s it is 4.5 mm since the scan where the wander is stated, 5.8 mm where it is
not. `StateEstimate.position_sigma` refers to the place in the world and contains both parts.

**Smooth output.** A tool in contact needs a smooth estimate: on a surface of 3e4 N/m a jump of 0.2 mm is 6 N.
Corrections are therefore withheld and released gradually, by d'' = -sqrt(2) f d' - f^2 d. This is the linear-quadratic
optimum between the remaining error and the acceleration added to the motion. The output position and velocity have no
steps, and one is the derivative of the other. The frequency f follows that of the filter's own gain.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from perception.navigation.filter_kernel import (
    ATTITUDE,
    DVL,
    FIX,
    HAS,
    INPUT,
    JUMP,
    MOST_STATES,
    SHIFT,
    TIME,
    VALUE,
    VARIANCE,
    VISION,
    all_finite,
    inertial,
    mahalanobis,
    replay,
    smoothed_output,
)
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.messages import (
    DvlMeasurement,
    DvlNoise,
    EncoderMeasurement,
    ImuMeasurement,
    ImuNoise,
    Measurement,
    StateEstimate,
    TorqueMeasurement,
    VisionMeasurement,
    VisionNoise,
)
from sim.interfaces.spatial import GRAVITY, Array

_HISTORY = 512  # IMU samples stored: largest delay of vision
_REPEATS = 3  # equal readings in a row by which a noisy sensor is found frozen
_IMU_REPEATS = 25  # equal samples in a row by which the IMU is found frozen
_IMU_SILENCE = 0.05  # [s] without a sample, after which the filter runs without the IMU
_BLIND = 2.5e-3  # [(m/s^2)^2 s] spectral density of the hull's unmeasured acceleration
_MEAN_TIME = 0.25  # [s] time constant of the mean innovation; it detects a jump by 0.05 m/s^2 in twice that
_MEAN_GATE = 45.0  # [-] chi-square with 3 degrees of freedom: noise alone exceeds it once in 10^9 fixes
_AGREEING = 5  # consistent rejected fixes in a row, after which the filter is taken to be wrong
_MOST_SCALE = 100.0  # [-] largest factor on a sensor's variance
_SCALE_GAIN, _SCALE_CAP, _SCALE_SLACK = 0.05, 4.0, 1.2  # [-] gain per fix, largest square used, neutral square


@dataclass(slots=True, eq=False)
class FixMonitor:
    """Monitor of one kind of fix: frozen readings, noise scale, rejected fixes, mean innovation."""

    last: Array  # (3,) last reading
    time: float  # [s] of it
    used: float  # [s] time of the newest fix used
    repeats: int = 0  # equal readings in a row, less one
    scale: float = 1.0  # [-] factor on the stated variance, from the innovations
    agreeing: int = 0  # consistent rejected fixes in a row
    rejected: Array = field(default_factory=lambda: np.zeros(3))  # (3,) innovation of the last rejected fix
    mean: Array = field(default_factory=lambda: np.zeros(3))  # (3,) mean of recent whitened innovations
    mean_variance: float = 0.0  # [-] of each of its axes for white innovations
    mean_time: float = -math.inf  # [s] of the last innovation in it
    refused: int = 0  # fixes not used since the start, for the log

    def take(self, white: Array, time: float, most: float) -> float:
        """Add a whitened innovation to the running mean.

        A steady offset is not noise, so the mean so far is subtracted before the square.

        Args:
            white: (3,) whitened innovation.
            time: [s] of the fix.
            most: Length to which the innovation is clipped in the mean.

        Returns:
            Mean square [-] about the mean so far, 1 for a sensor as noisy as stated.
        """
        off = white - self.mean
        square = float(off @ off) / (3.0 + 3.0 * self.mean_variance)
        share = 1.0 - math.exp(-max(time - self.mean_time, 0.0) / _MEAN_TIME)
        self.mean_time = max(time, self.mean_time)
        self.mean = self.mean + share * (white * min(1.0, most / max(math.hypot(*white.tolist()), 1e-9)) - self.mean)
        self.mean_variance = (1.0 - share) ** 2 * self.mean_variance + share**2
        return square


@dataclass(slots=True, eq=False)
class NavigationState:
    """State of the filter. Arrays belong to it and change in place."""

    time: float  # [s] of the filter: the newest IMU sample
    clock: float  # [s] newest time of any measurement
    given: float  # [s] time of the last estimate
    imu_time: float  # [s] of the newest sound IMU sample
    interval: float  # [s] shortest interval between IMU samples so far
    imu: ImuNoise
    layout: Array  # (3,) int, see `filter_kernel`
    walks: Array  # (3,) see `filter_kernel.propagate`
    turning: Array  # (3,) `variances` of `filter_kernel.turn`
    R_WB: Array  # (3, 3)
    gyro: Array  # (3,) covariance of angle and gyro bias, the same for each axis
    rate_bias: Array  # (3,) [rad/s]
    x: Array  # (15,) states, see `filter_kernel`
    P: Array  # (15, 15)
    held: Array  # (2, 3) withheld corrections of position [m] and velocity [m/s] in W
    a_B: Array  # (3,) smoothed acceleration [m/s^2]
    force: Array  # (3,) [m/s^2] last specific force in B
    w_B: Array  # (3,) [rad/s] last gyro rates in B
    imu_last: ImuMeasurement
    imu_repeats: int
    past_input: Array  # (_HISTORY, INPUT)
    past_x: Array  # (_HISTORY, 15) before the fixes of that step
    past_P: Array  # (_HISTORY, 15, 15)
    past_fix: Array  # (_HISTORY, 2, FIX)
    head: int  # newest row of the past
    watches: tuple[FixMonitor, FixMonitor]
    bias_jumps: int  # detected jumps of the accelerometer bias since the start, for the log
    q: Array
    qd: Array
    tau: Array


_IMU = ImuNoise(
    acceleration=2.5e-3, acceleration_bias=6e-3, rate=2e-4, rate_bias=1e-4, attitude=5e-5, attitude_bias=5e-4
)
_DVL, _VISION = DvlNoise(white=3e-3), VisionNoise(white=2e-3)


@dataclass(frozen=True, slots=True, kw_only=True)
class Navigation:
    """Strapdown navigation filter with delayed fixes, adaptive noise and smooth output.

    Implements `sim.interfaces.protocols.Estimator`. `imu`, `dvl` and `vision` apply to a sensor that states no noise.
    """

    period: float = 0.002  # [s]
    imu: ImuNoise = _IMU
    dvl: DvlNoise = _DVL
    vision: VisionNoise = _VISION
    bias_walk: float = 5e-6  # [m/s^2/sqrt(s)] random walk of the accelerometer bias
    rate_bias_walk: float = 1e-7  # [rad/s/sqrt(s)] random walk of the gyro bias
    adapt: bool = True  # raise a sensor's variance on large innovations; estimate a bias anew that jumped
    gate: float = 27.9  # [-] chi-square with 3 degrees of freedom: a sound fix is refused 4 times in a million
    release: tuple[float, float, float, float] = (16.0, 2.0, 12.0, 5e-3)
    """Of held corrections: pace over the filter's own, slowest and fastest [rad/s], largest distance that pulls [m]."""
    acceleration_time: float = 0.02  # [s] time constant of the output acceleration

    def init(self, first: Sequence[Measurement]) -> NavigationState:
        """Initial state from the first measurements of every sensor; velocity zero without a DVL.

        Raises:
            ConfigurationError: If an IMU, vision, encoder or torque measurement is missing, or one of them is not
                finite.
        """
        by_type = {type(m): m for m in first}
        try:
            imu, vision = by_type[ImuMeasurement], by_type[VisionMeasurement]
            encoders, torque = by_type[EncoderMeasurement], by_type[TorqueMeasurement]
        except KeyError as missing:
            raise ConfigurationError(f"navigation needs a first {missing.args[0].__name__}") from None
        assert isinstance(imu, ImuMeasurement)
        assert isinstance(vision, VisionMeasurement)
        assert isinstance(encoders, EncoderMeasurement)
        assert isinstance(torque, TorqueMeasurement)
        dvl = by_type.get(DvlMeasurement)
        speed = dvl if isinstance(dvl, DvlMeasurement) and _sound(dvl.v_WB_B) else None
        for m, values in (
            (imu, (imu.specific_force_B, imu.w_WB_B, imu.R_WB)),
            (vision, (vision.p_WB,)),
            (encoders, (encoders.q, encoders.qd)),
            (torque, (torque.tau,)),
        ):
            if not (math.isfinite(m.time) and all(_sound(v) for v in values)):
                raise ConfigurationError(f"navigation needs a first {type(m).__name__} that is finite, got {values}")
        of_imu, of_vision = imu.noise or self.imu, vision.noise or self.vision
        of_dvl = speed.noise or self.dvl if speed else self.dvl
        R = np.array(imu.R_WB, dtype=np.float64)
        x, P, layout = np.zeros(MOST_STATES), np.zeros((MOST_STATES, MOST_STATES)), np.full(3, -1)
        x[:3], n = vision.p_WB, 9
        P[:3, :3] = (of_vision.white**2 + of_vision.wander**2) * np.eye(3)
        P[3:6, 3:6] = 0.1**2 * np.eye(3)
        up = R[2]  # the tilt error of the attitude reference couples gravity in, across `up`
        P[6:9, 6:9] = of_imu.acceleration_bias**2 * np.eye(3)
        P[6:9, 6:9] += (GRAVITY * of_imu.attitude_bias) ** 2 * (np.eye(3) - np.outer(up, up))
        if of_dvl.bias > 0.0:
            layout[1], n = n, n + 3
            P[n - 3 : n, n - 3 : n] = of_dvl.bias**2 * np.eye(3)
        if speed:
            x[3:6] = R @ speed.v_WB_B
            P[3:6, 3:6] = (of_dvl.white**2 + of_dvl.bias**2) * np.eye(3)
            if of_dvl.bias > 0.0:
                P[3:6, n - 3 : n] = -(of_dvl.bias**2) * R
                P[n - 3 : n, 3:6] = P[3:6, n - 3 : n].T
        if of_vision.wander > 0.0:
            layout[2], n = n, n + 3
            P[n - 3 : n, n - 3 : n] = of_vision.wander**2 * np.eye(3)
            P[:3, n - 3 : n] = P[n - 3 : n, :3] = -(of_vision.wander**2) * np.eye(3)
        layout[0] = n
        state = NavigationState(
            time=imu.time,
            clock=imu.time,
            given=imu.time,
            imu_time=imu.time,
            interval=math.inf,
            imu=of_imu,
            layout=layout,
            walks=np.array([self.bias_walk**2, of_vision.wander**2, of_vision.wander_time]),
            turning=np.zeros(3),
            R_WB=R,
            gyro=np.array([of_imu.attitude**2, 0.0, of_imu.rate_bias**2]),
            rate_bias=np.zeros(3),
            x=x,
            P=P,
            held=np.zeros((2, 3)),
            a_B=np.zeros(3),
            force=imu.specific_force_B,
            w_B=imu.w_WB_B,
            imu_last=imu,
            imu_repeats=0,
            past_input=np.full((_HISTORY, INPUT), -np.inf),
            past_x=np.zeros((_HISTORY, MOST_STATES)),
            past_P=np.zeros((_HISTORY, MOST_STATES, MOST_STATES)),
            past_fix=np.zeros((_HISTORY, 2, FIX)),
            head=0,
            watches=(
                FixMonitor(vision.p_WB, vision.time, vision.time),
                FixMonitor(speed.v_WB_B, speed.time, speed.time)
                if speed
                else FixMonitor(np.zeros(3), -math.inf, -math.inf),
            ),
            bias_jumps=0,
            q=encoders.q,
            qd=encoders.qd,
            tau=torque.tau,
        )
        state.past_input[0, TIME] = imu.time
        state.past_input[0, ATTITUDE : ATTITUDE + 9] = R.ravel()
        state.past_x[0], state.past_P[0] = x, P
        return state

    def step(
        self, state: NavigationState, measurements: Sequence[Measurement]
    ) -> tuple[NavigationState, StateEstimate]:
        """Process the measurements that have arrived, in any order, and return the estimate of now.

        Measurements that are not finite, were processed before or repeat a frozen reading are ignored. The ages in the
        estimate then grow.

        Args:
            state: Of the last call, or of `init`; changed in place.
            measurements: All that have arrived since.
        """
        fixes: list[VisionMeasurement | DvlMeasurement] = []
        q, qd, tau = state.q, state.qd, state.tau
        for m in measurements:  # the frequent types first
            if isinstance(m, EncoderMeasurement):
                q, qd = m.q, m.qd
            elif isinstance(m, TorqueMeasurement):
                tau = m.tau
            elif isinstance(m, ImuMeasurement):
                self._inertial(state, m)
            elif isinstance(m, (VisionMeasurement, DvlMeasurement)):
                fixes.append(m)
                continue  # fixes do not set the clock: a wrong time stamp on a picture must not
            if m.time > state.clock:
                state.clock = m.time
        if all_finite(q, qd, tau):
            state.q, state.qd, state.tau = q, qd, tau
        else:  # a joint whose reading is not finite keeps its last one, and fault detection finds it
            state.q, state.qd, state.tau = (
                np.where(np.isfinite(new), new, old) for new, old in ((q, state.q), (qd, state.qd), (tau, state.tau))
            )
        if state.clock - state.imu_time > _IMU_SILENCE:
            self._go_on_blind(state)
        for m in fixes:  # after the IMU, so that their step exists
            if isinstance(m, VisionMeasurement):
                noise = m.noise or self.vision
                self._fix(state, VISION, m.time, m.p_WB, noise.white)
            else:
                noise = m.noise or self.dvl
                self._fix(state, DVL, m.time, m.v_WB_B, noise.white)
        X_WB, v_B, w_B, a_B, sigma = smoothed_output(
            state.clock - state.given,
            state.clock - state.time,
            self.acceleration_time,
            self.release,
            state.force,
            state.w_B,
            state.R_WB,
            state.rate_bias,
            state.x,
            state.P,
            state.held,
            state.a_B,
        )
        state.given = state.clock
        vision, dvl = state.watches
        return state, StateEstimate(
            time=state.clock,
            X_WB=X_WB,
            v_WB_B=v_B,
            w_WB_B=w_B,
            a_WB_B=a_B,
            q=state.q,
            qd=state.qd,
            tau=state.tau,
            position_sigma=sigma,
            vision_age=state.clock - vision.used,
            dvl_age=state.clock - dvl.used,
            imu_age=state.clock - state.imu_time,
        )

    def _inertial(self, state: NavigationState, m: ImuMeasurement) -> None:
        dt = m.time - state.time
        force, w = m.specific_force_B, m.w_WB_B
        if not dt > 1e-9:
            return
        last, state.imu_last = state.imu_last, m
        if force[0] != last.specific_force_B[0]:
            state.imu_repeats = 0
        elif np.array_equal(force, last.specific_force_B) and np.array_equal(w, last.w_WB_B):
            state.imu_repeats += 1
            if state.imu_repeats >= _IMU_REPEATS:
                return
        if self._advance(state, dt, force, w, m.R_WB, 0.0):
            state.imu_time = m.time

    def _go_on_blind(self, state: NavigationState) -> None:
        """Propagate without IMU: constant velocity with an unknown acceleration."""
        dt = state.clock - state.time
        if dt > 1e-9:
            force = state.R_WB[2] * GRAVITY + state.x[6:9]
            self._advance(state, dt, force, state.rate_bias, state.R_WB, _BLIND * dt)

    def _advance(self, state: NavigationState, dt: float, force: Array, w: Array, R: Array, unknown: float) -> bool:
        noise = state.imu
        if dt < 0.999 * state.interval and not unknown:  # first samples, or a faster stream than assumed
            state.interval = dt
            state.turning[:] = noise.rate**2 * dt, noise.attitude**2 + 1e-16, self.rate_bias_walk**2
        elif dt > 1.5 * state.interval and not unknown:
            unknown = _BLIND * (dt - state.interval)
        along = (noise.acceleration * dt) ** 2 + unknown
        # Tilt noise left after the attitude filter: equal shares of gyro and reference, white at the resolution of
        # vision.
        across = along + 2.0 * (GRAVITY * noise.attitude) ** 2 * state.interval * dt
        head = (state.head + 1) % _HISTORY
        taken = inertial(
            force,
            w,
            R,
            state.time + dt,
            dt,
            across,
            along,
            state.layout,
            state.walks,
            state.turning,
            state.R_WB,
            state.gyro,
            state.rate_bias,
            state.x,
            state.P,
            head,
            state.past_input,
            state.past_x,
            state.past_P,
            state.past_fix,
        )
        if taken:
            state.head, state.force, state.w_B = head, force, w
            state.time += dt
        return taken

    def _fix(self, state: NavigationState, kind: int, time: float, value: Array, sigma: float) -> None:
        """Validate a position or a velocity, update the filter at its step, and withhold the correction."""
        watch = state.watches[kind]
        if not (_sound(value) and math.isfinite(time)):
            watch.refused += 1
            return
        if np.array_equal(value, watch.last):
            if time == watch.time:
                return
            watch.repeats += 1
        else:
            watch.repeats = 0
        watch.last, watch.time = value, time
        if watch.repeats >= _REPEATS and sigma > 0.0:
            watch.refused += 1
            return
        at, shift = _step_of(state, time)
        if at < 0:
            watch.refused += 1
            return
        fix = np.zeros(FIX)
        R = state.past_input[at, ATTITUDE : ATTITUDE + 9].reshape(3, 3)
        fix[VALUE : VALUE + 3] = value if kind == VISION else R @ value
        floor = 1e-6 if kind == VISION else 1e-7  # [m], [m/s]
        fix[HAS], fix[VARIANCE], fix[SHIFT] = 1.0, watch.scale * max(sigma, floor) ** 2, shift
        innovation, white = np.empty(3), np.empty(3)
        squared = mahalanobis(
            kind, fix, at, state.layout, state.past_input, state.past_x, state.past_P, innovation, white
        )
        square = watch.take(white, time, math.sqrt(self.gate))
        if self.adapt:
            excess = min(square, _SCALE_CAP) - _SCALE_SLACK
            watch.scale = min(max(watch.scale * math.exp(_SCALE_GAIN * excess), 1.0), _MOST_SCALE)
        first = self._bias_jumped(state, watch, innovation, time) if kind == DVL and self.adapt else -1
        if first < 0 and not self._admit(state, watch, kind, fix, at, innovation, squared):
            watch.refused += 1
            return
        slot = state.past_fix[at, kind]
        if slot[HAS]:  # two of a kind at one step: their weighted mean
            share = fix[VARIANCE] / (fix[VARIANCE] + slot[VARIANCE])
            fix[VALUE:] = share * slot[VALUE:] + (1.0 - share) * fix[VALUE:]
            fix[VARIANCE] = share * slot[VARIANCE]
        slot[:] = fix
        before = state.x[:6].copy()
        replay(
            at if first < 0 else first,
            state.head,
            state.layout,
            state.walks,
            state.past_input,
            state.past_x,
            state.past_P,
            state.past_fix,
            state.x,
            state.P,
        )
        state.held += (state.x[:6] - before).reshape(2, 3)
        watch.used = max(watch.used, time)

    @staticmethod
    def _bias_jumped(state: NavigationState, watch: FixMonitor, innovation: Array, time: float) -> int:
        """Row of the past before a jump of the accelerometer bias shown by the DVL's mean innovation; -1 without one.

        The bias is then assumed to have changed twice the time constant of the mean ago. The variance added there
        explains the innovation as a velocity that runs away.
        """
        if float(watch.mean @ watch.mean) <= _MEAN_GATE * watch.mean_variance:
            return -1
        ago = 2.0 * _MEAN_TIME
        at, _ = _step_of(state, time - ago)
        before = (at - 1) % _HISTORY
        if at < 0 or not -math.inf < state.past_input[before, TIME] < state.past_input[at, TIME]:
            return -1  # older than the stored past
        state.past_input[at, JUMP] += float(innovation @ innovation) / ago**2
        state.bias_jumps += 1
        watch.mean, watch.mean_variance = np.zeros(3), 0.0
        for blamed in state.watches:  # their errors were the accelerometer's
            blamed.scale, blamed.agreeing = 1.0, 0
        return before

    def _admit(
        self,
        state: NavigationState,
        watch: FixMonitor,
        kind: int,
        fix: Array,
        at: int,
        innovation: Array,
        squared: float,
    ) -> bool:
        """Chi-square gate on the innovation, overruled by consecutive rejected fixes that agree."""
        if squared <= self.gate:
            watch.agreeing = 0
            return True
        apart = float(np.sum((innovation - watch.rejected) ** 2))
        watch.agreeing = watch.agreeing + 1 if watch.agreeing and apart <= 2.0 * self.gate * fix[VARIANCE] else 1
        watch.rejected = innovation
        if watch.agreeing < _AGREEING:
            return False
        # The filter is wrong: its covariance at that step is increased until the fixes pass.
        first = 0 if kind == VISION else 3
        for i in range(3):
            state.past_P[at, first + i, first + i] += innovation[i] ** 2
        watch.agreeing, watch.scale = 0, 1.0
        return True


def _sound(values: Array) -> bool:
    """True if all of `values` (n,) or (n, n) are finite."""
    return bool(np.isfinite(values).all())


def _step_of(state: NavigationState, time: float) -> tuple[int, float]:
    """Row of the past nearest to `time`, and `time` after it [s]; row -1 if it is too old or too new."""
    times = state.past_input[:, TIME]
    at = int(np.argmin(np.abs(times - time)))
    shift = time - float(times[at])
    known = state.interval if math.isfinite(state.interval) else 0.0
    return (at if abs(shift) <= 0.75 * known + 1e-9 else -1), shift
