"""Further terms of a body's hydrodynamics, in addition to added mass, damping matrices and strips.

Each is a frozen dataclass in the body frame, kept in `BodyHydrodynamics.forms`. A form is stored as
a record behind the body's row (`uuv.models.hydrodynamics.LAYOUT`), and the passive callback
evaluates it (`uuv.sim.native.form_kernel`). A body without forms needs no computing time.

The wrench of a form is a function of the twist relative to the water, nu_r = (v; w) at the body
origin. Therefore a steady current has the same effect as motion through still water.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Final, Self

import numpy as np
from numpy.typing import ArrayLike

from uuv.models.water.bounds import LONGEST, SEA_WATER, bounded, not_negative, positive, segment
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.interfaces.spatial import (
    Array,
    checked,
    checked_rows,
    finite_number,
    readonly,
    shown,
    skew,
)

MAX_TERMS: Final = 64  # largest number of terms of one CrossTerms
SWEEPS: Final = (-2, 0, 2)  # allowed values of `LiftDrag.sweep`
# Parameters of gz-sim's plugin LiftDrag.
_GZ_LIFT_DRAG: Final = (
    "cla",
    "cda",
    "alpha_stall",
    "cla_stall",
    "cda_stall",
    "a0",
    "area",
    "forward",
    "upward",
    "cp",
)
_RIGHT: Final = 0.5 * math.pi
_KEPT: Final = 1e-12  # largest error of a vector's length with which it is kept bit by bit
_SQUARE: Final = 1e-3  # largest cosine of an angle that must be a right angle
# Directions of flow at which the slope of a LiftDrag is sampled, by differences of _STEP: angles
# [rad] in the plane of forward and upward, and out of that plane. _BETWEEN is a margin for the
# directions between.
_ANGLES: Final = np.linspace(-math.pi, math.pi, 361) + 1e-3
_SWEPT: Final = np.radians([0.0, 25.0, 50.0, 65.0, 80.0, -50.0])
_STEP, _BETWEEN = 1e-5, 1.05


class Form(ABC):
    """Base of the forms; each is a frozen dataclass."""

    kind: ClassVar[int]  # number that identifies the form's record

    @abstractmethod
    def numbers(self) -> list[float]:
        """Numbers of the record, without its kind and length."""

    @classmethod
    @abstractmethod
    def of(cls, numbers: Array) -> Self:
        """Form with the `numbers` of a record; ConfigurationError for numbers out of range."""

    @abstractmethod
    def wrench(self, v: Array, w: Array, added_mass: Array) -> Array:
        """Wrench on the body at its origin, body axes.

        Args:
            v: (n, 3) [m/s] velocities relative to the water, body axes.
            w: (n, 3) [rad/s] angular velocities, body axes.
            added_mass: (6, 6) of the body.

        Returns:
            Wrenches (n, 6) [N, N m].
        """

    @abstractmethod
    def slope(self, speed: float) -> Array:
        """Bound (6, 6), symmetric, of the damping at `speed` [m/s, rad/s], for the time step."""

    @abstractmethod
    def scaled(self, factor: float) -> Self:
        """The form with `factor` times its forces, for perturbations; a MunkFactor is unchanged."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MunkFactor(Form):
    """Share of the potential-flow couple that acts on the body, about each body axis.

    The couple v x p, with the linear momentum p = A11 v + A12 w of the water, turns a slender body
    across the flow [Munk 1924]. If the flow separates, most of this couple is absent. With the
    factors k, the torque and force that act are

        torque:  -(k_i (v x p)_i),    force:  -sum_i k_i w_i e_i x p.

    If both are scaled, their total power about each axis is zero for any k; if only the torque is
    scaled, it is not. PythonVehicleSimulator's REMUS 100 corresponds to k = 0 about y and z.

    Raises:
        ConfigurationError: a factor outside 0 to 1.
    """

    kind: ClassVar[int] = 1
    factor: Array = field(default_factory=lambda: np.ones(3))  # (3,), about x, y and z

    def __post_init__(self) -> None:
        factor = bounded(self.factor, (3,), "munk factor")
        if factor.min() < 0.0 or factor.max() > 1.0:
            raise ConfigurationError(f"munk factor: must be in 0 to 1, got {factor.tolist()}")
        object.__setattr__(self, "factor", factor)

    def numbers(self) -> list[float]:
        """The factors."""
        return self.factor.tolist()

    @classmethod
    def of(cls, numbers: Array) -> Self:
        """Form with these factors."""
        return cls(factor=numbers)

    def wrench(self, v: Array, w: Array, added_mass: Array) -> Array:
        """The share that is removed: (1 - k) times the couple and its force."""
        p = v @ added_mass[:3, :3].T + w @ added_mass[:3, 3:].T
        gone = 1.0 - self.factor
        return np.hstack([np.cross(gone * w, p), gone * np.cross(v, p)])

    def slope(self, speed: float) -> Array:
        """Zero, since the form has no power."""
        return np.zeros((6, 6))

    def scaled(self, factor: float) -> Self:
        """The form itself."""
        return self


@dataclass(frozen=True, kw_only=True, eq=False)
class FadingDamping(Form):
    """Linear damping that fades with speed, where quadratic drag dominates: -d exp(-rate |v|) nu_r.

    Raises:
        ConfigurationError: a number is negative.
    """

    kind: ClassVar[int] = 2
    linear: Array  # (6,) [N s/m, N m s] at rest
    rate: float  # [s/m]

    def __post_init__(self) -> None:
        linear = bounded(self.linear, (6,), "fading damping linear")
        if linear.min() < 0.0:
            raise ConfigurationError(
                f"fading damping linear: must not be negative, got {linear.tolist()}"
            )
        object.__setattr__(self, "linear", linear)
        object.__setattr__(self, "rate", not_negative(self.rate, "fading damping rate [s/m]"))

    def numbers(self) -> list[float]:
        """Six dampings, then the rate."""
        return [*self.linear.tolist(), self.rate]

    @classmethod
    def of(cls, numbers: Array) -> Self:
        """Form of seven numbers."""
        numbers = checked(numbers, (7,), "fading damping")
        return cls(linear=numbers[:6], rate=float(numbers[6]))

    def wrench(self, v: Array, w: Array, added_mass: Array) -> Array:
        """The damping."""
        fading = np.exp(-self.rate * np.linalg.norm(v, axis=1))
        return -fading[:, None] * self.linear * np.hstack([v, w])

    def slope(self, speed: float) -> Array:
        """The damping at rest, plus a diagonal that dominates the coupling by the fading."""
        # rate d |nu| exp(-rate |v|) is at most d / e in translation, d rate speed in rotation
        most = np.concatenate([self.linear[:3] / math.e, self.linear[3:] * self.rate * speed])
        coupled = np.outer(most, [1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
        return np.diag(self.linear + np.sum(0.5 * (coupled + coupled.T), axis=1))

    def scaled(self, factor: float) -> Self:
        """The form with `factor` times the damping."""
        return replace(self, linear=factor * self.linear)


@dataclass(frozen=True, kw_only=True, eq=False)
class LiftDrag(Form):
    """Lift and drag of a fin, wing or slender body in the plane of its `forward` and `upward`.

    With the components a, b of the velocity of `point` along the two, and V^2 = a^2 + b^2, the
    angle of attack is atan(-b / a) + incidence, within 90 degrees. The force at `point` is

        q S (C_L (a upward - b forward) - C_D (a forward + b upward)) / V.

    - Pressure: q = rho / 2 V^2 (V / |v|)^sweep.
    - Lift: C_L = slope alpha up to the stall. Beyond it C_L follows `stalled_slope`, but not below
      0.
    - Drag: C_D = drag_0 + drag_slope |alpha| + induced C_L^2. Beyond the stall it follows
      `stalled_drag_slope`.

    Lift has no power at any angle; drag dissipates. With sweep -2 the drag keeps its magnitude as
    the flow becomes parallel to the span, and its direction jumps there.

    Raises:
        ConfigurationError: a number is out of bounds, or the directions are not perpendicular
            within 1e-3.
    """

    kind: ClassVar[int] = 3
    area: float  # [m^2] S
    lift_slope: float  # [1/rad]
    drag_0: float = 0.0  # C_D at zero angle of attack
    induced: float = 0.0  # C_D per C_L^2
    drag_slope: float = 0.0  # [1/rad]
    incidence: float = 0.0  # [rad] angle of attack for flow along `forward` (b = 0)
    stall: float = _RIGHT  # [rad] angle of stall; 90 degrees: none
    # [1/rad] of C_L beyond the stall; by default it falls to 0 at 90 degrees
    stalled_slope: float | None = None
    # [1/rad] of C_D beyond the stall; by default `drag_slope`
    stalled_drag_slope: float | None = None
    # 0: flow along the span has no effect; -2: it counts in q [Fossen 2021]; 2: as in gz-sim
    sweep: int = 0
    point: Array = field(default_factory=lambda: np.zeros(3))  # (3,) [m] centre of pressure
    forward: Array = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))  # (3,) unit vector
    upward: Array = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))  # (3,) unit vector
    # [kg/m^3] density of the water for which the force is computed
    water_density: float = SEA_WATER

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "area", positive(self.area, "lift-drag area [m^2]"))
        for name in ("lift_slope", "drag_0", "induced", "drag_slope"):
            put(self, name, not_negative(getattr(self, name), f"lift-drag {name}"))
        put(
            self,
            "incidence",
            finite_number(self.incidence, "lift-drag incidence [rad]", least=-_RIGHT, most=_RIGHT),
        )
        put(
            self,
            "stall",
            finite_number(self.stall, "lift-drag stall [rad]", above=0.0, most=_RIGHT),
        )

        # By default lift falls to 0 at 90 degrees, and drag rises as before the stall.
        fall = _fall(self.lift_slope, self.stall)
        slope = fall if self.stalled_slope is None else self.stalled_slope
        put(
            self,
            "stalled_slope",
            finite_number(slope, "lift-drag stalled_slope [1/rad]", least=-1e12, most=1e12),
        )
        drag = self.drag_slope if self.stalled_drag_slope is None else self.stalled_drag_slope
        put(self, "stalled_drag_slope", not_negative(drag, "lift-drag stalled_drag_slope [1/rad]"))

        if self.sweep not in SWEEPS:
            raise ConfigurationError(
                f"lift-drag sweep: must be -2, 0 or 2, got {shown(self.sweep)}"
            )
        put(self, "sweep", int(self.sweep))
        put(self, "point", bounded(self.point, (3,), "lift-drag point [m]", LONGEST))

        for name in ("forward", "upward"):
            put(self, name, _unit(getattr(self, name), f"lift-drag {name}"))
        if abs(float(self.forward @ self.upward)) > _SQUARE:
            raise ConfigurationError(
                f"lift-drag: forward {self.forward.tolist()} and upward {self.upward.tolist()} "
                "must be perpendicular"
            )

        put(self, "water_density", positive(self.water_density, "lift-drag water_density [kg/m^3]"))

    @classmethod
    def of_wing(
        cls, *, area: float, span: float, drag_0: float, oswald: float = 0.7, **figures: Any
    ) -> Self:
        """Lift and induced drag of a wing of finite span [Beard 2012, section 4.2].

        With L = span^2 / area: slope pi L / (1 + sqrt(1 + (L / 2)^2)), induced 1 / (pi oswald L).

        Args:
            area: [m^2].
            span: [m].
            drag_0: C_D without lift.
            oswald: Oswald's efficiency factor.
            **figures: the other fields, without lift_slope and induced.

        Returns:
            The form.

        Raises:
            ConfigurationError: a number is out of bounds, or a computed field is stated too.
        """
        if computed := [name for name in ("lift_slope", "induced") if name in figures]:
            raise ConfigurationError(
                f"wing {', '.join(computed)}: follows from area, span and oswald; leave it out"
            )

        ratio = positive(span, "wing span [m]") ** 2 / positive(area, "wing area [m^2]")
        return cls(
            area=area,
            drag_0=drag_0,
            lift_slope=math.pi * ratio / (1.0 + math.sqrt(1.0 + (0.5 * ratio) ** 2)),
            induced=1.0 / (math.pi * positive(oswald, "wing oswald") * ratio),
            **figures,
        )

    @classmethod
    def of_gz(cls, parameters: Mapping[str, Any], water_density: float = SEA_WATER) -> Self:
        """Form from the parameters of gz-sim's plugin LiftDrag, by their names in that plugin.

        The parameters are cla, cda, alpha_stall, cla_stall, cda_stall, a0, area, forward, upward,
        cp and air_density, with the plugin's defaults. In the plugin `cp` is relative to the link's
        centre of mass; here it is relative to the body origin.

        Args:
            parameters: values by name.
            water_density: [kg/m^3], unless air_density is among them.

        Returns:
            The form.

        Raises:
            ConfigurationError: a name is unknown, or a number is out of bounds.
        """
        _check_gz_names(parameters)
        return cls(
            area=parameters.get("area", 1.0),
            lift_slope=parameters.get("cla", 1.0),
            drag_slope=parameters.get("cda", 0.01),
            incidence=parameters.get("a0", 0.0),
            stall=min(
                finite_number(parameters.get("alpha_stall", _RIGHT), "gz-sim LiftDrag alpha_stall"),
                _RIGHT,
            ),
            stalled_slope=parameters.get("cla_stall", 0.0),
            stalled_drag_slope=parameters.get("cda_stall", 1.0),
            sweep=2,
            point=parameters.get("cp", np.zeros(3)),
            forward=parameters.get("forward", [1.0, 0.0, 0.0]),
            upward=parameters.get("upward", [0.0, 0.0, 1.0]),
            water_density=parameters.get("air_density", water_density),
        )

    def numbers(self) -> list[float]:
        """Point, forward, upward, then the scalars."""
        assert self.stalled_slope is not None
        assert self.stalled_drag_slope is not None
        return [
            *self.point.tolist(),
            *self.forward.tolist(),
            *self.upward.tolist(),
            # Scalars, in the order of `of`.
            self.area,
            self.water_density,
            self.lift_slope,
            self.drag_0,
            self.induced,
            self.drag_slope,
            self.incidence,
            self.stall,
            self.stalled_slope,
            self.stalled_drag_slope,
            float(self.sweep),
        ]

    @classmethod
    def of(cls, numbers: Array) -> Self:
        """Form from the twenty numbers of a record."""
        numbers = checked(numbers, (20,), "lift-drag")
        scalars = [float(x) for x in numbers[9:]]
        return cls(
            point=numbers[:3],
            forward=numbers[3:6],
            upward=numbers[6:9],
            area=scalars[0],
            water_density=scalars[1],
            lift_slope=scalars[2],
            drag_0=scalars[3],
            induced=scalars[4],
            drag_slope=scalars[5],
            incidence=scalars[6],
            stall=min(scalars[7], _RIGHT),  # MJCF may round an angle of 90 degrees up
            stalled_slope=scalars[8],
            stalled_drag_slope=scalars[9],
            sweep=int(scalars[10]),
        )

    def coefficients(self, alpha: Array) -> tuple[Array, Array]:
        """C_L and C_D at angles of attack `alpha` (n,) [rad] within 90 degrees."""
        assert self.stalled_slope is not None
        assert self.stalled_drag_slope is not None
        size = np.abs(alpha)

        near = np.minimum(size, self.stall)
        beyond = np.maximum(size - self.stall, 0.0)
        lift = np.maximum(self.lift_slope * near + self.stalled_slope * beyond, 0.0) * np.sign(
            alpha
        )

        drag = (
            self.drag_0
            + self.drag_slope * near
            + self.stalled_drag_slope * beyond
            + self.induced * lift**2
        )
        return lift, drag

    def wrench(self, v: Array, w: Array, added_mass: Array) -> Array:
        """Lift and drag."""
        force = self._force(v + np.cross(w, self.point))
        return np.hstack([force, np.cross(self.point, force)])

    def slope(self, speed: float) -> Array:
        """Bound (6, 6) from the largest slope of the force over directions of flow at `point`."""
        angle, sweep = np.meshgrid(_ANGLES, _SWEPT if self.sweep else _SWEPT[:1])
        angle = angle.ravel()[:, None]
        sweep = sweep.ravel()[:, None]
        plane = np.cos(angle) * self.forward + np.sin(angle) * self.upward
        flow = np.cos(sweep) * plane + np.sin(sweep) * np.cross(self.forward, self.upward)

        columns = [
            (self._force(flow + _STEP * e) - self._force(flow - _STEP * e)) / (2.0 * _STEP)
            for e in np.eye(3)
        ]
        jacobians = -np.stack(columns, axis=2)

        # Where a step crosses the jump from +90 to -90 degrees, the difference is not a slope.
        smooth = np.abs(np.cos(angle[:, 0] - self.incidence)) > 10.0 * _STEP
        eigenvalues = np.linalg.eigvalsh(0.5 * (jacobians + jacobians.transpose(0, 2, 1)))[smooth]

        # the force grows with the square of the speed
        largest = speed * _BETWEEN * float(eigenvalues.max())
        to_point = np.hstack([np.eye(3), -skew(self.point)])
        return max(largest, 0.0) * to_point.T @ to_point

    def scaled(self, factor: float) -> Self:
        """The form with `factor` times the area."""
        return replace(self, area=factor * self.area)

    def _force(self, u: Array) -> Array:
        """Force (n, 3) for velocities `u` (n, 3) of the point."""
        a = u @ self.forward
        b = u @ self.upward
        square = a * a + b * b
        whole = np.sum(u * u, axis=1)
        V = np.sqrt(square)

        # Angle of attack, within 90 degrees.
        alpha = np.where(a >= 0.0, np.arctan2(-b, a), np.arctan2(b, -a)) + self.incidence
        alpha = np.where(
            alpha > _RIGHT, alpha - math.pi, np.where(alpha < -_RIGHT, alpha + math.pi, alpha)
        )

        lift, drag = self.coefficients(alpha)
        with np.errstate(divide="ignore", invalid="ignore"):
            swept = {0: square, -2: whole, 2: square * np.where(whole > 0.0, square / whole, 0.0)}[
                self.sweep
            ]
            share = np.where(V > 0.0, 0.5 * self.water_density * self.area * swept / V, 0.0)

        along = share * (-lift * b - drag * a)
        across = share * (lift * a - drag * b)
        return along[:, None] * self.forward + across[:, None] * self.upward


@dataclass(frozen=True, kw_only=True, eq=False)
class CrossTerms(Form):
    """Sum of terms -c |nu_k| nu_j or -c nu_k nu_j in components i of the wrench, as in gz-sim.

    A positive c with i = j and |nu_k| is damping. Other terms may add energy;
    `uuv.sim.hydrodynamics.doubts` searches for a motion in which they do.

    Raises:
        ConfigurationError: an index is outside 0 to 5, or there are too many terms.
    """

    kind: ClassVar[int] = 4
    terms: Array  # (n, 5): i, j, k, 1 for the absolute value of nu_k or 0, c [SI]

    def __post_init__(self) -> None:
        terms = checked_rows(self.terms, 5, "cross terms (i, j, k, absolute, coefficient)")
        bounded(terms, terms.shape, "cross terms")
        indices = terms[:, :3]
        absolute = terms[:, 3]

        if len(terms) > MAX_TERMS:
            raise ConfigurationError(f"cross terms: expected at most {MAX_TERMS}, got {len(terms)}")
        if np.any(indices != np.clip(np.round(indices), 0, 5)) or not np.all(
            (absolute == 0.0) | (absolute == 1.0)
        ):
            raise ConfigurationError(
                "cross terms: i, j, k must be whole numbers 0 to 5 and absolute 0 or 1, got "
                f"{shown(terms[:, :4])}"
            )

        object.__setattr__(self, "terms", terms)

    @classmethod
    def of_gz(cls, parameters: Mapping[str, float]) -> Self:
        """Terms from gz-sim's names and signs: X = xUabsV |v| u, with negative damping.

        A name has one of x y z k m n, one of U V W P Q R, and another of these, with or without
        `abs` before it.

        Args:
            parameters: coefficients by name, such as `{"yVabsR": -3.0, "nUV": 2.0}`.

        Returns:
            The form.

        Raises:
            ConfigurationError: a name is unknown, or a coefficient is not a finite number.
        """
        rows = []
        for name, coefficient in parameters.items():
            term = gz_term(name)
            if term is None or term[2] < 0:
                raise ConfigurationError(
                    f"gz-sim Hydrodynamics: expected names like xUabsV or xUV, got {shown(name)}"
                )
            rows.append([*term, -finite_number(coefficient, f"gz-sim Hydrodynamics {name}")])
        return cls(terms=np.array(rows))

    def numbers(self) -> list[float]:
        """The terms, row by row."""
        return self.terms.ravel().tolist()

    @classmethod
    def of(cls, numbers: Array) -> Self:
        """Form from the numbers of a record, five for each term."""
        if len(numbers) % 5:
            raise ConfigurationError(
                f"cross terms: expected five numbers for each term, got {len(numbers)} numbers in "
                "all"
            )
        return cls(terms=np.reshape(numbers, (-1, 5)))

    def wrench(self, v: Array, w: Array, added_mass: Array) -> Array:
        """Sum of the terms."""
        nu = np.hstack([v, w])
        total = np.zeros((len(v), 6))
        for i, j, k, absolute, coefficient in self.terms:
            times = nu[:, int(k)]
            total[:, int(i)] -= coefficient * (np.abs(times) if absolute else times) * nu[:, int(j)]
        return total

    def slope(self, speed: float) -> Array:
        """Diagonal that dominates the symmetric part of the derivative, whatever the signs."""
        entries = np.zeros((6, 6))
        for i, j, k, _, coefficient in self.terms:
            entries[int(i), int(j)] += abs(coefficient) * speed
            entries[int(i), int(k)] += abs(coefficient) * speed
        return np.diag(np.sum(0.5 * (entries + entries.T), axis=1))

    def scaled(self, factor: float) -> Self:
        """The form with `factor` times every coefficient."""
        return replace(self, terms=self.terms * [1.0, 1.0, 1.0, 1.0, factor])


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarStrip(Form):
    """Cross-flow drag of a segment in one direction, as in ship theory [Faltinsen 1990].

    Force per length: `-drag |u_d| u_d` along `direction`, with the local velocity's component u_d
    [Fossen 2021, section 6.5]. The integral is exact. In contrast, a StripDrag acts in all
    directions across the segment.

    Raises:
        ConfigurationError: the drag is negative, or the segment or the direction has no length.
    """

    kind: ClassVar[int] = 5
    start: Array  # (3,) [m]
    end: Array  # (3,) [m]
    direction: Array  # (3,) unit vector
    drag: float  # [kg/m^2] = 0.5 rho C_d d

    def __post_init__(self) -> None:
        ends = segment(self.start, self.end, "planar strip")
        for name, point in zip(("start", "end"), ends, strict=True):
            object.__setattr__(self, name, point)
        object.__setattr__(self, "direction", _unit(self.direction, "planar strip direction"))
        object.__setattr__(self, "drag", not_negative(self.drag, "planar strip drag [kg/m^2]"))

    def numbers(self) -> list[float]:
        """Start, end, direction, drag."""
        return [*self.start.tolist(), *self.end.tolist(), *self.direction.tolist(), self.drag]

    @classmethod
    def of(cls, numbers: Array) -> Self:
        """Form from the ten numbers of a record."""
        numbers = checked(numbers, (10,), "planar strip")
        return cls(
            start=numbers[:3], end=numbers[3:6], direction=numbers[6:9], drag=float(numbers[9])
        )

    def wrench(self, v: Array, w: Array, added_mass: Array) -> Array:
        """The drag, integrated exactly on each side of the point where the flow reverses."""
        along = self.end - self.start
        at_start, at_end = ((v + np.cross(w, p)) @ self.direction for p in (self.start, self.end))

        # Point where the flow reverses, as a share of the segment.
        with np.errstate(divide="ignore", invalid="ignore"):
            turn = np.where(at_start * at_end < 0.0, at_start / (at_start - at_end), 0.0)

        total = np.zeros((len(v), 6))
        for low, high in ((np.zeros(len(v)), turn), (turn, np.ones(len(v)))):
            for node in (-1.0, 1.0):
                s = 0.5 * (low + high) + node * 0.5 * (high - low) / math.sqrt(3.0)
                u = at_start + s * (at_end - at_start)
                share = -0.5 * (high - low) * self.drag * np.linalg.norm(along) * np.abs(u) * u
                force = share[:, None] * self.direction
                total += np.hstack([force, np.cross(self.start + s[:, None] * along, force)])

        return total

    def slope(self, speed: float) -> Array:
        """Derivative of the drag with `speed` at every station."""
        along = self.end - self.start
        total = np.zeros((6, 6))
        for node in (-1.0, 1.0):
            p = self.start + 0.5 * (1.0 + node / math.sqrt(3.0)) * along
            row = np.concatenate([self.direction, np.cross(p, self.direction)])
            total += (
                0.5 * float(np.linalg.norm(along)) * 2.0 * speed * self.drag * np.outer(row, row)
            )
        return total

    def scaled(self, factor: float) -> Self:
        """The form with `factor` times the drag."""
        return replace(self, drag=factor * self.drag)


KINDS: Final[dict[int, type[Form]]] = {
    form.kind: form for form in (MunkFactor, FadingDamping, LiftDrag, CrossTerms, PlanarStrip)
}


def _fall(lift_slope: float, stall: float) -> float:
    """Slope [1/rad] by which lift falls from the stall to 0 at 90 degrees; 0 without a stall."""
    return -lift_slope * stall / max(_RIGHT - stall, 1e-9) if stall < _RIGHT else 0.0


def _check_gz_names(parameters: Mapping[str, Any]) -> None:
    """Refuse names that gz-sim's plugin LiftDrag does not have."""
    for name in parameters:
        if name not in (*_GZ_LIFT_DRAG, "air_density"):
            hint = did_you_mean(name, _GZ_LIFT_DRAG)
            raise ConfigurationError(f"gz-sim LiftDrag: unknown parameter {shown(name)}{hint}")


def gz_term(name: str) -> tuple[int, int, int, int] | None:
    """Indices i, j, k, and 1 if absolute, of a name like xUabsV; k is -1 for xU; else None."""
    if not (isinstance(name, str) and name[:1] in tuple("xyzkmn") and name[1:2] in tuple("UVWPQR")):
        return None
    rest = name[2:]
    i = "xyzkmn".index(name[0])
    j = "UVWPQR".index(name[1])
    if not rest:
        return i, j, -1, 0
    last = rest.removeprefix("abs")
    return (i, j, "UVWPQR".index(last), int(rest != last)) if last in tuple("UVWPQR") else None


def _unit(values: ArrayLike, name: str) -> Array:
    """Unit vector along `values`; a vector of length 1 up to rounding is unchanged."""
    vector = checked(values, (3,), name)
    length = float(np.linalg.norm(vector))
    if not 1e-9 < length < 1e9:
        raise ConfigurationError(f"{name}: expected a direction, got {shown(vector)}")
    return vector if abs(length - 1.0) < _KEPT else readonly(vector / length)
