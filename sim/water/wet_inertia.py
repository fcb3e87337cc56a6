"""Joint-space inertia of a wet model, M + A, its inverse, and drag over it: one block for each kinematic tree.

Bodies of different trees share no degree of freedom, so M + A and the slope of the drag are block diagonal, and the
cost is linear in the number of trees. How a tree is solved depends on its degrees of freedom:

- Up to LARGEST_SMALL: by LAPACK. The vehicles are such trees, and the last digits of their recorded trajectories depend
  on its rounding.
- More: by MuJoCo's sparse factor, whose cost is the square of the tree's depth for each degree of freedom. The largest
  rate of the drag is by Lanczos iteration.
- Up to LARGEST_INVERSE, contact weights are from LAPACK's inverse all the same. M + A of a long chain is so
  ill-conditioned (1e9 with 200 links) that weights by two factorisations differ in the ninth digit.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from models.hydrodynamics import BodyHydrodynamics
from sim.interfaces.errors import HydrodynamicsError
from sim.interfaces.spatial import Array

if TYPE_CHECKING:
    from scipy.sparse import csr_array

Indices = NDArray[np.integer]

LARGEST_SMALL = 64  # degrees of freedom
LARGEST_INVERSE = 320  # degrees of freedom

_ROWS = 256  # right-hand sides that are solved for at a time, which bounds the memory
_RATE_TOLERANCE = 1e-6  # relative, of the drag rate of a large tree
_LANCZOS_VECTORS = 40  # ARPACK's 20 take three times as many iterations where eigenvalues cluster, as in long chains


class TreeSums:
    """Sums over the wet bodies of a model in joint space, at a state, as one block for each kinematic tree."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, bodies: Mapping[int, BodyHydrodynamics]) -> None:
        """Takes the Jacobians of the bodies.

        Args:
            model: Compiled model.
            data: State whose kinematics and comPos are up to date.
            bodies: Coefficients of movable bodies, by index.
        """
        self.model = model
        self.data = data
        self.bodies = bodies

        ends = zip(model.tree_dofadr.tolist(), model.tree_dofnum.tolist(), strict=True)
        self.trees = [slice(start, start + count) for start, count in ends]
        self.tree_of = model.body_treeid.tolist()
        self.movers = _moving_dofs(model)
        self.bodies_of: list[list[int]] = [[] for _ in self.trees]
        for i in bodies:
            self.bodies_of[self.tree_of[i]].append(i)

        self._rows = np.zeros((6, model.nv))  # of one Jacobian; MuJoCo clears them itself
        self._jacobians = {i: self._at_origin(i) for i in bodies}

    def at_center_of_mass(self, body: int) -> Array:
        """Jacobian (6, n) of the centre of mass of `body`, in world axes, for its tree; valid until the next call."""
        mujoco.mj_jacBodyCom(self.model, self.data, self._rows[:3], self._rows[3:], body)
        return self._rows[:, self.trees[self.tree_of[body]]]

    def block(self, tree: int, matrix_of: Callable[[BodyHydrodynamics], Array]) -> Array:
        """Sum of J_b^T X_b J_b (n, n) of a tree, with X_b (6, 6) in body axes at the body origin."""
        count = self.trees[tree].stop - self.trees[tree].start
        total = np.zeros((count, count))
        for i in self.bodies_of[tree]:
            X = matrix_of(self.bodies[i])
            if X.any():
                total[_square(self._local(i))] += self._jacobians[i].T @ X @ self._jacobians[i]
        return total

    def dense(self, matrix_of: Callable[[BodyHydrodynamics], Array]) -> Array:
        """The matrix (nv, nv) that has each tree's `block` on its diagonal."""
        total = np.zeros((self.model.nv, self.model.nv))
        for k, tree in enumerate(self.trees):
            total[tree, tree] = self.block(k, matrix_of)
        return total

    def stacked(self, tree: int) -> "csr_array":
        """The Jacobians of a tree's wet bodies (6 b, n), one below the other."""
        from scipy.sparse import csr_array  # slow to import, and for large trees alone

        bodies, count = self.bodies_of[tree], self.trees[tree].stop - self.trees[tree].start
        columns = [np.tile(self._local(i), 6) for i in bodies]
        ends = np.cumsum([0, *(len(self.movers[i]) for i in bodies for _ in range(6))])
        values = [self._jacobians[i].ravel() for i in bodies]
        return csr_array((np.concatenate(values), np.concatenate(columns), ends), shape=(6 * len(bodies), count))

    def force(self, wrench_of: Callable[[int, BodyHydrodynamics], Array]) -> Array:
        """Sum of J_b^T f_b (nv,), with f_b (6,) in body axes at the body origin, of a body's index and coefficients."""
        total = np.zeros(self.model.nv)
        for i, body in self.bodies.items():
            total[self.movers[i]] += self._jacobians[i].T @ wrench_of(i, body)
        return total

    def _local(self, body: int) -> Indices:
        """The `movers` of a body, counted from the first degree of freedom of its tree."""
        return self.movers[body] - self.trees[self.tree_of[body]].start

    def _at_origin(self, body: int) -> Array:
        """Jacobian (6, k) of the origin of `body`, in body axes, for its `movers`."""
        mujoco.mj_jacBody(self.model, self.data, self._rows[:3], self._rows[3:], body)
        J = self._rows[:, self.movers[body]]
        R_BW = self.data.xmat[body].reshape(3, 3).T
        return np.vstack([R_BW @ J[:3], R_BW @ J[3:]])


class WetInertia:
    """Inverse of M + A, and the rate of the drag, at a state.

    Mobility is velocity per impulse: J inv(M + A) J^T.
    """

    def __init__(self, sums: TreeSums) -> None:
        """Factors M + A.

        Args:
            sums: Sums at the state, whose `data.M` has the dry inertia. Its `data.M` and `data.qLD` become those of
                M + A if a tree is large.

        Raises:
            HydrodynamicsError: M + A is not positive definite.
        """
        self.sums = sums
        blocks = [_dry_block(sums, k) + sums.block(k, lambda body: body.added_mass) for k in range(len(sums.trees))]
        self.diagonal = np.concatenate([np.diag(block) for block in blocks])  # (nv,) of M + A
        try:
            self._trees = _factored(sums, blocks)
        except np.linalg.LinAlgError as error:
            raise HydrodynamicsError(
                f"the inertia with the added mass is not positive definite at qpos0 (its diagonal runs from "
                f"{self.diagonal.min():.3g} to {self.diagonal.max():.3g})"
            ) from error

    def of_body(self, body: int) -> Array:
        """Mobility (6,) of the centre of mass of a movable body along the world axes, linear and angular."""
        return self._trees[self.sums.tree_of[body]].mobility(self.sums.at_center_of_mass(body))

    def of_dofs(self) -> Array:
        """Mobility (nv,) of each degree of freedom: the diagonal of inv(M + A)."""
        return np.concatenate([tree.diagonal() for tree in self._trees])

    def along(self, columns: Indices, values: Array) -> float:
        """Mobility along a row of nv numbers, given by its `columns` and their `values`, such as that of a tendon."""
        return sum(self._trees[k].along(dofs, part) for k, dofs, part in self._parts(columns, values))

    def accelerations(self, columns: Indices, values: Array) -> Array:
        """inv(M + A) f of the trees that a force f touches, given by its `columns` and their `values`."""
        parts = [self._trees[k].solve(dofs, part) for k, dofs, part in self._parts(columns, values)]
        return np.concatenate([np.zeros(0), *parts])

    def drag_rate(self, slope_of: Callable[[BodyHydrodynamics], Array]) -> float:
        """Largest rate [1/s] of drag over inertia: largest eigenvalue of inv(M + A) D.

        Args:
            slope_of: Symmetric damping (6, 6) of a body, in body axes at its origin.
        """
        return max(tree.largest_rate(slope_of) for tree in self._trees)

    def _parts(self, columns: Indices, values: Array) -> Iterator[tuple[int, Indices, Array]]:
        """Index of each tree that a row touches, its columns counted within the tree, and their values."""
        owners = self.sums.model.dof_treeid[columns]
        for k in np.unique(owners):
            mine = owners == k
            yield int(k), columns[mine] - self.sums.trees[k].start, values[mine]


class _Tree(Protocol):
    """Factored block of M + A of one kinematic tree; `dofs` count within the tree."""

    def mobility(self, rows: Array) -> Array:
        """Diagonal of rows inv(M + A) rows^T (r,), with `rows` (r, n)."""
        ...

    def along(self, dofs: Indices, values: Array) -> float:
        """The mobility of a single row with `values` (k,) at `dofs`."""
        ...

    def diagonal(self) -> Array:
        """Diagonal of inv(M + A)."""
        ...

    def solve(self, dofs: Indices, values: Array) -> Array:
        """inv(M + A) f (n,) of a force with `values` (k,) at `dofs`."""
        ...

    def largest_rate(self, slope_of: Callable[[BodyHydrodynamics], Array]) -> float:
        """Largest eigenvalue of inv(M + A) D, with D the sum over the bodies of `slope_of` them."""
        ...


class _SmallTree:
    """A tree for which LAPACK does everything."""

    def __init__(self, sums: TreeSums, tree: int, block: Array) -> None:
        self._sums = sums
        self._tree = tree
        self._factor = np.linalg.inv(np.linalg.cholesky(block))  # inv(M + A) = factor^T factor
        self._inverse: np.ndarray = np.linalg.inv(block)

    def mobility(self, rows: Array) -> Array:
        return _mobility(self._inverse, rows)

    def along(self, dofs: Indices, values: Array) -> float:
        return float(values @ self._inverse[_square(dofs)] @ values)

    def diagonal(self) -> Array:
        return np.diag(self._inverse)

    def solve(self, dofs: Indices, values: Array) -> Array:
        return self._inverse[:, dofs] @ values

    def largest_rate(self, slope_of: Callable[[BodyHydrodynamics], Array]) -> float:
        slope = self._sums.block(self._tree, slope_of)
        return float(np.linalg.eigvalsh(self._factor @ slope @ self._factor.T)[-1])


class _LargeTree:
    """A tree that MuJoCo's sparse factor solves, and whose mobilities are from an inverse if that is not too large."""

    def __init__(self, sums: TreeSums, tree: int, block: Array) -> None:
        """Takes `block`, which is a part of the inertia that `sums.data` has the factor of."""
        self._sums = sums
        self._tree = tree
        self._block = block
        self._inverse: np.ndarray | None = np.linalg.inv(block) if len(block) <= LARGEST_INVERSE else None

    def mobility(self, rows: Array) -> Array:
        if self._inverse is not None:
            return _mobility(self._inverse, rows)
        return np.sum(rows * self._solved(rows), axis=1)

    def along(self, dofs: Indices, values: Array) -> float:
        return float(values @ self.solve(dofs, values)[dofs])

    def diagonal(self) -> Array:
        if self._inverse is not None:
            return np.diag(self._inverse)
        count = len(self._block)
        starts = range(0, count, _ROWS)
        return np.concatenate([self.mobility(np.eye(min(_ROWS, count - k), count, k)) for k in starts])

    def solve(self, dofs: Indices, values: Array) -> Array:
        force = np.zeros((1, len(self._block)))
        force[0, dofs] = values
        return self._solved(force)[0]

    def largest_rate(self, slope_of: Callable[[BodyHydrodynamics], Array]) -> float:
        from scipy.sparse import csr_array  # slow to import, and for large trees alone
        from scipy.sparse.linalg import LinearOperator, eigsh

        bodies = [self._sums.bodies[i] for i in self._sums.bodies_of[self._tree]]
        slopes = np.array([slope_of(body) for body in bodies])
        if not slopes.any():
            return 0.0
        J = self._sums.stacked(self._tree)
        transposed = J.T.tocsr()

        def drag(qvel: Array) -> Array:
            return transposed @ np.einsum("bij,bj->bi", slopes, (J @ qvel).reshape(-1, 6)).ravel()

        def inverse(force: Array) -> Array:
            return self._solved(force.reshape(1, -1))[0]

        shape = self._block.shape
        largest = eigsh(
            LinearOperator(shape, matvec=drag, dtype=float),
            k=1,
            M=csr_array(self._block),  # sparse: threads of BLAS would wait for each other at each product
            Minv=LinearOperator(shape, matvec=inverse, dtype=float),
            which="LA",
            ncv=_LANCZOS_VECTORS,
            v0=np.ones(shape[0]),  # ARPACK would draw it at random
            tol=_RATE_TOLERANCE,
            return_eigenvectors=False,
        )
        return float(largest[0])

    def _solved(self, rows: Array) -> Array:
        """inv(M + A) times each of `rows` (r, n), as rows."""
        forces = np.zeros((len(rows), self._sums.model.nv))
        columns = self._sums.trees[self._tree]
        forces[:, columns] = rows
        solved = np.empty_like(forces)
        mujoco.mj_solveM(self._sums.model, self._sums.data, solved, forces)
        return solved[:, columns]


def _factored(sums: TreeSums, blocks: list[Array]) -> list[_Tree]:
    """The trees with the `blocks` of M + A.

    Raises:
        np.linalg.LinAlgError: A block is not positive definite.
    """
    if any(len(block) > LARGEST_SMALL for block in blocks):
        _factor_by_mujoco(sums, blocks)
    return [
        (_SmallTree if len(block) <= LARGEST_SMALL else _LargeTree)(sums, k, block) for k, block in enumerate(blocks)
    ]


def _factor_by_mujoco(sums: TreeSums, blocks: list[Array]) -> None:
    """Puts M + A and its factor into `sums.data`.

    Raises:
        np.linalg.LinAlgError: A block is not positive definite.
    """
    for tree, block in zip(sums.trees, blocks, strict=True):
        entries, rows, columns = _entries(sums.model, tree)
        sums.data.M[entries] = block[rows, columns]
    mujoco.mj_factorM(sums.model, sums.data)
    if sums.data.warning[mujoco.mjtWarning.mjWARN_INERTIA].number or not np.all(sums.data.qLDiagInv > 0.0):
        raise np.linalg.LinAlgError("a pivot of the factor is not positive")


def _mobility(inverse: np.ndarray, rows: Array) -> Array:
    # Over all columns of the tree, also zeros: in a long chain the terms cancel, and another order of summation would
    # change the eleventh digit.
    return np.einsum("ij,jk,ik->i", rows, inverse, rows)


def _square(dofs: Indices) -> tuple[Any, ...]:
    """Index of the rows and columns `dofs`, ascending, of a matrix; as a view where they are neighbours."""
    if len(dofs) and dofs[-1] - dofs[0] == len(dofs) - 1:
        part = slice(int(dofs[0]), int(dofs[-1]) + 1)
        return part, part
    return np.ix_(dofs, dofs)


def _dry_block(sums: TreeSums, tree: int) -> Array:
    """The dry inertia M (n, n) of a tree."""
    entries, rows, columns = _entries(sums.model, sums.trees[tree])
    count = sums.trees[tree].stop - sums.trees[tree].start
    block = np.zeros((count, count))
    block[rows, columns] = block[columns, rows] = sums.data.M[entries]
    return block


def _entries(model: mujoco.MjModel, tree: slice) -> tuple[slice, Indices, Indices]:
    """Entries of `data.M` that belong to a tree: their place, and their rows and columns within its block.

    `data.M` holds the lower triangle by rows, and of each row the columns of the ancestors.
    """
    counts = model.M_rownnz[tree]
    start = int(model.M_rowadr[tree.start])
    entries = slice(start, start + int(counts.sum()))
    rows = np.repeat(np.arange(len(counts)), counts)
    return entries, rows, model.M_colind[entries] - tree.start


def _moving_dofs(model: mujoco.MjModel) -> list[Indices]:
    """Degrees of freedom that move each body, ascending: its own and those of its ancestors."""
    parents, starts, counts = model.body_parentid.tolist(), model.body_dofadr.tolist(), model.body_dofnum.tolist()
    movers: list[Indices] = [np.zeros(0, dtype=int)]
    for parent, start, count in zip(parents[1:], starts[1:], counts[1:], strict=True):
        inherited = movers[parent]
        movers.append(np.concatenate([inherited, np.arange(start, start + count)]) if count else inherited)
    return movers
