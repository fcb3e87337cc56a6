"""Foresight of a planner: the set points of its next periods, and bounds within which they hold.

A phase that only follows a path needs no estimate. Its planner then returns the set points of
several periods at once, together with bounds on the estimates that it monitors. Compiled ticks take
the set points row by row, each at the time for which it was made. At the first estimate beyond a
bound they stop, and the planner makes its usual step. A run therefore has the same bits with
foresight and without.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, TypeGuard

import numpy as np

from uuv.sim.interfaces.kernels.slots import gives_kernel
from uuv.sim.interfaces.kernels.stored import kernel
from uuv.sim.interfaces.messages import (
    JawReference,
    Reference,
    StateEstimate,
    Target,
    TurnReference,
)
from uuv.sim.interfaces.records import FOLLOWS, ReferenceRecord, reference_record, take_reference
from uuv.sim.interfaces.spatial import Array

ROWS = 64  # most periods that a table holds
# Share of a bound by which the table's bound is narrower. A kernel may round a magnitude
# differently from the planner, so that every value that the planner may see beyond its bound goes
# to the planner.
_ROUNDING = 1e-9


class EstimateBounds(NamedTuple):
    """Largest values of the estimate for which the foreseen set points hold."""

    off: float = np.inf  # [m] of the hull from its reference
    speed: float = np.inf  # [m/s] of the hull
    turn: float = np.inf  # [rad/s] of the hull
    normal: float = np.inf  # [N] estimated normal force
    # [N] minus the estimated normal force, so that -8.0 requires at least 8 N
    slack: float = np.inf
    force: float = np.inf  # [N] magnitude of the estimated contact force, in any direction
    sigma: float = np.inf  # [N] standard deviation of the normal force
    moved: float = np.inf  # [m] of the object, as the camera on the arm sees it

    def and_within(self, *others: "EstimateBounds") -> "EstimateBounds":
        """The narrower bound of each pair."""
        return EstimateBounds(*map(min, self, *others)) if others else self


@dataclass(frozen=True, slots=True, eq=False)
class Foresight:
    """Set points of the next periods of a planner, beginning with the period after the present
    one.
    """

    references: Sequence[Reference]
    times: Sequence[float]  # [s] times of the estimates that they belong to
    within: Sequence[EstimateBounds]
    seen: tuple[StateEstimate, Target | None]  # estimate and state that they were made from
    after: Any = None  # state of the planner after the last of them, where that is known


class Foresees(Protocol):
    """Planner that has foresight."""

    def ahead(
        self, state: Any, estimate: StateEstimate, target: Target | None, times: Sequence[float]
    ) -> Foresight | None:
        """The next periods, as far as they depend on time alone; None if not even the next one
        does.

        Args:
            state: State after the present step; it is not changed.
            estimate: Estimate of the present step.
            target: Newest target, or None.
            times: [s] Times of the estimates of the next steps.
        """
        ...

    def followed(self, state: Any, foresight: Foresight, periods: int) -> Any:
        """State after `periods` of the foreseen periods, where `foresight` is the result of `ahead`
        for `state`.
        """
        ...


def foresees(planner: object) -> TypeGuard[Foresees]:
    """True if `planner` has foresight (`gives_kernel`)."""
    return gives_kernel(planner, "ahead")


class TableRecord(NamedTuple):
    """Foreseen periods as rows of arrays."""

    references: ReferenceRecord  # arrays with ROWS rows each
    times: Array  # (ROWS,) [s]
    bounds: Array  # (ROWS, number of `EstimateBounds`)
    rows: np.ndarray  # (2,) number of rows taken, and of all rows


class ReferenceTable:
    """Rows for the compiled ticks, filled again with each new foresight."""

    def __init__(self, joints: int) -> None:
        """Allocate the table for a vehicle with `joints` joints."""
        row = reference_record(joints)
        stacked = ReferenceRecord(*(np.repeat(array[None], ROWS, axis=0) for array in row))
        self._views = [ReferenceRecord(*(array[k] for array in stacked)) for k in range(ROWS)]
        self._references: Sequence[Reference] = ()
        self.record = TableRecord(
            references=stacked,
            times=np.zeros(ROWS),
            bounds=np.full((ROWS, len(EstimateBounds())), np.inf),
            rows=np.zeros(2, dtype=np.int64),
        )

    @property
    def taken(self) -> int:
        """Number of rows taken so far."""
        return int(self.record.rows[0])

    def present(self) -> Reference | None:
        """Set points of the row last taken; None before the first."""
        taken = self.taken
        return self._references[taken - 1] if taken else None

    def fill(self, foresight: Foresight) -> None:
        """Write foreseen periods into the table, at most `ROWS`."""
        record = self.record
        self._references = foresight.references
        count = len(self._references)
        for view, reference in zip(self._views, self._references, strict=False):
            take_reference(view, reference)
        record.times[:count] = foresight.times

        # Narrowest bounds, made narrower than the planner's by the size of a rounding error.
        bounds = record.bounds[:count]
        bounds[:] = foresight.within
        finite = np.isfinite(bounds)
        bounds[finite] -= _ROUNDING * np.abs(bounds[finite])
        record.rows[:] = 0, count

    def clear(self) -> None:
        """Remove all rows."""
        self.record.rows[:] = 0


@kernel
def take_row(table, estimate, command, reference):
    """Take the next row of a table as the set points, if the estimate is within the row's bounds.

    Args:
        table: `TableRecord`; updated.
        estimate: Present `EstimateRecord` of the vehicle.
        command: `Commanded` of the previous tick.
        reference: `ReferenceRecord` of the previous period; updated.

    Returns:
        False if the planner has to decide.
    """
    row = table.rows[0]
    if row == table.rows[1] or estimate.time[0] != table.times[row]:
        return False

    # Values of the estimate, in the order of `EstimateBounds`.
    off = speed = turn = moved = force = 0.0
    for i in range(3):
        off += (estimate.X_WB[i, 3] - reference.X_WB[i, 3]) ** 2
        speed += estimate.v_WB_B[i] ** 2
        turn += estimate.w_WB_B[i] ** 2
        force += command.f_W[i] ** 2
        moved += estimate.object_moved_W[i] ** 2
    felt = command.felt[0]
    force += felt**2
    seen = (
        np.sqrt(off),
        np.sqrt(speed),
        np.sqrt(turn),
        felt,
        -felt,
        np.sqrt(force),
        command.sigma_G[2],
        np.sqrt(moved),
    )
    for k in range(len(seen)):
        bound = table.bounds[row, k]
        if bound < np.inf and not seen[k] <= bound:
            return False

    _copy_row(table.references, row, reference)
    table.rows[0] = row + 1
    return True


@kernel
def _copy_row(rows, at, record):
    """Copy row `at` of a ReferenceRecord of rows into `record`, in the form that `take_reference`
    writes.
    """
    record.time[0] = rows.time[at, 0]
    record.set_force[0] = rows.set_force[at, 0]
    for k in range(record.flags.shape[0]):
        record.flags[k] = rows.flags[at, k]

    follows = record.flags[FOLLOWS]
    for i in range(4):
        for j in range(4):
            record.X_WB[i, j] = rows.X_WB[at, i, j]
            if follows:
                record.X_WG[i, j] = rows.X_WG[at, i, j]

    for i in range(3):
        record.v_WB_W[i] = rows.v_WB_W[at, i]
        record.w_WB_W[i] = rows.w_WB_W[at, i]
        record.v_WG_W[i] = rows.v_WG_W[at, i]
        record.w_WG_W[i] = rows.w_WG_W[at, i]

    for j in range(record.q.shape[0]):
        record.q[j] = rows.q[at, j]
        record.qd[j] = rows.qd[at, j]


def is_plain(reference: Reference) -> bool:
    """True if set points fit into a row: they request nothing from sensors, navigation, jaws and
    observers.
    """
    if reference.scan or isinstance(reference, JawReference | TurnReference):
        return False
    return reference.at_rest is None and reference.touch is None
