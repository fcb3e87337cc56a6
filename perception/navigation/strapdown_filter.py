"""The vehicle's own state from IMU, DVL, late vision, encoders and torque sensors: a small documented filter.

Position, velocity and accelerometer bias are one Kalman filter driven by the accelerometer at the IMU's rate
(`perception.navigation.filter_kernel`). The bias is kept in hull axes, where it and the tilt of the attitude reference,
which couples gravity into the acceleration and cannot be told from it, stay what they are when the hull turns.

What a sensor is worth it says itself: the noise that its maker states travels with the measurement; where it states
none, the filter's own belief of that sensor stands. A sensor whose innovations are larger than that is believed less,
never more (`Watch.scale`). What the DVL says beside the inertial unit is white noise while the accelerometer's bias is
what it was; a mean of it that noise does not explain is a bias that jumped, which is then learnt anew.

Vision arrives late, and not always in order. The filter goes back to the step at which the picture was taken, takes it
in there and runs forward again over the stored IMU samples with every fix that has come since: the result is that of
a filter which had everything in time (Larsen et al., FUSION 1998, call it recalculation, and exact).

A vision that wanders (`VisionNoise.wander`) has a state of its own. What can be known then: how the hull has moved
since some moment, to what the inertial unit and the DVL remember of it; not where it is in the world, for a wander
that was there from the beginning looks like another place. The object was found with the same cameras, so the error
of that moment goes into object and hull alike and does not move the tool on it; what has wandered since then does
(5 mm that forget themselves in 20 s: 4.5 mm since the scan where the wander is stated, 5.8 mm where it is not).
`StateEstimate.position_sigma` is of the place in the world and holds both.

What matters to a tool in contact is smoothness: on a surface of 3e4 N/m a jump of 0.2 mm is 6 N. So corrections are
not handed on at once. What is held back of them is let go as the linear-quadratic optimum has it that weighs the
error against the acceleration that is added to the motion, d'' = -sqrt(2) f d' - f^2 d: the place and the velocity
handed on have no steps, and one is the derivative of the other. Its frequency f follows that of the filter's own gain.
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
    hand_on,
    inertial,
    replay,
    sound,
    surprise,
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

_HISTORY = 512  # IMU samples kept: vision may be this many late
_REPEATS = 3  # readings equal to the last bit, one after another, that are too many for a noisy sensor: it is frozen
_IMU_REPEATS = 25
_IMU_SILENCE = 0.05  # [s] without a sample, after which the filter goes on without
_BLIND = 2.5e-3  # [(m/s^2)^2 s] spectral density of a hull's acceleration that nobody measures
_MEAN_TIME = 0.25  # [s] of the mean innovation; a bias that jumps by 0.05 m/s^2 is beyond noise after twice that
_MEAN_GATE = 45.0  # chi-square of three: noise alone exceeds it once in 10^9 fixes
_AGREEING = 5  # rejected fixes in a row that agree with one another: it is the filter that is wrong
_MOST_SCALE = 100.0  # of a sensor's variance
_SCALE_GAIN, _SCALE_CAP, _SCALE_SLACK = 0.05, 4.0, 1.2


@dataclass(slots=True, eq=False)
class Watch:
    """What is remembered of one kind of fix, to judge the next."""

    last: Array  # (3,) last reading
    time: float  # [s] of it
    used: float  # [s] of the newest that was used
    repeats: int = 0
    scale: float = 1.0  # by which its variance is larger than stated, from the innovations
    agreeing: int = 0  # rejected in a row, and like one another
    rejected: Array = field(default_factory=lambda: np.zeros(3))  # (3,) innovation of the last rejected
    mean: Array = field(default_factory=lambda: np.zeros(3))  # (3,) of recent innovations, by their deviations
    mean_variance: float = 0.0  # of each of its axes, were they white
    mean_time: float = -math.inf  # [s] of the last one in it
    refused: int = 0  # since the start, for the log

    def take(self, white: Array, time: float, most: float) -> float:
        """Take an innovation by its deviations (3,) into the mean, no more of it than `most`.

        Returns its mean square beside the mean so far, 1 for a sensor that is as noisy as stated: what is steady is no
        noise.
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
    """Memory of the filter. Arrays are owned by it and change in place."""

    time: float  # [s] of the filter: the newest IMU sample
    clock: float  # [s] newest time of any measurement
    given: float  # [s] time of the last estimate
    imu_time: float  # [s] of the newest sound IMU sample
    interval: float  # [s] between IMU samples, the shortest seen
    imu: ImuNoise
    layout: Array  # (3,) int, see the kernel
    walks: Array  # (3,)
    turning: Array  # (3,)
    R_WB: Array  # (3, 3)
    gyro: Array  # (3,) covariance of angle and gyro bias, the same for each axis
    rate_bias: Array  # (3,) [rad/s]
    x: Array  # (15,) states, see the kernel
    P: Array  # (15, 15)
    held: Array  # (2, 3) corrections of position not yet handed on [m], and their rate [m/s]
    a_B: Array  # (3,) smoothed acceleration [m/s^2]
    force: Array  # (3,) [m/s^2] last specific force
    w_B: Array  # (3,) [rad/s] last rates
    imu_last: ImuMeasurement
    imu_repeats: int
    past_input: Array  # (_HISTORY, INPUT)
    past_x: Array  # (_HISTORY, 15) before the fixes of that step
    past_P: Array  # (_HISTORY, 15, 15)
    past_fix: Array  # (_HISTORY, 2, FIX)
    head: int  # newest row of the past
    watches: tuple[Watch, Watch]
    bias_jumps: int  # of the accelerometer since the start, for the log
    q: Array
    qd: Array
    tau: Array


_IMU = ImuNoise(
    acceleration=2.5e-3, acceleration_bias=6e-3, rate=2e-4, rate_bias=1e-4, attitude=5e-5, attitude_bias=5e-4
)
_DVL, _VISION = DvlNoise(white=3e-3), VisionNoise(white=2e-3)


@dataclass(frozen=True, slots=True, kw_only=True)
class Navigation:
    """Estimator (`sim.interfaces.protocols.Estimator`).

    `imu`, `dvl` and `vision` are believed of a sensor that states no noise of its own.
    """

    period: float = 0.002  # [s]
    imu: ImuNoise = _IMU
    dvl: DvlNoise = _DVL
    vision: VisionNoise = _VISION
    bias_walk: float = 5e-6  # [m/s^2] per square root of second
    rate_bias_walk: float = 1e-7  # [rad/s] per square root of second
    adapt: bool = True  # believe a sensor less when its innovations are too large; learn a bias anew that jumped
    gate: float = 27.9  # chi-square of three: a sound fix is refused 4 times in a million
    release: tuple[float, float, float, float] = (16.0, 2.0, 12.0, 5e-3)
    """Of held corrections: pace over the filter's own, slowest and fastest [rad/s], largest distance that pulls [m]."""
    acceleration_time: float = 0.02  # [s] smoothing of the acceleration handed on

    def init(self, first: Sequence[Measurement]) -> NavigationState:
        """Start from the first measurements of every sensor; at rest, if there is no DVL.

        Raises ConfigurationError if an IMU, a vision, an encoder or a torque measurement is not among them, or one of
        them is not finite.
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
        up = R[2]  # tilt of the attitude reference couples gravity in, across it
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
                Watch(vision.p_WB, vision.time, vision.time),
                Watch(speed.v_WB_B, speed.time, speed.time) if speed else Watch(np.zeros(3), -math.inf, -math.inf),
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
        """Take what has arrived, in any order, and give the estimate of now.

        What is not finite, what has been taken before, and what a frozen sensor repeats is left aside; the ages in
        the estimate tell of it.
        """
        fixes: list[VisionMeasurement | DvlMeasurement] = []
        q, qd, tau = state.q, state.qd, state.tau
        for m in measurements:  # the frequent ones first
            if isinstance(m, EncoderMeasurement):
                q, qd = m.q, m.qd
            elif isinstance(m, TorqueMeasurement):
                tau = m.tau
            elif isinstance(m, ImuMeasurement):
                self._inertial(state, m)
            elif isinstance(m, (VisionMeasurement, DvlMeasurement)):
                fixes.append(m)
                continue  # they do not set the clock: a wild stamp on a picture must not
            if m.time > state.clock:
                state.clock = m.time
        if sound(q, qd, tau):
            state.q, state.qd, state.tau = q, qd, tau
        else:  # what one joint lacks the others do not: its last reading stands, and is found frozen
            state.q, state.qd, state.tau = (
                np.where(np.isfinite(new), new, old) for new, old in ((q, state.q), (qd, state.qd), (tau, state.tau))
            )
        if state.clock - state.imu_time > _IMU_SILENCE:
            self._go_on_blind(state)
        for m in fixes:  # after the IMU, so that the step they belong to is there
            if isinstance(m, VisionMeasurement):
                noise = m.noise or self.vision
                self._fix(state, VISION, m.time, m.p_WB, noise.white)
            else:
                noise = m.noise or self.dvl
                self._fix(state, DVL, m.time, m.v_WB_B, noise.white)
        X_WB, v_B, w_B, a_B, sigma = hand_on(
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
        """The IMU is silent: the hull goes on as it moved, with an acceleration that nobody knows."""
        dt = state.clock - state.time
        if dt > 1e-9:
            force = state.R_WB[2] * GRAVITY + state.x[6:9]
            self._advance(state, dt, force, state.rate_bias, state.R_WB, _BLIND * dt)

    def _advance(self, state: NavigationState, dt: float, force: Array, w: Array, R: Array, unknown: float) -> bool:
        noise = state.imu
        if dt < 0.999 * state.interval and not unknown:  # first samples, or a faster stream than was thought
            state.interval = dt
            state.turning[:] = noise.rate**2 * dt, noise.attitude**2 + 1e-16, self.rate_bias_walk**2
        elif dt > 1.5 * state.interval and not unknown:
            unknown = _BLIND * (dt - state.interval)
        along = (noise.acceleration * dt) ** 2 + unknown
        # What gyro and attitude reference leave of noise in the tilt: as much each, white for what vision resolves.
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
        """Judge a position or a velocity, take it in at its step, and hold the correction back from what is given."""
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
        squared = surprise(kind, fix, at, state.layout, state.past_input, state.past_x, state.past_P, innovation, white)
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
    def _bias_jumped(state: NavigationState, watch: Watch, innovation: Array, time: float) -> int:
        """Row of the past before the accelerometer's bias jumped, where the DVL's mean innovation tells of it; else -1.

        The bias is then believed to have changed, twice the time of the mean ago, by what explains the innovation:
        a velocity that runs away.
        """
        if float(watch.mean @ watch.mean) <= _MEAN_GATE * watch.mean_variance:
            return -1
        ago = 2.0 * _MEAN_TIME
        at, _ = _step_of(state, time - ago)
        before = (at - 1) % _HISTORY
        if at < 0 or not -math.inf < state.past_input[before, TIME] < state.past_input[at, TIME]:
            return -1  # not remembered
        state.past_input[at, JUMP] += float(innovation @ innovation) / ago**2
        state.bias_jumps += 1
        watch.mean, watch.mean_variance = np.zeros(3), 0.0
        for blamed in state.watches:  # for what was the accelerometer's
            blamed.scale, blamed.agreeing = 1.0, 0
        return before

    def _admit(
        self, state: NavigationState, watch: Watch, kind: int, fix: Array, at: int, innovation: Array, squared: float
    ) -> bool:
        """Chi-square gate on the innovation, which gives way to many that agree with one another."""
        if squared <= self.gate:
            watch.agreeing = 0
            return True
        apart = float(np.sum((innovation - watch.rejected) ** 2))
        watch.agreeing = watch.agreeing + 1 if watch.agreeing and apart <= 2.0 * self.gate * fix[VARIANCE] else 1
        watch.rejected = innovation
        if watch.agreeing < _AGREEING:
            return False
        # The filter is where it is not: what it believes since then is widened until the fixes fit.
        first = 0 if kind == VISION else 3
        for i in range(3):
            state.past_P[at, first + i, first + i] += innovation[i] ** 2
        watch.agreeing, watch.scale = 0, 1.0
        return True


def _sound(values: Array) -> bool:
    """Whether all of `values` (n,) or (n, n) are finite."""
    return bool(np.isfinite(values).all())


def _step_of(state: NavigationState, time: float) -> tuple[int, float]:
    """Row of the past nearest to `time`, and how long after it `time` is [s]; row -1 if there is none so old or new."""
    times = state.past_input[:, TIME]
    at = int(np.argmin(np.abs(times - time)))
    shift = time - float(times[at])
    known = state.interval if math.isfinite(state.interval) else 0.0
    return (at if abs(shift) <= 0.75 * known + 1e-9 else -1), shift
