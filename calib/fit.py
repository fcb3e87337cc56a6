"""Maximum a posteriori fit of an arm to touches: Levenberg-Marquardt on centroid residuals in unit-scaled columns.

sum over pairs |x_j - x_s|^2 = m sum |x_j - c|^2 (paper 000, eq. 7, series of m touches about their mean c), so the
m (m - 1) / 2 dependent pairs of a series are replaced by m centred points, with the degrees of freedom told rightly.
The paper's criterion alone has its minimum at an arm shrunk to a point; the prior holds that and every other direction
that touching does not see. Where no prior is stated, its deviations and the noise are those that make the data most
probable (evidence: MacKay 1992, "Bayesian interpolation", Neural Computation 4, eq. 2.25-2.27).
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.stats import chi2

from calib import kernels
from calib.arm import Arm
from calib.kernels import ROW, THETA, D
from calib.parameters import Parameters
from sim.interfaces.spatial import Array

FIRST_NOISE = 1e-4  # [m] a good hand: where the estimate starts, and stays where too few touches are left to tell
LEAST_FREEDOM = 5.0  # degrees of freedom from which the noise is estimated
NOISE_FLOOR = 1e-6  # [m] no encoder sees less, and a noise of zero would leave the prior no say
_SETTLED = 1e-5  # a step shorter than this share of the posterior deviations ends the iteration
_PSEUDO = 2.0  # parameters' worth of belief in the default deviation when the data choose it
_ROUNDS = 12  # of the evidence
_CAUCHY = 2.4  # [deviations] where a touch counts half
_CAUCHY_ROUNDS = 3
_MEDIAN = 1.5382  # of the length of a vector of three unit normals
_REJECTIONS = 10
Load = Callable[[Array], Array]  # table (n, 5) -> load (M, n) on each joint [N m]


@dataclass(frozen=True, kw_only=True, eq=False)
class Data:
    """Touches of all series, stacked, and distances known between their points."""

    q: Array  # (M, n) [rad] or [m]
    starts: np.ndarray  # (S,) first row of each series
    distances: tuple[tuple[int, int, float, float], ...] = ()  # (series, series, length [m], deviation [m])
    load: Load | None = None
    weights: Array = field(default_factory=lambda: np.empty(0))  # (M,) of each touch, 0 leaves it out

    @property
    def series(self) -> np.ndarray:
        """(M,) the series of each touch."""
        return np.searchsorted(self.starts, np.arange(len(self.q)), side="right") - 1

    @property
    def degrees(self) -> float:
        """Degrees of freedom of the centred touches that count."""
        counted = np.add.reduceat((self.weights > 0.0).astype(np.float64), self.starts)
        return 3.0 * float(np.maximum(counted - 1.0, 0.0).sum())


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """A solution: full vector, its rows and what they say."""

    full: Array  # (5 n + 3 + n,) table, tool point, compliances
    residuals: Array  # (M, 3) [m] tips about their series' mean
    noise: float  # [m] deviation of a touch, each axis
    deviations: Array  # (P,) of the prior
    covariance: Array  # (P, P)
    effective: float  # number of parameters that the data determine (gamma)
    cost: float  # [m^2] eq. (7) over the touches that count
    history: tuple[float, ...]  # [m^2] eq. (7) before the first step and after each
    converged: bool


def tips_of(arm: Arm, full: Array, data: Data) -> tuple[Array, Array]:
    """Tips (M, 3) [m] and derivatives (M, 5 n + 3 + n, 3) by the full vector."""
    n, size = arm.n, ROW * arm.n
    table, tcp, compliance = full[:size].reshape(n, ROW), full[size : size + 3], full[size + 3 :]
    arm = arm.with_table(table)
    if data.load is None:
        p, J = arm.tips_and_jacobian(data.q, tcp)
        return p, J
    tau = data.load(table)
    p, J = arm.tips_and_jacobian(data.q + compliance * tau, tcp)
    moved = ROW * np.arange(n) + np.where(arm.slides, D, THETA)
    return p, np.concatenate([J, J[:, moved] * tau[:, :, None]], axis=1)


def linearised(arm: Arm, full: Array, data: Data, parameters: Parameters) -> tuple[Array, Array, Array, Array, Array]:
    """`kernels.centred_rows` of the touches at `full`: residuals, weighted ones, rows, means, their derivatives [m]."""
    p, J = tips_of(arm, full, data)
    return kernels.centred_rows(p, J, data.weights, data.starts, parameters.index)


def centred(values: Array, data: Data) -> Array:
    """`values` (M, 3) less their weighted mean in each series."""
    return values - means(values, data)[data.series]


def means(values: Array, data: Data) -> Array:
    """Weighted mean (S, 3) of each series."""
    total = np.maximum(np.add.reduceat(data.weights, data.starts), 1e-300)
    return np.add.reduceat(data.weights[:, None] * values, data.starts) / total[:, None]


def pair_cost(residuals: Array, data: Data) -> float:
    """J of eq. (7) [m^2]: squared distances over all pairs of each series, touches of weight 0 left out."""
    counts = (data.weights > 0.0).astype(np.float64)
    square = np.add.reduceat(counts * np.einsum("mi,mi->m", residuals, residuals), data.starts)
    return float(np.add.reduceat(counts, data.starts) @ square)


def _distances(data: Data, noise: float) -> list[tuple[int, int, float, float]]:
    """The known distances, each with the deviation that it has from the mean tips: a mean of m touches is itself off by
    noise / sqrt(m). Where distances share a point, that they share its error is left out."""
    share = noise**2 / np.maximum(np.add.reduceat(data.weights, data.starts), 1e-300)
    return [(i, j, length, float(np.sqrt(sd**2 + share[i] + share[j]))) for i, j, length, sd in data.distances]


def distance_rows(c: Array, C: Array, data: Data, noise: float) -> tuple[Array, Array]:
    """Known distances between points `c` (S, 3) [m] with derivatives `C` (S, P, 3): errors (D,), their derivatives
    (D, P), both in shares of the distances' deviations."""
    errors, rows = [], []
    for i, j, length, deviation in _distances(data, noise):
        gap = c[i] - c[j]
        found = float(np.linalg.norm(gap))
        errors.append((found - length) / deviation)
        rows.append((C[i] - C[j]) @ gap / max(found, 1e-12) / deviation)
    return np.array(errors), np.array(rows)


class Problem:
    """The fit of `parameters` of `arm` to `data`, about the full vector `mean`."""

    def __init__(self, arm: Arm, data: Data, parameters: Parameters, mean: Array) -> None:
        self.arm, self.data, self.parameters, self.mean = arm, data, parameters, mean
        self.index = parameters.index
        self._slides = arm.slides
        self._length = 1.0
        self._length = self.scale(mean)[0]  # [m]

    def scale(self, full: Array) -> tuple[float, Array]:
        """Size of the arm against that of `mean`, and its derivative (P,).

        The criterion rewards a smaller arm, for all its spreads shrink with it. Seen as a likelihood of joint values,
        the tip's density carries the volume of dp/dq, which shrinks as fast: residuals are therefore counted in shares
        of the arm, and touching stays silent about size.
        """
        table, tcp = self._split(full)[:2]
        length, gradient = kernels.arm_size(table, self.arm.X_n_flange, tcp)
        padded = np.concatenate([gradient, np.zeros(self.arm.n)])
        return length / self._length, padded[self.index] / self._length

    def _split(self, full: Array) -> tuple[Array, Array, Array]:
        size = ROW * self.arm.n
        return full[:size].reshape(-1, ROW), full[size : size + 3], full[size + 3 :]

    def equations(self, full: Array, noise: float) -> tuple[Array, Array, Array]:
        """Residuals (M, 3) [m]; J^T J (P, P) and J^T r (P,) of all scaled residuals, the prior's apart."""
        data = self.data
        residuals, r, rows, c, C = linearised(self.arm, full, data, self.parameters)
        size, gradient = self.scale(full)
        # Of r / (noise size): the rows gain -r (grad size / size)^T.
        toward, square, lean = rows.T @ r, float(r @ r), gradient / size
        over = 1.0 / (noise * size) ** 2
        crossed = np.outer(toward, lean)
        H = over * (rows.T @ rows - crossed - crossed.T + square * np.outer(lean, lean))
        g = over * (toward - square * lean)
        if data.distances:
            errors, rows = distance_rows(c, C, data, noise)
            H, g = H + rows.T @ rows, g + rows.T @ errors
        return residuals, H, g

    def value(self, full: Array, noise: float, deviations: Array) -> tuple[float, Array]:
        """Twice the negative log posterior, constants left out, and the residuals (M, 3) [m]."""
        data = self.data
        table, tcp, compliance = self._split(full)
        q = data.q if data.load is None else data.q + compliance * data.load(table)
        p = kernels.tips(table, self._slides, self.arm.X_base_0, self.arm.X_n_flange, tcp, q, kernels.NO_JACOBIAN)
        residuals = centred(p, data)
        total = float(data.weights @ np.einsum("mi,mi->m", residuals, residuals)) / (noise * self.scale(full)[0]) ** 2
        if data.distances:
            c = means(p, data)
            total += sum(((np.linalg.norm(c[i] - c[j]) - k) / sd) ** 2 for i, j, k, sd in _distances(data, noise))
        away = (full - self.mean)[self.index] / deviations
        return float(total + away @ away), residuals

    def descend(
        self, full: Array, noise: float, deviations: Array, iterations: int, history: list[float]
    ) -> tuple[Array, bool]:
        """Levenberg-Marquardt (eq. 17, mu raised on failure) in columns scaled by the prior; appends to `history`."""
        mu, (value, residuals) = 1e-6, self.value(full, noise, deviations)
        if not history:
            history.append(pair_cost(residuals, self.data))
        for _ in range(iterations):
            _, H, g = self.equations(full, noise)
            H = H * np.outer(deviations, deviations) + np.eye(len(g))
            gradient = g * deviations + (full - self.mean)[self.index] / deviations
            while True:
                step = -np.linalg.solve(H + mu * np.diag(np.diag(H)), gradient)
                trial = full.copy()
                trial[self.index] += step * deviations
                new, residuals = self.value(trial, noise, deviations)
                length = float(step @ H @ step)
                if new <= value:
                    full, mu = trial, max(mu / 10.0, 1e-9)
                    break
                # At the floor of rounding no step can fall any more.
                if length < _SETTLED**2 or mu > 1e8:
                    return full, True
                mu *= 10.0
            history.append(pair_cost(residuals, self.data))
            value = new
            if length < _SETTLED**2:
                return full, True
        return full, False

    def summary(self, full: Array, noise: float, deviations: Array, history: list[float], converged: bool) -> Fit:
        """The solution `full` with its covariance at the given noise and prior."""
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
    """Deviation of a touch from what is left, corrected for the parameters that the data determined [m]."""
    square = float(data.weights @ np.einsum("mi,mi->m", fit.residuals, fit.residuals))
    return max(np.sqrt(square / max(data.degrees - fit.effective, 1.0)), NOISE_FLOOR)


def _pooled(parameters: Parameters) -> list[np.ndarray]:
    """Places of the parameters that share a deviation chosen by the data; the tool point's is not chosen."""
    groups = np.array(parameters.groups)
    return [np.flatnonzero(groups == group) for group in dict.fromkeys(parameters.groups) if group != "tcp"]


def solve(
    problem: Problem,
    deviations: Array,
    *,
    noise: float | None,
    adapt: bool,
    start: Array | None = None,
    iterations: int = 100,
) -> Fit:
    """Fit with the prior's `deviations` (P,), or with those that make the data most probable (`adapt`).

    `noise` [m] is stated or, where None, estimated. `iterations` bounds the Levenberg-Marquardt steps altogether.
    """
    full = (problem.mean if start is None else start).copy()
    given = deviations
    history: list[float] = []
    sigma = noise if noise is not None else FIRST_NOISE
    full, converged = problem.descend(full, sigma, deviations, min(iterations, 3), history)
    fit = problem.summary(full, sigma, deviations, history, converged)
    if noise is not None and not adapt:
        full, converged = problem.descend(full, sigma, deviations, iterations - len(history) + 1, history)
        return problem.summary(full, sigma, deviations, history, converged)
    pools = _pooled(problem.parameters) if adapt else []
    # A fit that passes through everything would be believed to the last digit.
    estimate = noise is None and problem.data.degrees - fit.effective >= LEAST_FREEDOM
    for _ in range(_ROUNDS):
        before = np.append(deviations, sigma)
        if estimate:
            sigma = _noise_of(fit, problem.data)
        away = (fit.full - problem.mean)[problem.index]
        known = 1.0 - np.diag(fit.covariance) / fit.deviations**2
        deviations = deviations.copy()
        for pool in pools:
            square = float(away[pool] @ away[pool]) + _PSEUDO * float(given[pool] @ given[pool]) / len(pool)
            deviations[pool] = np.sqrt(square / (float(known[pool].sum()) + _PSEUDO))
        left = iterations - (len(history) - 1)
        full, converged = problem.descend(full, sigma, deviations, left, history) if left > 0 else (full, False)
        fit = problem.summary(full, sigma, deviations, history, converged)
        if left <= 0 or np.max(np.abs(np.append(deviations, sigma) / before - 1.0)) < 0.01:
            break
    return fit


def solve_robustly(problem: Problem, deviations: Array, *, level: float = 0.01, **options: Any) -> tuple[Fit, Data]:
    """`solve`, with touches that do not belong left out: the fit, and the data with weight 0 where so.

    A touch is left out where its distance from its series' point is less likely than `level` over the number of touches
    (Bonferroni): clean data lose one in a `level` of all fits. Once one is found, a Cauchy loss first pulls the fit off
    whatever else hides behind it.
    """
    fit = solve(problem, deviations, **options)
    counted = problem.data.weights > 0.0
    limit = float(chi2.isf(level / max(counted.sum(), 1), 3))
    strange = _strange(fit, problem.data, counted, limit, options["noise"])
    if not strange.any():
        return fit, problem.data
    every = problem.data
    for _ in range(_CAUCHY_ROUNDS):
        square = np.einsum("mi,mi->m", fit.residuals, fit.residuals) / _robust_noise(fit, every, counted) ** 2
        problem.data = replace(every, weights=np.where(counted, 1.0 / (1.0 + square / _CAUCHY**2), 0.0))
        fit = solve(problem, deviations, start=fit.full, **options)
    strange = _strange(fit, every, counted, limit, options["noise"])
    for _ in range(_REJECTIONS):
        problem.data = replace(every, weights=(counted & ~strange).astype(np.float64))
        fit = solve(problem, deviations, start=fit.full, **options)
        again = _strange(fit, problem.data, counted, limit, options["noise"])
        if np.array_equal(again, strange):
            break
        strange = again
    return fit, problem.data


def _robust_noise(fit: Fit, data: Data, counted: np.ndarray) -> float:
    """Deviation of a touch from the median distance, so that a few strange ones do not matter [m]."""
    kept = counted & (data.weights > 0.0)
    median = float(np.median(np.linalg.norm(fit.residuals[kept], axis=1)))
    lost = max(1.0 - (3.0 * len(data.starts) + fit.effective) / (3.0 * kept.sum()), 0.1)
    return max(median / (_MEDIAN * np.sqrt(lost)), NOISE_FLOOR)


def _strange(fit: Fit, data: Data, counted: np.ndarray, limit: float, noise: float | None) -> np.ndarray:
    """(M,) touches too far from their series' mean."""
    sigma = max(noise or 0.0, _robust_noise(fit, data, counted))
    return counted & (np.einsum("mi,mi->m", fit.residuals, fit.residuals) > limit * sigma**2)
