"""Tool path for the planner's tests: parts of it, and poses and loads of the tool along it."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.messages import ToolPath
from uuv.sim.interfaces.spatial import Array, pose

STANDOFF_STEPS = 3  # number of poses tried between the stand-off and the surface
_MOST_TURN = 0.3  # [rad] largest turn of the tool between two samples of its path
_HALF_STEP = 2e-3  # [m] half step of the central differences along the path


def tool_pose(path: ToolPath, s: float, roll: float) -> tuple[Array, Array, Array]:
    """Tool pose at arc length `s` of a path, and its derivative with respect to `s`.

    Args:
        path: tool path in W.
        s: [m] arc length.
        roll: [rad] rotation of the tool about its own axis from the path's x.

    Returns:
        The pose X_WG (4, 4), the derivative of its origin (3,) [-], and that of its axes (3,)
        [rad/m], W.
    """
    X = np.eye(4)
    tangent = np.empty(3)
    turn = np.empty(3)
    _tool_pose(_Samples(path.s, path.p, path.z, path.x), s, roll, X, tangent, turn)
    return X, tangent, turn


def middle_part(path: ToolPath, share: float) -> ToolPath:
    """Middle `share` [-] of a path, with an arc length that begins at 0."""
    if share >= 1.0:
        return path
    cut = 0.5 * (1.0 - share) * float(path.s[-1])
    keep = (path.s >= cut) & (path.s <= float(path.s[-1]) - cut)
    return part_of(path, keep)


def part_of(path: ToolPath, keep: np.ndarray) -> ToolPath:
    """The samples selected by `keep` (N,), from the first to the last at which the tool can press.

    The arc length of the part begins at 0.
    """
    if path.fits is not None and (keep & path.fits).any():
        first, last = np.flatnonzero(keep & path.fits)[[0, -1]]
        keep = keep & (np.arange(len(keep)) >= first) & (np.arange(len(keep)) <= last)

    fits = None if path.fits is None else path.fits[keep]
    s = path.s[keep]
    p = path.p[keep]
    z = path.z[keep]
    x = path.x[keep]
    return replace(path, s=s - s[0], p=p, z=z, x=x, on_scan=path.on_scan[keep], fits=fits)


def stretches(path: ToolPath) -> tuple[tuple[float, float], ...]:
    """Beginning and end [m] of each stretch of a path on which the tool can press, in order."""
    if path.fits is None:
        return ((0.0, float(path.s[-1])),)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], path.fits, [False]]).astype(np.int8)))
    return tuple(
        (float(path.s[first]), float(path.s[last - 1])) for first, last in edges.reshape(-1, 2)
    )


class _Samples(NamedTuple):
    """A tool path in the form of the kernels; fields as in `ToolPath`."""

    s: Array  # (k,) [m]
    p: Array  # (k, 3) [m]
    z: Array  # (k, 3)
    x: Array  # (k, 3)


@kernel
def _tool_pose(path, s, roll, X, tangent, turn):
    low = max(0.0, s - _HALF_STEP)
    high = min(path.s[-1], s + _HALF_STEP)
    R_low, p_low = _frame(path, low, roll)
    R_high, p_high = _frame(path, high, roll)
    X[:3, :3], X[:3, 3] = _frame(path, s, roll)

    for i in range(3):
        j = (i + 1) % 3
        k = (i + 2) % 3
        total = 0.0
        for m in range(3):  # vee of the antisymmetric part of R_high R_low^T
            total += R_high[k, m] * R_low[j, m] - R_high[j, m] * R_low[k, m]
        turn[i] = 0.5 * total / (high - low)
        tangent[i] = (p_high[i] - p_low[i]) / (high - low)


@kernel
def _frame(path, s, roll):
    """Axes (3, 3) and position (3,) of the tool at `s`, interpolated between the path's samples."""
    i = min(max(np.searchsorted(path.s, s) - 1, 0), path.s.shape[0] - 2)
    share = (s - path.s[i]) / (path.s[i + 1] - path.s[i])
    p = (1.0 - share) * path.p[i] + share * path.p[i + 1]

    # Axes, orthonormal again
    z = (1.0 - share) * path.z[i] + share * path.z[i + 1]
    z /= np.sqrt((z * z).sum())
    x = (1.0 - share) * path.x[i] + share * path.x[i + 1]
    x -= (x * z).sum() * z
    x /= np.sqrt((x * x).sum())
    y = np.array([z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]])

    # Turned about z by the angle `roll`
    c, sn = np.cos(roll), np.sin(roll)
    R = np.empty((3, 3))
    R[:, 0] = c * x + sn * y
    R[:, 1] = c * y - sn * x
    R[:, 2] = z
    return R, p


def samples_along(path: ToolPath, count: int) -> Array:
    """Arc lengths [m] at which a path is tested: `count` evenly spaced ones, and more where the
    tool turns.
    """
    even = np.linspace(0.0, float(path.s[-1]), count)
    frame = np.hstack([path.x, np.cross(path.z, path.x), path.z])

    # [rad] turn of the tool's axes up to each sample
    turned = np.concatenate(
        [[0.0], np.cumsum(np.sqrt(0.5 * np.sum(np.diff(frame, axis=0) ** 2, axis=1)))]
    )

    at = np.interp(even, path.s, turned)
    more = np.maximum(np.ceil(np.diff(at) / _MOST_TURN) - 1, 0).astype(np.int64)
    if not more.any():
        return even

    between = [
        np.interp(np.linspace(a, b, k + 2)[1:-1], turned, path.s)
        for a, b, k in zip(at, at[1:], more, strict=False)
    ]
    return np.sort(np.concatenate([even, *between]))


def tool_poses(path: ToolPath, shares: Array, roll: float, standoff: float) -> list[Array]:
    """Tool poses (4, 4) from the stand-off to the surface, along the path, and back.

    Args:
        path: tool path in W.
        shares: [m] arc lengths of the poses on the path.
        roll: [rad] rotation of the tool about its own axis.
        standoff: [m] from which the tool approaches.

    Returns:
        The poses in W, `STANDOFF_STEPS` before and after those on the path.
    """
    along = [tool_pose(path, s, roll)[0] for s in shares]
    steps = standoff * np.arange(1, STANDOFF_STEPS + 1) / STANDOFF_STEPS
    down, up = (
        [pose(X[:3, :3], X[:3, 3] - X[:3, 2] * step) for step in steps]
        for X in (along[0], along[-1])
    )
    return down[::-1] + along + up


def tool_loads(path: ToolPath, shares: Array, roll: float, force: float, drag: float) -> Array:
    """Force (k, 3) [N] of the surface on the tip at `tool_poses`, tool axes; zero off the
    surface.
    """
    loads = np.zeros((len(shares) + 2 * STANDOFF_STEPS, 3))
    for load, s in zip(loads[STANDOFF_STEPS:], shares, strict=False):
        X, tangent, _ = tool_pose(path, s, roll)
        load[:] = -force * (np.array([0.0, 0.0, 1.0]) + drag * X[:3, :3].T @ tangent)
    return loads


def from_moving_hull(poses: list[Array], gone: Array) -> list[Array]:
    """Make `poses` relative to a hull displaced by `gone` (k, 3) [m] since mid-path, in place."""
    for X, way in zip(poses, gone, strict=True):
        X[:3, 3] -= way
    return poses
