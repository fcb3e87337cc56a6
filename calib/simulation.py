"""Simulated touches: an arm with parameter errors, touched points, an operator with noise."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from uuv.calib import kernels
from uuv.calib.loads import Loads
from uuv.calib.parameters import GROUPS, select
from uuv.models.arms.kinematics import ROW, THETA, D
from uuv.models.arms.serial_arm import SerialArm
from uuv.sim.interfaces.errors import ConfigurationError, ReachError
from uuv.sim.interfaces.spatial import Array, checked, rotation_from_z

HAND_NOISE = 0.092e-3  # [m] along each axis: J = 28.7 mm^2 of [Yukhimets 2023] over 3 x 21 touches
_TRIES = 400  # maximal number of starts and orientations tried for one touch
_STEPS = 60  # maximal iterations of the inverse kinematics
_SEATED = 1e-10  # [m] distance from its seat at which a tip rests
# [rad] difference of encoder readings that ends the search for true joint values
_READ_ALIKE = 1e-12


def wrong_arm(
    arm: SerialArm, deviations: Mapping[str, float], rng: np.random.Generator
) -> SerialArm:
    """Arm with normally distributed errors in its table, whose standard deviations are stated per
    group.

    Args:
        arm: nominal arm.
        deviations: standard deviation by group (theta, d, a, alpha, beta) [rad, m].
        rng: source of randomness.

    Returns:
        The disturbed arm.

    Raises:
        ConfigurationError: a group is unknown.
    """
    table = np.array(arm.table)
    for group in deviations:
        if group not in GROUPS[:5]:
            raise ConfigurationError(
                f"deviations: {group!r} is no group of the table; must be one of "
                f"{', '.join(GROUPS[:5])}"
            )

    for group in GROUPS[:5]:  # in fixed order, so that a seed gives one arm
        if group in deviations and not (group == "beta" and not arm.near_parallel):
            index = select(arm, group).index
            table.ravel()[index] += deviations[group] * rng.standard_normal(len(index))

    return arm.with_table(table)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Postures:
    """Postures of an operator: every touch tilts the flange's z within `cone` of `approach`.

    Tilts are uniform over the cap, spins over a turn.
    """

    cone: float = np.deg2rad(60.0)  # [rad] half-angle
    approach: ArrayLike = (0.0, 0.0, -1.0)  # (3,) mean direction of the flange's z, in the base
    # (n, 2) of the joints; by default -pi to pi [rad] for hinges, 0 to 1 m for slides
    limits: ArrayLike | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sag:
    """Joints that deflect under weights and buoyancy, evaluated at the true joint positions."""

    compliance: ArrayLike  # (n,) [rad/(N m)]
    loads: Loads


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EccentricGears:
    """Eccentric gears: the encoder of a joint at q reads q - amplitude sin(q + phase)."""

    amplitude: Array  # (n,) [rad]
    phase: Array  # (n,) [rad]

    @classmethod
    def draw(cls, spread: float, n: int, rng: np.random.Generator) -> "EccentricGears":
        """Gears of `n` joints with normal amplitudes of standard deviation `spread` [rad]."""
        return cls(amplitude=spread * rng.standard_normal(n), phase=rng.uniform(-np.pi, np.pi, n))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Seating:
    """Errors of a ball in its sockets: the centre of the ball has an offset of `maps[s] z` from the
    middle of socket s.

    z is the flange's z axis in the base. Because of friction and form errors a ball rests on one
    flank of its socket, and does so again whenever it comes from the same direction, so the error
    is not noise.
    """

    maps: Array  # (S, 3, 3) [m]

    @classmethod
    def draw(cls, spread: float, points: int, rng: np.random.Generator) -> "Seating":
        """Seating in so many sockets; `spread` [m] is the standard deviation along each axis."""
        return cls(maps=spread * rng.standard_normal((points, 3, 3)))

    def seat(self, arm: SerialArm, tcp: ArrayLike, series: Sequence[Array]) -> list[Array]:
        """Move the joints, by the least motion, so that the tips rest at their positions in the
        sockets.

        Args:
            arm: true arm.
            tcp: (3,) [m] true tool point in the flange.
            series: true joint values (m_i, n) of touches without seating errors, one array per
                socket.

        Raises:
            ReachError: the arm does not reach the displaced position.
            ConfigurationError: the numbers of series and of sockets differ.
        """
        maps = checked(self.maps, (len(series), 3, 3), "seating")
        tip = checked(tcp, (3,), "tcp")
        moved = ROW * np.arange(arm.n) + np.where(arm.slides, D, THETA)
        out = []

        for offset, touches in zip(maps, series, strict=True):
            q = np.array(touches)
            goal = arm.tips(q, tip) + arm.flange(q)[:, :3, 2] @ offset.T

            # Gauss-Newton steps of least norm to the seat.
            for _ in range(_STEPS):
                p, J = arm.tips_and_jacobian(q, tip)
                q += np.einsum(
                    "mni,mi->mn",
                    np.linalg.pinv(J[:, moved].transpose(0, 2, 1), rcond=1e-3),
                    goal - p,
                )
                if np.abs(goal - p).max() < _SEATED:
                    break
            else:
                raise ReachError(
                    "the arm does not reach the displaced positions of the tip in the sockets"
                )

            out.append(q)
        return out


def read_by_encoders(
    arm: SerialArm,
    series: Sequence[Array],
    *,
    sag: Sag | None = None,
    gears: EccentricGears | None = None,
) -> list[Array]:
    """Encoder readings, arrays (m_i, n) [rad], for the true joint values `series` of `arm`.

    Args:
        arm: true arm.
        series: true joint values.
        sag: elastic joints; None: stiff ones.
        gears: eccentric gears; None: ideal ones.
    """
    counts = [len(q) for q in series]
    stands = np.ascontiguousarray(np.vstack(series))
    read = stands

    if sag is not None:
        c = checked(sag.compliance, (arm.n,), "compliance")
        read = read - c * sag.loads.bind(arm, counts).at(stands)(arm.table)
    if gears is not None:
        amplitude, phase = (checked(v, (arm.n,), "gears") for v in (gears.amplitude, gears.phase))
        read = read - amplitude * np.sin(stands + phase)

    return np.split(read, np.cumsum(counts)[:-1])


def true_joints(
    arm: SerialArm, read: Array, *, sag: Sag | None = None, gears: EccentricGears | None = None
) -> Array:
    """True joint values (M, n) [rad] at readings `read` (M, n): inverse of `read_by_encoders`.

    Args:
        arm: true arm.
        read: joint values as read.
        sag: elastic joints; None: stiff ones.
        gears: eccentric gears; None: ideal ones.

    Raises:
        ConfigurationError: deflections or gear errors are so large that no true values were found.
    """
    stands = np.array(read)

    for _ in range(_STEPS):
        error = read - read_by_encoders(arm, [stands], sag=sag, gears=gears)[0]
        stands += error
        if np.abs(error).max() < _READ_ALIKE:
            return stands

    raise ConfigurationError(
        "sag, gears: must be smaller; no true joint values were found for these readings"
    )


def touch(
    arm: SerialArm,
    tcp: ArrayLike,
    rng: np.random.Generator,
    *,
    points: int | ArrayLike = 3,
    touches: int | Sequence[int] = 21,
    noise: float = HAND_NOISE,
    postures: Postures | None = None,
    sag: Sag | None = None,
) -> list[Array]:
    """Simulate touches of the true `arm`: joint values (m_i, n) [rad] per point, for `identify`.

    The tip meets its goal exactly.

    Args:
        arm: true arm.
        tcp: (3,) [m] tool point in the flange.
        rng: source of randomness.
        points: number of points, which are drawn within the arm's reach, or points (P, 3) [m] in
            the base.
        touches: number of touches per point.
        noise: [m] standard deviation of the operator's error along each axis.
        postures: directions and joint limits; by default those of `Postures()`.
        sag: elastic joints; None: stiff ones.

    Returns:
        Joint values as the encoders read them, one array per point.

    Raises:
        ReachError: no pose within the limits reaches a point.
        ConfigurationError: a shape or count is wrong.
    """
    hand = _Hand(arm, checked(tcp, (3,), "tcp"), postures or Postures())
    requested = np.asarray(points, dtype=np.float64)
    goals = hand.points(int(requested), rng) if requested.ndim == 0 else requested

    counts = [touches] * len(goals) if isinstance(touches, (int, np.integer)) else list(touches)
    if len(counts) != len(goals) or goals.ndim != 2 or goals.shape[1] != 3:
        raise ConfigurationError(
            f"points, touches: must have one count for each point (P, 3), got {len(counts)} counts "
            f"for points of shape {goals.shape}"
        )

    series = []
    for goal, count in zip(goals, counts, strict=True):
        poses = []
        for _ in range(count):
            q = hand.touching(goal + noise * rng.standard_normal(3), rng)
            if q is None:
                raise ReachError(
                    f"no pose touches {np.round(goal, 3).tolist()} m within the joint limits"
                )
            poses.append(q)
        series.append(np.array(poses))

    return series if sag is None else read_by_encoders(arm, series, sag=sag)


def reach(arm: SerialArm, tcp: Array, p: Array, R: Array, q: Array, steps: int = _STEPS) -> bool:
    """Move `q` in place until the tool point is at `p`, and, with six or more joints, the flange
    has orientation `R`.

    Args:
        arm: kinematics.
        tcp: (3,) [m] tool point in the flange.
        p: (3,) [m] goal in the base.
        R: (3, 3) orientation of the flange in the base.
        q: (n,) start, overwritten by the solution.
        steps: largest number of iterations.

    Returns:
        True if the goal was reached.
    """
    rows = (arm.table, arm.slides, arm.X_base_0, arm.X_n_flange)
    return bool(kernels.reach_pose(*rows, tcp, p, R, q, arm.n >= 6, steps))


class _Hand:
    """An operator who guides an arm to points, in given postures."""

    def __init__(self, arm: SerialArm, tcp: Array, postures: Postures) -> None:
        self.arm = arm
        self.tcp = tcp
        self.cone = postures.cone
        self.axis = checked(postures.approach, (3,), "approach")
        limits = postures.limits
        self.bounds = (
            np.where(arm.slides[:, None], [[0.0, 1.0]], [[-np.pi, np.pi]])
            if limits is None
            else checked(limits, (arm.n, 2), "limits")
        )

    def touching(self, p: Array, rng: np.random.Generator) -> Array | None:
        """Joint values (n,) that put the tip at `p` with the flange's z in the cone, or None."""
        lower, upper = self.bounds.T
        for _ in range(_TRIES):
            q, reached = self._try(p, rng)
            if not reached:
                continue

            hinges = ~self.arm.slides
            q[hinges] = (q[hinges] + np.pi) % (2.0 * np.pi) - np.pi
            # With fewer than six joints only the position was solved for, so the orientation is
            # tested here.
            if np.all((q >= lower) & (q <= upper)) and (self.arm.n >= 6 or self._in_cone(q)):
                return q
        return None

    def points(self, count: int, rng: np.random.Generator) -> Array:
        """Random points, well apart, that the arm reaches in varied orientations."""
        length = self.arm.reach + float(np.linalg.norm(self.tcp))
        points: list[Array] = []
        for _ in range(_TRIES):
            goal = self.arm.X_base_0[:3, 3] + length * rng.uniform(
                [-0.6, -0.6, 0.0], [0.6, 0.6, 0.4]
            )

            near = any(np.linalg.norm(goal - other) < 0.15 * length for other in points)
            tries = [self._try(goal, rng)[1] for _ in range(8)]
            if not near and sum(tries) >= 2:
                points.append(goal)
            if len(points) == count:
                return np.array(points)
        raise ReachError(
            f"could not find {count} points that the arm can touch in varied orientations"
        )

    def _try(self, p: Array, rng: np.random.Generator) -> tuple[Array, bool]:
        q = rng.uniform(self.bounds[:, 0], self.bounds[:, 1])
        return q, reach(self.arm, self.tcp, p, _orientation(self.axis, self.cone, rng), q)

    def _in_cone(self, q: Array) -> bool:
        return bool(
            self.arm.flange(q[None])[0, :3, 2] @ self.axis
            >= np.cos(self.cone) * np.linalg.norm(self.axis)
        )


def _orientation(axis: Array, cone: float, rng: np.random.Generator) -> Array:
    """Random rotation with z within `cone` [rad] of `axis`, uniform over the cap, uniform spin."""
    cosine = rng.uniform(np.cos(cone), 1.0)
    around, spin = rng.uniform(0.0, 2.0 * np.pi, 2)
    sine = np.sqrt(max(1.0 - cosine**2, 0.0))

    middle = rotation_from_z(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
    z = middle @ [sine * np.cos(around), sine * np.sin(around), cosine]
    R = rotation_from_z(z, middle @ [np.cos(spin), np.sin(spin), 0.01])
    c, s = np.cos(spin), np.sin(spin)
    return R @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
