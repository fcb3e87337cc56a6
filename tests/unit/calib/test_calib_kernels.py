"""Kernels of the calibration, uncompiled, against NumPy and SciPy."""

import numpy as np
import pytest

from dh_product import drawn_arm, link_frames
from uncompiled import uncompiled
from uuv.sim.interfaces.spatial import Array

*_, kernels = uncompiled(
    "uuv.models.arms.kinematics", "uuv.models.arms.tip_places", "uuv.calib.kernels"
)


def test_the_size_is_the_root_of_summed_squares(rng: np.random.Generator) -> None:
    """Of an arm without flange and tool: all its a and all its d but the first; and its
    derivative.
    """
    table = drawn_arm(rng)[0]
    size, _ = kernels.arm_size(table, np.eye(4), np.zeros(3), np.zeros(len(table), dtype=bool))
    assert size == pytest.approx(np.sqrt(np.sum(table[:, 2] ** 2) + np.sum(table[1:, 1] ** 2)))
    table, _, _, X_flange, tcp = drawn_arm(rng)
    parallel = np.arange(len(table)) == 1
    size, slope = kernels.arm_size(table, X_flange, tcp, parallel)
    h = 1e-6
    n = len(table)
    for i in range(5 * n + 3):
        e = h * np.eye(5 * n + 3)[i]
        ahead, behind = (
            kernels.arm_size(
                table + s * e[: 5 * n].reshape(n, 5), X_flange, tcp + s * e[5 * n :], parallel
            )[0]
            for s in (1, -1)
        )
        # The last beta leaves the length of link and tool as it is only together with alpha: it is
        # not counted.
        if i != 5 * (n - 1) + 4:
            assert slope[i] == pytest.approx((ahead - behind) / (2 * h), abs=1e-8)


def test_shifts_along_parallel_axes_that_cancel_are_no_size(rng: np.random.Generator) -> None:
    """Two axes that point the same way, or one against the other."""
    for alpha, against in ((0.01, -1.0), (np.pi - 0.01, 1.0)):
        table, _, _, X_flange, tcp = drawn_arm(rng)
        table[1, 3] = alpha
        parallel = np.arange(len(table)) == 1
        shifted = table.copy()
        shifted[1:3, 1] += 0.7, 0.7 * against
        sizes = [
            kernels.arm_size(geometry, X_flange, tcp, parallel)[0] for geometry in (table, shifted)
        ]
        assert sizes[1] == pytest.approx(sizes[0], rel=1e-12)
        assert kernels.arm_size(shifted, X_flange, tcp, np.zeros_like(parallel))[
            0
        ] != pytest.approx(sizes[0], rel=1e-3)


def test_touches_are_centred_about_the_weighted_mean_of_their_series(
    rng: np.random.Generator,
) -> None:
    p = rng.normal(size=(9, 3))
    J = rng.normal(size=(9, 6, 3))
    weights = rng.uniform(0.2, 1.0, 9)
    starts = np.array([0, 4, 7])
    index = np.array([5, 0, 2])
    weights[[1, 7, 8]] = 0.0  # one touch, and all of the last series
    residuals, r, rows, c, C = kernels.centred_rows(p, J, weights, starts, index)
    for s, part in enumerate((slice(0, 4), slice(4, 7))):
        w = weights[part]
        mean = np.average(p[part], axis=0, weights=w)
        slope = np.average(J[part][:, index], axis=0, weights=w)
        np.testing.assert_allclose(c[s], mean)
        np.testing.assert_allclose(C[s], slope)
        np.testing.assert_allclose(residuals[part], p[part] - mean)
        root = np.sqrt(w)
        np.testing.assert_allclose(r.reshape(9, 3)[part], root[:, None] * (p[part] - mean))
        expected = root[:, None, None] * (J[part][:, index] - slope)
        np.testing.assert_allclose(rows.reshape(9, 3, 3)[part], expected.transpose(0, 2, 1))
    assert not c[2].any()
    assert not r.reshape(9, 3)[7:].any()
    assert np.isfinite(rows).all()


def test_loads_of_hanging_bodies_are_slopes_of_their_work(rng: np.random.Generator) -> None:
    table, slides, X_base, *_ = drawn_arm(rng)
    n = len(table)
    M = 2
    q = rng.normal(size=(M, n))
    forces, points = rng.normal(size=(2, n, 2, 3))
    extra_f, extra_p = rng.normal(size=(2, M, 1, 3))

    def work(m: int, q: Array) -> float:
        """Of dead forces, fixed in the base."""
        X = link_frames(table, slides, X_base, q)
        total = sum(
            float(forces[k, b] @ (X[k + 1] @ [*points[k, b], 1.0])[:3])
            for k in range(n)
            for b in range(2)
        )
        return total + float(extra_f[m, 0] @ (X[n] @ [*extra_p[m, 0], 1.0])[:3])

    X = np.array([link_frames(table, slides, X_base, row) for row in q])
    tau = kernels.joint_loads(X, slides, forces, points, extra_f, extra_p)
    for m in range(M):
        for k, e in enumerate(1e-5 * np.eye(n)):
            slope = (work(m, q[m] + e) - work(m, q[m] - e)) / 2e-5
            assert tau[m, k] == pytest.approx(slope, abs=1e-8)


@pytest.mark.parametrize("orient", [False, True])
def test_a_pose_is_reached_in_few_steps(orient: bool, rng: np.random.Generator) -> None:
    """Newton's method near the pose: the error's axes and the Jacobian must be right for that."""
    table, slides, X_base, X_flange, tcp = drawn_arm(rng)
    for _ in range(3):
        q = rng.uniform(-0.5, 0.5, len(table))
        X = link_frames(table, slides, X_base, q)[-1] @ X_flange
        start = q + rng.uniform(-0.03, 0.03, len(q))
        goal = (X @ [*tcp, 1.0])[:3]
        q_solved = start.copy()
        done = kernels.reach_pose(
            table, slides, X_base, X_flange, tcp, goal, X[:3, :3], q_solved, orient, 12
        )
        assert done
        reached = link_frames(table, slides, X_base, q_solved)[-1] @ X_flange
        np.testing.assert_allclose((reached @ [*tcp, 1.0])[:3], goal, atol=1e-10)
        if orient:
            np.testing.assert_allclose(reached[:3, :3], X[:3, :3], atol=3e-6)
        assert not kernels.reach_pose(
            table, slides, X_base, X_flange, tcp, goal, X[:3, :3], start, orient, 1
        )


def test_a_pose_is_reached_from_the_other_side(rng: np.random.Generator) -> None:
    """From a start turned by more than a quarter turn, where the sine of the error falls again."""
    table, slides, X_base, X_flange, tcp = drawn_arm(rng, "rrrrrrr")
    solved = 0
    for _ in range(4):
        q, start = rng.uniform(-1.5, 1.5, (2, len(table)))
        X = link_frames(table, slides, X_base, q)[-1] @ X_flange
        X_tip = link_frames(table, slides, X_base, start)[-1] @ X_flange
        start[-1] += 2.5 if np.trace(X_tip[:3, :3].T @ X[:3, :3]) > 1.0 else 0.0
        goal = (X @ [*tcp, 1.0])[:3]
        solved += kernels.reach_pose(
            table, slides, X_base, X_flange, tcp, goal, X[:3, :3], start, True, 300
        )
    assert solved >= 2
