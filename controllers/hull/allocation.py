"""Thrust allocation: hull wrench to thruster commands, within bounds, through the inverse of the
static thrust curve.

Six thrusters leave no redundancy. Where they saturate, part of the wrench is given up in the order
of `PRIORITIES`: strict priority levels (`uuv.controllers.hull.priorities`), no weights. Roll and
pitch come first: a tilt of the hull tilts the tool and moves the tip by the length of the arm. The
force comes next: where it lacks, the hull is pushed away slowly and the arm re-aims. Yaw is last.
Among thrusts that are equal in all this, the effort is minimal.

A rotating propeller gives at least a minimal thrust (`uuv.models.water.thrusters`). Thrusts between
zero and that minimum do not exist (the gap), so the problem is no longer convex. There the wrench
that the levels have chosen is approached by weighted least squares, |W (B x - w)|^2 + e^2 |D x|^2.
Weights spread the small remaining error over all axes instead of putting all of it on one:

- With more thrusters than directions, some work against each other (preload). All such sign
  patterns are tried in a fixed order until one gives the wrench as well as without a gap. The fixed
  order keeps the pattern from changing between steps.
- Otherwise thrusters in the gap are settled one at a time: the one nearest to an existing thrust
  first, then all others are solved again. Then each thruster is tried on its other branches while
  that lowers the cost.

This is a search by single changes: its wrench error may exceed the least possible one. It has no
memory, so a thrust near the middle of a gap may chatter.
"""

import itertools
from collections.abc import Sequence
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from uuv.controllers.hull.priorities import PRIORITIES, solve_levels
from uuv.controllers.tuning import HULL
from uuv.models.vehicle import Vehicle
from uuv.models.water.thruster_curves import command_for
from uuv.models.water.thrusters import FORWARD, LEAST, REVERSE, curves
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array, checked, fitting

# order of a wrench on the hull, hull axes
AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
# [-] share of the largest entry of B below which an entry is rounding noise and set to zero
_ROUNDING = 1e-12
_ROUNDS = 4  # maximal number of passes over all thrusters in search of a better branch
_EFFORT = 1e-10  # [-] weight of the effort, relative to the mean diagonal of A^T A
# [-] times the sum of all thrusts: a demand that always saturates, to measure the authority
_BEYOND = 1e3


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
            priorities: levels of names from `AXES`, the first is kept first once thrusters
                saturate. Within a level newtons and newton metres count alike. An axis in no level
                is not driven.
            effort: (m,) [-] cost weight of each thruster, > 0, equal by default. A larger weight
                spares that thruster where there is a choice.
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
        levels = _levels(priorities)
        self._set_up(vehicle, levels, effort, headroom, np.zeros(m, dtype=bool))
        if not self._spans:
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
        self._B = np.where(lost, 0.0, vehicle.thruster_wrench)
        longest = np.abs(self._B).max(initial=0.0)
        self._B[np.abs(self._B) < _ROUNDING * longest] = 0.0  # rounding noise would raise the rank
        m = self._B.shape[1]
        self._order = np.array([axis for level in levels for axis in level])
        self._rows = self._B[self._order]
        self._starts = np.cumsum([0, *map(len, levels)])
        self._effort = effort
        self._spans = bool(np.linalg.matrix_rank(self._rows) == len(self._order))
        self._inverse = np.zeros((m, 6))
        self._inverse[:, self._order] = np.linalg.pinv(self._rows / effort) / effort[:, None]
        table = vehicle.thruster_table
        self._low = np.where(lost, 0.0, -headroom * table[:, REVERSE])
        self._high = np.where(lost, 0.0, headroom * table[:, FORWARD])
        self._least = np.where(lost, 0.0, table[:, LEAST])
        self._patterns = preloads(self._rows)
        self._gaps = bool(np.any(self._least > 0.0))
        self._curves = curves(table)
        weights = np.zeros(6)
        weights[self._order] = np.array(HULL.gap_weights)[self._order]
        self._H, right = normal_equations(weights[:, None] * self._B, effort)
        self._right = right * weights

    @property
    def available(self) -> np.ndarray:
        """Thrusters in use: (m,) bool, False for lost thrusters."""
        return ~self._of[4]

    def without(
        self, *thrusters: int | str, priorities: Sequence[Sequence[str]] | None = None
    ) -> Self:
        """Allocation with the remaining thrusters, when `thrusters` give no thrust whatever their
        command.

        It need not span all directions: the priorities decide which part of a wrench is given up.

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
        left._set_up(
            vehicle, levels if priorities is None else _levels(priorities), effort, headroom, lost
        )
        return left

    def lost_directions(self) -> Array:
        """Uncontrollable wrenches (d, 6) [N, N m], hull axes: orthonormal, orthogonal to all that
        the thrusters give.

        Force and moment count alike. d = 0 while the thrusters span all six directions.
        """
        return np.linalg.svd(self._B.T)[2][np.linalg.matrix_rank(self._B) :]

    def authority(self, *, spoiling: Sequence[str] = ()) -> Array:
        """Least and greatest wrench along each axis while all others are zero; minimal thrusts are
        ignored.

        Args:
            spoiling: names of `AXES` that are left free, for instance "yaw": the surge that remains
                if the heading is given up.

        Returns:
            (6, 2) [N, N m]: row i holds the least and the greatest value along axis i of `AXES`.

        Raises:
            ConfigurationError: a name is not in `AXES`.
        """
        free = {_axis(name) for name in spoiling}
        most, low, high = np.zeros((6, 2)), self._low, self._high
        for axis in range(6):
            others = [i for i in range(6) if i != axis and i not in free]
            A = self._B[[*others, axis]]
            for column, sign in enumerate((-1.0, 1.0)):
                b, x = np.zeros(len(A)), np.zeros(len(low))
                b[-1] = sign * _BEYOND * float(np.abs(A[-1]) @ np.maximum(-low, high))
                solve_levels(A, b, np.array([0, len(others), len(A)]), self._effort, low, high, x)
                most[axis, column] = A[-1] @ x
        return most

    def thrust(self, wrench_B: Array) -> Array:
        """Thrusts (m,) [N] for the wrench `wrench_B` (6,) [N, N m], within the bounds of each
        thruster.

        Exact, with least effort, while no bound is met. Otherwise the priorities decide which part
        is kept. Where a thruster has a minimal thrust, its thrust is zero or at least that.

        Raises:
            ConfigurationError: another shape, or a number that is not finite.
        """
        wrench_B = fitting(wrench_B, (6,), "wrench wanted of the thrusters")
        thrust = self._inverse @ wrench_B
        if not (self._spans and np.all(thrust >= self._low) and np.all(thrust <= self._high)):
            right = wrench_B[self._order]
            solve_levels(
                self._rows, right, self._starts, self._effort, self._low, self._high, thrust
            )
        if not (self._gaps and np.any((thrust != 0.0) & (np.abs(thrust) < self._least))):
            return thrust
        right = self._right @ (self._B @ thrust)
        return nearest_thrusts(self._H, right, self._low, self._high, self._least, self._patterns)

    def command(self, thrust: Array) -> Array:
        """Normalised propeller speeds (m,) in [-1, 1] that give `thrust` (m,) [N] in still water,
        or the nearest to it.

        Raises:
            ConfigurationError: another shape, or a number that is not finite.
        """
        return _commands(self._curves, fitting(thrust, self._least.shape, "thrusts wanted [N]"))

    def lacking(self, wrench_B: Array, thrust: Array) -> Array:
        """Part (6,) [N, N m] of `wrench_B` (6,) that saturation withholds from its allocation
        `thrust` (m,) [N].

        Zero while no thruster is saturated.
        """
        missing = wrench_B - self._B @ thrust
        full = (thrust <= self._low * (1.0 - 1e-9)) | (thrust >= self._high * (1.0 - 1e-9))
        if not np.any(full):
            return np.zeros(6)
        return np.where(np.abs(missing) > 1e-6 * np.abs(wrench_B).max(), missing, 0.0)


def _axis(name: str) -> int:
    if name not in AXES:
        raise ConfigurationError(f"axis {name!r}: expected one of {list(AXES)}")
    return AXES.index(name)


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


def preloads(B: Array) -> np.ndarray:
    """Sign patterns (p, m), 1 or -1 each, with which thrusters of wrench columns `B` (k, m) work
    against each other.

    These are the signs of thrusts in the null space of B, sampled in a few of its directions. p = 0
    where B has no null space, or where the null space leaves a thruster out.
    """
    null = np.linalg.svd(B)[2][np.linalg.matrix_rank(B) :]
    found: list[tuple[int, ...]] = []
    for mix in itertools.product((1, 0, -1), repeat=min(len(null), 3)):
        along = np.array(mix) @ null[:3]
        signs = tuple(np.sign(along).astype(int).tolist())
        if np.all(np.abs(along) > 1e-6) and signs not in found:
            found.append(signs)
    return np.array(sorted(found), dtype=np.int64).reshape(-1, B.shape[1])


def normal_equations(A: Array, effort: Array) -> tuple[Array, Array]:
    """Normal equations of min |A x - b|^2 + e^2 |effort x|^2: the matrix (m, m), and A^T (m, k).

    A^T b is the right side. `e` is so small that `effort` (m,) decides only where `A` (k, m) leaves
    a choice.
    """
    H = A.T @ A
    return H + _EFFORT * np.trace(H) / len(H) * np.diag(effort**2 / np.mean(effort**2)), A.T.copy()


@kernel
def _commands(curve, thrust):
    command = np.empty(thrust.shape[0])
    for i in range(thrust.shape[0]):
        command[i] = command_for(curve[i], thrust[i])
    return command


@kernel
def bounded(H, c, low, high, x):
    """Minimise x^T H x / 2 - c^T x over low <= x <= high by a primal active-set method; result in
    `x` (m,).

    Each step solves for the free variables and moves there, or to the first bound on the way. At a
    minimum of the free variables, the bound variable with the steepest inward descent is set free.
    The cost falls with every step, so no active set occurs twice.

    Args:
        H: (m, m) positive definite.
        c: (m,) linear term.
        low: (m,) lower bounds.
        high: (m,) upper bounds.
        x: (m,) output; its content on entry is ignored.

    Returns:
        The number of steps.
    """
    m = c.shape[0]
    at = np.zeros(m, dtype=np.int8)
    L, z, free = np.empty((m, m)), np.empty(m), np.empty(m, dtype=np.int64)
    scale = 0.0
    for i in range(m):
        scale = max(scale, abs(c[i]), H[i, i] * max(abs(low[i]), abs(high[i])))
    first = True
    steps = 0
    while steps < 20 * (m + 1):
        steps += 1
        count = 0
        for i in range(m):
            if at[i] == 0:
                free[count] = i
                count += 1
        _solve_free(H, c, x, free, count, L, z)
        if first:  # initial active set: the variables whose free minimum lies beyond their bounds
            first = False
            outside = False
            for i in range(m):
                x[i] = min(max(z[i], low[i]), high[i])
                if z[i] < low[i]:
                    at[i], outside = -1, True
                elif z[i] > high[i]:
                    at[i], outside = 1, True
            if outside:
                continue
            return steps
        share, hit = 1.0, -1
        for a in range(count):
            i = free[a]
            if z[a] < low[i]:
                s = (low[i] - x[i]) / (z[a] - x[i])
            elif z[a] > high[i]:
                s = (high[i] - x[i]) / (z[a] - x[i])
            else:
                continue
            if s < share or hit < 0:
                share, hit = max(s, 0.0), i
        for a in range(count):
            i = free[a]
            x[i] += share * (z[a] - x[i])
            if share == 1.0 and hit < 0:
                x[i] = z[a]
        if hit >= 0:
            at[hit] = -1 if x[hit] - low[hit] < high[hit] - x[hit] else 1
            x[hit] = low[hit] if at[hit] < 0 else high[hit]
            continue
        worst, release = 1e-13 * scale, -1
        for i in range(m):
            if at[i] == 0 or low[i] == high[i]:
                continue
            slope = -c[i]
            for j in range(m):
                slope += H[i, j] * x[j]
            pull = -slope if at[i] < 0 else slope
            if pull > worst:
                worst, release = pull, i
        if release < 0:
            break
        at[release] = 0
    return steps


@kernel
def _solve_free(H, c, x, free, count, L, z):
    """Minimise over the `count` variables in `free`, the others held at `x`; result in `z` in the
    order of `free`.
    """
    m = c.shape[0]
    for a in range(count):
        i = free[a]
        total = c[i]
        held = 0
        for j in range(m):
            if held < count and free[held] == j:
                held += 1
            else:
                total -= H[i, j] * x[j]
        z[a] = total
        for b in range(a + 1):
            total = H[i, free[b]]
            for k in range(b):
                total -= L[a, k] * L[b, k]
            L[a, b] = np.sqrt(total) if a == b else total / L[b, b]
        for k in range(a):
            z[a] -= L[a, k] * z[k]
        z[a] /= L[a, a]
    for a in range(count - 1, -1, -1):
        for k in range(a + 1, count):
            z[a] -= L[k, a] * z[k]
        z[a] /= L[a, a]


@kernel
def nearest_thrusts(H, c, low, high, least, patterns):
    """Thrusts of least cost x^T H x / 2 - c^T x within bounds, each zero or at least its minimal
    thrust in size.

    Near the least cost where a gap is met: see the search in the docstring of this module.

    Args:
        H: (m, m) matrix of `normal_equations`.
        c: (m,) right side, A^T b.
        low: (m,) [N] lower bounds.
        high: (m,) [N] upper bounds.
        least: (m,) [N] minimal thrust of each rotating propeller, either way; 0 for a thruster
            without a gap.
        patterns: (p, m) sign patterns of `preloads`.

    Returns:
        Thrusts (m,) [N].
    """
    m = c.shape[0]
    x, y = np.zeros(m), np.zeros(m)
    bounded(H, c, low, high, x)
    free = _cost(H, c, x)
    from_, to = low.copy(), high.copy()
    enough = 0.0
    for i in range(m):
        enough = max(enough, 1e-6 * H[i, i] * least[i] ** 2)
    met = False
    while True:
        nearest, which = np.inf, -1
        for i in range(m):
            if from_[i] == to[i] or abs(x[i]) >= least[i] * (1.0 - 1e-9):
                continue
            distance = min(abs(x[i]), least[i] - abs(x[i])) / least[i]
            if distance < nearest:
                nearest, which = distance, i
        if which < 0:
            break
        if not met:
            for row in range(patterns.shape[0]):
                for i in range(m):
                    _limit(patterns[row, i], low[i], high[i], least[i], from_, to, i)
                bounded(H, c, from_, to, y)
                if _cost(H, c, y) - free <= enough:
                    return y
            from_[:], to[:] = low, high
            met = True
        branch = 0 if abs(x[which]) < 0.5 * least[which] else int(np.sign(x[which]))
        _limit(branch, low[which], high[which], least[which], from_, to, which)
        bounded(H, c, from_, to, x)
    best = _cost(H, c, x)
    for _ in range(_ROUNDS if met else 0):
        better = False
        for i in range(m):
            _limit(int(np.sign(x[i])), low[i], high[i], least[i], from_, to, i)
        for i in range(m):
            for other in range(-1, 2):
                kept = int(np.sign(x[i]))
                if least[i] == 0.0 or other == kept:
                    continue
                _limit(other, low[i], high[i], least[i], from_, to, i)
                bounded(H, c, from_, to, y)
                cost = _cost(H, c, y)
                if cost < best - 1e-12 * abs(best):
                    best, better = cost, True
                    x[:] = y
                else:
                    _limit(kept, low[i], high[i], least[i], from_, to, i)
        if not better:
            break
    return x


@kernel
def _limit(branch, low, high, least, from_, to, i):
    """Set the bounds `from_` and `to` of thruster `i` on one branch: -1 reverse, 0 off, 1
    forward.
    """
    if least == 0.0:  # it has no gap
        from_[i], to[i] = low, high
        return
    from_[i] = low if branch < 0 else least if branch > 0 else 0.0
    to[i] = high if branch > 0 else -least if branch < 0 else 0.0


@kernel
def _cost(H, c, x):
    total = 0.0
    for i in range(c.shape[0]):
        total -= c[i] * x[i]
        for j in range(c.shape[0]):
            total += 0.5 * x[i] * H[i, j] * x[j]
    return total
