"""Thrust allocation from the hull wrench to thruster commands, within bounds, by the static thrust
curve.

Six thrusters leave no redundancy. If thrusters saturate, part of the wrench is given up by strict
priority levels (`uuv.controllers.hull.priorities`) in the order of `PRIORITIES`, not by weights.
Roll and pitch come first, because a tilt of the hull tilts the tool and moves the tip by the tilt
times the length of the arm. The force comes next: if it is too small, the hull is pushed away
slowly and the arm re-aims. Yaw is last. Among thrusts that are equal in all this, those of least
effort are chosen.

If no thrusters drive roll or pitch, weight and buoyancy right the hull. That axis then is in no
level (`undriven_axes`), and the hull lists until weight and buoyancy balance the remaining moment.

A rotating propeller gives at least a minimal thrust: `uuv.controllers.hull.thruster_gaps` finds the
nearest thrusts that exist.
"""

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from uuv.controllers.hull.priorities import PRIORITIES, solve_levels
from uuv.controllers.hull.thruster_gaps import (
    MOST_PATTERNS,
    nearest_thrusts,
    normal_equations,
    preloads,
)
from uuv.controllers.tuning import HULL
from uuv.models.vehicle import Vehicle
from uuv.models.water.thruster_curves import command_for
from uuv.models.water.thrusters import FORWARD, LEAST, REVERSE, curves
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array, checked, fitting

# order of a wrench on the hull, hull axes
AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
# axes that weight and buoyancy stabilise if no thrusters do
RIGHTED = ("pitch", "roll")
# [rad] largest list of a hull stabilised by weight and buoyancy, at which it has to work
MOST_LIST = float(np.radians(20.0))
# [-] share of the largest entry of B, below which an entry is rounding noise and set to zero
_ROUNDING = 1e-12
# [m] lever, or share of a unit thrust, below which thrusters do not reach an axis
_REACHED = 1e-6
# [-] factor on the sum of all thrusts: a demand that always saturates, to measure the authority
_BEYOND = 1e3


# Entries of `AllocationRecord.numbers`: number of driven axes; not 0 if the thrusters span these;
# not 0 if a thruster has a gap; number of sign patterns
_AXES, _SPANS, _GAPS, _PATTERNS, _NUMBERS = range(5)


class AllocationRecord(NamedTuple):
    """Thrusters in use and priority levels, as arrays of the same size for all allocations of a
    vehicle.
    """

    numbers: np.ndarray  # (_NUMBERS,) int
    B: Array  # (6, m) wrench of unit thrusts; zero for a lost thruster
    order: np.ndarray  # (6,) int: axes by priority
    rows: Array  # (6, m) rows of `B`, in this order
    starts: np.ndarray  # (7,) int: first row of each level; the last entry is repeated
    inverse: Array  # (m, 6) thrusts of least effort for a wrench
    effort: Array  # (m,) cost weights
    low: Array  # (m,) [N] lower bounds
    high: Array  # (m,) [N] upper bounds
    least: Array  # (m,) [N] minimal thrusts
    patterns: np.ndarray  # (p, m) int: signs of `preloads`
    H: Array  # (m, m) matrix of `normal_equations`
    right: Array  # (m, 6) the right side for a wrench


def allocation_record(thrusters: int) -> AllocationRecord:
    """Record for `thrusters` thrusters, to be filled by `take_allocation`."""
    m = thrusters
    return AllocationRecord(
        numbers=np.zeros(_NUMBERS, dtype=np.int64),
        B=np.zeros((6, m)),
        order=np.zeros(6, dtype=np.int64),
        rows=np.zeros((6, m)),
        starts=np.zeros(7, dtype=np.int64),
        inverse=np.zeros((m, 6)),
        effort=np.zeros(m),
        low=np.zeros(m),
        high=np.zeros(m),
        least=np.zeros(m),
        patterns=np.zeros((MOST_PATTERNS, m), dtype=np.int64),
        H=np.zeros((m, m)),
        right=np.zeros((m, 6)),
    )


def take_allocation(record: AllocationRecord, allocation: AllocationRecord) -> None:
    """Write an allocation of the same vehicle into `record`."""
    for mine, other in zip(record, allocation, strict=True):
        mine[...] = other


@kernel
def allocate(allocation, wrench_B):
    """Thrusts (m,) [N] for a wrench (6,) [N, N m]: see `Allocation.thrust`."""
    a = allocation
    axes = a.numbers[_AXES]
    spans = a.numbers[_SPANS]
    thrust = a.inverse @ wrench_B

    # Within all bounds if possible, else by levels.
    m = thrust.shape[0]
    fits = spans != 0
    for i in range(m):
        fits = fits and a.low[i] <= thrust[i] <= a.high[i]
    if not fits:
        right = np.empty(axes)
        for row in range(axes):
            right[row] = wrench_B[a.order[row]]
        solve_levels(a.rows[:axes], right, a.starts, a.effort, a.low, a.high, thrust)

    # Thrusts are moved out of the gaps.
    in_gap = False
    for i in range(m):
        in_gap = in_gap or (thrust[i] != 0.0 and abs(thrust[i]) < a.least[i])
    if not (a.numbers[_GAPS] and in_gap):
        return thrust
    c = a.right @ (a.B @ thrust)
    return nearest_thrusts(a.H, c, a.low, a.high, a.least, a.patterns[: a.numbers[_PATTERNS]])


def undriven_axes(B: Array) -> tuple[str, ...]:
    """Axes of `RIGHTED` that thrusters with the wrenches B (6, m) do not drive, so that weight and
    buoyancy stabilise them.

    Empty if the thrusters span all six axes, or if they lack axes other than roll and pitch.
    """
    if _spans(B):
        return ()
    for axes in (("pitch",), ("roll",), RIGHTED):
        if _spans(np.delete(B, [AXES.index(axis) for axis in axes], axis=0)):
            lacking = np.linalg.svd(B)[0][:, _rank(B) :]
            weights = np.abs(lacking).max(axis=1)
            either = len(axes) == 1 and _spans(np.delete(B, AXES.index("roll"), axis=0))
            # of two possible axes, the one that the thrusters reach less
            if either and weights[AXES.index("roll")] > weights[AXES.index("pitch")]:
                return ("roll",)
            return axes
    return ()


def _spans(rows: Array) -> bool:
    return bool(rows.size) and _rank(rows) == len(rows)


def _rank(rows: Array) -> int:
    """Number of directions that thrusters reach significantly (`_REACHED`), not just beyond
    rounding.
    """
    return int(np.linalg.matrix_rank(rows, tol=_REACHED))


class Allocation:
    """Thrust allocation of one vehicle by strict priority levels."""

    def __init__(
        self,
        vehicle: Vehicle,
        *,
        priorities: Sequence[Sequence[str]] = PRIORITIES,
        effort: ArrayLike | None = None,
        headroom: float = HULL.headroom,
    ) -> None:
        """Set up the allocation for the thrusters of `vehicle`.

        Args:
            vehicle: the vehicle, with a thruster wrench matrix (6, m) and a table of its m
                thrusters.
            priorities: levels of names from `AXES`; if thrusters saturate, the first level has the
                highest priority. Within a level newtons and newton metres have the same weight. An
                axis in no level is not driven, nor is one of `undriven_axes`.
            effort: (m,) [-] cost weight of each thruster, > 0, equal by default. A thruster with a
                larger weight is used less if there is a choice.
            headroom: [-] share of full thrust that is used, in (0, 1].

        Raises:
            ConfigurationError: priorities, effort or headroom are invalid, or the thrusters do not
                span all driven directions.
        """
        m = vehicle.thruster_wrench.shape[1]
        effort = checked(np.ones(m) if effort is None else effort, (m,), "effort of the thrusters")
        if not np.all(effort > 0.0):
            raise ConfigurationError(f"effort of the thrusters: must be > 0, got {effort.tolist()}")
        if not 0.0 < headroom <= 1.0:
            raise ConfigurationError(f"headroom: must be in (0, 1], got {headroom}")

        spared = {AXES.index(axis) for axis in undriven_axes(vehicle.thruster_wrench)}
        levels = _driven_levels(priorities, spared)
        self._set_up(vehicle, levels, effort, headroom, np.zeros(m, dtype=bool))
        if not self.record.numbers[_SPANS]:
            driven = sum(map(len, levels))
            word = "six directions" if driven == 6 else f"{driven} driven directions"
            raise ConfigurationError(f"the {m} thrusters do not span all {word} of the hull")

    def _set_up(
        self,
        vehicle: Vehicle,
        levels: list[list[int]],
        effort: Array,
        headroom: float,
        lost: np.ndarray,
    ) -> None:
        self._of = (vehicle, levels, effort, headroom, lost)
        m = len(lost)
        self._record = r = allocation_record(m)

        # Levels.
        B = np.where(lost, 0.0, vehicle.thruster_wrench)
        B[np.abs(B) < _ROUNDING * np.abs(B).max(initial=0.0)] = 0.0  # noise would raise the rank
        order = np.array([axis for level in levels for axis in level])
        axes = len(order)
        rows = B[order]
        starts = np.cumsum([0, *map(len, levels)])
        r.B[:] = B
        r.order[:axes] = order
        r.rows[:axes] = rows
        r.starts[: len(starts)] = starts
        r.starts[len(starts) :] = axes
        r.inverse[:, order] = np.linalg.pinv(rows / effort) / effort[:, None]
        r.effort[:] = effort

        # Bounds.
        table = vehicle.thruster_table
        self._curves = curves(table)
        r.low[:] = np.where(lost, 0.0, -headroom * table[:, REVERSE])
        r.high[:] = np.where(lost, 0.0, headroom * table[:, FORWARD])
        r.least[:] = np.where(lost, 0.0, table[:, LEAST])

        # Gaps.
        patterns = preloads(rows)
        r.patterns[: len(patterns)] = patterns
        weights = np.zeros(6)
        weights[order] = np.array(HULL.gap_weights)[order]
        r.H[:], right = normal_equations(weights[:, None] * B, effort)
        r.right[:] = right * weights
        spans = _spans(rows)
        r.numbers[:] = axes, spans, np.any(r.least > 0.0), len(patterns)

    @property
    def record(self) -> AllocationRecord:
        """The allocation in the form of `allocate`."""
        return self._record

    @property
    def available(self) -> np.ndarray:
        """Thrusters in use: (m,) bool, False for lost thrusters."""
        return ~self._of[4]

    def without(
        self, *thrusters: int | str, priorities: Sequence[Sequence[str]] | None = None
    ) -> Self:
        """Allocation to the remaining thrusters, if `thrusters` give no thrust.

        The remaining thrusters need not span all directions; the priorities decide which part of a
        wrench is given up.

        Args:
            thrusters: lost thrusters, each by index or name.
            priorities: new priority levels; None keeps those of this allocation.

        Returns:
            A new allocation for the same vehicle.

        Raises:
            ConfigurationError: there is no such thruster, or none is left.
        """
        vehicle, levels, effort, headroom, lost = self._of
        lost = lost.copy()

        for thruster in thrusters:
            names = vehicle.thruster_names
            if isinstance(thruster, str) and thruster in names:
                lost[names.index(thruster)] = True
            elif isinstance(thruster, (int, np.integer)) and 0 <= thruster < len(lost):
                lost[thruster] = True
            else:
                raise ConfigurationError(
                    f"thruster {thruster!r}: expected an index below {len(lost)} or one of "
                    f"{list(names)}"
                )

        if lost.all():
            raise ConfigurationError("no thruster is left to allocate to")

        left = object.__new__(type(self))
        if priorities is not None:
            driven = {axis for level in levels for axis in level}
            spared = {AXES.index(axis) for axis in undriven_axes(vehicle.thruster_wrench)} - driven
            levels = _driven_levels(priorities, spared)
        left._set_up(vehicle, levels, effort, headroom, lost)
        return left

    def authority(self, *, spoiling: Sequence[str] = ()) -> Array:
        """Least and greatest wrench along each axis, all others zero; minimal thrusts are ignored.

        Args:
            spoiling: names of `AXES` that are left free, for instance "yaw": the surge that remains
                if the heading is given up.

        Returns:
            (6, 2) [N, N m]; row i is the least and the greatest value along axis i of `AXES`.

        Raises:
            ConfigurationError: a name is not in `AXES`.
        """
        free = {_axis(name) for name in spoiling}
        most = np.zeros((6, 2))
        r = self.record

        for axis in range(6):
            others = [i for i in range(6) if i != axis and i not in free]
            A = r.B[[*others, axis]]

            # Demands that always saturate, one in each direction.
            for column, sign in enumerate((-1.0, 1.0)):
                b = np.zeros(len(A))
                x = np.zeros(len(r.low))
                b[-1] = sign * _BEYOND * float(np.abs(A[-1]) @ np.maximum(-r.low, r.high))
                solve_levels(A, b, np.array([0, len(others), len(A)]), r.effort, r.low, r.high, x)
                most[axis, column] = A[-1] @ x
        return most

    def thrust(self, wrench_B: Array) -> Array:
        """Thrusts (m,) [N] for the wrench `wrench_B` (6,) [N, N m], within each thruster's bounds.

        The wrench is exact, with least effort, while no bound is reached. Otherwise the priorities
        decide which part is kept. If a thruster has a minimal thrust, its thrust is zero or at
        least the minimal thrust.

        Raises:
            ConfigurationError: the wrench has another shape, or a number is not finite.
        """
        return allocate(self.record, fitting(wrench_B, (6,), "wrench wanted of the thrusters"))

    def command(self, thrust: Array) -> Array:
        """Propeller speeds (m,) in [-1, 1] for `thrust` (m,) [N] in still water, or the nearest.

        Raises:
            ConfigurationError: another shape, or a number that is not finite.
        """
        thrust = fitting(thrust, self.record.least.shape, "thrusts wanted [N]")
        return _commands(self._curves, thrust)


def _axis(name: str) -> int:
    if name not in AXES:
        raise ConfigurationError(f"axis {name!r}: expected one of {list(AXES)}")
    return AXES.index(name)


def _driven_levels(priorities: Sequence[Sequence[str]], spared: set[int]) -> list[list[int]]:
    """Axis indices of each priority level without those `spared`; an empty level drops out.

    Raises:
        ConfigurationError: As `_levels`, or nothing is left to drive.
    """
    levels = [[axis for axis in level if axis not in spared] for level in _levels(priorities)]
    levels = [level for level in levels if level]
    if not levels:
        raise ConfigurationError(
            f"priorities: no thruster drives any axis of them, got {priorities!r}"
        )
    return levels


def _levels(priorities: Sequence[Sequence[str]]) -> list[list[int]]:
    """Axis indices of each priority level; ConfigurationError for an unknown, missing or repeated
    axis.
    """
    try:
        levels = [[_axis(name) for name in level] for level in priorities]
    except TypeError:
        raise ConfigurationError(
            f"priorities: expected levels of {list(AXES)}, got {priorities!r}"
        ) from None

    flat = [axis for level in levels for axis in level]
    if not flat or not all(levels) or len(set(flat)) < len(flat):
        raise ConfigurationError(
            "priorities: expected one or more levels, none empty, no axis twice, got "
            f"{priorities!r}"
        )
    return levels


@kernel
def _commands(curve, thrust):
    command = np.empty(thrust.shape[0])
    for i in range(thrust.shape[0]):
        command[i] = command_for(curve[i], thrust[i])
    return command
