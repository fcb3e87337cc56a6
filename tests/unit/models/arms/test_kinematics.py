"""Kinematics of arms with tables, uncompiled, against products of elementary moves and their
differences.
"""

import numpy as np

from dh_product import drawn_arm, link_frames
from uncompiled import uncompiled
from uuv.sim.interfaces.spatial import Array, exp_so3

kinematics, tip_places = uncompiled("uuv.models.arms.kinematics", "uuv.models.arms.tip_places")


def test_frames_are_products_of_elementary_moves(rng: np.random.Generator) -> None:
    table, slides, X_base, *_ = drawn_arm(rng)
    q = rng.normal(size=len(table))
    R = X_base[:3, :3].copy()
    o = X_base[:3, 3].copy()
    expected = link_frames(table, slides, X_base, q)
    for k, row in enumerate(table):
        axes = np.empty((4, 3))
        kinematics.frame_step(R, o, row, q[k], slides[k], axes)
        np.testing.assert_allclose(R, expected[k + 1][:3, :3], atol=1e-13)
        np.testing.assert_allclose(o, expected[k + 1][:3, 3], atol=1e-13)
        np.testing.assert_allclose(axes[0], expected[k][:3, 2], atol=1e-13)
        np.testing.assert_allclose(axes[1], expected[k][:3, 3], atol=1e-13)
        before_beta = expected[k + 1][:3, :3] @ exp_so3([0, -row[4], 0])
        np.testing.assert_allclose(axes[2], before_beta[:, 0], atol=1e-13)
        np.testing.assert_allclose(axes[3], before_beta[:, 1], atol=1e-13)


def test_tips_and_their_derivatives(rng: np.random.Generator) -> None:
    table, slides, X_base, X_flange, tcp = drawn_arm(rng)
    n = len(table)
    q = rng.normal(size=(3, len(table)))

    def tips(table: Array, tcp: Array) -> Array:
        return np.array(
            [
                (link_frames(table, slides, X_base, row)[-1] @ X_flange @ [*tcp, 1.0])[:3]
                for row in q
            ]
        )

    J = np.zeros((3, 5 * n + 3, 3))
    np.testing.assert_allclose(
        tip_places.tips(table, slides, X_base, X_flange, tcp, q, J), tips(table, tcp), atol=1e-12
    )
    none = tip_places.tips(table, slides, X_base, X_flange, tcp, q, tip_places.NO_JACOBIAN)
    np.testing.assert_allclose(none, tips(table, tcp), atol=1e-12)
    h = 1e-6
    for i in range(5 * n + 3):
        e = h * np.eye(5 * n + 3)[i]
        rows = e[: 5 * n].reshape(n, 5)
        point = e[5 * n :]
        slope = (tips(table + rows, tcp + point) - tips(table - rows, tcp - point)) / (2 * h)
        np.testing.assert_allclose(J[:, i], slope, atol=1e-8)
