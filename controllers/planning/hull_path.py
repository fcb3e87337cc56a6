"""Clearance of hull and arm from an object, and hull paths with folded arm that keep this
clearance.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull

from uuv.controllers.mkps import Chain
from uuv.controllers.planning.arm_size import size
from uuv.controllers.planning.trajectories import PoseMove
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array, exp_so3, inverse, pose, transform_points

# [m] from hull, joints and tip to the object; includes the tool's size, marine growth and tracking
# lag
CLEARANCE = 0.2
ROUNDING = 1e-9  # [m] far larger than the rounding error of a distance
_CHECKED = 40  # number of poses along a move at which its clearance is computed
_SKIN_STEP = 0.15  # [m] largest distance of points on the edges of the object's convex hull
# [m] detours away from the object, tried in this order if a straight path is too close
_BACK = (0.4, 0.8, 1.2)
_ARC = float(np.radians(30.0))  # largest angle between two poses of a path around the object
_GROUP = 32  # number of points on the skin in a group, which one ball encloses


class Skin(NamedTuple):
    """Points on the convex hull of an object, in groups of neighbours."""

    points: Array  # (k, 3) [m], W; those of a group follow each other
    starts: np.ndarray  # (g + 1,) index of the first point of each group, and k
    middles: Array  # (g, 3) [m] middle of the ball that encloses a group, W
    radii: Array  # (g,) [m] its radius


class HullPath:
    """Clearance and paths of a vehicle with folded arm near the convex hull of an object."""

    def __init__(self, vehicle: Vehicle, chain: Chain, hull_box: Array, obstacle: Array) -> None:
        """Set the vehicle and the object.

        Args:
            vehicle: the vehicle, its arm in the home pose.
            chain: kinematics of its arm.
            hull_box: (2, 3) [m] corners of the hull's box in B.
            obstacle: (k, 3) [m] points of the object in W.
        """
        q = np.array(vehicle.q_home)
        arm_A = np.vstack([joint_centres(chain, q), chain.kinematics(q)[0][:3, 3]])
        self._arm_B = transform_points(np.array(vehicle.X_BA), arm_A)
        self._hull_box = hull_box

        shell = ConvexHull(obstacle)
        self._clearance = size(chain) * CLEARANCE
        self._skin = skin_of(obstacle, shell)
        self._planes = shell.equations
        self._middle = obstacle.mean(axis=0)

    @property
    def clearance(self) -> float:
        """Clearance [m] that paths keep where they can."""
        return self._clearance

    def gap(self, X_WB: Array) -> float:
        """Distance [m] of hull box, arm joints and tip to the object; negative inside."""
        return min(hull_gap(X_WB, self._hull_box, self._skin.points), self._arm_gap(X_WB))

    def keeps(self, X_WB: Array, clearance: float) -> bool:
        """True if `gap` is at least `clearance` [m]; faster than computing the gap."""
        arm = joint_gap_kernel(self._arm_B, inverse(X_WB), self._planes, np.zeros(3))
        if abs(arm - clearance) <= ROUNDING:  # the kernel cannot decide
            arm = self._arm_gap(X_WB)
        if arm < clearance:
            return False
        return hull_keeps(X_WB, self._hull_box, self._skin, clearance)

    def _arm_gap(self, X_WB: Array) -> float:
        """Distance [m] of arm joints and tip to the object's convex hull; negative inside."""
        arm_W = transform_points(X_WB, self._arm_B)
        return convex_gap(arm_W, self._planes)

    def lowest(self, X_WB: Array) -> float:
        """Height [m] in W of the lowest of arm joints, tip and underside of a level hull."""
        arm_W = transform_points(X_WB, self._arm_B)
        return min(float(arm_W[:, 2].min()), float(X_WB[2, 3] + self._hull_box[0, 2]))

    def least_gap(self, poses: Sequence[Array], enough: float = -np.inf) -> float:
        """Least distance [m] to the object on straight moves through `poses` (4, 4).

        The result may be too large where it is at most `enough` [m].
        """
        least = np.inf
        for X_WB in _checked(poses):
            if (least := min(least, self.gap(X_WB))) <= enough:
                break
        return least

    def way(self, X_from: Array, X_to: Array) -> list[Array]:
        """Poses (4, 4) of a path from `X_from` (4, 4), excluded, to `X_to` (4, 4), included.

        The path is straight if it keeps CLEARANCE, scaled to the arm's size, or as much clearance
        as its ends have. Otherwise it is the first detour that does, the shortest detours first,
        those around the object last. If no detour does, it is the path with the largest clearance.
        """
        clearance = min(self._clearance, self.gap(X_from), self.gap(X_to)) - 1e-9
        ways = list(self._ways(X_from, X_to))
        for way in ways:
            if all(self.keeps(X_WB, clearance) for X_WB in _checked([X_from, *way])):
                return way

        widest = ways[0]
        most = -np.inf
        for way in ways:
            if (gap := self.least_gap([X_from, *way], most)) > most:
                widest = way
                most = gap
        return widest

    def _ways(self, X_from: Array, X_to: Array) -> Iterator[list[Array]]:
        yield [X_to]
        R_from = X_from[:3, :3]
        R_to = X_to[:3, :3]
        # rotation first, then a straight move, since the arm is on the other side
        yield [pose(R_to, X_from[:3, 3]), X_to]
        for back in _BACK:
            yield [pose(R_from, self._off(X_from, back)), pose(R_to, self._off(X_to, back)), X_to]
        # the other side is reached around the object only
        for back in (0.0, *_BACK):
            yield from self._arcs(X_from, X_to, back)

    def _arcs(self, X_from: Array, X_to: Array, back: float) -> Iterator[list[Array]]:
        """Paths around the object's middle both ways, the shorter first.

        Args:
            X_from: (4, 4) hull pose at the start.
            X_to: (4, 4) hull pose at the end.
            back: [m] by which they are farther from the middle than the farther end.
        """
        start, end = (X[:2, 3] - self._middle[:2] for X in (X_from, X_to))
        radius = max(float(np.linalg.norm(start)), float(np.linalg.norm(end))) + back
        bearing = float(np.arctan2(start[1], start[0]))
        turn = _wrapped(float(np.arctan2(end[1], end[0])) - bearing)

        R = X_to[:3, :3] @ X_from[:3, :3].T
        yaw = float(np.arctan2(R[1, 0], R[0, 0]))
        for angle in (turn, turn - np.copysign(2.0 * np.pi, turn)):
            # the heading turns with the bearing
            heading = angle + _wrapped(yaw - angle)
            stops = []
            for share in np.linspace(0.0, 1.0, 1 + max(1, int(np.ceil(abs(angle) / _ARC)))):
                at = bearing + share * angle
                out = [radius * np.cos(at), radius * np.sin(at)]
                z = X_from[2, 3] + share * (X_to[2, 3] - X_from[2, 3])
                turned = exp_so3([0.0, 0.0, share * heading]) @ X_from[:3, :3]
                stops.append(pose(turned, [*(self._middle[:2] + out), z]))
            yield [*stops[:-1], pose(X_to[:3, :3], stops[-1][:3, 3]), X_to]

    def _off(self, X_WB: Array, back: float) -> Array:
        """Position (3,) [m] of a pose moved horizontally by `back` [m] off the object's middle."""
        away = (X_WB[:3, 3] - self._middle) * [1.0, 1.0, 0.0]
        return X_WB[:3, 3] + back * away / max(float(np.linalg.norm(away)), 1e-9)


def _checked(poses: Sequence[Array]) -> Iterator[Array]:
    """Poses (4, 4) on straight moves through `poses` (4, 4), _CHECKED of each move."""
    for start, end in pairwise(poses):
        move = PoseMove(0.0, 1.0, start, end)
        for share in np.linspace(0.0, 1.0, _CHECKED):
            yield move.at(share)[0]


def _wrapped(angle: float) -> float:
    """The angle [rad] from -pi to pi."""
    return float((angle + np.pi) % (2.0 * np.pi) - np.pi)


def skin_of(obstacle: Array, hull: ConvexHull) -> Skin:
    """Points on the edges of the convex hull, no further apart than _SKIN_STEP."""
    edges = np.unique(np.sort(hull.simplices[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
    start = obstacle[edges[:, 0]]
    end = obstacle[edges[:, 1]]
    count = np.ceil(np.linalg.norm(end - start, axis=1) / _SKIN_STEP).astype(int)

    points = [obstacle[hull.vertices]]
    for n in np.unique(count[count > 1]):
        share = np.arange(1, n)[:, None, None] / n
        rows = count == n
        points.append((start[rows] + share * (end[rows] - start[rows])).reshape(-1, 3))
    return grouped(np.vstack(points))


def grouped(points: Array) -> Skin:
    """`points` (k, 3) [m] in groups of neighbours, by halves along their longest extent."""
    groups = []
    halves = [points]
    while halves:
        part = halves.pop()
        if len(part) <= _GROUP:
            groups.append(part)
            continue
        order = np.argsort(part[:, np.ptp(part, axis=0).argmax()], kind="stable")
        halves += [part[order[: len(part) // 2]], part[order[len(part) // 2 :]]]

    middles = np.array([0.5 * (group.min(axis=0) + group.max(axis=0)) for group in groups])
    radii = [
        float(np.linalg.norm(group - middle, axis=1).max())
        for group, middle in zip(groups, middles, strict=True)
    ]
    starts = np.cumsum([0, *(len(group) for group in groups)])
    return Skin(np.vstack(groups), starts, middles, np.array(radii))


def hull_gap(X_WB: Array, hull_box: Array, obstacle: Array) -> float:
    """Distance [m] from the hull's box to the nearest point of the object; negative inside.

    Args:
        X_WB: (4, 4) hull pose.
        hull_box: (2, 3) [m] corners of the hull's box in B.
        obstacle: (k, 3) [m] points of the object in W.

    Returns:
        The distance [m].
    """
    p_B = (obstacle - X_WB[:3, 3]) @ X_WB[:3, :3]

    # Coordinate by coordinate, because NumPy reduces rows of three several times slower.
    x, y, z = np.maximum(hull_box[0] - p_B, p_B - hull_box[1]).T
    inside = float(np.maximum(np.maximum(x, y), z).min())
    if inside < 0.0:
        return inside
    x = np.maximum(x, 0.0)
    y = np.maximum(y, 0.0)
    z = np.maximum(z, 0.0)
    return float(np.sqrt((x**2 + y**2 + z**2).min()))


@kernel
def _outside_box(p_W: Array, X_WB: Array, hull_box: Array, away: Array) -> float:
    """Distance [m] of a point `p_W` (3,) [m], displaced by -`away`, from a box; negative inside."""
    deepest = -np.inf
    square = 0.0
    for k in range(3):
        p_B = 0.0
        for m in range(3):
            p_B += (p_W[m] - away[m] - X_WB[m, 3]) * X_WB[m, k]
        outside = max(hull_box[0, k] - p_B, p_B - hull_box[1, k])
        deepest = max(deepest, outside)
        square += max(outside, 0.0) ** 2
    return deepest if deepest < 0.0 else np.sqrt(square)


@kernel
def hull_gap_kernel(X_WB, hull_box, skin, away, enough, most):
    """As `hull_gap` for a skin displaced by -`away` (3,) [m], up to rounding.

    Args:
        X_WB: (4, 4) hull pose.
        hull_box: (2, 3) [m] corners of the hull's box in B.
        skin: fields of `Skin`, in a tuple.
        away: (3,) [m]
        enough: [m] distance below which the result may be too large.
        most: [m] distance above which the result is `most`.
    """
    skin = Skin(*skin)
    nearest = most

    # A group is left out if its ball lies farther away than the nearest point so far
    for group in range(len(skin.radii)):
        of_ball = _outside_box(skin.middles[group], X_WB, hull_box, away) - skin.radii[group]
        if of_ball > nearest:
            continue
        for i in range(skin.starts[group], skin.starts[group + 1]):
            nearest = min(nearest, _outside_box(skin.points[i], X_WB, hull_box, away))
        if nearest < enough:
            break
    return nearest


def hull_keeps(
    X_WB: Array, hull_box: Array, skin: Skin, clearance: float, away: Array | None = None
) -> bool:
    """True if the hull's box keeps `clearance` [m] from the object, which is displaced by -`away`
    (3,) [m].
    """
    away = np.zeros(3) if away is None else away
    bounds = clearance - ROUNDING, clearance + 2.0 * ROUNDING
    gap = hull_gap_kernel(X_WB, hull_box, tuple(skin), away, *bounds)
    if abs(gap - clearance) <= ROUNDING:  # the kernel cannot decide
        gap = hull_gap(X_WB, hull_box, skin.points - away)
    return gap >= clearance


def arm_gap(chain: Chain, q: Array, X_AW: Array, planes: Array, gone: Array) -> float:
    """Distance [m] from the arm's joint centres to the object's convex hull; inf without joints.

    Negative inside. The first two joints, which hardly move, and the last two, which move to the
    contact with the tool, are left out.
    """
    moved = joint_centres(chain, q)[2 : chain.n - 2]
    if not len(moved):
        return np.inf
    p_W = (moved - X_AW[:3, 3]) @ X_AW[:3, :3] + gone
    return convex_gap(p_W, planes)


def convex_gap(points: Array, planes: Array) -> float:
    """Least signed distance [m] of `points` (k, 3) [m] from a convex hull of `planes` (m, 4)."""
    outside = planes[:, :3] @ points.T + planes[:, 3:]
    # Along contiguous rows, because NumPy reduces a few columns several times slower.
    return float(np.ascontiguousarray(outside.T).max(axis=1).min())


def joint_centres(chain: Chain, q: Array) -> Array:
    """Positions (n, 3) [m] of the joints in the arm's base at joint coordinates `q` (n,)."""
    centres = np.empty((chain.n, 3))  # each joint is moved by the joints before it
    X = np.eye(4)
    for i, (kind, motion, point) in enumerate(
        zip(chain.joint_types, chain.motions, chain.points, strict=True)
    ):
        centres[i] = X[:3, :3] @ point + X[:3, 3]
        if kind == "p":
            X = X @ pose(p=motion * q[i])
        else:
            R = exp_so3(motion * q[i])
            X = X @ pose(R, point - R @ point)
    return centres


@kernel
def joint_gap_kernel(joints_A: Array, X_AW: Array, planes: Array, gone: Array) -> float:
    """As `arm_gap`, for given joint centres (k, 3) [m]."""
    nearest = np.inf
    for x, y, z in joints_A:
        x = x - X_AW[0, 3]
        y = y - X_AW[1, 3]
        z = z - X_AW[2, 3]
        u = X_AW[0, 0] * x + X_AW[1, 0] * y + X_AW[2, 0] * z + gone[0]
        v = X_AW[0, 1] * x + X_AW[1, 1] * y + X_AW[2, 1] * z + gone[1]
        w = X_AW[0, 2] * x + X_AW[1, 2] * y + X_AW[2, 2] * z + gone[2]

        outside = -np.inf
        for a, b, c, offset in planes:
            outside = max(outside, a * u + b * v + c * w + offset)
        nearest = min(nearest, outside)
    return nearest


@kernel
def joint_centres_kernel(slides: np.ndarray, axes: Array, points: Array, q: Array) -> Array:
    """As `joint_centres`, up to rounding; `slides` (n,) is True for slides."""
    centres = np.empty((len(q), 3))
    # each joint is moved by those before it
    R = np.eye(3)
    turned = np.empty((3, 3))
    p = np.zeros(3)

    for i in range(len(q)):
        for a in range(3):
            centres[i, a] = (
                R[a, 0] * points[i, 0] + R[a, 1] * points[i, 1] + R[a, 2] * points[i, 2] + p[a]
            )

        if slides[i]:
            for a in range(3):
                p[a] += (R[a, 0] * axes[i, 0] + R[a, 1] * axes[i, 1] + R[a, 2] * axes[i, 2]) * q[i]
            continue

        s, c = np.sin(q[i]), np.cos(q[i])
        # Rodrigues' formula on the rows of R: r + sin (r x k) + (1 - cos) ((r . k) k - r)
        for a in range(3):
            x, y, z = R[a]
            u, v, w = axes[i]
            along = (1.0 - c) * (x * u + y * v + z * w)
            turned[a, 0] = c * x + s * (y * w - z * v) + along * u
            turned[a, 1] = c * y + s * (z * u - x * w) + along * v
            turned[a, 2] = c * z + s * (x * v - y * u) + along * w
            p[a] = centres[i, a] - (
                turned[a, 0] * points[i, 0]
                + turned[a, 1] * points[i, 1]
                + turned[a, 2] * points[i, 2]
            )
        R[:] = turned
    return centres
