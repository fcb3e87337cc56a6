"""Fusion of several identifications of one object, taken some seconds apart, into one pose.

An identification in W has two errors. That of the registration is independent in every frame. That of the believed hull
position is correlated over some seconds. The path inherits it unchanged, while the tool is later aimed with a position
estimate whose error has become another. Averaging identifications that lie apart in time reduces both errors.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim.interfaces.messages import Target
from sim.interfaces.spatial import Array, exp_so3, log_so3, pose, readonly, transform_points

AGREE = (0.05, 0.1)  # [m], [rad] from the last one; one farther off is of another object, or of a wrong orientation


def fuse_poses(finds: Sequence[Target]) -> Target:
    """Move the last identification, with its path, to the mean of all that agree with it.

    Displacements are taken at the middle of the path, or at the object's origin where there is no path. Orientation
    errors then do not grow with the distance to the origin of W.
    """
    last = finds[-1]
    middle = last.X_WT[:3, 3] if last.path is None else last.path.p.mean(axis=0)
    moves, turns = [], []
    for find in finds:
        R = find.X_WT[:3, :3] @ last.X_WT[:3, :3].T
        move, turn = find.X_WT[:3, 3] + R @ (middle - last.X_WT[:3, 3]) - middle, log_so3(R)
        if np.linalg.norm(move) <= AGREE[0] and np.linalg.norm(turn) <= AGREE[1]:
            moves.append(move)
            turns.append(turn)
    R = exp_so3(np.mean(turns, axis=0))
    moved = pose(R, middle + np.mean(moves, axis=0) - R @ middle)
    path = last.path
    if path is not None:
        path = replace(path, p=readonly(transform_points(moved, path.p)), z=_turned(R, path.z), x=_turned(R, path.x))
    return replace(last, X_WT=readonly(moved @ last.X_WT), path=path)


def _turned(R: Array, axes: Array) -> Array:
    """Rotate axes (N, 3) by `R` (3, 3)."""
    return readonly(axes @ R.T)
