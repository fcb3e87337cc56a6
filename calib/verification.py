"""Verification of a calibration, by a tracker and by touches predicted from other positions.

Against a tracker [Yukhimets 2023], clouds of flange points are centred, aligned and compared. The
flange keeps its orientation, so that the position of the reflector on the flange does not matter.
The residuals measure the accuracy of relative moves; alignment removes the poses of base and
tracker.

The posterior covariance only accounts for touch noise. A real arm has errors that its parameters
cannot express (gears, sag, seating of the probe). Such errors are similar in neighbouring postures,
so the residuals of the fit understate them. The touches at each position are therefore predicted
from those at the other positions, and the spread of these prediction errors widens the intervals.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from uuv.calib.simulation import reach
from uuv.models.arms.serial_arm import SerialArm
from uuv.sim.interfaces.errors import ConfigurationError, ReachError
from uuv.sim.interfaces.spatial import Array, checked, exp_so3, readonly, transform_points

TRACKER_NOISE = 0.015e-3  # [m] noise of a FARO Vantage [Yukhimets 2023]
Alignment = Literal["kabsch", "icp"]
# share of the arm's reach: points closer to each other count as one position and are predicted
# together
_ONE_PLACE = 0.1
_POINTS = 13  # number of flange points, as in [Yukhimets 2023]
_PLACES = 300  # maximal number of positions of the box that are tried
_TRIES = 6  # number of goals drawn per required point
_STEPS = 60  # maximal iterations of the inverse kinematics
_ICP_STEPS = 100  # maximal iterations of one ICP run


@dataclass(frozen=True, kw_only=True, eq=False)
class Cloud:
    """Flange points of one model, by stage of the comparison [Yukhimets 2023, fig. 5-8]."""

    raw: Array  # (N, 3) [m] in the arm's base; the tracker's points in the tracker's frame
    centred: Array  # (N, 3) [m] minus their mean
    aligned: Array  # (N, 3) [m] turned onto the tracker's centred points
    deviations: Array  # (N,) [m] distance from the tracker's points
    rms: float  # [m] RMS of these distances


def flange_poses(
    controller: SerialArm,
    rng: np.random.Generator,
    count: int = _POINTS,
    *,
    box: float = 0.25,
    limits: ArrayLike | None = None,
) -> Array:
    """Joint values (count, n) of random flange points in a box, at constant orientation and branch.

    The box extends by `box` times the arm's reach to each side of a random position in front of or
    beside the arm. The flange looks down, and the arm keeps its branch, as it does in straight
    moves.

    Args:
        controller: arm as its controller models it.
        rng: source of randomness.
        count: number of points.
        box: half side of the box, as a share of the arm's reach.
        limits: (n, 2) joint limits [rad], slides [m]; by default -pi to pi.

    Returns:
        Joint values [rad], slides [m].

    Raises:
        ReachError: too few points were found.
    """
    bounds = np.full((controller.n, 2), [-np.pi, np.pi])
    bounds = bounds if limits is None else checked(limits, (controller.n, 2), "limits")
    R_down = np.diag([1.0, -1.0, -1.0])
    start = controller.X_base_0[:3, 3]
    best = 0

    # A random middle and posture, around which all points are searched for.
    for _ in range(_PLACES):
        turn, out, up = rng.uniform([-np.pi, 0.35, 0.05], [np.pi, 0.5, 0.3])
        middle = start + controller.reach * np.array([out * np.cos(turn), out * np.sin(turn), up])
        home = rng.uniform(bounds[:, 0], bounds[:, 1])
        if not _reach(controller, middle, R_down, home, bounds):
            continue

        poses: list[Array] = []
        for _ in range(_TRIES * count):
            goal = middle + box * controller.reach * rng.uniform(-1.0, 1.0, 3)
            q = home.copy()
            if _reach(controller, goal, R_down, q, bounds) and np.abs(q - home).max() < 0.5 * np.pi:
                poses.append(q)
            if len(poses) == count:
                return np.array(poses)

        best = max(best, len(poses))

    raise ReachError(f"only {best} of {count} flange points found in one orientation and branch")


def _reach(arm: SerialArm, goal: Array, R: Array, q: Array, bounds: Array) -> bool:
    """Move `q` in place to the flange pose; True if reached within the bounds."""
    reached = reach(arm, np.zeros(3), goal, R, q, _STEPS)
    q[:] = np.where(arm.slides, q, (q + np.pi) % (2.0 * np.pi) - np.pi)
    return bool(reached and np.all((q >= bounds[:, 0]) & (q <= bounds[:, 1])))


def track(
    truth: SerialArm,
    q: ArrayLike,
    rng: np.random.Generator,
    *,
    noise: float = TRACKER_NOISE,
    reflector: ArrayLike = (0, 0, 0),
) -> Array:
    """Simulated tracker points (N, 3) [m] of a reflector on the flange, in the tracker's frame.

    Args:
        truth: true arm.
        q: (N, n) joint values.
        rng: source of randomness.
        noise: [m] standard deviation along each axis.
        reflector: (3,) [m] in the flange.

    Returns:
        Points in a randomly placed tracker frame.
    """
    points = truth.tips(q, checked(reflector, (3,), "reflector"))
    R_TB = exp_so3(rng.uniform(-1.0, 1.0, 3) * np.array([0.2, 0.2, np.pi]))
    return points @ R_TB.T + rng.uniform(-3.0, 3.0, 3) + noise * rng.standard_normal(points.shape)


def kabsch(source: Array, target: Array) -> Array:
    """Rigid transform (4, 4) that best aligns `source` (N, 3) to its `target` [Kabsch 1976]."""
    a, b = source.mean(axis=0), target.mean(axis=0)
    U, _, Vt = np.linalg.svd((source - a).T @ (target - b))
    turn = np.diag([1.0, 1.0, np.sign(np.linalg.det(Vt.T @ U.T))])

    X = np.eye(4)
    X[:3, :3] = Vt.T @ turn @ U.T
    X[:3, 3] = b - X[:3, :3] @ a
    return X


def icp(source: Array, target: Array) -> Array:
    """Rigid transform (4, 4) as by `kabsch`, but without known correspondences, by iterative
    closest points.

    Starts from four alignments of the principal axes and keeps the best, since clouds that are only
    centred may differ by any rotation.
    """
    tree = cKDTree(target)
    best = np.eye(4)
    best_rms = np.inf
    for start in _starts(source, target):
        X = start
        before = None
        for _ in range(_ICP_STEPS):
            pairs = tree.query(transform_points(X, source))[1]
            if before is not None and np.array_equal(pairs, before):
                break
            X = kabsch(source, target[pairs])
            before = pairs

        rms = float(np.sqrt(np.mean(tree.query(transform_points(X, source))[0] ** 2)))
        # A match is not valid if two points are paired with one target.
        if before is not None and len(np.unique(before)) == len(source) and rms < best_rms:
            best = X
            best_rms = rms

    return best


def _starts(source: Array, target: Array) -> list[Array]:
    """Poses that align the principal axes of two clouds, in all four ways."""
    a, b = source.mean(axis=0), target.mean(axis=0)
    axes = [np.linalg.svd(cloud - mean)[2].T for cloud, mean in ((source, a), (target, b))]

    starts = []
    for x in (1.0, -1.0):
        for y in (1.0, -1.0):
            R = axes[1] @ np.diag([x, y, 1.0]) @ axes[0].T
            if np.linalg.det(R) < 0.0:
                R = axes[1] @ np.diag([x, y, -1.0]) @ axes[0].T
            X = np.eye(4)
            X[:3, :3], X[:3, 3] = R, b - R @ a
            starts.append(X)

    return starts


def compare(
    tracker: ArrayLike, clouds: dict[str, Array], alignment: Alignment = "kabsch"
) -> dict[str, Cloud]:
    """Compare each of `clouds` with the tracker's points: centred, aligned, residuals.

    Args:
        tracker: (N, 3) [m] measured points.
        clouds: (N, 3) [m] points per model, by name.
        alignment: "kabsch" pairs points by index; "icp" finds the pairs.

    Returns:
        The compared clouds by name, and that of the tracker as "tracker".

    Raises:
        ConfigurationError: the clouds differ in size, there are fewer than 3 points, or the
            alignment is unknown.
    """
    if alignment not in get_args(Alignment):
        raise ConfigurationError(
            f"alignment: must be one of {', '.join(get_args(Alignment))}, got {alignment!r}"
        )

    measured = np.asarray(tracker, dtype=np.float64)
    measured = checked(measured, (len(measured), 3), "tracker")
    if len(measured) < 3:
        raise ConfigurationError(f"tracker: must have at least 3 points, got {len(measured)}")

    # The tracker's own points.
    target = measured - measured.mean(axis=0)
    zero = np.zeros(len(measured))
    out = {
        "tracker": Cloud(
            raw=measured,
            centred=readonly(target),
            aligned=readonly(target),
            deviations=zero,
            rms=0.0,
        )
    }

    for name, points in clouds.items():
        raw = checked(points, measured.shape, name)
        centred = raw - raw.mean(axis=0)
        aligned = transform_points(
            (kabsch if alignment == "kabsch" else icp)(centred, target), centred
        )

        gaps = (
            np.linalg.norm(aligned - target, axis=1)
            if alignment == "kabsch"
            else cKDTree(target).query(aligned)[0]
        )

        out[name] = Cloud(
            raw=raw,
            centred=readonly(centred),
            aligned=readonly(aligned),
            deviations=readonly(gaps),
            rms=float(np.sqrt(np.mean(gaps**2))),
        )

    return out


def pair_distances(tips: list[Array]) -> Array:
    """Distances [m] between the tips (m_i, 3) of all pairs of each series, in order of series.

    These are the values of [Yukhimets 2023, fig. 4].
    """
    out = []
    for p in tips:
        j, s = np.triu_indices(len(p), 1)
        out.append(np.linalg.norm(p[j] - p[s], axis=1))
    return np.concatenate(out)


def places(points: ArrayLike, reach: float) -> np.ndarray:
    """Index (S,) of the position of each point; points within a tenth of `reach` [m], also in
    chains, share a position.
    """
    p = np.asarray(points, dtype=np.float64)
    near = np.linalg.norm(p[:, None] - p[None], axis=2) < _ONE_PLACE * reach
    labels = np.arange(len(p))

    # The least index spreads along the chains.
    for _ in range(len(p)):
        labels = np.where(near, labels[None], len(p)).min(axis=1)

    return labels


@dataclass(frozen=True, kw_only=True, eq=False)
class PointTouches:
    """Touches of one point under the identified arm, minus their weighted mean."""

    rows: Array  # (m, P, 3) derivatives of the tips by the free parameters
    residuals: Array  # (m, 3) [m]
    weights: Array  # (m,) weights in the fit, above 0


def scores(series: Sequence[PointTouches], label: np.ndarray, prior: Array, noise: float) -> Array:
    """Sorted errors of touches that are predicted without those at their own position, over their
    predicted deviations.

    The parameters without a position's touches are computed by one Gauss-Newton step that removes
    these touches. Known distances are not used, since they only determine the scale, which does not
    affect the spread of touches.

    Args:
        series: touches in use.
        label: (S,) position of each series. If all series share one position, each series counts as
            a separate one.
        prior: (P,) standard deviations of the prior.
        noise: [m] standard deviation of a touch along each axis.

    Returns:
        Absolute scores (3 M,); their 95 % quantile is 1.96 if the model is right.
    """
    # With a single position each point is predicted from the others.
    if len(set(label.tolist())) == 1:
        label = np.arange(len(series))

    rows = [
        touched.rows.transpose(0, 2, 1).reshape(-1, len(prior)) * prior / noise
        for touched in series
    ]
    weights = [np.repeat(touched.weights, 3) for touched in series]
    each_tells = np.array([(J * w[:, None]).T @ J for J, w in zip(rows, weights, strict=True)])
    total = np.eye(len(prior)) + each_tells.sum(axis=0)
    out = []

    for k in sorted(set(label.tolist())):
        mine = np.flatnonzero(label == k).tolist()
        without = np.linalg.inv(total - each_tells[mine].sum(axis=0))
        J = np.concatenate([rows[s] for s in mine])
        w = np.concatenate([weights[s] for s in mine])
        r = np.concatenate([series[s].residuals.ravel() for s in mine]) / noise

        # Ratio of the variance of a touch about the mean of its series to that of a touch.
        lost = np.repeat(
            [1.0 - 1.0 / len(series[s].weights) for s in mine], [len(weights[s]) for s in mine]
        )

        error = r + J @ (without @ (J.T @ (w * r)))
        out.append(np.abs(error) / np.sqrt(np.einsum("mp,pr,mr->m", J, without, J) + lost))

    return readonly(np.sort(np.concatenate(out)))
