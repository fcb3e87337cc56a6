"""Hull placement: the level hull pose from which the arm reaches the whole tool path, and the arm's first posture.

Candidate positions of the arm's base around the path are tried, each with the hull level. If the base's axis points
down (or up), the hull is turned so that the arm reaches forward, or at right angles to that. If the axis is horizontal,
it faces the surface. Along the path the inverse kinematics (MKPS [Danilov 2021]) keeps to one branch.

The best candidate maximises the smallest margin. Margins: joint limits, singular postures, torque limits under the set
force, distance to the object, and thrust under that force and its friction. The thrust margin decides the heading. A
force applied a metre below a hull tilts it, and its thrusters have shorter levers against roll.

Where this margin is small the hull may travel while the tool works [Konoplin 2019, section 6]. It moves straight, by a
share of the way between the ends of the path, at the pace of the tool. The arm then meets every point in nearly the
posture of the middle, drives stay away from their limits, and the path may be longer than the arm. `PathStanding`
chooses this share, and how much of a path is worked.
"""

import itertools
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import Enum, auto
from typing import NamedTuple, cast

import numba
import numpy as np
from scipy.spatial import ConvexHull

from controllers.hull.thrust_margin import ThrustMargin
from controllers.mkps import Chain, IkOptions, solve
from controllers.planning.hull_path import (
    arm_gap,
    hull_gap,
    hull_gap_kernel,
    joint_centres_kernel,
    joint_gap_kernel,
    skin_of,
)
from models.objects.targets import TargetModel
from models.vehicle import Vehicle
from sim.interfaces.errors import ReachError, StrongCurrentError
from sim.interfaces.messages import Target, ToolPath
from sim.interfaces.spatial import Array, exp_so3, inverse, pose, readonly, transform_points

_TRAVELS = (0.0, 0.5, 1.0, 1.4)  # travels of the hull that are tried, as shares of the line between the path's ends
_SHORTER = 0.04  # share of a path by which it is shortened per try, where it is too long
_STILL = readonly(np.zeros(3))
_FEW_STEPS = IkOptions(max_iterations=60)
_STANDOFF_STEPS = 3  # number of poses tried between the stand-off and the surface
_ROUNDING = 1e-9  # [m] far above the rounding of a distance
_BETTER = 1e-4  # share by which a margin must be larger to count: a round tool turned by half has the same one
_LARGEST_STEP = 0.8  # [rad] of a joint between two poses of a path
_AT_LIMIT = 0.02  # [rad] from its limit a joint counts as at it, in a message
_ROOMY_THRUST = 0.4  # [-] unused share of thrust, left for the current, that gives a margin of 1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Placement:
    """Hull pose from which the whole path can be worked, with the arm's posture at its start."""

    X_WB: Array  # (4, 4) at the path's start
    travel_W: Array  # (3,) [m] displacement of the hull by the end of the path
    roll: float  # [rad] rotation of the tool about its own axis from the path's x
    q_start: Array  # (n,) [rad] at the stand-off before the path's first point
    margin: float  # [-] smallest margin along the path: 1 is roomy, 0 is at a limit
    reached: float  # [-] share of the path within reach
    held: bool = True  # the thrusters bear push and friction along the whole path, or are not considered

    def hull_at(self, share: float) -> Array:
        """Hull pose (4, 4) when the tool has done `share` [-] of the path."""
        X_WB = self.X_WB.copy()
        X_WB[:3, 3] += share * self.travel_W
        return X_WB


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacementSearch:
    """Search grid and clearances of the placement; heights and radii in lengths of the stretched arm."""

    heights: tuple[float, ...] = (0.4, 0.5, 0.6, 0.7)  # of the base off the middle, against its own axis
    radii: tuple[float, ...] = (0.13, 0.26, 0.4, 0.53)  # of the base off the middle, across that axis
    bearings: int = 12  # number of directions around the middle
    asides: int = 6  # number of directions across the axis of a base with a horizontal axis
    turns: tuple[float, ...] = (0.0, -0.5 * np.pi, 0.5 * np.pi)  # [rad] hull yaw, from forward reach
    headings: tuple[float, ...] = (-0.6, 0.0, 0.6)  # [rad] hull yaw from facing the surface, horizontal axis
    refinements: tuple[float, ...] = (0.06, 0.02)  # [m] steps of the final local search
    rolls: int = 4  # number of rotations of the tool about its axis
    clearance: float = 0.25  # [m] least distance of the hull to the object
    arm_clearance: float = 0.06  # [m] distance of joint centres to the object that gives a margin of 1
    samples: int = 15  # number of poses tried along the path


def tool_pose(path: ToolPath, s: float, roll: float) -> tuple[Array, Array, Array]:
    """Tool pose at arc length `s` of a path, and its derivative with respect to `s`.

    Args:
        path: tool path in W.
        s: [m] arc length.
        roll: [rad] rotation of the tool about its own axis from the path's x.

    Returns:
        The pose X_WG (4, 4), the derivative of its origin (3,) [-], and that of its axes (3,) [rad/m], W.
    """
    X, tangent, turn = np.eye(4), np.empty(3), np.empty(3)
    _tool_pose(_Samples(path.s, path.p, path.z, path.x), s, roll, X, tangent, turn)
    return X, tangent, turn


def middle_part(path: ToolPath, share: float) -> ToolPath:
    """Middle `share` [-] of a path, its arc length counted anew from 0."""
    if share >= 1.0:
        return path
    cut = 0.5 * (1.0 - share) * float(path.s[-1])
    keep = (path.s >= cut) & (path.s <= float(path.s[-1]) - cut)
    return part_of(path, keep)


def part_of(path: ToolPath, keep: np.ndarray) -> ToolPath:
    """The samples of a path where `keep` (N,) is True, from the first to the last one on which the tool can press.

    The arc length is counted anew from 0.
    """
    if path.fits is not None and (keep & path.fits).any():
        first, last = np.flatnonzero(keep & path.fits)[[0, -1]]
        keep = keep & (np.arange(len(keep)) >= first) & (np.arange(len(keep)) <= last)
    fits = None if path.fits is None else path.fits[keep]
    s, p, z, x = path.s[keep], path.p[keep], path.z[keep], path.x[keep]
    return replace(path, s=s - s[0], p=p, z=z, x=x, on_scan=path.on_scan[keep], fits=fits)


def stretches(path: ToolPath) -> tuple[tuple[float, float], ...]:
    """Begin and end [m] of each stretch of a path on which the tool can press, in order."""
    if path.fits is None:
        return ((0.0, float(path.s[-1])),)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], path.fits, [False]]).astype(np.int8)))
    return tuple((float(path.s[first]), float(path.s[last - 1])) for first, last in edges.reshape(-1, 2))


_SCALE = np.array([1.0, 1.0, 1.0, 0.4, 0.4, 0.4])[:, None]  # [m/rad] weights rotation against translation
_SINGULAR = 0.12  # smallest singular value of the weighted Jacobian that gives a margin of 1
_MOST_TURN = 0.3  # [rad] of the tool between two samples of its path
_HALF_STEP = 2e-3  # [m] half step of the central differences along the path


class _Samples(NamedTuple):
    """A tool path as the kernels take it; as in `ToolPath`."""

    s: Array  # (k,) [m]
    p: Array  # (k, 3) [m]
    z: Array  # (k, 3)
    x: Array  # (k, 3)


@numba.njit(cache=True)
def _tool_pose(path, s, roll, X, tangent, turn):
    low, high = max(0.0, s - _HALF_STEP), min(path.s[-1], s + _HALF_STEP)
    R_low, p_low = _frame(path, low, roll)
    R_high, p_high = _frame(path, high, roll)
    X[:3, :3], X[:3, 3] = _frame(path, s, roll)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        total = 0.0
        for m in range(3):  # vee of the antisymmetric part of R_high R_low^T
            total += R_high[k, m] * R_low[j, m] - R_high[j, m] * R_low[k, m]
        turn[i] = 0.5 * total / (high - low)
        tangent[i] = (p_high[i] - p_low[i]) / (high - low)


@numba.njit(cache=True)
def _frame(path, s, roll):
    """Axes (3, 3) and position (3,) of the tool at `s`, interpolated between the path's samples."""
    i = min(max(np.searchsorted(path.s, s) - 1, 0), path.s.shape[0] - 2)
    share = (s - path.s[i]) / (path.s[i + 1] - path.s[i])
    p = (1.0 - share) * path.p[i] + share * path.p[i + 1]
    z = (1.0 - share) * path.z[i] + share * path.z[i + 1]
    z /= np.sqrt((z * z).sum())
    x = (1.0 - share) * path.x[i] + share * path.x[i + 1]
    x -= (x * z).sum() * z
    x /= np.sqrt((x * x).sum())
    y = np.array([z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]])
    c, sn = np.cos(roll), np.sin(roll)
    R = np.empty((3, 3))
    R[:, 0], R[:, 1], R[:, 2] = c * x + sn * y, c * y - sn * x, z
    return R, p


@numba.njit(cache=True)
def _step_and_room(before, q, low, high):
    """Largest change of a joint from `before` to `q`, and the smallest distance of `q` to the limits; (n,) each."""
    jump, room = 0.0, np.inf
    for j in range(q.shape[0]):
        jump = max(jump, abs(q[j] - before[j]))
        room = min(room, min(q[j] - low[j], high[j] - q[j]))
    return jump, room


@numba.njit(cache=True)
def _are_above(margin, J, push, torque_limits):
    """True if the margins of torque and of singular postures are above `margin` by more than rounding.

    Args:
        margin: [-]
        J: (6, n) Jacobian of the tip.
        push: (3,) [N] force on it, same axes.
        torque_limits: (n,) [N m]
    """
    n = J.shape[1]
    for j in range(n):
        load = abs(J[0, j] * push[0] + J[1, j] * push[1] + J[2, j] * push[2]) / torque_limits[j]
        if 3.0 * (1.0 - load) < margin + 1e-9:
            return False
    # The smallest singular value is above t where the Gram matrix less t^2 has a Cholesky factorisation.
    k, t = min(6, n), _SINGULAR * margin * (1.0 + 1e-6)
    L, trace = np.empty((k, k)), 0.0
    for a in range(k):
        for b in range(a + 1):
            total = -t * t if a == b else 0.0
            for m in range(max(6, n)):
                if n < 6:
                    total += J[m, a] * J[m, b] * _SCALE[m, 0] * _SCALE[m, 0]
                else:
                    total += J[a, m] * J[b, m] * _SCALE[a, 0] * _SCALE[b, 0]
            if a == b:
                trace += total
            for m in range(b):
                total -= L[a, m] * L[b, m]
            if a == b:
                if not total > 1e-12 * abs(trace):
                    return False
                L[a, a] = np.sqrt(total)
            else:
                L[a, b] = total / L[b, b]
    return True


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Surroundings:
    """The hull's box, and what it keeps clear of."""

    obstacle: Array  # (k, 3) [m] points of the object in W; hull and arm keep clear of its convex hull
    hull_box: Array  # (2, 3) [m] corners of the hull's box in B
    floor: float = -np.inf  # [m] height in W of the seabed, above which the hull keeps its clearance


def place_hull(
    vehicle: Vehicle,
    chain: Chain,
    path: ToolPath,
    *,
    around: Surroundings,
    force: float,
    standoff: float,
    travel: float = 0.0,
    search: PlacementSearch | None = None,
    holding: ThrustMargin | None = None,
) -> Placement:
    """Hull pose with the largest margin for `path`.

    Args:
        vehicle: the vehicle.
        chain: kinematics of its arm, from base to tip.
        path: tool path in W.
        around: what the hull and arm keep clear of.
        force: [N] largest set force.
        standoff: [m] from which the tool approaches.
        travel: [-] share of the way between the path's ends that the hull travels while the tool works.
        search: grid and clearances; None takes the defaults.
        holding: thrust margin of the vehicle; None leaves thrust out.

    Returns:
        The placement, its pose at the start of the path.

    Raises:
        ReachError: no candidate reaches all of the path; the message gives the largest share reached.
    """
    search = search or PlacementSearch()
    shares = samples_along(path, search.samples)
    middle = 0.5 * (path.p.min(axis=0) + path.p.max(axis=0))
    hull = ConvexHull(around.obstacle)
    skin = skin_of(around.obstacle, hull)
    rolls = [2.0 * np.pi / search.rolls * i for i in range(1 if path.keeps_x else search.rolls)]
    travel_W = travel * (path.p[-1] - path.p[0])
    # The poses relative to the travelling hull: its displacement since mid-path is subtracted.
    even = np.linspace(0.0, float(path.s[-1]), search.samples)
    done = np.interp(shares, even, np.linspace(-0.5, 0.5, search.samples))
    done = np.pad(done, _STANDOFF_STEPS, mode="edge")
    gone = done[:, None] * travel_W
    drag = holding.drag if holding else 0.0
    tracks = [
        ToolTrack(
            poses=_seen(tool_poses(path, shares, roll, standoff), gone),
            gone=gone,
            loads=_loads(path, shares, roll, force, drag),
        )
        for roll in rolls
    ]
    arm = ArmMargins(
        vehicle=vehicle,
        chain=chain,
        planes=hull.equations,
        force=force,
        clearance=search.arm_clearance,
        holding=holding,
    )
    mounting = _Mounting.of(vehicle.X_BA)
    ways = (-0.5, 0.0, 0.5) if travel else (0.0,)
    best: Placement | None = None
    best_yaw, furthest = 0.0, cast("Dropped | None", None)

    def too_close(X_WB: Array, away_W: Array) -> bool:
        """True if the hull, displaced by `away_W` (3,) [m], is nearer to the object than its clearance."""
        gap = hull_gap_kernel(X_WB, around.hull_box, skin, away_W, search.clearance - _ROUNDING)
        if abs(gap - search.clearance) <= _ROUNDING:  # the kernel cannot tell
            gap = hull_gap(X_WB, around.hull_box, skin - away_W)
        return gap < search.clearance

    def consider(base: Array, yaw: float) -> bool:
        """Try all tool rolls from this position of the arm's base (3,) [m] with this hull yaw [rad]; True if better."""
        nonlocal best, best_yaw, furthest
        R_WB = exp_so3([0.0, 0.0, yaw])
        X_WB = pose(R_WB, base - R_WB @ vehicle.X_BA[:3, 3])
        if X_WB[2, 3] - 0.5 * abs(travel_W[2]) + around.hull_box[0, 2] < around.floor + search.clearance:
            return False
        if any(too_close(X_WB, way * travel_W) for way in ways):
            return False
        better = False
        for roll, track in zip(rolls, tracks, strict=True):
            to_beat = (1.0 + _BETTER) * best.margin if best else 0.0
            found = arm.along(track, X_WB, to_beat)
            if isinstance(found, Dropped):
                if best is None and (furthest is None or found.reached > furthest.reached):
                    furthest = found
            elif found.margin > to_beat:
                best = Placement(
                    X_WB=X_WB, travel_W=travel_W, roll=roll, q_start=found.q_start, margin=found.margin, reached=1.0
                )
                best_yaw, better = yaw, True
        return better

    for base, yaw in mounting.candidates(path, middle, reach(chain), search):
        consider(base, yaw)
    for step in search.refinements:
        while best is not None:
            base = best.X_WB[:3, :3] @ vehicle.X_BA[:3, 3] + best.X_WB[:3, 3]
            better = [consider(*near) for near in mounting.neighbours(base, best_yaw, middle, step)]
            if not any(better):
                break
    if best is None:
        held = " while the thrusters hold it" if holding else ""
        where = "0%: nowhere is there room for the hull"
        if furthest is not None:
            at = float(shares[min(max(furthest.at - _STANDOFF_STEPS, 0), len(shares) - 1)])
            where = f"{furthest.reached:.0%}, up to {at:.2f} m, where {arm.said(furthest)}"
        raise ReachError(
            f"the tool path is out of reach: no place of the hull lets the arm take all of it{held}, at best {where}"
        )
    start = best.X_WB.copy()
    start[:3, 3] -= 0.5 * travel_W
    return replace(best, X_WB=start)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Mounting:
    """Mounting of the arm's base on a level hull."""

    axis_B: Array  # (3,) the base's own axis, z_A
    R_BA: Array  # (3, 3)
    upright: bool  # the axis is closer to vertical than to horizontal: hull yaw then rotates about it
    forward: float  # [rad] heading on the hull of the arm's forward direction, or of a horizontal axis

    @classmethod
    def of(cls, X_BA: Array) -> "_Mounting":
        axis, reach = X_BA[:3, 2], X_BA[:3, 0]
        upright = bool(abs(axis[2]) > np.sqrt(0.5))
        ahead = reach if upright else axis
        return cls(axis_B=axis, R_BA=X_BA[:3, :3], upright=upright, forward=float(np.arctan2(ahead[1], ahead[0])))

    def candidates(
        self, path: ToolPath, middle: Array, reach: float, search: PlacementSearch
    ) -> Iterator[tuple[Array, float]]:
        """Positions (3,) [m] of the arm's base in W, each with the hull's yaw [rad]."""
        if self.upright:
            # Bearings are counted from the path's own direction, so that the search turns with the object.
            chord = path.p[-1] - path.p[0]
            start = np.arctan2(chord[1], chord[0])
            bearings = start + np.arange(search.bearings) * (2.0 * np.pi / search.bearings)
            up = -np.sign(self.axis_B[2])
            aside = itertools.product(search.turns, search.heights, search.radii, bearings)
            for turn, height, radius, bearing in aside:
                base = middle + reach * np.array([radius * np.cos(bearing), radius * np.sin(bearing), up * height])
                yield base, self._facing(base, middle) + turn
            return
        into = path.z.mean(axis=0)  # mean direction of the tool axis
        facing = float(np.arctan2(into[1], into[0])) - self.forward
        asides = np.arange(search.asides) * (2.0 * np.pi / search.asides)
        for turn, height, radius, aside in itertools.product(search.headings, search.heights, search.radii, asides):
            R_WA = exp_so3([0.0, 0.0, facing + turn]) @ self.R_BA
            yield middle + reach * R_WA @ [radius * np.cos(aside), radius * np.sin(aside), -height], facing + turn

    def neighbours(self, base: Array, yaw: float, middle: Array, step: float) -> list[tuple[Array, float]]:
        """Candidates `step` [m] away from a good one, and with yaw changed by 2 `step` [rad]."""
        moved = [base + step * way for way in np.vstack([np.eye(3), -np.eye(3)])]
        turned = [(base, yaw + turn) for turn in (-2.0 * step, 2.0 * step)]  # [rad]
        if self.upright:
            aside = yaw - self._facing(base, middle)
            return [(near, self._facing(near, middle) + aside) for near in moved] + turned
        return [(near, yaw) for near in moved] + turned

    def _facing(self, base: Array, middle: Array) -> float:
        """Hull yaw [rad] with which the arm reaches forward from `base` to `middle`."""
        away = base - middle
        return float(np.arctan2(away[1], away[0])) + np.pi - self.forward


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ToolTrack:
    """Tool poses along a path, from the stand-off and back to it."""

    poses: list[Array]  # k poses (4, 4) in W, relative to the travelling hull
    gone: Array  # (k, 3) [m] displacement of the hull at each since mid-path, W
    loads: Array | None = None  # (k, 3) [N] force of the world on the tip at each, tool axes; None: thrust is left out


class Limit(Enum):
    """What ends a path for the arm."""

    REACH = auto()  # no inverse kinematics
    TURN = auto()  # a joint would turn too far between two poses
    JOINT = auto()  # of a joint's angle
    TORQUE = auto()
    SINGULAR = auto()
    OBJECT = auto()  # nearness of the arm to the object
    THRUST = auto()


class Worked(NamedTuple):
    """Path that the arm takes from a hull pose."""

    margin: float  # [-] smallest along it
    q_start: Array  # (n,) [rad] joint angles at its first pose


class Dropped(NamedTuple):
    """First pose of a path that fails from a hull pose."""

    at: int  # its index
    reached: float  # share of the poses before it
    limit: Limit
    q: Array  # (n,) joint angles there [rad]; for TURN the steps to them [rad], for TORQUE those per newton [m]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ArmMargins:
    """Margins of the arm at work from a hull pose."""

    vehicle: Vehicle
    chain: Chain  # kinematics of its arm
    planes: Array  # (f, 4) faces of the object's convex hull, outward unit normal and offset [m], W
    force: float  # [N] largest set force
    clearance: float  # [m] distance of joint centres to the object that gives a margin of 1
    holding: ThrustMargin | None = None  # thrust margin of the vehicle; None leaves thrust out

    def along(self, track: ToolTrack, X_WB: Array, to_beat: float) -> "Worked | Dropped":
        """Smallest margin of a hull pose along tool poses, by inverse kinematics on one branch.

        Args:
            track: the tool poses.
            X_WB: (4, 4) hull pose.
            to_beat: [-] margin to be exceeded, but at least 0.05; otherwise the candidate is dropped.

        Returns:
            The margin with the first joint angles; or the first pose that fails, and why.
        """
        X_AW = inverse(X_WB @ self.vehicle.X_BA)
        low, high = self.vehicle.q_limits[:, 0], self.vehicle.q_limits[:, 1]
        margin, floor = np.inf, max(to_beat, 0.05)
        q, q_start = self.vehicle.q_ready, None
        slides = np.array([kind == "p" for kind in self.chain.joint_types])
        for i, X_WG in enumerate(track.poses):
            share = i / len(track.poses)
            result = solve(self.chain, X_AW @ X_WG, q, 1e-4, 1e-3, branch="keep", options=_FEW_STEPS)
            jump, room = _step_and_room(q, result.q, low, high)
            if not result.converged:
                return Dropped(i, share, Limit.REACH, result.q)
            if i and jump > _LARGEST_STEP:
                return Dropped(i, share, Limit.TURN, result.q - q)
            q = result.q
            margin = min(margin, room / 0.5)
            if margin <= floor:  # cheap margins first: most candidates are rejected here
                return Dropped(i, share, Limit.JOINT, q)
            X_AG, J = self.chain.kinematics(q)
            # These two, and the gap, seldom are the smallest margin: kernels, equal but for rounding, tell where.
            if not _are_above(margin, J, X_AG[:3, 2] * self.force, self.vehicle.torque_limits):
                torque = 1.0 - np.abs(J[:3].T @ (X_AG[:3, 2] * self.force) / self.vehicle.torque_limits).max()
                margin = min(margin, 3.0 * torque)
                if margin <= floor:
                    return Dropped(i, share, Limit.TORQUE, J[:3].T @ X_AG[:3, 2])
                margin = min(margin, np.linalg.svd(J * _SCALE, compute_uv=False)[-1] / _SINGULAR)
                if margin <= floor:
                    return Dropped(i, share, Limit.SINGULAR, q)
            centres = joint_centres_kernel(slides, self.chain.axes, self.chain.points, q)[2 : self.chain.n - 2]
            if joint_gap_kernel(centres, X_AW, self.planes, track.gone[i]) < margin * self.clearance + _ROUNDING:
                margin = min(margin, arm_gap(self.chain, q, X_AW, self.planes, track.gone[i]) / self.clearance)
                if margin <= floor:
                    return Dropped(i, share, Limit.OBJECT, q)
            if self.holding is not None and track.loads is not None:
                margin = min(margin, (1.0 - self.holding.used(q, X_WB[:3, :3], track.loads[i])) / _ROOMY_THRUST)
                if margin <= floor:
                    return Dropped(i, share, Limit.THRUST, q)
            if i == 0:
                q_start = q
        assert q_start is not None
        return Worked(float(margin), q_start)

    def said(self, dropped: "Dropped") -> str:
        """What ends the path where a candidate was dropped, in a few words."""
        vehicle = self.vehicle

        def joint(sizes: Array) -> str:
            return vehicle.joint_names[int(np.argmax(sizes))]

        match dropped.limit:
            case Limit.REACH:
                low, high = vehicle.q_limits[:, 0], vehicle.q_limits[:, 1]
                at_limit = np.flatnonzero(np.minimum(dropped.q - low, high - dropped.q) < _AT_LIMIT)
                names = ", ".join(vehicle.joint_names[j] for j in at_limit)
                return (
                    f"{names} {'is' if len(at_limit) == 1 else 'are'} at the limit" if names else "the arm is too short"
                )
            case Limit.TURN:
                return f"{joint(np.abs(dropped.q))} would turn by {np.degrees(np.abs(dropped.q).max()):.0f} deg at once"
            case Limit.JOINT:
                low, high = vehicle.q_limits[:, 0], vehicle.q_limits[:, 1]
                return f"{joint(-np.minimum(dropped.q - low, high - dropped.q))} comes to its limit"
            case Limit.TORQUE:
                return f"{joint(np.abs(dropped.q) / vehicle.torque_limits)} cannot bear the push"
            case Limit.SINGULAR:
                return "the arm is stretched, or its wrist"
            case Limit.OBJECT:
                return "the arm comes too near to the object"
            case Limit.THRUST:
                return "the thrusters cannot bear push and friction"


def samples_along(path: ToolPath, count: int) -> Array:
    """Arc lengths [m] at which a path is tested: `count` even ones, and more where the tool turns over an edge."""
    even = np.linspace(0.0, float(path.s[-1]), count)
    frame = np.hstack([path.x, np.cross(path.z, path.x), path.z])
    turned = np.concatenate([[0.0], np.cumsum(np.sqrt(0.5 * np.sum(np.diff(frame, axis=0) ** 2, axis=1)))])  # [rad]
    at = np.interp(even, path.s, turned)
    more = np.maximum(np.ceil(np.diff(at) / _MOST_TURN) - 1, 0).astype(np.int64)
    if not more.any():
        return even
    between = [
        np.interp(np.linspace(a, b, k + 2)[1:-1], turned, path.s) for a, b, k in zip(at, at[1:], more, strict=False)
    ]
    return np.sort(np.concatenate([even, *between]))


def tool_poses(path: ToolPath, shares: Array, roll: float, standoff: float) -> list[Array]:
    """Tool poses (4, 4) from the stand-off to the surface, along the path, and back off the surface.

    Args:
        path: tool path in W.
        shares: [m] arc lengths of the poses on the path.
        roll: [rad] rotation of the tool about its own axis.
        standoff: [m] from which the tool approaches.

    Returns:
        The poses in W, `_STANDOFF_STEPS` before and after those on the path.
    """
    along = [tool_pose(path, s, roll)[0] for s in shares]
    steps = standoff * np.arange(1, _STANDOFF_STEPS + 1) / _STANDOFF_STEPS
    down, up = ([pose(X[:3, :3], X[:3, 3] - X[:3, 2] * step) for step in steps] for X in (along[0], along[-1]))
    return down[::-1] + along + up


def _loads(path: ToolPath, shares: Array, roll: float, force: float, drag: float) -> Array:
    """Force of the surface on the tip (k, 3) [N], tool axes, at each of `tool_poses`; zero off the surface."""
    loads = np.zeros((len(shares) + 2 * _STANDOFF_STEPS, 3))
    for load, s in zip(loads[_STANDOFF_STEPS:], shares, strict=False):
        X, tangent, _ = tool_pose(path, s, roll)
        load[:] = -force * (np.array([0.0, 0.0, 1.0]) + drag * X[:3, :3].T @ tangent)
    return loads


def _seen(poses: list[Array], gone: Array) -> list[Array]:
    """Make `poses` relative to a hull displaced by `gone` (k, 3) [m] since mid-path, in place."""
    for X, way in zip(poses, gone, strict=True):
        X[:3, 3] -= way
    return poses


def reach(chain: Chain) -> float:
    """Length [m] of the stretched arm, from joint to joint to the tip."""
    stations = np.vstack([np.zeros(3), chain.points, chain.X_base_tip0[:3, 3]])
    return float(np.linalg.norm(np.diff(stations, axis=0), axis=1).sum())


@dataclass(frozen=True, slots=True, kw_only=True)
class StandingLimits:
    """What a placement must allow."""

    force: float  # [N] largest set force
    standoff: float  # [m] distance to the surface from which the tool approaches
    least_share: float = 1.0  # share of the path that must be reached; the rest is cut off equally at both ends
    roomy: float = 0.8  # placement margin under which the hull travels with the tool
    cramped: float = 0.6  # placement margin under which part of the path is left out
    spared: float = 0.7  # share of full thrust for push and steady current up to which the hull is not turned
    thrust: float = 0.95  # share that they may take at most


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PathStanding:
    """Hull placement beside a known object, for as much of a path as is within reach."""

    vehicle: Vehicle
    chain: Chain  # its arm, base to tool
    model: TargetModel  # of the object
    hull_box: Array  # (2, 3) [m] corners of the hull in B, kept clear of the object and of the seabed
    limits: StandingLimits
    floor: float = -np.inf  # [m] height of the seabed in W
    search: PlacementSearch | None = None  # hull placements that are tried
    holding: ThrustMargin | None = None  # thrust margin of the hull beside the object; None: not tested

    def __call__(self, target: Target, whole: ToolPath, current_W: Array = _STILL) -> tuple[Placement, ToolPath, float]:
        """Best placement, the part of the path worked from it, and its share.

        A placement without thrust margin against the worst friction is accepted as a second choice, marked
        `held=False`. The place is first chosen in still water. Where push and current would ask for much of a thruster
        there, it is chosen anew in the current, which turns the hull.

        Args:
            target: the object.
            whole: tool path on it.
            current_W: (3,) [m/s] steady current, W.

        Raises:
            ReachError: if there is none.
            StrongCurrentError: if the thrusters hold none in the current.
        """
        obstacle = transform_points(target.X_WT, self.model.vertices)
        try:
            chosen = self._best(obstacle, whole, self.holding)
        except ReachError:
            if self.holding is None:
                raise
            # Friction may be less than the worst case, and a hull that is pushed off its place retreats.
            placement, path, worked = self._best(obstacle, whole, self.holding.without_friction())
            chosen = replace(placement, held=False), path, worked
        if self.holding is None or not np.any(current_W):
            return chosen
        moved = self.holding.in_current(current_W)
        smooth = moved.without_friction()
        used = self.used(chosen[0], chosen[1], smooth)
        if used <= self.limits.spared:
            return chosen
        for holding in (moved, smooth):
            with suppress(ReachError):
                turned, path, worked = self._best(obstacle, whole, holding)
                if (least := self.used(turned, path, smooth)) < used:
                    chosen, used = (replace(turned, held=holding is moved), path, worked), least
                break
        if used <= self.limits.thrust:
            return chosen
        raise StrongCurrentError(
            f"the current of {np.linalg.norm(current_W):.2f} m/s is too strong: the tool's push and it ask for "
            f"{used:.0%} of a thruster, {self.limits.thrust:.0%} may be used"
        )

    def used(self, placement: Placement, path: ToolPath, holding: ThrustMargin) -> float:
        """Largest share of thrust that any thruster uses along a path from a placement; 1 is full thrust.

        Args:
            placement: the hull's place for the path.
            path: tool path.
            holding: thrust margin of the vehicle.

        Returns:
            The share [-].
        """
        count = (self.search or PlacementSearch()).samples
        shares = samples_along(path, count)
        poses = tool_poses(path, shares, placement.roll, self.limits.standoff)
        loads = _loads(path, shares, placement.roll, self.limits.force, holding.drag)
        done = np.interp(shares, np.linspace(0.0, float(path.s[-1]), count), np.linspace(0.0, 1.0, count))
        done = np.pad(done, _STANDOFF_STEPS, mode="edge")
        q, most = placement.q_start, 0.0
        for X_WG, load, share in zip(poses, loads, done, strict=True):
            X_WB = placement.hull_at(share)
            X_AG = inverse(X_WB @ self.vehicle.X_BA) @ X_WG
            q = solve(self.chain, X_AG, q, 1e-4, 1e-3, branch="keep", options=_FEW_STEPS).q
            most = max(most, holding.used(q, X_WB[:3, :3], load))
        return most

    def _best(
        self, obstacle: Array, whole: ToolPath, holding: ThrustMargin | None
    ) -> tuple[Placement, ToolPath, float]:
        """Best placement over shares of the path and travels of the hull; raises ReachError if none exists."""
        limits = self.limits
        around = Surroundings(obstacle=obstacle, hull_box=self.hull_box, floor=self.floor)
        best: tuple[Placement, ToolPath, float] | None = None
        failure: ReachError | None = None
        for share, travel in self._candidates():
            if share < 1.0 and best is not None and best[0].margin >= limits.cramped:
                break
            shorter = middle_part(whole, share)
            try:
                found = place_hull(
                    self.vehicle,
                    self.chain,
                    shorter,
                    around=around,
                    force=limits.force,
                    standoff=limits.standoff,
                    travel=travel,
                    search=self.search,
                    holding=holding,
                )
            except ReachError as error:
                failure = failure or error
                continue
            if best is None or found.margin > best[0].margin:
                best = found, shorter, share
            if best[0].margin >= limits.roomy:
                break
        if best is None:
            raise failure or ReachError("there is no way to stand")
        return best

    def _candidates(self) -> Iterator[tuple[float, float]]:
        """Candidates (share of the path to work, travel of the hull as a share of it), the best first."""
        yield from ((1.0, travel) for travel in _TRAVELS)
        share = 1.0 - _SHORTER
        while share >= self.limits.least_share - 1e-9:
            yield share, 1.0
            share -= _SHORTER
