"""Residuals between logs and their replay in windows, each with its own initial state and current.

The initial state of a window is that of the log, up to its noise. Its current is that of the log,
up to the gusts. Both are parameters of the window, which the fit estimates and discards. A gap or
an accumulated drift therefore has no effect, and the information of a window comes only from its
own few seconds.
"""

import queue
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from uuv.calib.water.estimator import WaterFit, estimate
from uuv.calib.water.logs import ATTITUDE, DEPTH, FORCE, POSITION, RATE, VELOCITY, WaterLog
from uuv.calib.water.named_fit import NamedParameter, Slopes, fit_blocks, values_of
from uuv.sim.interfaces.errors import ConfigurationError, UuvError
from uuv.sim.interfaces.spatial import GRAVITY, Array
from uuv.water_identification.settings import FitSettings
from uuv.water_identification.vehicle_replay import ReplayVehicle, Script

# prior standard deviations of the differences; small, since only their sum is observed
STEP = 1e-4
NODES = 3  # nodes of a window's current: at its begin, middle and end, with linear interpolation
STATE = 12  # parameters of a window's start: position, attitude, velocity, rate; (3,) each
OWN = STATE + 3 * NODES  # number of parameters of a window
_SMOOTHED = 0.3  # [s] before and after the start of a window, for its first guess
_STILL = 3.0  # number of standard deviations within which a hull counts as at rest


@dataclass(frozen=True, slots=True, eq=False)
class _Samples:
    """Samples of one channel in all windows."""

    row: np.ndarray  # (k,) row of the replay before each sample
    share: Array  # (k,) share of the step from that row to the sample
    measured: Array  # (k, d)
    sigma: Array  # (k,)
    window: np.ndarray  # (k,)


class LogReplay:
    """One log, cut into windows, with the inputs of the vehicle and the measurements."""

    def __init__(self, replay: ReplayVehicle, log: WaterLog, settings: FitSettings) -> None:
        """Cut the log.

        Raises:
            ConfigurationError: No part of the log is long enough for a window.
        """
        self.log, self.settings, self._dt = log, settings, replay.timestep
        cut = _windows(log, settings.window)
        measured = [window for window in cut if _seen(log, *window, self._dt)]
        self.windows = measured[:: settings.every]
        if not self.windows:
            raise ConfigurationError(
                f"{log.name}: has no measurement within its {len(cut)} windows"
            )

        if curveless := [
            name
            for name, has in zip(replay.names, replay.has_curve, strict=True)
            if name in log.commands and not has
        ]:
            raise ConfigurationError(
                f"{log.name}: thruster {curveless[0]} has no thrust curve in the vehicle; give "
                f"thrust.{curveless[0]} [N] in place of thruster.{curveless[0]}"
            )

        # Rows of the replay, window by window.
        begin = np.array([a for a, _ in self.windows])
        steps = np.array([max(1, int((b - a) / self._dt)) for a, b in self.windows], dtype=np.int64)
        self.first = np.concatenate([[0], np.cumsum(steps + 1)[:-1]]).astype(np.int64)
        self.steps, self.begin = steps, begin
        self.time = np.concatenate(
            [a + self._dt * np.arange(n + 1) for a, n in zip(begin, steps, strict=True)]
        )
        # For each row: share (R, NODES) of the nodes of its window's current.
        through = np.concatenate([np.linspace(0.0, NODES - 1.0, n + 1) for n in steps])
        self._nodes = np.maximum(0.0, 1.0 - np.abs(through[:, None] - np.arange(NODES)))
        self._of_row = np.repeat(np.arange(len(begin)), steps + 1)

        self.script = self._script(replay)
        self.starts = np.array([_start(log, a) for a in begin])

        # Steps for differences of starts and currents, for x, y and z each.
        channels = log.channels
        self.spread = np.repeat(
            [
                10.0 * settings.noise[POSITION],
                10.0 * settings.noise[ATTITUDE] if ATTITUDE in channels else 0.1,
                0.1 if POSITION in channels or VELOCITY in channels else 0.2,
                0.1 if RATE in channels or ATTITUDE in channels else 0.3,
                *NODES * [settings.gust],
            ],
            3,
        )

        # Residuals by channel, then sorted by window.
        sampled = {kind: self._sampled(kind) for kind in log.channels}
        self._samples = {kind: samples for kind, samples in sampled.items() if len(samples.row)}
        self.kinds = kinds = tuple(self._samples)
        windows = [
            np.repeat(samples.window, 3 if kind == ATTITUDE else samples.measured.shape[1])
            for kind, samples in self._samples.items()
        ]
        window = np.concatenate(windows)
        self.order = np.argsort(window, kind="stable")
        self.splits = np.cumsum(np.bincount(window, minlength=len(begin)))[:-1]

        # index into `kinds` of each residual
        widths = [len(of_channel) for of_channel in windows]
        self.kind = np.repeat(np.arange(len(kinds)), widths)[self.order]
        self.weight = np.ones(len(kinds))  # number of residuals of each channel

        steps_of = [float(np.median(np.diff(log.channels[kind].time))) for kind in kinds]
        # samples, by kind
        self.a_second = [round(min(settings.rate, 1.0 / step)) for step in steps_of]

        self.nuisances = self._nuisances()

    def _nuisances(self) -> tuple[NamedParameter, ...]:
        """Parameters of this log that are fitted in addition to those of the vehicle."""
        settings, name = self.settings, self.log.name
        unknowns = [(f"current {axis}", "m/s", settings.current) for axis in "xyz"]
        if ATTITUDE in self.log.channels:
            unknowns += [(f"mount {axis}", "rad", settings.mount) for axis in ("roll", "pitch")]
        if RATE in self.log.channels:
            unknowns += [(f"rate bias {axis}", "rad/s", settings.rate_bias) for axis in "xyz"]
        if FORCE in self.log.channels:
            unknowns += [(f"force bias {axis}", "m/s^2", settings.force_bias) for axis in "xyz"]

        return tuple(
            NamedParameter(name=f"{name}: {word}", unit=unit, nominal=0.0, sigma=sigma)
            for word, unit, sigma in unknowns
            if sigma > 0.0
        )

    def _script(self, replay: ReplayVehicle) -> Script:
        log, dt = self.log, self._dt
        thrust = np.full((len(self.time), len(replay.names)), np.nan)
        amid = self.time + 0.5 * dt
        commands = (
            np.column_stack(
                [log.commands.get(name, np.zeros(len(log.time))) for name in replay.names]
            )
            if replay.names
            else np.zeros((len(log.time), 0))
        )

        speed = replay.speeds(log.time, commands, self.time)
        for i, name in enumerate(replay.names):
            if name in log.thrusts:
                at = np.clip(np.searchsorted(log.time, amid + 1e-9) - 1, 0, len(log.time) - 1)
                thrust[:, i] = log.thrusts[name][at]
            elif not replay.has_curve[i]:
                thrust[:, i] = 0.0

        # Angles by local quadratic fits; a passive or unlogged joint stays at its home position.
        n = len(replay.joints)
        q, qd, qdd = (
            np.zeros((len(self.begin), n)),
            np.zeros((len(self.begin), n)),
            np.zeros((len(self.time), n)),
        )
        for j, name in enumerate(replay.joints):
            q[:, j] = replay.vehicle.q_home[j]
            if name not in log.joints:
                continue

            angle, speed_at = _smooth(log.time, log.joints[name], self.time)
            for w, (a, k) in enumerate(zip(self.first, self.steps, strict=True)):
                q[w, j], qd[w, j] = angle[a], speed_at[a]
                qdd[a : a + k, j] = np.diff(speed_at[a : a + k + 1]) / dt

        return Script(
            first=self.first, steps=self.steps, speed=speed, thrust=thrust, q=q, qd=qd, qdd=qdd
        )

    def _sampled(self, kind: str) -> _Samples:
        """Samples of a channel in windows, averaged to the rate in the settings."""
        channel, rate = self.log.channels[kind], self.settings.rate
        at = np.searchsorted(self.begin, channel.time, side="right") - 1
        ends = self.begin + self.steps * self._dt
        inside = (at >= 0) & (channel.time <= ends[np.maximum(at, 0)] - 1e-9)
        at, time, samples = at[inside], channel.time[inside], channel.values[inside]

        # Cells at the rate in the settings, in each window.
        together = max(1, round(1.0 / (rate * float(np.median(np.diff(channel.time))))))
        cells = np.floor((time - self.begin[at]) * rate).astype(np.int64)
        cell = cells if together > 1 else np.arange(len(time))
        key = at * (int(cell.max(initial=0)) + 1) + cell
        _, first, of, count = np.unique(
            key, return_index=True, return_inverse=True, return_counts=True
        )

        mean = np.zeros((len(first), samples.shape[1]))
        np.add.at(mean, of, samples)
        when = np.bincount(of, time) / count if len(first) else np.zeros(0)
        mean /= count[:, None]

        if kind == ATTITUDE:
            mean /= np.linalg.norm(mean, axis=1, keepdims=True)

        # Row of the replay before each sample, and its share of the step.
        window = at[first]
        steps = (when - self.begin[window]) / self._dt
        k = np.minimum(np.floor(steps).astype(np.int64), self.steps[window] - 1)

        return _Samples(
            self.first[window] + k,
            steps - k,
            mean,
            self.settings.noise[kind] / np.sqrt(count),
            window,
        )

    def begun(self, local: Array) -> tuple[Array, Array]:
        """Starts (W, 13), and additions to the current (R, 3), from window parameters (OWN,)."""
        moved = local * self.spread
        starts = self.starts.copy()
        starts[:, :3] += moved[:, :3]

        turned = Rotation.from_quat(self.starts[:, [4, 5, 6, 3]]) * Rotation.from_rotvec(
            moved[:, 3:6]
        )
        starts[:, 3:7] = turned.as_quat()[:, [3, 0, 1, 2]]
        starts[:, 7:] += moved[:, 6:12]

        nodes = moved[self._of_row, STATE:].reshape(-1, NODES, 3)
        return starts, np.einsum("rk,rkj->rj", self._nodes, nodes)

    def residuals(self, rows: Array, values: Mapping[str, float]) -> Array:
        """Residuals (m,) of all windows in sequence, in units of their standard deviations."""
        residuals = []
        for kind, weight in zip(self.kinds, self.weight, strict=True):
            samples = self._samples[kind]
            off = self._off(kind, samples, rows, values)
            residuals.append((weight * off / samples.sigma[:, None]).ravel())
        return np.concatenate(residuals)[self.order]

    def _off(self, kind: str, samples: _Samples, rows: Array, values: Mapping[str, float]) -> Array:
        """Replayed minus measured values (k, d)."""
        share = samples.share[:, None]

        def bias(word: str) -> Array:
            return np.array([values.get(f"{self.log.name}: {word} {axis}", 0.0) for axis in "xyz"])

        def at(columns: slice) -> Array:
            here = rows[samples.row, columns]
            return here + share * (rows[samples.row + 1, columns] - here)

        if kind == POSITION:
            return at(slice(0, 3)) - samples.measured
        if kind == DEPTH:
            return -at(slice(2, 3)) - samples.measured
        if kind == RATE:
            return at(slice(10, 13)) + bias("rate bias") - samples.measured

        quat = at(slice(3, 7))
        R_WB = Rotation.from_quat(quat[:, [1, 2, 3, 0]])
        if kind == ATTITUDE:
            mounted = [
                values.get(f"{self.log.name}: mount {axis}", 0.0) for axis in ("roll", "pitch")
            ]
            R_replayed = R_WB * Rotation.from_rotvec([*mounted, 0.0])
            return (Rotation.from_quat(samples.measured).inv() * R_replayed).as_rotvec()

        if kind == VELOCITY:
            return R_WB.inv().apply(at(slice(7, 10))) - samples.measured

        gain = (rows[samples.row + 1, 7:10] - rows[samples.row, 7:10]) / self._dt
        return (
            R_WB.inv().apply(gain + np.array([0.0, 0.0, GRAVITY]))
            + bias("force bias")
            - samples.measured
        )

    def replayed(
        self, rows: Array, kind: str, values: Mapping[str, float]
    ) -> tuple[Array, Array, Array, np.ndarray]:
        """Time (k,) [s], measured and replayed values (k, d), and window (k,) of a channel."""
        samples = self._samples[kind]
        time = self.time[samples.row] + samples.share * self._dt
        off = self._off(kind, samples, rows, values)

        if kind == ATTITUDE:
            measured = Rotation.from_quat(samples.measured)
            shown = np.unwrap(measured.as_euler("ZYX"), axis=0)[:, ::-1]
            # small differences about axes of the hull
            return time, shown, shown + off, samples.window

        return time, samples.measured, samples.measured + off, samples.window


class WaterResiduals:
    """Residuals of logs, in one block for each window, for `uuv.calib.water.named_fit`."""

    def __init__(
        self, vehicle: ReplayVehicle, logs: Sequence[WaterLog], settings: FitSettings
    ) -> None:
        """Cut the logs.

        Raises:
            ConfigurationError: A log has no part that is long enough, or nothing moves in any log.
        """
        self.vehicle, self.settings = vehicle, settings
        self.logs = tuple(LogReplay(vehicle, log, settings) for log in logs)
        _check_excited(logs, settings)

        self.parameters = (
            *vehicle.water.parameters,
            *(nuisance for log in self.logs for nuisance in log.nuisances),
        )
        self._index = {parameter.name: i for i, parameter in enumerate(self.parameters)}
        # values at which slopes were computed last
        self._last: tuple[Array, Array, list[Slopes]] | None = None

        self._engines: queue.SimpleQueue[ReplayVehicle] = queue.SimpleQueue()
        for i in range(settings.workers):
            self._engines.put(vehicle if i == 0 else vehicle.copy())

    @property
    def local(self) -> list[int]:
        """Number of parameters of each window."""
        return [OWN] * sum(len(log.begin) for log in self.logs)

    @property
    def channels(self) -> list[str]:
        """Channel and log of each kind of residual."""
        return [f"{log.log.name}: {kind}" for log in self.logs for kind in log.kinds]

    @property
    def widths(self) -> list[int]:
        """Number of components in a sample of each channel."""
        return [1 if kind == DEPTH else 3 for log in self.logs for kind in log.kinds]

    @property
    def a_second(self) -> list[int]:
        """Number of samples per second of each channel."""
        return [count for log in self.logs for count in log.a_second]

    @property
    def labels(self) -> list[np.ndarray]:
        """Index into `channels` of each window's residuals."""
        before = np.cumsum([0, *(len(log.kinds) for log in self.logs)])
        return [
            part
            for log, b in zip(self.logs, before[:-1], strict=True)
            for part in np.split(log.kind + b, log.splits)
        ]

    def widen(self, factors: Array) -> None:
        """Multiply the noise of each channel."""
        if self._last is not None:
            x, local, slopes = self._last
            shares = [(1.0 / factors)[label] for label in self.labels]
            thinner = [
                Slopes(r * s, J * s[:, None], L * s[:, None])
                for (r, J, L), s in zip(slopes, shares, strict=True)
            ]
            self._last = x, local, thinner

        ends = np.cumsum([len(log.kinds) for log in self.logs])
        for log, its in zip(self.logs, np.split(factors, ends[:-1]), strict=True):
            log.weight /= its

    def _local_of(self, local: Sequence[Array]) -> list[Array]:
        """Each log's part of the parameters of the windows, (W, OWN)."""
        ends = np.cumsum([len(log.begin) for log in self.logs])
        return np.split(np.array(local), ends[:-1])

    def states(self, deviations: Array, local: Sequence[Array]) -> list[Array]:
        """States (R, 13) of each log's replay."""
        return self._run(deviations, self._local_of(local))

    def _run(self, deviations: Array, local: Sequence[Array]) -> list[Array]:
        parameters = values_of(self.parameters, deviations)
        engine = self._engines.get()

        try:
            states = []
            for log, its in zip(self.logs, local, strict=True):
                starts, added = log.begun(its)
                current = np.array(
                    [parameters.get(f"{log.log.name}: current {axis}", 0.0) for axis in "xyz"]
                )
                states.append(engine.run(parameters, log.script, starts, current + added))
            return states
        except UuvError:  # no vehicle can have these values
            return [np.full((log.script.rows, 13), np.nan) for log in self.logs]
        finally:
            self._engines.put(engine)

    def _residuals(self, rows: Sequence[Array], values: Mapping[str, float]) -> list[Array]:
        return [_finite(log, states, values) for log, states in zip(self.logs, rows, strict=True)]

    def residuals(self, deviations: Array, local: Sequence[Array]) -> list[Array]:
        """Residuals of each window."""
        residuals = self._residuals(
            self.states(deviations, local), values_of(self.parameters, deviations)
        )
        return [
            part
            for log, r in zip(self.logs, residuals, strict=True)
            for part in np.split(r, log.splits)
        ]

    def slopes(self, deviations: Array, local: Sequence[Array]) -> list[Slopes]:
        """Residuals of each window and their differences, with one replay for each parameter."""
        if (
            self._last is not None
            and np.array_equal(self._last[0], deviations)
            and np.array_equal(self._last[1], local)
        ):
            return self._last[2]

        x, y = np.array(deviations), self._local_of(local)
        parameters = values_of(self.parameters, x)
        base = self._run(x, y)
        r = self._residuals(base, parameters)
        physical = len(self.vehicle.water.parameters)
        shared = [np.zeros((len(r_log), len(x))) for r_log in r]
        starts = [np.zeros((len(r_log), OWN)) for r_log in r]

        def differ(rows: Sequence[Array], changed: Mapping[str, float]) -> list[Array]:
            residuals = self._residuals(rows, changed)
            return [
                (a - b) / STEP if np.all(np.isfinite(a)) else np.zeros_like(b)
                for a, b in zip(residuals, r, strict=True)
            ]

        def parameter(j: int) -> None:
            moved = x + STEP * np.eye(len(x))[j]
            # The sensors' own parameters need no further replay.
            rows = self._run(moved, y) if j < physical else base
            for J, column in zip(
                shared, differ(rows, values_of(self.parameters, moved)), strict=True
            ):
                J[:, j] = column

        def window(k: int) -> None:
            # the water is the same everywhere, so another initial position only shifts the motion
            if k < 3:
                rows = [
                    states + STEP * log.spread[k] * np.eye(13)[k]
                    for states, log in zip(base, self.logs, strict=True)
                ]
            else:
                rows = self._run(x, [y_log + STEP * np.eye(OWN)[k] for y_log in y])
            for L, column in zip(starts, differ(rows, parameters), strict=True):
                L[:, k] = column

        # Differences with respect to the mean current are sums over the windows' own currents.
        currents = {
            self._index[f"{log.log.name}: current {axis}"]
            for log in self.logs
            for axis in "xyz"
            if f"{log.log.name}: current {axis}" in self._index
        }
        tasks: list[tuple[Callable[[int], None], int]] = [
            (parameter, j) for j in range(len(x)) if j not in currents
        ]
        tasks += [(window, k) for k in range(OWN)]

        if self.settings.workers > 1:
            with ThreadPoolExecutor(self.settings.workers) as pool:
                list(pool.map(lambda task: task[0](task[1]), tasks))
        else:
            for act, which in tasks:
                act(which)

        for log, J, L in zip(self.logs, shared, starts, strict=True):
            for i, axis in enumerate("xyz"):
                name = f"{log.log.name}: current {axis}"
                if name in self._index:
                    J[:, self._index[name]] = L[:, STATE + i :: 3].sum(axis=1) * (
                        self.settings.current / self.settings.gust
                    )

        slopes = [
            Slopes(*parts)
            for log, r_log, J, L in zip(self.logs, r, shared, starts, strict=True)
            for parts in zip(
                np.split(r_log, log.splits),
                np.split(J, log.splits),
                np.split(L, log.splits),
                strict=True,
            )
        ]
        self._last = x, np.array(local), slopes
        return slopes


def identify(
    vehicle: ReplayVehicle, logs: Sequence[WaterLog], settings: FitSettings
) -> tuple[WaterFit, WaterResiduals]:
    """Identify a vehicle's hydrodynamics from logs: fits to short, then to long windows.

    Raises:
        ConfigurationError: As for `WaterResiduals`.
    """
    rough = WaterResiduals(vehicle, logs, settings.short())
    first = fit_blocks(rough, rough.parameters, rounds=6, enough=0.3, straight=True)
    residuals = WaterResiduals(vehicle, logs, settings)
    return estimate(residuals, residuals.parameters, start=first.deviations), residuals


def _finite(log: LogReplay, rows: Array, values: Mapping[str, float]) -> Array:
    return (
        log.residuals(rows, values)
        if np.all(np.isfinite(rows))
        else np.full(len(log.order), np.nan)
    )


def _windows(log: WaterLog, length: float) -> list[tuple[float, float]]:
    """Begin and end [s] of windows of about this length, without gaps."""
    windows = []
    parts = _parts(log)
    for a, b in parts:
        count = max(1, round((b - a) / length))
        if b - a >= 0.4 * length:
            # Windows begin at rows, where commands change and steps of the replay begin.
            edges = log.time[np.searchsorted(log.time, np.linspace(a, b, count + 1) - 1e-9)]
            windows += [(float(p), float(q)) for p, q in pairwise(edges) if q > p]

    if not windows:
        longest = max((b - a for a, b in parts), default=0.0)
        raise ConfigurationError(
            f"{log.name}: must have a part of {0.4 * length:g} s without a gap for windows of "
            f"{length:g} s; its longest lasts {longest:.3g} s"
        )
    return windows


def _parts(log: WaterLog) -> list[tuple[float, float]]:
    """Begin and end [s] of parts without a gap, after the first attitude and the first position.

    Before these measurements the pose of the hull at the start of a window is unknown.
    """
    parts = []
    for a, b in log.segments():
        first = {}
        for kind in (ATTITUDE, POSITION):
            if kind in log.channels:
                time = log.channels[kind].time
                first[kind] = float(min(time[(time >= a) & (time <= b)], default=b))

        begin = first.get(ATTITUDE, a)
        again = max(begin, first.get(POSITION, begin))
        parts += [(p, q) for p, q in ((begin, again), (again, b)) if q > p]
    return parts


def _seen(log: WaterLog, begin: float, end: float, dt: float) -> bool:
    """True if anything was measured in a window, up to the last step of its replay."""
    last = begin + max(1, int((end - begin) / dt)) * dt - 1e-9
    return any(
        np.any((channel.time >= begin) & (channel.time <= last))
        for channel in log.channels.values()
    )


def _smooth(time: Array, values: Array, at: Array) -> tuple[Array, Array]:
    """Values and slopes at times `at` by local quadratics over 0.2 s, or five samples."""
    half = max(0.1, 2.5 * float(np.median(np.diff(time))))
    angle, slope = np.empty(len(at)), np.empty(len(at))
    low, high = np.searchsorted(time, at - half), np.searchsorted(time, at + half)

    for k, t in enumerate(at):
        angle[k], slope[k] = _local(
            time[low[k] : high[k]] - t, values[low[k] : high[k]], t, time, values
        )
    return angle, slope


def _local(dt: Array, values: Array, t: float, time: Array, every: Array) -> tuple[float, float]:
    if len(dt) < 3:
        return float(np.interp(t, time, every)), 0.0
    c = np.linalg.lstsq(np.vander(dt, 3, increasing=True), values, rcond=None)[0]
    return float(c[0]), float(c[1])


def _near(log: WaterLog, kind: str, t: float) -> tuple[Array, Array] | None:
    """Times from t and values of samples near t, on t's side of a gap; None if there are none."""
    if kind not in log.channels:
        return None
    channel = log.channels[kind]
    begin, end = next(part for part in log.segments() if part[0] - 1e-9 <= t <= part[1] + 1e-9)
    inside = np.flatnonzero((channel.time >= begin - 1e-9) & (channel.time <= end + 1e-9))
    dt, samples = channel.time[inside] - t, channel.values[inside]

    if not len(dt) or dt[0] > _SMOOTHED or dt[-1] < -_SMOOTHED:
        return None

    chosen = np.abs(dt) <= _SMOOTHED + 1e-9
    if chosen.sum() < 4:
        chosen = np.argsort(np.abs(dt))[:4]
    return dt[chosen], samples[chosen]


def _line(samples: tuple[Array, Array]) -> tuple[Array, Array]:
    """Value and slope at 0 of a quadratic through samples."""
    dt, y = samples
    degree = min(2, len(dt) - 1)
    c = np.linalg.lstsq(np.vander(dt, degree + 1, increasing=True), y, rcond=None)[0]
    return c[0], c[1] if degree else np.zeros(y.shape[1])


def _start(log: WaterLog, t: float) -> Array:
    """State (13,) of the hull at t, estimated from the samples near t."""
    state = np.zeros(13)
    R, w = Rotation.identity(), np.zeros(3)
    attitude, force = _near(log, ATTITUDE, t), _near(log, FORCE, t)

    # Measured attitude or, without one, roll and pitch from the direction of the specific force.
    if attitude is not None:
        dt, quats = attitude
        reference = Rotation.from_quat(quats[int(np.argmin(np.abs(dt)))])
        off, w = _line((dt, (reference.inv() * Rotation.from_quat(quats)).as_rotvec()))
        R = reference * Rotation.from_rotvec(off)
    elif force is not None:
        up = force[1].mean(axis=0) / np.linalg.norm(force[1].mean(axis=0))
        R = Rotation.align_vectors([[0.0, 0.0, 1.0]], [up])[0]

    if (rate := _near(log, RATE, t)) is not None:
        w = _line(rate)[0]

    if (position := _near(log, POSITION, t)) is not None:
        state[:3], state[7:10] = _line(position)
    elif (depth := _near(log, DEPTH, t)) is not None:
        z, slope = _line(depth)
        state[2], state[9] = -z[0], -slope[0]

    if (velocity := _near(log, VELOCITY, t)) is not None:
        state[7:10] = R.apply(_line(velocity)[0])

    state[3:7] = R.as_quat()[[3, 0, 1, 2]]
    state[10:] = w
    return state


def _check_excited(logs: Sequence[WaterLog], settings: FitSettings) -> None:
    """Refuse logs in which nothing pushes the vehicle, no joint moves, and the hull is at rest."""
    for log in logs:
        pushed = any(
            np.any(command != 0.0) for command in (*log.commands.values(), *log.thrusts.values())
        )
        swung = any(np.ptp(angle) > 0.02 for angle in log.joints.values())
        moved = any(
            np.any(np.std(channel.values, axis=0) > _STILL * settings.noise[kind])
            for kind, channel in log.channels.items()
        )
        if pushed or swung or moved:
            return

    raise ConfigurationError(
        f"{', '.join(log.name for log in logs)}: no thruster is commanded, no joint moves and the "
        "hull is at rest; the hydrodynamics are not identifiable"
    )
