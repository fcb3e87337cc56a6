"""Joint-space inertia M + A of a model with added mass, its inverse, and the rate of its drag,
block by block.

Bodies of different kinematic trees share no degree of freedom, so M + A and the slope of the drag
are block diagonal, and the cost is linear in the number of trees. A model of up to LARGEST_SMALL
degrees of freedom is nevertheless treated as one block. The vehicles are such models, and the last
digits of their trajectories depend on the rounding of the whole inverse. The method for a block
depends on its degrees of freedom:

- Up to LARGEST_SMALL: by LAPACK.
- More: by MuJoCo's sparse factor, whose cost is the square of the tree's depth for each degree of
  freedom. The largest rate of the drag is computed by Lanczos iteration.
- Up to LARGEST_INVERSE, contact weights are nevertheless computed from LAPACK's inverse. M + A of a
  long chain is so ill-conditioned (1e9 with 200 links) that weights by two factorisations differ in
  the ninth digit.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from uuv.models.hydrodynamics import BodyHydrodynamics
from uuv.sim.interfaces.errors import HydrodynamicsError
from uuv.sim.interfaces.spatial import Array

if TYPE_CHECKING:
    from scipy.sparse import csr_array

Indices = NDArray[np.integer]

LARGEST_SMALL = 64  # degrees of freedom
LARGEST_INVERSE = 320  # degrees of freedom

_ROWS = 256  # right-hand sides that are solved for at a time, which bounds the memory
_RATE_TOLERANCE = 1e-6  # relative tolerance of the drag rate of a large block
# ARPACK's 20 take three times as many iterations where eigenvalues cluster, as in long chains
_LANCZOS_VECTORS = 40


class BlockSums:
    """Sums over the bodies with coefficients in joint space, at one state, as uncoupled blocks."""

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, bodies: Mapping[int, BodyHydrodynamics]
    ) -> None:
        """Compute the Jacobians of the bodies.

        Args:
            model: Compiled model.
            data: State whose kinematics and comPos are up to date.
            bodies: Coefficients of movable bodies, by index.
        """
        self.model = model
        self.data = data
        self.bodies = bodies

        # Degrees of freedom of each block, and the block of each movable body and degree of
        # freedom.
        if model.nv <= LARGEST_SMALL:
            self.dofs = [slice(0, model.nv)]
            self.block_of = [0] * model.nbody
            self.owners = np.zeros(model.nv, dtype=int)
        else:
            ends = zip(model.tree_dofadr.tolist(), model.tree_dofnum.tolist(), strict=True)
            self.dofs = [slice(start, start + count) for start, count in ends]
            self.block_of = model.body_treeid.tolist()
            self.owners = np.array(model.dof_treeid)

        self.movers = _moving_dofs(model)
        self.bodies_of: list[list[int]] = [[] for _ in self.dofs]
        for i in bodies:
            self.bodies_of[self.block_of[i]].append(i)

        self._rows = np.zeros((6, model.nv))  # array for one Jacobian, which MuJoCo clears
        self._jacobians = {i: self._at_origin(i) for i in bodies}

    def at_center_of_mass(self, body: int) -> Array:
        """Jacobian (6, n) of a body's centre of mass in W axes, for its block; valid until the next
        call.
        """
        mujoco.mj_jacBodyCom(self.model, self.data, self._rows[:3], self._rows[3:], body)
        return self._rows[:, self.dofs[self.block_of[body]]]

    def count(self, block: int) -> int:
        """Number of degrees of freedom of a block."""
        return self.dofs[block].stop - self.dofs[block].start

    def block(self, block: int, matrix_of: Callable[[BodyHydrodynamics], Array]) -> Array:
        """Sum of J_b^T X_b J_b (n, n) of a block, X_b (6, 6) in body axes at the body origin."""
        total = np.zeros((self.count(block), self.count(block)))
        for i in self.bodies_of[block]:
            X = matrix_of(self.bodies[i])
            if X.any():
                total[_square(self._local(i))] += self._jacobians[i].T @ X @ self._jacobians[i]
        return total

    def dense(self, matrix_of: Callable[[BodyHydrodynamics], Array]) -> Array:
        """The matrix (nv, nv) with each `block` on its diagonal."""
        total = np.zeros((self.model.nv, self.model.nv))
        for k, dofs in enumerate(self.dofs):
            total[dofs, dofs] = self.block(k, matrix_of)
        return total

    def stacked(self, block: int) -> "csr_array":
        """The Jacobians of the bodies of a block with coefficients (6 b, n), stacked."""
        from scipy.sparse import csr_array  # slow to import, and only needed for large blocks

        bodies = self.bodies_of[block]
        columns = [np.tile(self._local(i), 6) for i in bodies]
        ends = np.cumsum([0, *(len(self.movers[i]) for i in bodies for _ in range(6))])
        entries = [self._jacobians[i].ravel() for i in bodies]

        return csr_array(
            (np.concatenate(entries), np.concatenate(columns), ends),
            shape=(6 * len(bodies), self.count(block)),
        )

    def force(self, wrench_of: Callable[[int, BodyHydrodynamics], Array]) -> Array:
        """Sum of J_b^T f_b (nv,), with f_b (6,) in body axes at the body origin; `wrench_of` takes
        a body's index and coefficients.
        """
        total = np.zeros(self.model.nv)
        for i, body in self.bodies.items():
            total[self.movers[i]] += self._jacobians[i].T @ wrench_of(i, body)
        return total

    def _local(self, body: int) -> Indices:
        """The `movers` of a body, counted from the first degree of freedom of its block."""
        return self.movers[body] - self.dofs[self.block_of[body]].start

    def _at_origin(self, body: int) -> Array:
        """Jacobian (6, k) of the origin of `body`, in body axes, for its `movers`."""
        mujoco.mj_jacBody(self.model, self.data, self._rows[:3], self._rows[3:], body)
        J = self._rows[:, self.movers[body]]
        R_BW = self.data.xmat[body].reshape(3, 3).T
        return np.vstack([R_BW @ J[:3], R_BW @ J[3:]])


class WetInertia:
    """Inverse of M + A, and the rate of the drag, at one state.

    Mobility is velocity per impulse: J inv(M + A) J^T.
    """

    def __init__(self, sums: BlockSums) -> None:
        """Factor M + A.

        Args:
            sums: Sums at the state. On input, `data.M` is the dry inertia. If a block is large,
                `data.M` and `data.qLD` are replaced by those of M + A.

        Raises:
            HydrodynamicsError: M + A is not positive definite.
        """
        self.sums = sums
        blocks = [
            _dry_block(sums, k) + sums.block(k, lambda body: body.added_mass)
            for k in range(len(sums.dofs))
        ]
        # (nv,) diagonal of M + A
        self.diagonal = np.concatenate([np.diag(block) for block in blocks])
        try:
            self._blocks = _factored(sums, blocks)
        except np.linalg.LinAlgError as error:
            raise HydrodynamicsError(
                "the inertia with the added mass is not positive definite at qpos0 (its diagonal "
                f"runs from {self.diagonal.min():.3g} to {self.diagonal.max():.3g})"
            ) from error

    def of_body(self, body: int) -> Array:
        """Mobility (6,) of a movable body's centre of mass along W axes, linear and angular."""
        return self._blocks[self.sums.block_of[body]].mobility(self.sums.at_center_of_mass(body))

    def of_dofs(self) -> Array:
        """Mobility (nv,) of each degree of freedom: the diagonal of inv(M + A)."""
        return np.concatenate([block.diagonal() for block in self._blocks])

    def along(self, columns: Indices, values: Array) -> float:
        """Mobility along a row of nv numbers, by its `columns` and `values`, such as a tendon's."""
        return sum(
            self._blocks[k].along(dofs, part) for k, dofs, part in self._parts(columns, values)
        )

    def accelerations(self, columns: Indices, values: Array) -> Array:
        """inv(M + A) f for the blocks in which a force f, given by its `columns` and `values`, is
        not zero.
        """
        parts = [
            self._blocks[k].solve(dofs, part) for k, dofs, part in self._parts(columns, values)
        ]
        return np.concatenate([np.zeros(0), *parts])

    def drag_rate(self, slope_of: Callable[[BodyHydrodynamics], Array]) -> float:
        """Largest rate [1/s] of drag over inertia: largest eigenvalue of inv(M + A) D.

        Args:
            slope_of: Symmetric damping (6, 6) of a body, in body axes at its origin.
        """
        return max(block.largest_rate(slope_of) for block in self._blocks)

    def _parts(self, columns: Indices, values: Array) -> Iterator[tuple[int, Indices, Array]]:
        """For each block with entries of a row: its index, the columns within the block, and the
        values.
        """
        owners = self.sums.owners[columns]
        for k in np.unique(owners):
            in_block = owners == k
            yield int(k), columns[in_block] - self.sums.dofs[k].start, values[in_block]


class _Block(Protocol):
    """Block of M + A with its factor; indices `dofs` count within the block."""

    def mobility(self, rows: Array) -> Array:
        """Diagonal (r,) of `rows @ inv(M + A) @ rows.T`; `rows` has shape (r, n)."""
        ...

    def along(self, dofs: Indices, values: Array) -> float:
        """Mobility of a single row with `values` (k,) at `dofs`."""
        ...

    def diagonal(self) -> Array:
        """Diagonal of inv(M + A)."""
        ...

    def solve(self, dofs: Indices, values: Array) -> Array:
        """Acceleration `inv(M + A) @ f` (n,) by a force f that has `values` (k,) at `dofs`."""
        ...

    def largest_rate(self, slope_of: Callable[[BodyHydrodynamics], Array]) -> float:
        """Largest eigenvalue of inv(M + A) D, where D is the sum of `slope_of` over the bodies."""
        ...


class _SmallBlock:
    """A block that is solved by LAPACK."""

    def __init__(self, sums: BlockSums, index: int, block: Array) -> None:
        self._sums = sums
        self._index = index
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
        slope = self._sums.block(self._index, slope_of)
        return float(np.linalg.eigvalsh(self._factor @ slope @ self._factor.T)[-1])


class _LargeBlock:
    """A block that is solved by MuJoCo's sparse factor. Mobilities use an inverse unless it is too
    large.
    """

    def __init__(self, sums: BlockSums, index: int, block: Array) -> None:
        """Take `block`, a block of the inertia whose factor is in `sums.data`."""
        self._sums = sums
        self._index = index
        self._block = block
        self._inverse: np.ndarray | None = (
            np.linalg.inv(block) if len(block) <= LARGEST_INVERSE else None
        )

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
        return np.concatenate(
            [self.mobility(np.eye(min(_ROWS, count - k), count, k)) for k in starts]
        )

    def solve(self, dofs: Indices, values: Array) -> Array:
        force = np.zeros((1, len(self._block)))
        force[0, dofs] = values
        return self._solved(force)[0]

    def largest_rate(self, slope_of: Callable[[BodyHydrodynamics], Array]) -> float:
        from scipy.sparse import csr_array  # slow to import, and only needed for large blocks
        from scipy.sparse.linalg import LinearOperator, eigsh

        bodies = [self._sums.bodies[i] for i in self._sums.bodies_of[self._index]]
        slopes = np.array([slope_of(body) for body in bodies])
        if not slopes.any():
            return 0.0

        J = self._sums.stacked(self._index)
        transposed = J.T.tocsr()

        def drag(qvel: Array) -> Array:
            return transposed @ np.einsum("bij,bj->bi", slopes, (J @ qvel).reshape(-1, 6)).ravel()

        def inverse(force: Array) -> Array:
            return self._solved(force.reshape(1, -1))[0]

        shape = self._block.shape
        largest = eigsh(
            LinearOperator(shape, matvec=drag, dtype=float),
            k=1,
            # sparse, because BLAS threads would wait for each other at each product
            M=csr_array(self._block),
            Minv=LinearOperator(shape, matvec=inverse, dtype=float),
            which="LA",
            ncv=_LANCZOS_VECTORS,
            v0=np.ones(shape[0]),  # otherwise ARPACK would draw the start vector at random
            tol=_RATE_TOLERANCE,
            return_eigenvectors=False,
        )

        return float(largest[0])

    def _solved(self, rows: Array) -> Array:
        """inv(M + A) times each row of `rows` (r, n), as rows."""
        forces = np.zeros((len(rows), self._sums.model.nv))
        columns = self._sums.dofs[self._index]
        forces[:, columns] = rows
        solved = np.empty_like(forces)
        mujoco.mj_solveM(self._sums.model, self._sums.data, solved, forces)
        return solved[:, columns]


def _factored(sums: BlockSums, blocks: list[Array]) -> list[_Block]:
    """Make the `blocks` of M + A with their factors.

    Raises:
        np.linalg.LinAlgError: A block is not positive definite.
    """
    if any(len(block) > LARGEST_SMALL for block in blocks):
        _factor_by_mujoco(sums, blocks)
    return [
        (_SmallBlock if len(block) <= LARGEST_SMALL else _LargeBlock)(sums, k, block)
        for k, block in enumerate(blocks)
    ]


def _factor_by_mujoco(sums: BlockSums, blocks: list[Array]) -> None:
    """Write M + A and its factor into `sums.data`.

    Raises:
        np.linalg.LinAlgError: A block is not positive definite.
    """
    for dofs, block in zip(sums.dofs, blocks, strict=True):
        entries, rows, columns = _entries(sums.model, dofs)
        sums.data.M[entries] = block[rows, columns]
    mujoco.mj_factorM(sums.model, sums.data)

    if sums.data.warning[mujoco.mjtWarning.mjWARN_INERTIA].number or not np.all(
        sums.data.qLDiagInv > 0.0
    ):
        raise np.linalg.LinAlgError("a pivot of the factor is not positive")


def _mobility(inverse: np.ndarray, rows: Array) -> Array:
    # The sum runs over all columns of the block, including zeros. In a long chain the terms cancel,
    # and another order of summation would change the eleventh digit.
    return np.einsum("ij,jk,ik->i", rows, inverse, rows)


def _square(dofs: Indices) -> tuple[Any, ...]:
    """Index of rows and columns `dofs`, ascending, of a matrix; a view if they are neighbours."""
    if len(dofs) and dofs[-1] - dofs[0] == len(dofs) - 1:
        part = slice(int(dofs[0]), int(dofs[-1]) + 1)
        return part, part
    return np.ix_(dofs, dofs)


def _dry_block(sums: BlockSums, index: int) -> Array:
    """The dry inertia M (n, n) of a block."""
    entries, rows, columns = _entries(sums.model, sums.dofs[index])
    block = np.zeros((sums.count(index), sums.count(index)))
    block[rows, columns] = block[columns, rows] = sums.data.M[entries]
    return block


def _entries(model: mujoco.MjModel, dofs: slice) -> tuple[slice, Indices, Indices]:
    """Entries of `data.M` that belong to the block of `dofs`: their indices, and their rows and
    columns within the block.

    `data.M` holds the lower triangle by rows, and in each row the columns of the ancestors.
    """
    counts = model.M_rownnz[dofs]
    start = int(model.M_rowadr[dofs.start])
    entries = slice(start, start + int(counts.sum()))
    rows = np.repeat(np.arange(len(counts)), counts)
    return entries, rows, model.M_colind[entries] - dofs.start


def _moving_dofs(model: mujoco.MjModel) -> list[Indices]:
    """Degrees of freedom that move each body, in ascending order: its own and those of its
    ancestors.
    """
    parents = model.body_parentid.tolist()
    starts = model.body_dofadr.tolist()
    counts = model.body_dofnum.tolist()
    movers: list[Indices] = [np.zeros(0, dtype=int)]
    for parent, start, count in zip(parents[1:], starts[1:], counts[1:], strict=True):
        inherited = movers[parent]
        movers.append(
            np.concatenate([inherited, np.arange(start, start + count)]) if count else inherited
        )
    return movers
