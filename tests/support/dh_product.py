"""Forward kinematics of standard Denavit-Hartenberg rows by products of elementary moves, to compare with."""

import numpy as np

from sim.interfaces.spatial import Array, exp_so3, pose


def tips_here(dh: Array, q: Array, tcp: Array) -> Array:
    """Tips (M, 3) [m] of hinges with rows `dh` (n, 4) at `q` (M, n) [rad], for a tool point `tcp` (3,) [m]."""
    out = []
    for row in q:
        X = np.eye(4)
        for (theta, d, a, alpha), angle in zip(dh, row, strict=True):
            X = X @ pose(exp_so3([0, 0, theta + angle]), [0, 0, d]) @ pose(exp_so3([alpha, 0, 0]), [a, 0, 0])
        out.append(X[:3, :3] @ tcp + X[:3, 3])
    return np.array(out)
