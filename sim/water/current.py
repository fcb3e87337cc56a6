"""Current: steady part, regular wave, gusts of finite acceleration, flow fields on top."""

import copy
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array, checked, number, readonly
from uuv.sim.water.flow_field import FlowField, checked_flow, placed_in, total_velocity

if TYPE_CHECKING:
    import mujoco

# Of the time [s]: factor on the current, and its rate [1/s].
Profile = Callable[[float], tuple[float, float]]

_BLOCK = 4096  # steps generated at a time
_FEWEST = 20.0  # [steps] in the period of a wave
# [s] at which the rate of a profile is compared with its factor
_PROFILE_TIMES = (0.37, 1.13, 2.71, 5.9, 11.3)
_LONGEST = 1e12  # [steps] longest time constant; beyond it the filter's pole is lost in rounding
_ALONG = 1e-3  # [s] before and after, between which the acceleration of a flow field is taken


@kernel
def _filter(gain: float, pole: float, signal: Array, state: Array) -> None:
    """Filter of first order on the columns of `signal` (N, 3), in place, as scipy.signal.lfilter.

    SciPy's takes as long to import as a fifth of the program.
    """
    for k in range(len(signal)):
        for i in range(3):
            output = state[i] + gain * signal[k, i]
            signal[k, i] = output
            state[i] = pole * output


@dataclass(frozen=True, slots=True, kw_only=True)
class Wave:
    """Regular wave of long length: the water swings to and fro along one direction."""

    amplitude_W: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [m/s] of the velocity, world axes
    frequency: float = 0.1  # [Hz]
    # [rad] at the start; 0: the water stands still and begins to move along the amplitude
    phase: float = 0.0

    def __post_init__(self) -> None:
        checked(self.amplitude_W, (3,), "amplitude of the wave [m/s]")
        number(self.phase, "phase of the wave [rad]")
        frequency = number(self.frequency, "frequency of the wave [Hz]")
        if not 0.0 < frequency < np.inf:
            raise ConfigurationError(
                f"frequency of the wave: must be finite and > 0 Hz, got {frequency}"
            )

    def velocity(self, time: ArrayLike) -> Array:
        """Velocity (N, 3) [m/s] of the water at `time` (N,) [s]."""
        time = np.asarray(time, dtype=np.float64)
        return np.outer(np.sin(2.0 * np.pi * self.frequency * time + self.phase), self.amplitude_W)


STILL = Wave()


class Current:
    """Velocity and acceleration of the water, one sample a step of the plant, for all bodies.

    Gusts are white noise through two equal first-order filters: their acceleration, which the
    pressure-gradient force needs, is then finite. `gust` is their standard deviation per axis.
    `with_flow` adds a velocity that depends on the place of the hull.

    `velocity` [m/s] and `acceleration` [m/s^2], each (N, 3), hold the steps generated ahead,
    without profile and flow fields; `row` (2,) is the next of their rows, and by how many rows a
    step moves on. Compiled code may take rows itself, `ready` of them, where `beyond_rows` names
    nothing. The three arrays are never replaced.

    A class of one's own overrides `step`, for water that is uniform in space, or `at`.
    """

    def __init__(
        self,
        mean_W: ArrayLike,
        *,
        gust: float = 0.0,
        wave: Wave = STILL,
        time_constant: float = 5.0,
        timestep: float = 0.002,
        rng: np.random.Generator | None = None,
        profile: Profile | None = None,
    ) -> None:
        """Set up the steady current, its wave and its gusts.

        Args:
            mean_W: Steady current (3,) [m/s].
            gust: Standard deviation of the gusts per axis [m/s].
            wave: Regular wave on top.
            time_constant: Of the gusts [s].
            timestep: Step of the plant [s].
            rng: Random generator; needed for gusts only.
            profile: Function of the time t [s] since the start. It returns a factor on the whole
                current and the factor's rate of change [1/s].

        Raises:
            ConfigurationError: A number is not finite or has the wrong sign, the time constant has
                too few or too many steps, the wave has too few, gusts lack a generator, or the
                profile's rate is not that of its factor.
        """
        self._mean = checked(mean_W, (3,), "current [m/s]")
        gust = number(gust, "gust [m/s]")
        dt = number(timestep, "timestep of the current [s]")
        time_constant = number(time_constant, "time constant of the gusts [s]")
        _check_gusts(gust, rng, time_constant, dt)
        if profile is not None:
            _check_profile(profile)

        self._rng = rng
        self._dt = dt
        self.profile = profile
        self._ticks = 0
        self.flows: tuple[FlowField, ...] = ()  # on top of all else; `with_flow` adds to them
        self._blows = gust > 0.0
        self._wave = wave if any(wave.amplitude_W) else None
        self._varies = self._blows or self._wave is not None
        if self._wave is not None:
            _check_wave(wave, dt)
        a = np.exp(-dt / time_constant)
        b = -np.expm1(-dt / time_constant)
        self._gain, self._pole = float(b), float(a)

        # Stationary start, by Lyapunov's equation: deviations of both filter states for unit white
        # noise (gain b and pole a, twice), scaled so that the second state has the gust's.
        first = gust * (1.0 + a) / (1.0 + a * a)
        self._scale = gust * (1.0 + a) * np.sqrt((1.0 + a) / (b * (1.0 + a * a)))

        rows = _BLOCK if self._varies else 1
        self.velocity, self.acceleration = np.tile(self._mean, (rows, 1)), np.zeros((rows, 3))
        self.row = np.array([rows, 1] if self._varies else [0, 0])  # none is generated yet
        self._filters, self._generated = np.zeros((2, 3)), 0
        self._before = np.zeros(3)  # [m/s] gust and wave at the last step generated

        if self._blows:
            assert rng is not None
            start, other = rng.standard_normal((2, 3))
            self._before[:] = gust * start
            self._filters[:] = a * first * (start + a * other), a * self._before
        if self._wave is not None:
            self._before += self._wave.velocity(np.array([-dt]))[0]

    @property
    def mean_W(self) -> Array:
        """Steady part (3,) [m/s] of the current, world axes; read-only, for another is a field."""
        return readonly(self._mean)

    def with_flow(self, flow: FlowField) -> Self:
        """The same current with one more flow field on top; to be used in place of this one.

        Raises:
            ConfigurationError: It has no method `velocity(p_W, time)`.
        """
        other = copy.copy(self)
        other.flows = (*self.flows, checked_flow(flow, "flow"))
        return other

    def with_profile(self, profile: Profile) -> Self:
        """The same current by one more factor of time; to be used in place of this one.

        Args:
            profile: As for the class; the factor is on flow fields too.

        Raises:
            ConfigurationError: The profile's rate is not that of its factor.
        """
        _check_profile(profile)
        other = copy.copy(self)
        other.profile = profile if self.profile is None else _product(self.profile, profile)
        return other

    def place(self, model: "mujoco.MjModel") -> None:
        """Take over the compiled world, for flow fields that depend on its objects."""
        self.flows = placed_in(model, self.flows)

    def beyond_rows(self) -> str:
        """What its rows do not hold, so that `at` must be called at every step; empty: nothing."""
        if self.profile is not None:
            return "the current has a profile"
        if self.flows:
            return f"the current has a flow field, {type(self.flows[0]).__name__}"
        # Of a subclass, or set on this object.
        methods = (self.step, Current.step), (self.at, Current.at)
        replaced = any(
            getattr(method, "__func__", None) is not base_method for method, base_method in methods
        )
        return f"current {type(self).__name__} has a step of its own" if replaced else ""

    @property
    def timestep(self) -> float | None:
        """Step of the plant [s] that it was made for; None for a steady one, which suits any."""
        return self._dt if self._varies or self.profile is not None else None

    def _refill(self) -> None:
        varying = np.zeros((_BLOCK, 3))
        if self._blows:
            assert self._rng is not None
            varying = self._scale * self._rng.standard_normal((_BLOCK, 3))
            for state in self._filters:
                _filter(self._gain, self._pole, varying, state)
        if self._wave is not None:
            varying += self._wave.velocity(
                np.arange(self._generated, self._generated + _BLOCK) * self._dt
            )
        self.velocity[:] = self._mean + varying
        self.acceleration[:] = np.diff(varying, axis=0, prepend=self._before[None]) / self._dt
        self._before = varying[-1]
        self._generated = self._generated + _BLOCK
        self.row[0] = 0

    def save(self) -> dict[str, Any]:
        """All that changes, as it is: to be copied before the next step."""
        stays = ("profile", "flows")
        return {name: attribute for name, attribute in vars(self).items() if name not in stays}

    def resume(self, saved: dict[str, Any], steps: int) -> None:
        """Go on from what `save` of an equal current returned; profile and flow fields stay.

        Args:
            saved: A copy of it.
            steps: That the plant has taken from the current.
        """
        for name, attribute in saved.items():
            array = getattr(self, name)
            if isinstance(array, np.ndarray) and array.flags.writeable:
                array[...] = attribute
            else:
                setattr(self, name, attribute)
        self._ticks = steps

    def ready(self) -> int:
        """Number of steps that may now be taken from the rows; generates more at their end."""
        if not self._varies:
            return sys.maxsize
        if self.row[0] == _BLOCK:
            self._refill()
        return _BLOCK - int(self.row[0])

    def step(self) -> tuple[Array, Array]:
        """Velocity (3,) [m/s] and acceleration (3,) [m/s^2] for the plant's next step, W axes."""
        self.ready()
        at = self.row[0]
        velocity = self.velocity[at].copy()
        acceleration = self.acceleration[at].copy()
        self.row[0] += self.row[1]

        if self.profile is None:
            return velocity, acceleration
        share, growth = self.profile(self._ticks * self._dt)
        self._ticks += 1
        return share * velocity, share * acceleration + growth * velocity

    def at(self, p_W: Array, time: float) -> tuple[Array, Array]:
        """Velocity (3,) [m/s] and acceleration (3,) [m/s^2] as of `step`, with the flow fields.

        The acceleration is that of the water which passes: along its path, by differences.

        Args:
            p_W: Position (3,) [m] of the hull's origin in W.
            time: [s] since the start of the run.
        """
        velocity, acceleration = self.step()
        if not self.flows:
            return velocity, acceleration
        share, growth = self.profile(time) if self.profile is not None else (1.0, 0.0)
        field = total_velocity(self.flows, p_W, time)
        velocity = velocity + share * field

        # A field need not know what was before the start.
        back = min(time, _ALONG)
        earlier = total_velocity(self.flows, p_W - back * velocity, time - back)
        later = total_velocity(self.flows, p_W + _ALONG * velocity, time + _ALONG)
        return velocity, acceleration + share * (later - earlier) / (back + _ALONG) + growth * field


def _check_gusts(gust: float, rng: object, time_constant: float, dt: float) -> None:
    """Refuse gusts of that deviation [m/s], generator, time constant [s] and step [s]."""
    if not (np.isfinite(gust) and gust >= 0.0):
        raise ConfigurationError(f"gust: must be finite and >= 0 m/s, got {gust}")
    if gust > 0.0 and not isinstance(rng, np.random.Generator):
        raise ConfigurationError(f"gusts need a random generator, got {rng!r}")
    if not (np.isfinite(dt) and dt > 0.0):
        raise ConfigurationError(f"timestep of the current: must be finite and > 0 s, got {dt}")
    if not 10.0 * dt < time_constant <= _LONGEST * dt:
        raise ConfigurationError(
            f"gust time constant {time_constant} s: must be above ten steps of {dt} s, and no "
            f"more than {_LONGEST:.0e} of them"
        )


def _check_wave(wave: Wave, dt: float) -> None:
    """Refuse a wave with too few steps of `dt` [s] in its period."""
    if not wave.frequency * dt * _FEWEST < 1.0:
        raise ConfigurationError(
            f"wave of {wave.frequency} Hz: its period must be above {_FEWEST:g} steps of {dt} s"
        )


def _product(first: Profile, second: Profile) -> Profile:
    """Both factors."""

    def both(time: float) -> tuple[float, float]:
        share, growth = first(time)
        factor, rate = second(time)
        return share * factor, growth * factor + share * rate

    return both


def _check_profile(profile: Profile) -> None:
    """Refuse a profile without two numbers, or whose rate is not its factor's at most times.

    A profile may have steps and bends, so that a single time proves nothing.
    """
    span = 1e-4  # [s]
    wrong: list[str] = []
    for time in _PROFILE_TIMES:
        try:
            (before, _), (_, rate), (after, _) = (
                profile(time + shift) for shift in (-span, 0.0, span)
            )
            slope = (after - before) / (2.0 * span)
        except (TypeError, ValueError) as error:
            raise ConfigurationError(
                f"profile of the current: must return a factor and its rate [1/s]: {error}"
            ) from error

        if not np.isfinite([before, rate, after]).all():
            raise ConfigurationError(
                f"profile of the current: not finite at {time} s, got {before}, rate {rate}"
            )
        if abs(slope - rate) > 0.02 * max(abs(slope), abs(rate)) + 1e-6:
            wrong.append(f"at {time} s it says {rate:.4g}, the factor changes by {slope:.4g} 1/s")

    if 2 * len(wrong) > len(_PROFILE_TIMES):
        raise ConfigurationError(
            f"profile of the current: its rate is not the factor's, at {len(wrong)} of "
            f"{len(_PROFILE_TIMES)} times; "
            f"{wrong[-1]}"
        )
