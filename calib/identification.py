"""Kinematic calibration of an arm from touches of unknown points, after [Yukhimets 2023].

A prior keeps the estimate from collapsing to an arm of size zero.

    calibration = identify(series, nominal_dh)
    calibration.dh, calibration.tcp, calibration.tips(q)
    print(calibration.rank)  # directions observable in the parameters; why the others are not
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args
from warnings import warn

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import chi2, t

from uuv.calib.fit import (
    LEAST_FREEDOM,
    Data,
    Fit,
    Problem,
    centred,
    pair_cost,
    solve,
    solve_robustly,
    tips_of,
)
from uuv.calib.loads import BoundLoads, Loads
from uuv.calib.paper import WARNING, paper_run
from uuv.calib.parameters import (
    DEFAULT_FREE,
    DEFAULT_PRIOR,
    Estimate,
    Parameters,
    prior_deviations,
    select,
    widest_prior,
)
from uuv.calib.rank import Combination, RankReport, rank_report
from uuv.calib.touches import UsableTouches, checked_series, usable
from uuv.calib.verification import PointTouches, kabsch, places, scores
from uuv.models.arms.kinematics import ROW
from uuv.models.arms.serial_arm import SerialArm
from uuv.sim.interfaces import page
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import (
    Array,
    finite_number,
    number,
    one_of,
    readonly,
    shown,
    transform_points,
    whole_number,
)

Method = Literal["map", "paper"]
Distance = tuple[int, int, float] | tuple[int, int, float, float]

_SURE_DISTANCE = 5e-5  # [m] standard deviation of a known distance where none is stated
_BETA_LEVEL = 0.05  # significance level below which betas are dropped
# [rad], and share of the arm's length: a larger change causes a warning
_FAR_TURN, _FAR_SHARE = 0.1, 0.05
_DETOUR = 5.0  # factor on the arm's reach, beyond which d of nearly parallel axes is no dimension
_MOST_LENGTH = 1e3  # [m] largest known distance, and largest arm
_LEAST_NOISE, _MOST_NOISE = 1e-9, 1.0  # [m] allowed range of the stated noise of a touch
_FAR_OFF = 5e-3  # [m] noise, above which the touches or the table are assumed to be wrong


@dataclass(frozen=True, kw_only=True, eq=False)
class Outlier:
    """A touch that was excluded because its distance from the point of its series is improbable."""

    series: int  # index of the series, from 0
    touch: int  # index of the touch, from 0
    distance: float  # [m] distance from the series' point under the identified arm

    def __str__(self) -> str:
        return (
            f"series {self.series + 1}, touch {self.touch + 1}: {1e3 * self.distance:.3g} mm from "
            "its point"
        )


@dataclass(frozen=True, kw_only=True)
class MapFit:
    """Settings of the maximum a posteriori fit: noise, outliers, and number of steps.

    Raises:
        ConfigurationError: a number out of its range.
    """

    # [m] standard deviation of a touch along each axis; None estimates it
    noise: float | None = None
    # True: reduce the weight of far touches, see `Calibration.weights` and `Calibration.outliers`
    robust: bool = True
    max_iterations: int = 200  # largest number of Levenberg-Marquardt steps

    def __post_init__(self) -> None:
        if self.noise is not None:
            noise = finite_number(self.noise, "noise [m]", least=_LEAST_NOISE, most=_MOST_NOISE)
            object.__setattr__(self, "noise", noise)

        whole_number(self.max_iterations, "max_iterations", least=1)
        if not isinstance(self.robust, bool | np.bool_):
            raise ConfigurationError(f"robust: must be True or False, got {shown(self.robust)}")


@dataclass(frozen=True, kw_only=True, eq=False)
class Calibration:
    """Result of an identification: arm, tool point, uncertainty and rank.

    Arrays are read-only; parameters are ordered as `names`.
    """

    tcp: Array  # (3,) [m] tool point in the flange
    compliance: Array  # (n,) [rad/(N m)] zero where not identified
    # the identified arm; its table (n, 5) has a column for beta, so that all changes are small
    arm: SerialArm
    nominal: SerialArm
    nominal_tcp: Array  # (3,) [m] initial tool point, from [Yukhimets 2023, eq. 16] or as stated
    cost: float  # [m^2] pair criterion (eq. 7) over the touches in use
    cost_nominal: float  # [m^2] the same for the nominal arm with `nominal_tcp`
    # [m] standard deviation of a touch along each axis, corrected for degrees of freedom
    noise: float
    points: Array  # (S, 3) [m] the touched points in the base
    # (m_i,) [m] distance of every touch from its point, including outliers
    residuals: tuple[Array, ...]
    # (m_i,) weight of every touch in the fit: 1 ordinary, less for far touches, 0 left out
    weights: tuple[Array, ...]
    outliers: tuple[Outlier, ...]
    estimate: Estimate
    # degrees of freedom of the noise: 3 (touches - series) minus the effective number of parameters
    degrees_of_freedom: float
    rank: RankReport  # rank of the 4 n + 3 DH and tool numbers
    rank_free: RankReport  # rank of `parameters`: with betas and compliances, without fixed ones
    history: tuple[float, ...]  # [m^2] pair criterion at the start and after each step
    converged: bool
    warnings: tuple[str, ...]
    loads: BoundLoads | None
    # (3 K,) sorted errors of touches predicted from other positions, in predicted deviations
    scores: Array

    @property
    def dh(self) -> Array:
        """Standard DH (n, 4) of the identified arm: theta0 [rad], d [m], a [m], alpha [rad].

        Exact, but not usable as dimensions where two axes are nearly parallel: their common normal
        may be far away. `arm.table` (n, 5) has Hayati's beta there and stays near nominal, and so
        has `dh.csv`.

        Warns:
            UserWarning: some d is far beyond the arm; the message names the joints.
        """
        dh = self.arm.dh
        far = np.flatnonzero(np.abs(dh[:, 1]) > _DETOUR * self.arm.reach)
        if len(far):
            joints = [k for k in self.arm.near_parallel if self.beta[k]]
            pairs = " and ".join(f"{k + 1}, {k + 2}" for k in joints)
            lengths = ", ".join(f"d{k + 1} = {dh[k, 1]:.3g} m" for k in far)
            warn(
                f"dh: axes {pairs} are nearly parallel, so that without beta {lengths}; use "
                "`arm.table` (theta0, d, a, alpha, beta), which stays near nominal",
                stacklevel=2,
            )
        return dh

    @property
    def beta(self) -> Array:
        """Hayati's angles (n,) [rad], which belong to `arm.table`, not to `dh`."""
        return self.arm.table[:, -1]

    @property
    def identifiable(self) -> np.ndarray:
        """A largest identifiable set of the DH and tool numbers (4 n + 3,) bool, the rest fixed."""
        return self.rank.identifiable

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the free parameters (P,)."""
        return self.estimate.names

    @property
    def sigma(self) -> Array:
        """Standard deviation (P,) of the error of each parameter, in its unit."""
        return self.estimate.sigma

    @property
    def covariance(self) -> Array:
        """Covariance (P, P) of the errors of the parameters, in their units.

        Where touches do not determine a parameter, its error is that of an arm within the stated
        tolerances, by default those of `uuv.calib.parameters.DEFAULT_PRIOR`.
        """
        return self.estimate.covariance

    def interval(self, confidence: float = 0.95) -> Array:
        """Confidence interval (P, 2) of each parameter by Student's t."""
        half = self.quantile(confidence) * self.sigma
        return np.column_stack([self.estimate.values - half, self.estimate.values + half])

    def quantile(self, confidence: float = 0.95) -> float:
        """Half-width of a two-sided confidence interval, in standard deviations."""
        if not 0.0 < number(confidence, "confidence") < 1.0:
            raise ConfigurationError(f"confidence: must be between 0 and 1, got {confidence!r}")
        return float(t.ppf(0.5 + 0.5 * confidence, max(self.degrees_of_freedom, 1.0)))

    def combinations(self, confidence: float = 0.95) -> tuple[Combination, ...]:
        """Observable combinations of free parameters, best first, with confidence intervals."""
        report, quantile = self.rank_free, self.quantile(confidence)
        out = []
        for i, weights in enumerate(report.directions):
            scaled = weights / report.scales
            value, sigma = (
                float(scaled @ self.estimate.changes),
                float(np.sqrt(scaled @ self.covariance @ scaled)),
            )
            bounds = (value - quantile * sigma, value + quantile * sigma)
            text = report.combination(i)

            out.append(
                Combination(text=text, weights=weights, value=value, sigma=sigma, interval=bounds)
            )

        return tuple(out)

    def scale(self, q: ArrayLike) -> tuple[float, float]:
        """Scale of the identified arm to the nominal one, from flanges at poses `q` (N, n).

        Scale 1.001: the identified arm moves 1.001 m where the nominal arm moves 1 m.

        Returns:
            The scale and its standard deviation.
        """
        values = checked_series([q], self.arm)[0]

        n, origin = self.arm.n, np.zeros(3)
        about = self.nominal.tips(values, origin)
        about = about - about.mean(axis=0)

        p, J = self.arm.tips_and_jacobian(np.ascontiguousarray(values), origin)
        J[:, ROW * n :] = 0.0
        full = np.concatenate([J, np.zeros((len(p), n, 3))], axis=1)[
            :, self.estimate.parameters.index
        ]

        total = float(np.sum(about**2))
        # A rotation moves every point at right angles to `about`, so this is the scale to first
        # order.
        gradient = np.einsum("mi,mpi->p", about, full) / total

        aligned = transform_points(kabsch(p, about), p)
        return float(np.sum(about * aligned)) / total, float(
            np.sqrt(gradient @ self.covariance @ gradient)
        )

    def tips(self, q: ArrayLike, payload_mass: float = 0.0) -> Array:
        """Tip positions (M, 3) [m] in the base at joint values `q` (M, n), with sag."""
        values = np.ascontiguousarray(q, dtype=np.float64)
        return self.arm.tips(self.deflected(values, payload_mass), self.tcp)

    def touched_tips(self, series: Sequence[Array]) -> list[Array]:
        """Tip positions (m_i, 3) [m] of the calibration's touches, each under its payload.

        Args:
            series: those touches (m_i, n), all of them.
        """
        every = np.ascontiguousarray(np.vstack(series))
        bent = every
        if self.loads is not None:
            bent = every + self.compliance * self.loads.at(every)(self.arm.table)

        return np.split(self.arm.tips(bent, self.tcp), np.cumsum([len(q) for q in series])[:-1])

    def half_widths(
        self, q: ArrayLike, payload_mass: float = 0.0, confidence: float = 0.95
    ) -> Array:
        """Half-widths of the predictive intervals of touches of one new point about their mean.

        Errors that the parameters cannot express (gears, sag, seating) widen them: see
        `uuv.calib.verification`.

        Args:
            q: (M, n) joint values of all touches of that point.
            payload_mass: [kg] carried.
            confidence: share of the errors, along each axis, that the intervals should contain.

        Returns:
            Half-widths (M, 3) [m].
        """
        J = self._spread(q, payload_mass)

        # Variance from the parameters and from the operator; errors of prediction may require more.
        share = 1.0 - 1.0 / len(J)
        variance = np.einsum("mpi,pr,mri->mi", J, self.covariance, J) + share * self.noise**2
        return self._widening(confidence) * self.quantile(confidence) * np.sqrt(variance)

    def predicted_rms(
        self, q: ArrayLike, payload_mass: float = 0.0, confidence: float = 0.95
    ) -> tuple[float, float]:
        """RMS distance of touches of one new point from their mean, as predicted, and its bound.

        The errors share the parameters, so that few of them are independent: the bound is that of a
        scaled chi-square with the mean and variance of the squared distances.

        Args:
            q: (M, n) joint values of all touches of that point.
            payload_mass: [kg] carried.
            confidence: probability that the RMS distance is below the bound.

        Returns:
            Predicted RMS distance [m], and its upper bound [m].
        """
        J = self._spread(q, payload_mass)
        noise2 = self.noise**2

        # Traces of the covariance of all tips and of its square.
        G = np.einsum("mpi,mri->pr", J, J) @ self.covariance
        mean = float(np.trace(G)) + 3.0 * (len(J) - 1) * noise2
        square = float(np.sum(G * G.T)) + 2.0 * noise2 * float(np.trace(G))
        square += 3.0 * (len(J) - 1) * noise2**2

        freedom = mean**2 / max(square, 1e-300)
        bound = mean / freedom * float(chi2.ppf(confidence, freedom))
        factor = self._widening(confidence)
        return factor * float(np.sqrt(mean / len(J))), factor * float(np.sqrt(bound / len(J)))

    def _spread(self, q: ArrayLike, payload_mass: float) -> Array:
        """Derivatives (M, P, 3) by the parameters of touched tips about their mean."""
        values = np.ascontiguousarray(q, dtype=np.float64)
        load = (
            None
            if self.loads is None
            else self.loads.with_payload(payload_mass, len(values)).at(values)
        )

        full = np.concatenate([self.arm.table.ravel(), self.tcp, self.compliance])
        data = Data(
            q=values, starts=np.zeros(1, dtype=int), load=load, weights=np.ones(len(values))
        )
        J = tips_of(self.arm, full, data)[1][:, self.estimate.parameters.index]
        return J - J.mean(axis=0)

    def _widening(self, confidence: float) -> float:
        """Factor >= 1 by which errors of prediction exceed those of a right model."""
        return max(1.0, float(np.quantile(self.scores, confidence)) / self.quantile(confidence))

    def deflected(self, q: ArrayLike, payload_mass: float = 0.0) -> Array:
        """Joint positions (M, n) at readings `q` (M, n), deflected under `payload_mass` [kg]."""
        values = np.ascontiguousarray(q, dtype=np.float64)
        if self.loads is None:
            return values

        bound = self.loads.with_payload(payload_mass, len(values))
        return values + self.compliance * bound.at(values)(self.arm.table)

    def _repr_html_(self) -> str:
        """Card for a notebook: figures and warnings, no verdict, which `uuv calibrate` adds."""
        touches = sum(len(distances) for distances in self.residuals)
        largest = max(float(distances.max()) for distances in self.residuals)
        rows = [
            (
                "touches, points, left out",
                f"{touches}, {len(self.residuals)}, {len(self.outliers)}",
                "",
            ),
            ("noise of a touch, each axis", f"{1e3 * self.noise:.3f}", "mm"),
            ("farthest touch from its point", f"{1e3 * largest:.3f}", "mm"),
            ("criterion J, before", f"{1e6 * self.cost_nominal:.4g}", "mm²"),
            ("criterion J, after", f"{1e6 * self.cost:.4g}", "mm²"),
            ("observable directions", f"{self.rank.rank} of {self.rank.total}", ""),
        ]

        doubts = [*self.warnings, *([] if self.converged else ["the fit did not converge"])]
        words = ("converged, no warnings", "with warnings")
        return page.card("Calibration of an arm", not doubts, doubts, rows, words)


def identify(
    series: Sequence[ArrayLike],
    nominal: ArrayLike | SerialArm,
    *,
    free: Iterable[str] | str | None = None,
    prior: Mapping[str, float] | None = None,
    distances: Iterable[Distance] = (),
    tcp: ArrayLike | None = None,
    loads: Loads | None = None,
    method: Method | MapFit = "map",
) -> Calibration:
    """Identify an arm from touches; `series` holds joint values (m_i, n) for each unknown point.

    Deterministic.

    Args:
        series: joint values (m_i, n) [rad], slides [m], one array per touched point.
        nominal: standard DH (n, 4) of hinges as theta0 [rad], d [m], a [m], alpha [rad], or a
            `SerialArm` (from axes, with slides).
        free: parameters that may change, as groups (theta, d, a, alpha, beta, tcp, compliance) or
            single names ("a2"). By default all except compliance, which is included if `loads` are
            given. Beta applies between near-parallel axes only; unless named, it is dropped again
            if it is not significant.
        prior: standard deviations about nominal by group or name, in rad, m, rad/(N m). Without it
            the evidence of the data chooses the deviation of each group, starting from
            `uuv.calib.parameters.DEFAULT_PRIOR`.
        distances: (i, j, length [m]) or (i, j, length, deviation [m]) between the points of series
            i and j, counted from 0. No other input makes the scale observable.
        tcp: initial tool point (3,) [m] in the flange; by default from [Yukhimets 2023, eq. 13-16].
        loads: weights and buoyancy on the arm; they make the joint compliances observable.
        method: "map", the fit by `MapFit()`; a `MapFit` with other settings; or "paper" for the run
            of [Yukhimets 2023], three steps on all 4 n + 3 parameters, for comparison.

    Returns:
        The identified arm with uncertainty, rank and outliers.

    Raises:
        ConfigurationError: the joint count is wrong, there are no touches, a number is not finite,
            units are degrees or millimetres, or a word is unknown.
    """
    if not isinstance(method, MapFit):
        one_of(method, get_args(Method), "method")
    if loads is not None and not isinstance(loads, Loads):
        raise ConfigurationError(f"loads: expected Loads, got {shown(loads)}")

    arm = nominal if isinstance(nominal, SerialArm) else SerialArm.from_dh(nominal, name="nominal")
    if not max(float(np.abs(arm.X_base_0[:3, 3]).max()), arm.reach) < _MOST_LENGTH:
        raise ConfigurationError(f"nominal: must be within {_MOST_LENGTH:g} m of its base")
    touches = usable(series, arm, tcp)
    used = touches.used

    # All touches in use as one array, and their indices among all touches.
    counts = [len(q) for q in touches.series]
    bound = None if loads is None else loads.bind(arm, counts)
    q = np.ascontiguousarray(np.vstack(used))
    offsets = np.cumsum([0, *counts])
    rows = np.concatenate([offsets[i] + touches.kept[i] for i in touches.live])
    data = Data(
        q=q,
        starts=np.cumsum([0, *(len(q_series) for q_series in used[:-1])]),
        distances=_checked_distances(distances, touches.live, len(counts)),
        load=None if bound is None else bound.at(q, rows),
        weights=np.ones(len(q)),
    )

    mean = np.concatenate([arm.table.ravel(), touches.tcp, np.zeros(arm.n)])
    observed = _Observed(arm=arm, mean=mean, touches=touches, loads=bound)
    warnings = list(touches.warnings)

    if method == "paper":
        parameters = select(arm, ("theta", "d", "a", "alpha", "tcp"))
        fit = paper_run(Problem(arm, data, parameters, mean))
        tolerances = fit.deviations
        warnings.append(WARNING)
    else:
        how = method if isinstance(method, MapFit) else MapFit()
        fit, data, parameters = _map_fit(observed, data, free, prior, how)
        # Deviations that the evidence chose may be below what arms are made to.
        tolerances = prior_deviations(parameters, None) if prior is None else fit.deviations

    return _assemble(observed, data, parameters, fit, tolerances, warnings)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Observed:
    """The touches, and the nominal arm with which they are assumed to be made."""

    arm: SerialArm  # nominal
    mean: Array  # (5 n + 3 + n,) its table, initial tool point, no compliance
    touches: UsableTouches
    loads: BoundLoads | None


def _map_fit(
    observed: _Observed,
    data: Data,
    free: Iterable[str] | str | None,
    prior: Mapping[str, float] | None,
    how: MapFit,
) -> tuple[Fit, Data, Parameters]:
    """Maximum a posteriori estimate: fit, data with outliers at weight 0, free parameters."""
    arm = observed.arm
    mean = observed.mean
    elastic = observed.loads is not None
    default = (*DEFAULT_FREE, "compliance") if elastic else DEFAULT_FREE
    try:
        words: list[str] = (
            [free] if isinstance(free, str) else list(default if free is None else free)
        )
    except TypeError as error:
        raise ConfigurationError(f"free: must be words, got {shown(free)}") from error

    if prior is not None and not isinstance(prior, Mapping):
        raise ConfigurationError(f"prior: must map words to deviations, got {shown(prior)}")

    parameters = select(arm, words)
    if not elastic and "compliance" in parameters.groups:
        raise ConfigurationError("free: compliance requires `loads`, which deflect the joints")

    solver = (
        solve_robustly
        if how.robust
        else lambda *arguments, **options: (solve(*arguments, **options), arguments[0].data)
    )

    def run(chosen: Parameters, on: Data) -> tuple[Fit, Data]:
        problem = Problem(arm, on, chosen, mean)
        deviations = prior_deviations(
            chosen, {k: v for k, v in (prior or {}).items() if k in _words(chosen)}
        )
        widest = widest_prior(chosen, arm.reach) if prior is None else None
        return solver(
            problem, deviations, noise=how.noise, widest=widest, iterations=how.max_iterations
        )

    prior_deviations(parameters, prior)  # refuses unknown words before the first estimate
    fit, used = run(parameters, data)

    betas = np.array([i for i, group in enumerate(parameters.groups) if group == "beta"], dtype=int)
    named = free is not None and any(word.startswith("beta") for word in words)
    if len(betas) and not named and not np.any(mean[parameters.index[betas]]):
        # Betas that are not significant are dropped, and the other parameters estimated again.
        estimated = fit.full[parameters.index[betas]]
        significance = estimated @ np.linalg.solve(fit.covariance[np.ix_(betas, betas)], estimated)
        if significance < chi2.isf(_BETA_LEVEL, len(betas)):
            parameters = parameters.only(np.setdiff1d(np.arange(len(parameters.names)), betas))
            fit, used = run(parameters, data)

    return fit, used, parameters


def _words(parameters: Parameters) -> set[str]:
    return {*parameters.names, *parameters.groups, *DEFAULT_PRIOR}


def _checked_distances(
    distances: Iterable[Distance], live: list[int], count: int
) -> tuple[tuple[int, int, float, float], ...]:
    """Known distances between series in use, by indices among those, each with a deviation."""
    out = []
    try:
        rows = [tuple(entry) for entry in distances]
    except TypeError as error:
        raise ConfigurationError(
            f"distances: expected (i, j, length[, deviation]), got {shown(distances)}"
        ) from error

    for row in rows:
        if len(row) not in (3, 4):
            raise ConfigurationError(
                f"distances: expected (i, j, length[, deviation]), got {shown(row)}"
            )
        i, j = (whole_number(k, "distances: series", most=count - 1) for k in row[:2])
        if i == j:
            raise ConfigurationError(
                f"distances: must be between two series of 0 to {count - 1}, got {i} and {j}"
            )

        length = finite_number(row[2], "distances: length [m]", above=0.0, most=_MOST_LENGTH)
        deviation = finite_number(
            row[3] if len(row) == 4 else _SURE_DISTANCE,
            "distances: deviation [m]",
            least=1e-9,
            most=_MOST_LENGTH,
        )

        if i in live and j in live:
            out.append((live.index(i), live.index(j), length, deviation))

    return tuple(out)


def _assemble(
    observed: _Observed,
    data: Data,
    parameters: Parameters,
    fit: Fit,
    tolerances: Array,
    warnings: list[str],
) -> Calibration:
    """Result of a fit; `tolerances` (P,) are the deviations of arms from nominal."""
    arm, mean, bound = observed.arm, observed.mean, observed.loads
    touches, live = observed.touches.series, observed.touches.live
    places_used = observed.touches.kept
    n, size = arm.n, ROW * arm.n
    identified = arm.with_table(fit.full[:size].reshape(n, ROW))
    tcp, compliance = fit.full[size : size + 3], fit.full[size + 3 :]

    # Rank of the DH and tool numbers, and of the free parameters.
    dh_numbers = select(arm, ("theta", "d", "a", "alpha", "tcp"))
    rank = rank_report(arm, fit.full, data, dh_numbers, fit.noise)
    same = parameters.names == dh_numbers.names
    rank_free = rank if same else rank_report(arm, fit.full, data, parameters, fit.noise)

    # Tips of all touches, including those left out.
    every = np.vstack(touches)
    bent = every if bound is None else every + compliance * bound.at(every)(identified.table)
    tips = identified.tips(bent, tcp)
    offsets = np.cumsum([0, *(len(q) for q in touches)])

    # Points as means of the touches in use, and the distance of every touch.
    points = np.empty((len(touches), 3))
    residuals, outliers = [], []
    weights = [np.zeros(len(q)) for q in touches]

    for s, i in enumerate(live):
        weights[i][places_used[i]] = data.weights[data.series == s]
    weight = {i: data.weights[data.series == s] > 0.0 for s, i in enumerate(live)}

    for i, q in enumerate(touches):
        mine = tips[offsets[i] : offsets[i] + len(q)]
        places = places_used[i][weight[i]] if i in live and weight[i].any() else np.arange(len(q))
        points[i] = mine[places].mean(axis=0)
        residuals.append(readonly(np.linalg.norm(mine - points[i], axis=1)))

        if i in live:
            left_out = places_used[i][~weight[i]]
            outliers += [
                Outlier(series=i, touch=int(j), distance=float(residuals[i][j])) for j in left_out
            ]

    # Warnings: noise, touches left out, an arm far from the nominal one.
    if data.degrees - fit.effective < LEAST_FREEDOM:
        warnings.append(
            f"{len(data.q)} touches leave {data.degrees - fit.effective:.2g} degrees of freedom: "
            f"the fit cannot be validated, and a noise of {1e3 * fit.noise:.2g} mm is assumed"
        )
    warnings += [f"left out as an outlier: {outlier}" for outlier in outliers]

    if fit.noise > _FAR_OFF:
        warnings.append(
            f"touches still scatter by {1e3 * fit.noise:.3g} mm about their points: they were not "
            "made with this arm, or the table, the joint signs or the joint zeros are wrong"
        )

    warnings += _far_from_nominal(arm, fit.full - mean, dh_numbers)
    warnings += _at_the_bound(arm, parameters, fit)
    tips_nominal = tips_of(arm, mean, data)[0]

    return Calibration(
        tcp=readonly(tcp),
        compliance=readonly(compliance),
        arm=identified,
        nominal=arm,
        nominal_tcp=readonly(mean[size : size + 3]),
        cost=fit.cost,
        cost_nominal=pair_cost(centred(tips_nominal, data), data),
        noise=fit.noise,
        # of every point and touch
        points=readonly(points),
        residuals=tuple(residuals),
        weights=tuple(readonly(w) for w in weights),
        outliers=tuple(outliers),
        estimate=Estimate(
            parameters=parameters,
            values=readonly(fit.full[parameters.index]),
            changes=readonly((fit.full - mean)[parameters.index]),
            covariance=readonly(fit.error_covariance(tolerances)),
            posterior=readonly(fit.covariance),
            prior=readonly(fit.deviations),
        ),
        degrees_of_freedom=max(data.degrees - fit.effective, 1.0),
        rank=rank,
        rank_free=rank_free,
        history=fit.history,
        converged=fit.converged,
        warnings=tuple(warnings),
        loads=bound,
        scores=_scores(arm, data, parameters, fit, points[live]),
    )


def _far_from_nominal(arm: SerialArm, change: Array, dh_numbers: Parameters) -> list[str]:
    """Warning about the DH number with the largest `change` of the full vector, if it is large."""
    moved = np.abs(change)[dh_numbers.index[:-3]]
    angles = np.array([group in {"theta", "alpha"} for group in dh_numbers.groups[:-3]])
    shares = np.where(angles, moved / _FAR_TURN, moved / (_FAR_SHARE * max(arm.reach, 1e-9)))

    k = int(shares.argmax())
    if not shares[k] > 1.0:
        return []

    amount = f"{np.rad2deg(moved[k]):.3g} deg" if angles[k] else f"{1e3 * moved[k]:.3g} mm"
    return [
        f"the identified arm is far from the nominal one ({dh_numbers.names[k]} by {amount}): "
        "check the table, the joint signs and the joint zeros"
    ]


def _at_the_bound(arm: SerialArm, parameters: Parameters, fit: Fit) -> list[str]:
    """Warning about groups that require a prior wider than manufacturing tolerances."""
    widest = widest_prior(parameters, arm.reach)
    held = {group: k for k, group in enumerate(parameters.groups) if fit.deviations[k] == widest[k]}

    if not held:
        return []

    bounds = (
        f"{group} by {np.rad2deg(widest[k]):.2g} deg"
        if parameters.units[k] == "rad"
        else f"{group} by {1e3 * widest[k]:.2g} mm"
        for group, k in held.items()
    )

    return [
        f"the identified arm is far from the nominal one: its {', '.join(bounds)} or more, beyond "
        "manufacturing tolerances, to which the prior is limited; check the table, the joint signs "
        "and the joint zeros, or state a prior"
    ]


def _scores(arm: SerialArm, data: Data, parameters: Parameters, fit: Fit, points: Array) -> Array:
    """Scores (3 K,) of the touches in use (`uuv.calib.verification`); `points` (S, 3) [m]."""
    J = tips_of(arm, fit.full, data)[1][:, parameters.index]

    series, used = [], []
    for s in range(len(data.starts)):
        mine = np.flatnonzero((data.series == s) & (data.weights > 0.0))
        if len(mine) < 2:
            continue

        weights = data.weights[mine]
        rows = J[mine] - np.average(J[mine], axis=0, weights=weights)
        series.append(PointTouches(rows=rows, residuals=fit.residuals[mine], weights=weights))
        used.append(s)

    return scores(series, places(points[used], arm.reach), fit.deviations, fit.noise)
