"""Simulated touches: an arm with parameter errors, an operator with noise, points touched in many orientations."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from calib import kernels
from calib.loads import Loads
from calib.parameters import GROUPS, select
from models.arms.serial_arm import SerialArm
from sim.interfaces.errors import ConfigurationError, ReachError
from sim.interfaces.spatial import Array, checked, rotation_from_z

HAND_NOISE = 0.092e-3  # [m] along each axis: J = 28.7 mm^2 of [Yukhimets 2023] over 3 x 21 touches
_TRIES = 400  # maximal starts and orientations tried for one touch
_STEPS = 60  # maximal iterations of the inverse kinematics


def wrong_arm(arm: SerialArm, deviations: Mapping[str, float], rng: np.random.Generator) -> SerialArm:
    """Arm with normally distributed errors in its table, standard deviations given per group.

    Args:
        arm: nominal arm.
        deviations: standard deviation by group (theta, d, a, alpha, beta) [rad, m].
        rng: source of randomness.

    Returns:
        The disturbed arm.

    Raises:
        ConfigurationError: other groups.
    """
    table = np.array(arm.table)
    for group in deviations:
        if group not in GROUPS[:5]:
            raise ConfigurationError(f"deviations: {group!r} is not of the table; allowed {', '.join(GROUPS[:5])}")
    for group in GROUPS[:5]:  # in fixed order, so that a seed gives one arm
        if group in deviations and not (group == "beta" and not arm.near_parallel):
            index = select(arm, group).index
            table.ravel()[index] += deviations[group] * rng.standard_normal(len(index))
    return arm.with_table(table)


def touch(
    arm: SerialArm,
    tcp: ArrayLike,
    rng: np.random.Generator,
    *,
    points: int | ArrayLike = 3,
    touches: int | Sequence[int] = 21,
    noise: float = HAND_NOISE,
    cone: float = np.deg2rad(60.0),
    approach: ArrayLike = (0.0, 0.0, -1.0),
    limits: ArrayLike | None = None,
    compliance: ArrayLike | None = None,
    loads: Loads | None = None,
) -> list[Array]:
    """Simulate touches: joint values (m_i, n) [rad] per point, with the true `arm`, as `identify` takes them.

    Every touch tilts the flange's z within `cone` of `approach` (uniform over the cap), with uniform spin. The tip
    meets its goal exactly.

    Args:
        arm: true arm.
        tcp: (3,) [m] tool point in the flange.
        rng: source of randomness.
        points: number of points, drawn in the arm's reach, or (P, 3) [m] in the base.
        touches: number per point.
        noise: [m] standard deviation of the operator's error along each axis.
        cone: [rad] half-angle of orientations.
        approach: (3,) mean direction of the flange's z, in the base.
        limits: (n, 2) joint limits; by default -pi to pi [rad] for hinges, 0 to 1 m for slides.
        compliance: (n,) [rad/(N m)] bends the joints under `loads`, evaluated at the true joint positions.
        loads: weights and buoyancy; by default those of `Loads()`.

    Returns:
        Joint values as the encoders read them, one array per point.

    Raises:
        ReachError: no pose within the limits reaches a point.
        ConfigurationError: wrong shapes or counts.
    """
    tool = checked(tcp, (3,), "tcp")
    bounds = _bounds(arm, limits)
    axis = checked(approach, (3,), "approach")
    given = np.asarray(points, dtype=np.float64)
    goals = _points(arm, tool, bounds, axis, cone, rng, int(given)) if given.ndim == 0 else given
    counts = [touches] * len(goals) if isinstance(touches, (int, np.integer)) else list(touches)
    if len(counts) != len(goals) or goals.ndim != 2 or goals.shape[1] != 3:
        raise ConfigurationError(f"points, touches: {len(counts)} counts for points of shape {goals.shape}")
    series = []
    for goal, count in zip(goals, counts, strict=True):
        poses = []
        for _ in range(count):
            hand = goal + noise * rng.standard_normal(3)
            q = _pose(arm, tool, hand, axis, cone, bounds, rng)
            if q is None:
                raise ReachError(f"no pose touches {np.round(goal, 3).tolist()} m within the joint limits")
            poses.append(q)
        series.append(np.array(poses))
    if compliance is None:
        return series
    c = checked(compliance, (arm.n,), "compliance")
    stands = np.ascontiguousarray(np.vstack(series))
    read = stands - c * (loads or Loads()).bind(arm, counts).at(stands)(arm.table)
    return np.split(read, np.cumsum(counts)[:-1])


def _bounds(arm: SerialArm, limits: ArrayLike | None) -> Array:
    if limits is not None:
        return checked(limits, (arm.n, 2), "limits")
    return np.where(arm.slides[:, None], [[0.0, 1.0]], [[-np.pi, np.pi]])


def _pose(arm: SerialArm, tool: Array, goal: Array, axis: Array, cone: float, bounds: Array, rng: np.random.Generator):
    """Joint values (n,) that put the tip at `goal` with the flange's z in the cone, or None."""
    six = arm.n >= 6
    for _ in range(_TRIES):
        q = rng.uniform(bounds[:, 0], bounds[:, 1])
        R = _orientation(axis, cone, rng)
        if not kernels.reach_pose(arm.table, arm.slides, arm.X_base_0, arm.X_n_flange, tool, goal, R, q, six, _STEPS):
            continue
        hinges = ~arm.slides
        q[hinges] = (q[hinges] + np.pi) % (2.0 * np.pi) - np.pi
        inside = np.all((q >= bounds[:, 0]) & (q <= bounds[:, 1]))
        # With fewer than six joints the position alone was solved, so the orientation is tested here.
        if inside and (six or arm.flange(q[None])[0, :3, 2] @ axis >= np.cos(cone) * np.linalg.norm(axis)):
            return q
    return None


def _orientation(axis: Array, cone: float, rng: np.random.Generator) -> Array:
    """Random rotation whose z is within `cone` [rad] of `axis`, uniform over the cap, with uniform spin."""
    cosine = rng.uniform(np.cos(cone), 1.0)
    around, spin = rng.uniform(0.0, 2.0 * np.pi, 2)
    sine = np.sqrt(max(1.0 - cosine**2, 0.0))
    middle = rotation_from_z(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    z = middle @ [sine * np.cos(around), sine * np.sin(around), cosine]
    R = rotation_from_z(z, middle @ [np.cos(spin), np.sin(spin), 0.01])
    c, s = np.cos(spin), np.sin(spin)
    return R @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _points(
    arm: SerialArm, tool: Array, bounds: Array, axis: Array, cone: float, rng: np.random.Generator, wanted: int
) -> Array:
    """Random points that the arm reaches in varied orientations, well apart."""
    length = arm.reach + float(np.linalg.norm(tool))
    found: list[Array] = []
    for _ in range(_TRIES):
        goal = arm.X_base_0[:3, 3] + length * rng.uniform([-0.6, -0.6, 0.0], [0.6, 0.6, 0.4])
        near = any(np.linalg.norm(goal - other) < 0.15 * length for other in found)
        tries = [_pose_quickly(arm, tool, goal, axis, cone, bounds, rng) for _ in range(8)]
        if not near and sum(tries) >= 2:
            found.append(goal)
        if len(found) == wanted:
            return np.array(found)
    raise ReachError(f"no {wanted} points found that the arm can touch in varied orientations")


def _pose_quickly(
    arm: SerialArm, tool: Array, goal: Array, axis: Array, cone: float, bounds: Array, rng: np.random.Generator
) -> bool:
    q = rng.uniform(bounds[:, 0], bounds[:, 1])
    R = _orientation(axis, cone, rng)
    return bool(
        kernels.reach_pose(arm.table, arm.slides, arm.X_base_0, arm.X_n_flange, tool, goal, R, q, arm.n >= 6, _STEPS)
    )
