"""Maximum a posteriori estimate of an arm's parameters from touches, by Levenberg-Marquardt.

A series is all touches of one unknown point. The criterion sums squared distances over all pairs of
a series [Yukhimets 2023, eq. 7]. For m touches x_j about their mean c the sum equals m sum |x_j -
c|^2. The m (m - 1) / 2 dependent pairs are therefore replaced by m centred points, which keeps the
degrees of freedom right.

That criterion alone has its minimum at an arm shrunk to a point. The prior fixes the scale and
every other direction that touching does not observe. If no prior is stated, the deviations of the
prior and the noise are those that maximise the evidence of the data [MacKay 1992, eq. 2.25-2.27].
The deviations have bounds, because otherwise they would grow without limit in unobserved directions
for touches that do not belong together, or for very many touches. Columns are scaled to unit size
by the prior's deviations.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.stats import chi2, f

from uuv.calib import kernels
from uuv.calib.parameters import Parameters
from uuv.models.arms.kinematics import ROW, THETA, D
from uuv.models.arms.serial_arm import SerialArm
from uuv.models.arms.tip_places import NO_JACOBIAN, tips
from uuv.sim.interfaces.spatial import Array

# [m] initial noise of a touch, kept if there are too few touches to estimate it
FIRST_NOISE = 1e-4
LEAST_FREEDOM = 5.0  # degrees of freedom needed to estimate the noise
# [m] least noise, below encoder resolution; at zero the prior would have no weight
NOISE_FLOOR = 1e-6
_SETTLED = 1e-5  # step length that ends the iteration, as a share of the posterior deviations
# number of pseudo-observations: weight of the default deviation where the data choose it
_PSEUDO = 2.0
_ROUNDS = 12  # maximal iterations of the evidence: noise and prior deviations
_CAUCHY = 2.4  # [deviations] residual length at which a touch has weight 1/2
_CAUCHY_ROUNDS = 30  # maximal reweighted estimates with the Cauchy loss
_CAUCHY_STEPS = 3  # Levenberg-Marquardt steps of each estimate
_MEDIAN = 1.5382  # median length of a vector of three unit normals
_REJECTIONS = 10  # maximal rounds of reweighting and of outlier rejection
_SAME_WEIGHTS = 0.01  # change of the weights that ends the reweighting
_FAR = 0.01  # share of normal errors, beyond which the weight of a touch falls
# degrees of freedom of the Student's t that distinguishes a heavy tail from a blunder
_BLUNDER_TAIL = 4.0
Load = Callable[[Array], Array]  # table (n, 5) -> joint loads (M, n) [N m]


@dataclass(frozen=True, kw_only=True, eq=False)
class Data:
    """Touches of all series, stacked, and known distances between their points."""

    q: Array  # (M, n) [rad] or [m]
    starts: np.ndarray  # (S,) first row of each series
    # (series, series, length [m], deviation [m])
    distances: tuple[tuple[int, int, float, float], ...] = ()
    load: Load | None = None
    # (M,) weight of each touch; 0 excludes it
    weights: Array = field(default_factory=lambda: np.empty(0))

    @property
    def series(self) -> np.ndarray:
        """Series index (M,) of each touch."""
        return np.searchsorted(self.starts, np.arange(len(self.q)), side="right") - 1

    @property
    def degrees(self) -> float:
        """Degrees of freedom of the centred touches with weight > 0."""
        counted = np.add.reduceat((self.weights > 0.0).astype(np.float64), self.starts)
        return 3.0 * float(np.maximum(counted - 1.0, 0.0).sum())


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """Solution of the estimation: full parameter vector, residuals, covariance and convergence."""

    full: Array  # (5 n + 3 + n,) table, tool point, compliances
    residuals: Array  # (M, 3) [m] tips minus the mean of their series
    noise: float  # [m] standard deviation of a touch along each axis
    deviations: Array  # (P,) standard deviations of the prior
    covariance: Array  # (P, P)
    effective: float  # effective number of parameters that the data determine (gamma)
    cost: float  # [m^2] pair criterion over the touches with weight > 0
    history: tuple[float, ...]  # [m^2] pair criterion before the first step and after each
    converged: bool

    def error_covariance(self, tolerances: Array) -> Array:
        """Covariance (P, P) of the errors of the estimate, if arms deviate by `tolerances` (P,).

        The posterior covariance assumes the deviations of the prior in use. Deviations that the
        evidence chose describe observable parameters; where touching observes nothing, the estimate
        stays near nominal, and its error is as large as arms deviate. With posterior covariance C
        and prior deviations D the pull toward nominal is C D^-2, so that true deviations W in place
        of D add C D^-2 (W^2 - D^2) D^-2 C.

        Args:
            tolerances: (P,) deviations of arms from nominal; smaller ones than those of the prior
                are replaced by these.
        """
        pull = self.covariance / self.deviations**2
        wider = np.maximum(tolerances, self.deviations) ** 2 - self.deviations**2
        return self.covariance + (pull * wider) @ pull.T


def tips_of(arm: SerialArm, full: Array, data: Data) -> tuple[Array, Array]:
    """Tip positions (M, 3) [m] and their derivatives (M, 5 n + 3 + n, 3) by the full vector.

    Args:
        arm: kinematics; its table is replaced by that in `full`.
        full: (5 n + 3 + n,) table, tool point, compliances.
        data: touches and, where joints are elastic, their joint loads.

    Returns:
        Tip positions in the base, and derivatives by table, tool point and compliances.
    """
    n, size = arm.n, ROW * arm.n
    table, tcp, compliance = full[:size].reshape(n, ROW), full[size : size + 3], full[size + 3 :]
    arm = arm.with_table(table)

    if data.load is None:
        p, J = arm.tips_and_jacobian(data.q, tcp)
        return p, J

    # Joints sag by compliance times load.
    tau = data.load(table)
    p, J = arm.tips_and_jacobian(data.q + compliance * tau, tcp)
    moved = ROW * np.arange(n) + np.where(arm.slides, D, THETA)
    return p, np.concatenate([J, J[:, moved] * tau[:, :, None]], axis=1)


def linearised(
    arm: SerialArm, full: Array, data: Data, parameters: Parameters
) -> tuple[Array, Array, Array, Array, Array]:
    """Linearised touches at `full`, centred in each series (`kernels.centred_rows`).

    Args:
        arm: kinematics.
        full: (5 n + 3 + n,) full vector.
        data: touches.
        parameters: P free parameters.

    Returns:
        Residuals (M, 3) [m], weighted residuals (3 M,), weighted derivatives (3 M, P), means (S, 3)
        [m], and derivatives of the means (S, P, 3).
    """
    p, J = tips_of(arm, full, data)
    return kernels.centred_rows(p, J, data.weights, data.starts, parameters.index)


def centred(values: Array, data: Data) -> Array:
    """Subtract from `values` (M, 3) their weighted mean in each series."""
    return values - means(values, data)[data.series]


def means(values: Array, data: Data) -> Array:
    """Weighted mean (S, 3) of `values` (M, 3) in each series."""
    total = np.maximum(np.add.reduceat(data.weights, data.starts), 1e-300)
    return np.add.reduceat(data.weights[:, None] * values, data.starts) / total[:, None]


def pair_cost(residuals: Array, data: Data) -> float:
    """Pair criterion [m^2]: squared distances over all pairs of a series [Yukhimets 2023, eq. 7].

    Touches of weight 0 are excluded.
    """
    counts = (data.weights > 0.0).astype(np.float64)
    square = np.add.reduceat(counts * np.einsum("mi,mi->m", residuals, residuals), data.starts)
    return float(np.add.reduceat(counts, data.starts) @ square)


def _distances(data: Data, noise: float) -> list[tuple[int, int, float, float]]:
    """Known distances between series points, each with its total deviation [m].

    The mean of m touches has a deviation of noise / sqrt(m), which is included. The correlation of
    distances that share a point is neglected.
    """
    share = noise**2 / np.maximum(np.add.reduceat(data.weights, data.starts), 1e-300)
    return [
        (i, j, length, float(np.sqrt(sd**2 + share[i] + share[j])))
        for i, j, length, sd in data.distances
    ]


def distance_rows(c: Array, C: Array, data: Data, noise: float) -> tuple[Array, Array]:
    """Residuals and derivatives of the known distances, each in units of its standard deviation.

    Args:
        c: (S, 3) [m] mean tip of each series.
        C: (S, P, 3) derivatives of `c` by the free parameters.
        data: touches with D known distances.
        noise: [m] standard deviation of a touch.

    Returns:
        Errors (D,) and their derivatives (D, P).
    """
    errors, rows = [], []

    for i, j, length, deviation in _distances(data, noise):
        gap = c[i] - c[j]
        distance = float(np.linalg.norm(gap))
        errors.append((distance - length) / deviation)
        rows.append((C[i] - C[j]) @ gap / max(distance, 1e-12) / deviation)

    return np.array(errors), np.array(rows)


class Problem:
    """Free `parameters` of `arm` estimated from `data`, the prior centred at the vector `mean`."""

    def __init__(self, arm: SerialArm, data: Data, parameters: Parameters, mean: Array) -> None:
        self.arm, self.data, self.parameters, self.mean = arm, data, parameters, mean
        self.index = parameters.index
        self._slides = arm.slides
        self._parallel = np.isin(np.arange(arm.n), arm.near_parallel)
        self._length = 1.0
        self._length = self.scale(mean)[0]  # [m]

    def scale(self, full: Array) -> tuple[float, Array]:
        """Size of the arm relative to that at `mean`, and its derivative (P,).

        The criterion rewards a smaller arm, because all spreads shrink with it. As a likelihood of
        joint values, the density of the tip contains the volume of dp/dq, which shrinks equally
        fast. Residuals are therefore divided by the relative size, so that touching carries no
        information about size.
        """
        table, tcp = self._split(full)[:2]
        length, gradient = kernels.arm_size(table, self.arm.X_n_flange, tcp, self._parallel)
        padded = np.concatenate([gradient, np.zeros(self.arm.n)])
        return length / self._length, padded[self.index] / self._length

    def _split(self, full: Array) -> tuple[Array, Array, Array]:
        size = ROW * self.arm.n
        return full[:size].reshape(-1, ROW), full[size : size + 3], full[size + 3 :]

    def equations(self, full: Array, noise: float) -> tuple[Array, Array, Array]:
        """Normal equations of the scaled residuals at `full`, without the prior.

        Returns:
            Residuals (M, 3) [m]; J^T J (P, P); J^T r (P,).
        """
        data = self.data
        residuals, r, rows, c, C = linearised(self.arm, full, data, self.parameters)
        size, gradient = self.scale(full)

        # Derivative of r / (noise size): the rows gain -r (grad size / size)^T.
        toward = rows.T @ r
        square = float(r @ r)
        lean = gradient / size
        over = 1.0 / (noise * size) ** 2
        crossed = np.outer(toward, lean)
        H = over * (rows.T @ rows - crossed - crossed.T + square * np.outer(lean, lean))
        g = over * (toward - square * lean)

        # Known distances.
        if data.distances:
            errors, rows = distance_rows(c, C, data, noise)
            H, g = H + rows.T @ rows, g + rows.T @ errors

        return residuals, H, g

    def value(self, full: Array, noise: float, deviations: Array) -> tuple[float, Array]:
        """Objective: twice the negative log posterior without the constant terms.

        Args:
            full: (5 n + 3 + n,) full vector.
            noise: [m] standard deviation of a touch.
            deviations: (P,) standard deviations of the prior.

        Returns:
            The objective, and the residuals (M, 3) [m].
        """
        data = self.data
        table, tcp, compliance = self._split(full)
        q = data.q if data.load is None else data.q + compliance * data.load(table)
        p = tips(table, self._slides, self.arm.X_base_0, self.arm.X_n_flange, tcp, q, NO_JACOBIAN)
        residuals = centred(p, data)
        total = (
            float(data.weights @ np.einsum("mi,mi->m", residuals, residuals))
            / (noise * self.scale(full)[0]) ** 2
        )

        if data.distances:
            c = means(p, data)
            total += sum(
                ((np.linalg.norm(c[i] - c[j]) - k) / sd) ** 2
                for i, j, k, sd in _distances(data, noise)
            )

        # Prior.
        away = (full - self.mean)[self.index] / deviations
        return float(total + away @ away), residuals

    def descend(
        self, full: Array, noise: float, deviations: Array, iterations: int, history: list[float]
    ) -> tuple[Array, bool]:
        """Levenberg-Marquardt on the objective [Yukhimets 2023, eq. 17]; the damping mu rises after
        a failed step.

        Args:
            full: (5 n + 3 + n,) start.
            noise: [m] standard deviation of a touch.
            deviations: (P,) standard deviations of the prior, which scale the columns.
            iterations: largest number of steps.
            history: [m^2] pair criterion, extended in place by every accepted step.

        Returns:
            The full vector, and True if it converged.
        """
        mu, (value, residuals) = 1e-6, self.value(full, noise, deviations)
        if not history:
            history.append(pair_cost(residuals, self.data))

        for _ in range(iterations):
            _, H, g = self.equations(full, noise)
            H = H * np.outer(deviations, deviations) + np.eye(len(g))
            gradient = g * deviations + (full - self.mean)[self.index] / deviations

            # Damped step; mu rises until the objective falls.
            while True:
                step = -np.linalg.solve(H + mu * np.diag(np.diag(H)), gradient)
                trial = full.copy()
                trial[self.index] += step * deviations
                new, residuals = self.value(trial, noise, deviations)
                length = float(step @ H @ step)
                if new <= value:
                    full, mu = trial, max(mu / 10.0, 1e-9)
                    break

                # Within rounding error no step lowers the value further.
                if length < _SETTLED**2 or mu > 1e8:
                    return full, True
                mu *= 10.0

            history.append(pair_cost(residuals, self.data))
            value = new
            if length < _SETTLED**2:
                return full, True

        return full, False

    def summary(
        self, full: Array, noise: float, deviations: Array, history: list[float], converged: bool
    ) -> Fit:
        """Assemble the `Fit` at `full`, with its covariance for the given noise and prior.

        Args:
            full: (5 n + 3 + n,) solution.
            noise: [m] standard deviation of a touch.
            deviations: (P,) standard deviations of the prior.
            history: [m^2] pair criterion before the first step and after each.
            converged: whether the iteration converged.

        Returns:
            The solution with residuals, covariance (P, P) and effective number of parameters.
        """
        residuals, H, _ = self.equations(full, noise)
        H = H * np.outer(deviations, deviations) + np.eye(len(deviations))
        inverse = np.linalg.inv(H)

        return Fit(
            full=full,
            residuals=residuals,
            noise=noise,
            deviations=deviations,
            covariance=inverse * np.outer(deviations, deviations),
            effective=float(len(H) - np.trace(inverse)),
            cost=pair_cost(residuals, self.data),
            history=tuple(history),
            converged=converged,
        )


def _noise_of(fit: Fit, data: Data) -> float:
    """Standard deviation of a touch [m], corrected for the effective number of parameters."""
    square = float(data.weights @ np.einsum("mi,mi->m", fit.residuals, fit.residuals))
    return max(np.sqrt(square / max(data.degrees - fit.effective, 1.0)), NOISE_FLOOR)


def _pooled(parameters: Parameters) -> list[np.ndarray]:
    """Indices of parameters that share one deviation, estimated from the data; the tool point keeps
    its own.
    """
    groups = np.array(parameters.groups)
    return [
        np.flatnonzero(groups == group)
        for group in dict.fromkeys(parameters.groups)
        if group != "tcp"
    ]


def solve(
    problem: Problem,
    deviations: Array,
    *,
    noise: float | None,
    widest: Array | None,
    start: Array | None = None,
    iterations: int = 100,
) -> Fit:
    """Estimate the parameters with a stated prior, or with one adapted to the data by evidence.

    Args:
        problem: arm, data, free parameters and prior mean.
        deviations: (P,) standard deviations of the prior; the start where `widest` is given.
        noise: [m] standard deviation of a touch; None estimates it.
        widest: (P,) choose the deviations that maximise the evidence of the data, up to these; None
            keeps them.
        start: (5 n + 3 + n,) start of the iteration; None starts at the prior mean.
        iterations: largest number of Levenberg-Marquardt steps altogether.

    Returns:
        The solution.
    """
    full = (problem.mean if start is None else start).copy()
    if widest is not None:
        deviations = np.minimum(deviations, widest)
    stated = deviations

    # First steps with the stated prior.
    history: list[float] = []
    sigma = noise if noise is not None else FIRST_NOISE
    full, converged = problem.descend(full, sigma, deviations, min(iterations, 3), history)
    fit = problem.summary(full, sigma, deviations, history, converged)

    if noise is not None and widest is None:
        full, converged = problem.descend(
            full, sigma, deviations, iterations - len(history) + 1, history
        )
        return problem.summary(full, sigma, deviations, history, converged)

    # Evidence: the data choose the noise and the deviations of the prior.
    pools = [] if widest is None else _pooled(problem.parameters)
    # With few degrees of freedom the residuals vanish, and an estimated noise would be far too
    # small.
    estimate = noise is None and problem.data.degrees - fit.effective >= LEAST_FREEDOM

    for _ in range(_ROUNDS):
        before = np.append(deviations, sigma)
        if estimate:
            sigma = _noise_of(fit, problem.data)

        # Deviation of each pool, with pseudo-observations of the stated one.
        away = (fit.full - problem.mean)[problem.index]
        known = 1.0 - np.diag(fit.covariance) / fit.deviations**2
        deviations = deviations.copy()
        for pool in pools:
            square = float(away[pool] @ away[pool]) + _PSEUDO * float(
                stated[pool] @ stated[pool]
            ) / len(pool)
            chosen = np.sqrt(square / (float(known[pool].sum()) + _PSEUDO))
            deviations[pool] = chosen if widest is None else np.minimum(chosen, widest[pool])

        left = iterations - (len(history) - 1)
        full, converged = (
            problem.descend(full, sigma, deviations, left, history) if left > 0 else (full, False)
        )
        fit = problem.summary(full, sigma, deviations, history, converged)
        if left <= 0 or np.max(np.abs(np.append(deviations, sigma) / before - 1.0)) < 0.01:
            break

    return fit


def solve_robustly(
    problem: Problem, deviations: Array, *, level: float = 0.01, **options: Any
) -> tuple[Fit, Data]:
    """Estimate the parameters as `solve` does, but robustly against a minority of outliers.

    Touches are judged by a robust fit from the prior alone (`_ordinary_fit`), since a fit to all of
    them would hide outliers. Without a touch that is less likely than `level` over the number of
    touches (Bonferroni), all weights stay
    1. Else far touches keep a reduced weight, whose influence falls with distance. Those too far
    for a heavy tail (Student's t) as well are excluded.

    Args:
        problem: arm, data, free parameters and prior mean; its data get the final weights.
        deviations: (P,) standard deviations of the prior.
        level: probability of reweighting clean data.
        **options: as of `solve`; `noise` is required.

    Returns:
        The solution, and the data with their weights, 0 for each excluded touch.
    """
    every = problem.data
    noise = options["noise"]
    counted = every.weights > 0.0
    share = level / max(counted.sum(), 1)
    ordinary = float(chi2.isf(share, 3))

    # Touches far from a fit to the majority.
    fit = _ordinary_fit(problem, deviations, counted)
    strange = _strange(fit, problem.data, counted, ordinary, noise)
    start = fit.full

    # Estimate without these touches, repeated until the same touches are left out.
    for _ in range(_REJECTIONS):
        problem.data = (
            replace(every, weights=(counted & ~strange).astype(np.float64))
            if strange.any()
            else every
        )
        fit = solve(problem, deviations, start=start if strange.any() else None, **options)
        again = _strange(fit, problem.data, counted, ordinary, noise)
        if np.array_equal(again, strange):
            break
        strange, start = again, fit.full

    if not strange.any():
        return fit, problem.data

    # Reweighting: blunders are left out, far touches have less weight.
    limit = float(3.0 * f.isf(share, 3, _BLUNDER_TAIL))
    for _ in range(_REJECTIONS):
        before = problem.data
        near_mean = counted & ~_strange(fit, before, counted, limit, noise)
        problem.data = replace(every, weights=_far_weights(fit, before, near_mean))
        fit = solve(problem, deviations, start=fit.full, **options)
        if np.max(np.abs(problem.data.weights - before.weights)) < _SAME_WEIGHTS:
            break

    return fit, problem.data


def _ordinary_fit(problem: Problem, deviations: Array, counted: np.ndarray) -> Fit:
    """Fit to the majority of touches: Cauchy weights whose scale falls with the median residual.

    The prior is kept as stated. If it were chosen by the evidence of data with outliers, it would
    become so wide that the arm shrinks to a point. `problem.data` gets the weights.
    """
    every = problem.data
    fit = problem.summary(problem.mean, FIRST_NOISE, deviations, [], False)
    for _ in range(_CAUCHY_ROUNDS):
        before = problem.data.weights
        sigma = _robust_noise(fit, problem.data, counted)
        square = np.einsum("mi,mi->m", fit.residuals, fit.residuals) / sigma**2
        problem.data = replace(
            every, weights=np.where(counted, 1.0 / (1.0 + square / _CAUCHY**2), 0.0)
        )
        history: list[float] = []
        full, converged = problem.descend(fit.full, sigma, deviations, _CAUCHY_STEPS, history)
        fit = problem.summary(full, sigma, deviations, history, converged)
        if np.max(np.abs(problem.data.weights - before)) < _SAME_WEIGHTS:
            break
    return fit


def _far_weights(fit: Fit, data: Data, ordinary: np.ndarray) -> Array:
    """Weights (M,): 1 near the mean, decreasing with squared distance farther away, 0 if not
    `ordinary`.
    """
    square = (
        np.einsum("mi,mi->m", fit.residuals, fit.residuals)
        / _robust_noise(fit, data, ordinary) ** 2
    )
    return np.where(ordinary, np.minimum(1.0, chi2.isf(_FAR, 3) / np.maximum(square, 1e-12)), 0.0)


def _robust_noise(fit: Fit, data: Data, counted: np.ndarray) -> float:
    """Standard deviation of a touch [m] from the median distance, which outliers hardly affect."""
    ordinary = counted & (data.weights > 0.0)
    median = float(np.median(np.linalg.norm(fit.residuals[ordinary], axis=1)))
    lost = max(1.0 - (3.0 * len(data.starts) + fit.effective) / (3.0 * ordinary.sum()), 0.1)
    return max(median / (_MEDIAN * np.sqrt(lost)), NOISE_FLOOR)


def _strange(
    fit: Fit, data: Data, counted: np.ndarray, limit: float, noise: float | None
) -> np.ndarray:
    """Mask (M,) of the touches too far from the mean of their series."""
    sigma = max(noise or 0.0, _robust_noise(fit, data, counted))
    return counted & (np.einsum("mi,mi->m", fit.residuals, fit.residuals) > limit * sigma**2)
