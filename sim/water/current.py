"""Current: steady part, regular wave, gusts of finite acceleration, and additional flow fields."""

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

# Function of the time [s] that returns a factor on the current, and its rate of change [1/s].
Profile = Callable[[float], tuple[float, float]]

_BLOCK = 4096  # number of steps generated at a time
_FEWEST = 20.0  # [steps] smallest number in the period of a wave
# [s] times at which the rate of a profile is compared with its factor
_PROFILE_TIMES = (0.37, 1.13, 2.71, 5.9, 11.3)
# [steps] longest time constant; for a longer one the filter's pole is lost in rounding
_LONGEST = 1e12
# [s] before and after, for the difference that gives the acceleration of a flow field
_ALONG = 1e-3


@kernel
def _filter(gain: float, pole: float, signal: Array, state: Array) -> None:
    """Filter of first order on the columns of `signal` (N, 3), in place, as scipy.signal.lfilter.

    The import of SciPy's filter takes as long as a fifth of the program's start.
    """
    for k in range(len(signal)):
        for i in range(3):
            output = state[i] + gain * signal[k, i]
            signal[k, i] = output
            state[i] = pole * output


@dataclass(frozen=True, slots=True, kw_only=True)
class Wave:
    """Regular wave of great length, in which the water oscillates along one direction."""

    amplitude_W: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [m/s] of the velocity, world axes
    frequency: float = 0.1  # [Hz]
    # [rad] at the start; 0: the water is at rest and begins to move along the amplitude
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
    """Velocity and acceleration of the water, one sample for each step of the plant, for all
    bodies.

    Gusts are white noise passed through two equal first-order filters, so that their acceleration,
    which the pressure-gradient force needs, is finite. `gust` is their standard deviation per axis.
    `with_flow` adds a velocity that depends on the position of the hull.

    `velocity` [m/s] and `acceleration` [m/s^2], each (N, 3), hold the steps generated ahead,
    without profile and flow fields. `row` (2,) holds the index of their next row, and the number of
    rows per step. If `beyond_rows` is empty, compiled code may take `ready` rows itself. The three
    arrays are never replaced.

    A user's subclass overrides `step`, for a current that is uniform in space, or `at`.
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
            wave: Regular wave that is added.
            time_constant: Time constant of the gusts [s].
            timestep: Step of the plant [s].
            rng: Random generator; needed for gusts only.
            profile: Function of the time t [s] since the start. It returns a factor on the whole
                current and the factor's rate of change [1/s].

        Raises:
            ConfigurationError: A number is not finite or has the wrong sign. The time constant or
                the wave's period has too few steps, or the time constant too many. Gusts have no
                random generator. The profile's rate is not the derivative of its factor.
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
        # flow fields that are added last; `with_flow` adds to them
        self.flows: tuple[FlowField, ...] = ()
        self._blows = gust > 0.0
        self._wave = wave if any(wave.amplitude_W) else None
        self._varies = self._blows or self._wave is not None
        if self._wave is not None:
            _check_wave(wave, dt)
        a = np.exp(-dt / time_constant)
        b = -np.expm1(-dt / time_constant)
        self._gain, self._pole = float(b), float(a)

        # Stationary start, from Lyapunov's equation: deviations of both filter states for unit
        # white noise (gain b and pole a, twice), scaled so that the second state has the deviation
        # of the gusts.
        first = gust * (1.0 + a) / (1.0 + a * a)
        self._scale = gust * (1.0 + a) * np.sqrt((1.0 + a) / (b * (1.0 + a * a)))

        rows = _BLOCK if self._varies else 1
        self.velocity, self.acceleration = np.tile(self._mean, (rows, 1)), np.zeros((rows, 3))
        self.row = np.array([rows, 1] if self._varies else [0, 0])  # no row is generated yet
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
        """Steady part (3,) [m/s] of the current, world axes; read-only; `with_flow` adds to it."""
        return readonly(self._mean)

    def with_flow(self, flow: FlowField) -> Self:
        """The same current with one more flow field, to be used in place of this current.

        Raises:
            ConfigurationError: `flow` has no method `velocity(p_W, time)`.
        """
        other = copy.copy(self)
        other.flows = (*self.flows, checked_flow(flow, "flow"))
        return other

    def with_profile(self, profile: Profile) -> Self:
        """The same current multiplied by one more function of time, to be used in place of this
        current.

        Args:
            profile: Profile as for the class; the factor also applies to flow fields.

        Raises:
            ConfigurationError: The profile's rate is not the derivative of its factor.
        """
        _check_profile(profile)
        other = copy.copy(self)
        other.profile = profile if self.profile is None else _product(self.profile, profile)
        return other

    def place(self, model: "mujoco.MjModel") -> None:
        """Take the compiled world, for flow fields that depend on its objects."""
        self.flows = placed_in(model, self.flows)

    def beyond_rows(self) -> str:
        """Reason why the rows are incomplete, so that `at` must be called at every step; empty if
        there is none.
        """
        if self.profile is not None:
            return "the current has a profile"
        if self.flows:
            return f"the current has a flow field, {type(self.flows[0]).__name__}"
        # Overridden in a subclass, or set on this object.
        methods = (self.step, Current.step), (self.at, Current.at)
        replaced = any(
            getattr(method, "__func__", None) is not base_method for method, base_method in methods
        )
        return f"current {type(self).__name__} overrides `step` or `at`" if replaced else ""

    @property
    def timestep(self) -> float | None:
        """Step of the plant [s] that the current was made for; None for a steady current, which
        fits any step.
        """
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
        """Everything that changes, not copied: copy it before the next step."""
        stays = ("profile", "flows")
        return {name: attribute for name, attribute in vars(self).items() if name not in stays}

    def resume(self, saved: dict[str, Any], steps: int) -> None:
        """Continue from a result of `save` of an equal current; profile and flow fields stay.

        Args:
            saved: Copy of that result.
            steps: Number of steps that the plant has taken from the current.
        """
        for name, attribute in saved.items():
            array = getattr(self, name)
            if isinstance(array, np.ndarray) and array.flags.writeable:
                array[...] = attribute
            else:
                setattr(self, name, attribute)
        self._ticks = steps

    def ready(self) -> int:
        """Number of steps that may now be taken from the rows; at their end more rows are
        generated.
        """
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
        """Velocity (3,) [m/s] and acceleration (3,) [m/s^2] from `step` and the flow fields.

        The acceleration is the material derivative, that is, of the water that passes, by
        differences along its path.

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

        # A field may be undefined before the start.
        back = min(time, _ALONG)
        earlier = total_velocity(self.flows, p_W - back * velocity, time - back)
        later = total_velocity(self.flows, p_W + _ALONG * velocity, time + _ALONG)
        return velocity, acceleration + share * (later - earlier) / (back + _ALONG) + growth * field


def _check_gusts(gust: float, rng: object, time_constant: float, dt: float) -> None:
    """Refuse an invalid deviation [m/s] of the gusts, generator, time constant [s] or step [s]."""
    if not (np.isfinite(gust) and gust >= 0.0):
        raise ConfigurationError(f"gust: must be finite and >= 0 m/s, got {gust}")
    if gust > 0.0 and not isinstance(rng, np.random.Generator):
        raise ConfigurationError(f"gusts need a random generator, got {rng!r}")
    if not (np.isfinite(dt) and dt > 0.0):
        raise ConfigurationError(f"timestep of the current: must be finite and > 0 s, got {dt}")
    if not 10.0 * dt < time_constant <= _LONGEST * dt:
        raise ConfigurationError(
            f"gust time constant: must be more than 10 and at most {_LONGEST:.0e} steps of {dt} s, "
            f"got {time_constant} s"
        )


def _check_wave(wave: Wave, dt: float) -> None:
    """Refuse a wave with too few steps of `dt` [s] in its period."""
    if not wave.frequency * dt * _FEWEST < 1.0:
        raise ConfigurationError(
            f"wave of {wave.frequency} Hz: the period must be longer than {_FEWEST:g} steps of "
            f"{dt} s"
        )


def _product(first: Profile, second: Profile) -> Profile:
    """Product of both factors, and its rate."""

    def both(time: float) -> tuple[float, float]:
        share, growth = first(time)
        factor, rate = second(time)
        return share * factor, growth * factor + share * rate

    return both


def _check_profile(profile: Profile) -> None:
    """Refuse a profile that does not return two numbers, or whose rate is wrong at most of the
    tested times.

    A profile may have steps and kinks, so that one time is not enough for a test.
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
            wrong.append(
                f"at {time} s the rate is {rate:.4g} 1/s, but the factor changes by {slope:.4g} 1/s"
            )

    if 2 * len(wrong) > len(_PROFILE_TIMES):
        raise ConfigurationError(
            "profile of the current: the rate must be the derivative of the factor; it is not at "
            f"{len(wrong)} of {len(_PROFILE_TIMES)} times: {wrong[-1]}"
        )
