"""Several finds of one object, some seconds apart, as one.

What a find says of the world holds two errors: the matcher's, new in every frame, and that of where the vehicle
believes to be, which forgets itself within seconds. The second goes into the path as it is, for the tool is later
re-aimed by a belief whose error has become another. A mean of finds that lie apart in time makes both smaller.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sim.interfaces.messages import Target
from sim.interfaces.spatial import Array, exp_so3, log_so3, pose, readonly, transform_points

AGREE = (0.05, 0.1)  # [m], [rad] from the last find; one further off is of something else, or of another turn


def fuse_poses(finds: Sequence[Target]) -> Target:
    """The last of `finds`, moved with its path to the mean of all that agree with it.

    Moves are taken at the middle of the path, or of the object where there is none, so that what a find errs in turning
    does not count by the distance to the world's origin.
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
    return readonly(axes @ R.T)
