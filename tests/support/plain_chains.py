"""Chains with their kernel memory, for tests of single kernels of `uuv.controllers.ik` in plain
Python.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from uncompiled import uncompiled
from uuv.controllers.ik.chain import Chain, memory_of
from uuv.sim.interfaces.spatial import Array, exp_so3, pose

kernels, sweeps, parts, descent, stages = uncompiled(
    "uuv.controllers.ik.chain_kernels",
    "uuv.controllers.ik.sweeps",
    "uuv.controllers.ik.pose_parts",
    "uuv.controllers.ik.damped_descent",
    "uuv.controllers.ik.paper_stages",
)
SCALE = 0.5  # of the memories here: a power of two that is not 1


@dataclass
class Plain:
    """A chain and views of its kernel memory."""

    chain: Chain
    memory: Array
    views: Any  # `Memory` of the uncompiled kernels

    table = property(lambda self: self.views.table)
    goal = property(lambda self: self.views.goal)
    normal = property(lambda self: self.views.normal)
    work = property(lambda self: self.views.work)
    past = property(lambda self: self.views.past)
    q = property(lambda self: self.views.q)

    def errors(self, q: Array) -> tuple[float, float]:
        """Squared position error [scaled] and squared chord at `q`, from matrices alone."""
        X = by_exponentials(self.chain, q)
        R = X[:3, :3] @ self.tool.T
        p2 = float(np.sum((self.goal[0] - SCALE * X[:3, 3]) ** 2))
        return p2, float(0.5 * np.sum((self.goal[1:].T - R) ** 2))

    @property
    def tool(self) -> Array:
        """Rotation (3, 3) of the tip in the last joint frame."""
        return self.table[1, :9].reshape(3, 3)

    def aim(self, X: Array) -> None:
        """Set the target to the tip pose `X` (4, 4)."""
        assert kernels.set_goal(self.table, X, self.goal)


def plain(chain: Chain) -> Plain:
    memory = memory_of(chain, SCALE)
    return Plain(chain, memory, kernels.partition(memory, chain.n))


def settings(
    tol_p: float,
    tol_r: float,
    limit: int,
    restarts: int = 0,
    keep: bool = False,
    axes: tuple[float, float] = (1.0, 1.0),
) -> Any:
    """`Settings` of the kernels; `axes` are the tolerances [rad] of the two axis stages."""
    return kernels.Settings(kernels.HYBRID, tol_p, tol_r, *axes, limit, restarts, keep, False)


def drawn_chain(rng: np.random.Generator, types: str = "rporrr", limit: float = 2.5) -> Chain:
    """A chain of links, twists and a tool drawn at random."""
    n = len(types)
    dh = np.column_stack(
        [
            rng.uniform(-3, 3, n),
            rng.uniform(-0.3, 0.3, n),
            rng.uniform(0.2, 0.6, n),
            rng.uniform(-2, 2, n),
        ]
    )
    limits = np.array([(-0.3, 0.4) if kind == "p" else (-limit, 0.9 * limit) for kind in types])
    return Chain.from_dh(
        dh, types, limits=limits, tool=pose(exp_so3([0.4, -0.5, 0.3]), [0.02, -0.03, 0.1])
    )


def drawn_q(chain: Chain, rng: np.random.Generator) -> Array:
    return rng.uniform(0.9 * chain.limits[:, 0], 0.9 * chain.limits[:, 1])


def by_exponentials(chain: Chain, q: Array) -> Array:
    """Tip pose (4, 4) as the product of each joint's displacement in the base frame and the tip
    pose at zero.
    """
    X = np.eye(4)
    for kind, axis, point, link, coordinate in zip(
        chain.joint_types, chain.axes, chain.points, chain.links, q, strict=True
    ):
        R = exp_so3(coordinate * axis)
        if kind == "r":
            X = X @ pose(R, point - R @ point)
        elif kind == "p":
            X = X @ pose(p=coordinate * axis)
        else:
            X = X @ pose(p=R @ link - link)
    return X @ chain.X_base_tip0
