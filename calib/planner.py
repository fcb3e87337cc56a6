"""Optimal choice of touches by information: greedy selection from candidates, then exchanges.

A touch of point i at pose q measures J dTheta - dc_i. The three coordinates of each point are
unknown too, and are estimated together with the parameters. Criterion D maximises the determinant
of the information of all parameters under the prior [Fedorov 1972], for arms [Borm 1991]. Criterion
V minimises the mean variance of relative flange positions between given poses.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from uuv.calib.identification import Calibration
from uuv.calib.parameters import DEFAULT_FREE, prior_deviations, select
from uuv.calib.simulation import HAND_NOISE
from uuv.calib.touches import checked_series
from uuv.models.arms.kinematics import ROW
from uuv.models.arms.serial_arm import SerialArm
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, checked

_ANYWHERE = 1.0  # [m] prior standard deviation of a point, each axis
_SWEEPS = 3  # maximal sweeps of exchanges over all chosen touches


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """Touches to make, with the expected accuracy."""

    chosen: tuple[tuple[int, int], ...]  # (series, row) of the chosen touches among the candidates
    series: tuple[Array, ...]  # (m_i, n) the same per point; empty for an unused point
    # after each choice: log determinant of the information (D), or expected RMS [m] (V)
    merit: tuple[float, ...]
    before: float  # the same figure for the prior and the touches already made
    deviations: Array  # (P,) expected posterior standard deviation of each parameter
    names: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Design:
    """Candidate touches as rows of information, and the prior knowledge; made by `design`."""

    poses: list[Array]  # (K_i, n) per point
    pairs: list[tuple[int, int]]  # (series, row) of each candidate
    # (K, 3, P + 3 S) derivatives of each candidate over the noise, in units of the priors
    rows: Array
    # (P + 3 S, P + 3 S) covariance from the prior and the touches already made, in units of the
    # prior
    C: Array
    W: Array | None  # weight of `_aim` for criterion V; None for D
    deviations: Array  # (P,) prior standard deviations
    names: tuple[str, ...]


def plan(design: Design, count: int) -> Plan:
    """Choose `count` candidates for the largest information or the least variance at the targets.

    Raises:
        ConfigurationError: there are fewer candidates than `count`.
    """
    _check_count(design, count)
    rows = design.rows
    C = design.C
    W = design.W
    before = _merit(C, W)

    # Greedy selection.
    chosen = []
    merit = []
    free_to_take = np.ones(len(rows), dtype=bool)
    for _ in range(count):
        # criterion D in both cases, since the first touch of a point gains nothing in V
        best = _best(rows, C, None, free_to_take)
        C = _updated(C, rows[best], 1.0)
        free_to_take[best] = False
        chosen.append(best)
        merit.append(_merit(C, W))

    # Exchanges: every touch is compared with the best candidate for its place, until none gains.
    for _ in range(_SWEEPS):
        swapped = False
        for slot in range(count):
            reached = _merit(C, W)
            current = chosen[slot]
            without = _updated(C, rows[current], -1.0)
            free_to_take[current] = True
            best = _best(rows, without, W, free_to_take)
            trial = _updated(without, rows[best], 1.0)
            better = _merit(trial, W) - reached

            if best != current and (better > 1e-9 if W is None else better < -1e-12):
                C, chosen[slot], swapped = trial, best, True
            free_to_take[chosen[slot]] = False
        if not swapped:
            break

    pairs = tuple(design.pairs[k] for k in chosen)
    return Plan(
        chosen=pairs,
        series=tuple(
            q[sorted(row for i, row in pairs if i == s)] for s, q in enumerate(design.poses)
        ),
        merit=(*merit[:-1], _merit(C, W)),
        before=before,
        deviations=np.sqrt(np.diag(C)[: len(design.deviations)]) * design.deviations,
        names=design.names,
    )


def random_merits(design: Design, count: int, rng: np.random.Generator, trials: int) -> Array:
    """Merits (trials,) of random choices of `count` candidates, to compare a plan with.

    Args:
        design: candidates.
        count: number of touches of each choice.
        rng: draws the choices.
        trials: number of choices.

    Returns:
        Log determinant of the information (D), or expected RMS [m] (V), of each choice.

    Raises:
        ConfigurationError: there are fewer candidates than `count`.
    """
    _check_count(design, count)
    out = []

    for _ in range(trials):
        C = design.C
        for k in rng.choice(len(design.rows), count, replace=False):
            C = _updated(C, design.rows[k], 1.0)
        out.append(_merit(C, design.W))

    return np.array(out)


def _check_count(design: Design, count: int) -> None:
    total = len(design.rows)
    if not 0 < count <= total:
        raise ConfigurationError(
            f"count: must be between 1 and {total}, the number of candidates, got {count}"
        )


def design(
    arm: Calibration | SerialArm | ArrayLike,
    candidates: Sequence[ArrayLike],
    *,
    tcp: ArrayLike | None = None,
    done: Sequence[ArrayLike] | None = None,
    targets: ArrayLike | None = None,
    free: Iterable[str] | str = DEFAULT_FREE,
    prior: Mapping[str, float] | None = None,
    noise: float | None = None,
) -> Design:
    """Candidate touches to choose from, linearised.

    Args:
        arm: a calibration so far (its tool point and noise are used), a `SerialArm`, or a DH table.
        candidates: (K_i, n) joint values [rad] per point.
        tcp: (3,) [m] tool point in the flange; by default the calibration's, else the flange.
        done: touches already made, of the same points in the same order.
        targets: (N, n) poses for whose relative flange positions criterion V is computed; without
            targets the criterion is D.
        free: parameters to be identified, as in `identify`.
        prior: standard deviations by group or name, as in `identify`.
        noise: [m] standard deviation of a touch; by default the calibration's, else `HAND_NOISE`.

    Returns:
        The candidates, for `plan` and `random_merits`.

    Raises:
        ConfigurationError: candidates, targets or touches are not joint values of the arm, or a
            parameter is unknown.
    """
    if isinstance(arm, Calibration):
        model = arm.arm
        tool = arm.tcp
        hand = arm.noise
    else:
        model = arm if isinstance(arm, SerialArm) else SerialArm.from_dh(arm, name="arm")
        tool = np.zeros(3)
        hand = HAND_NOISE

    tool = tool if tcp is None else checked(tcp, (3,), "tcp")
    sigma = hand if noise is None else noise

    poses = checked_series(candidates, model)
    parameters = select(model, free)
    deviations = prior_deviations(parameters, prior)
    rows = _rows(model, tool, poses, parameters.index, deviations, sigma)
    size = rows.shape[2]

    # Touches already made.
    C = np.eye(size)
    for i, q in enumerate(checked_series(done, model) if done is not None else []):
        for row in _rows(model, tool, [q], parameters.index, deviations, sigma, len(poses), i):
            C = _updated(C, row, 1.0)

    return Design(
        poses=poses,
        pairs=[(s, row) for s, q in enumerate(poses) for row in range(len(q))],
        rows=rows,
        C=C,
        W=_aim(model, targets, parameters.index, deviations, size) if targets is not None else None,
        deviations=deviations,
        names=parameters.names,
    )


def _rows(
    arm: SerialArm,
    tcp: Array,
    poses: list[Array],
    index: np.ndarray,
    deviations: Array,
    noise: float,
    points: int | None = None,
    first: int = 0,
) -> Array:
    """Derivatives (K, 3, P + 3 S) of each touch by parameters and points.

    They are divided by the noise, in units of the priors.
    """
    points = len(poses) if points is None else points
    blocks = []

    for s, q in enumerate(poses):
        J = arm.tips_and_jacobian(np.ascontiguousarray(q), np.ascontiguousarray(tcp))[1]
        J = np.concatenate([J, np.zeros((len(q), arm.n, 3))], axis=1)[:, index, :]
        block = np.zeros((len(q), 3, len(index) + 3 * points))
        block[:, :, : len(index)] = J.transpose(0, 2, 1) * deviations

        # Tip minus point, whose prior is wide.
        start = len(index) + 3 * (s + first)
        block[:, :, start : start + 3] = -_ANYWHERE * np.eye(3)
        blocks.append(block / noise)

    return np.concatenate(blocks)


def _aim(
    arm: SerialArm, targets: ArrayLike, index: np.ndarray, deviations: Array, size: int
) -> Array:
    """Weight W (P + 3 S, P + 3 S) [m^2]: trace(W C) is the mean square error of aligned flanges."""
    q = checked_series([targets], arm)[0]
    p, J = arm.tips_and_jacobian(q, np.zeros(3))
    J[:, ROW * arm.n :, :] = 0.0  # the flange does not depend on the tool point
    J = np.concatenate([J, np.zeros((len(q), arm.n, 3))], axis=1)[:, index, :]
    J = (J - J.mean(axis=0)).transpose(0, 2, 1).reshape(3 * len(q), -1) * deviations

    # Alignment removes rotations, and touching does not observe scale: both are projected out.
    about = p - p.mean(axis=0)
    gauges = np.column_stack(
        [*(np.cross(axis, about).ravel() for axis in np.eye(3)), about.ravel()]
    )
    Q = np.linalg.qr(gauges)[0]
    J -= Q @ (Q.T @ J)

    W = np.zeros((size, size))
    W[: len(index), : len(index)] = J.T @ J / len(q)
    return W


def _best(rows: Array, C: Array, W: Array | None, allowed: np.ndarray) -> int:
    """Index of the allowed candidate with the largest gain."""
    carried = rows @ C  # (K, 3, N)
    S = np.eye(3) + carried @ rows.transpose(0, 2, 1)

    # By the matrix determinant lemma (D), or by Woodbury's identity (V).
    if W is None:
        gain = np.linalg.slogdet(S)[1]
    else:
        gain = np.trace(
            np.linalg.solve(S, carried @ W @ carried.transpose(0, 2, 1)), axis1=1, axis2=2
        )

    return int(np.argmax(np.where(allowed, gain, -np.inf)))


def _updated(C: Array, row: Array, sign: float) -> Array:
    """Covariance after adding the touch `row` (3, N), or after removing it if `sign` is -1."""
    carried = row @ C
    new = C - sign * carried.T @ np.linalg.solve(np.eye(3) + sign * carried @ row.T, carried)
    return 0.5 * (new + new.T)


def _merit(C: Array, W: Array | None) -> float:
    """Log determinant of the information (`W` None), or the expected RMS [m]."""
    return -float(np.linalg.slogdet(C)[1]) if W is None else float(np.sqrt(np.sum(W * C)))
