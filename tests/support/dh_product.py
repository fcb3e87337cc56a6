"""Forward kinematics of Denavit-Hartenberg rows by products of elementary moves, to compare
with.
"""

import numpy as np

from uuv.sim.interfaces.spatial import Array, exp_so3, pose


def tips_here(dh: Array, q: Array, tcp: Array) -> Array:
    """Tips (M, 3) [m] of hinges with rows `dh` (n, 4) at `q` (M, n) [rad], for a tool point `tcp`
    (3,) [m].
    """
    out = []
    for row in q:
        X = np.eye(4)
        for (theta, d, a, alpha), angle in zip(dh, row, strict=True):
            X = (
                X
                @ pose(exp_so3([0, 0, theta + angle]), [0, 0, d])
                @ pose(exp_so3([alpha, 0, 0]), [a, 0, 0])
            )
        out.append(X[:3, :3] @ tcp + X[:3, 3])
    return np.array(out)


def drawn_arm(
    rng: np.random.Generator, slides: str = "rrrprrr"
) -> tuple[Array, np.ndarray, Array, Array, Array]:
    """Table, slides, base, flange and tool point, drawn at random."""
    n = len(slides)
    table = rng.uniform(-1.0, 1.0, (n, 5)) * [3.0, 0.4, 0.5, 1.5, 0.3]
    X_base, X_flange = (
        pose(exp_so3(rng.normal(size=3)), 0.2 * rng.normal(size=3)) for _ in range(2)
    )
    return (
        table,
        np.array([kind == "p" for kind in slides]),
        X_base,
        X_flange,
        0.1 * rng.normal(size=3),
    )


def link_frames(table: Array, slides: np.ndarray, X_base: Array, q: Array) -> list[Array]:
    """Link frames (4, 4) by products of elementary moves."""
    out = [X_base]
    for (theta, d, a, alpha, beta), coordinate, slide in zip(table, q, slides, strict=True):
        turn, shift = (theta, d + coordinate) if slide else (theta + coordinate, d)
        X = (
            out[-1]
            @ pose(exp_so3([0, 0, turn]), [0, 0, shift])
            @ pose(exp_so3([alpha, 0, 0]), [a, 0, 0])
        )
        out.append(X @ pose(exp_so3([0, beta, 0])))
    return out
