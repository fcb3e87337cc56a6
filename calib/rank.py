"""Rank analysis of a calibration: observable directions, and reasons why others are not observable.

Columns are scaled to comparable errors: 0.1 deg, and the displacement that such a turn causes over
a sixth of the arm. Singular values can then be compared; a direction counts as hidden if its value
is below `THRESHOLD` times the largest. For a UR10e with 63 touches, observable directions are above
0.04 times the largest. The pair hidden by a straight pin is at 5e-4, exact gauge freedoms are at
1e-6 and less.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr

from uuv.calib.fit import Data, distance_rows, linearised
from uuv.calib.parameters import Parameters
from uuv.models.arms.kinematics import ROW
from uuv.models.arms.serial_arm import SerialArm
from uuv.sim.interfaces.spatial import Array

SCALE = "scale"  # first word of the reason of a group of lengths with a common factor
THRESHOLD = 3e-3  # share of the largest singular value, below which a direction counts as hidden
_ANGLE = np.deg2rad(0.1)  # [rad] error to which the columns of angles are scaled
# divisor of the arm's length: over that length `_ANGLE` gives the comparable error in metres
_SHARE = 6.0
_LIES_IN = 0.9  # cosine to the hidden space, above which a direction counts as inside it
_EXPLAINS = 0.3  # residual length, below which a direction is explained by those named already
_NAMED = 0.05  # component of a hidden direction, from which on a group names the parameter
_MIXED = 0.98  # share of a parameter in hidden directions, above which it is unknowable


@dataclass(frozen=True, kw_only=True, eq=False)
class HiddenGroup:
    """Directions that touching does not observe, with the reason and the remedy."""

    names: tuple[str, ...]
    count: int
    reason: str
    handle: str  # remedy, or the reason why none is needed

    def __str__(self) -> str:
        return f"{self.count} in ({', '.join(self.names)}): {self.reason}; {self.handle}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Combination:
    """An observable combination: weighted sum of changes over `RankReport.scales`."""

    text: str  # its largest terms
    weights: Array  # (P,) of the changes over `RankReport.scales`, unit length
    value: float  # in units of `RankReport.scales`
    sigma: float
    interval: tuple[float, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class RankReport:
    """Rank of the scaled columns of `parameters` at a solution."""

    parameters: Parameters
    rank: int
    singular_values: Array  # (P,) [m] of the scaled columns, descending
    scales: Array  # (P,) error of each parameter that is scaled to one
    # (rank, P) observable combinations of scaled parameters, orthonormal, best first
    directions: Array
    hidden_directions: Array  # (P - rank, P)
    hidden: tuple[HiddenGroup, ...]
    # (P,) bool: as many parameters as the rank, identifiable with the others fixed
    identifiable: np.ndarray
    # status of each parameter: "known", "in combination" (not identifiable alone) or "unknowable"
    status: tuple[str, ...]
    touches: int

    @property
    def total(self) -> int:
        """Number of parameters examined."""
        return len(self.parameters.names)

    @property
    def scaled(self) -> tuple[str, ...]:
        """Parameters with a common factor that touching does not observe; empty if it does."""
        groups = [group for group in self.hidden if group.reason.startswith(SCALE)]
        return tuple(name for group in groups for name in group.names)

    @property
    def condition(self) -> float:
        """Ratio of the largest to the smallest singular value of the observable directions."""
        return (
            float(self.singular_values[0] / self.singular_values[self.rank - 1])
            if self.rank
            else np.inf
        )

    @property
    def observability(self) -> float:
        """Observability index O1 [m]: geometric mean of observable singular values over
        sqrt(touches) [Borm 1991].
        """
        if not self.rank:
            return 0.0
        return float(
            np.exp(np.mean(np.log(self.singular_values[: self.rank]))) / np.sqrt(self.touches)
        )

    def combination(self, i: int, terms: int = 4) -> str:
        """Text of the i-th observable direction: `terms` largest weights of scaled parameters."""
        weights = self.directions[i]
        largest = np.argsort(-np.abs(weights))[:terms]
        return " ".join(
            f"{weights[j]:+.2f} {self.parameters.names[j]}"
            for j in largest
            if abs(weights[j]) > 0.05
        )

    def __str__(self) -> str:
        lines = [
            f"{self.rank} of {self.total} directions are observable (condition "
            f"{self.condition:.3g}, O1 {self.observability:.3g} m)"
        ]
        lines += [f"not observable: {group}" for group in self.hidden]

        for word in ("known", "in combination", "unknowable"):
            named = [
                name
                for name, status in zip(self.parameters.names, self.status, strict=True)
                if status == word
            ]
            if named:
                lines.append(f"{word}: {', '.join(named)}")

        return "\n".join(lines)


def rank_report(
    arm: SerialArm, full: Array, data: Data, parameters: Parameters, noise: float
) -> RankReport:
    """Analyse the rank of `parameters` at a solution, for the touches with weight > 0.

    A known distance is an additional row, in units of the noise of a touch.

    Args:
        arm: kinematics.
        full: (5 n + 3 + n,) full vector of the solution.
        data: touches, with the arm's joint loads.
        parameters: P parameters to examine.
        noise: [m] standard deviation of a touch.

    Returns:
        Rank, directions and the groups of hidden directions.
    """
    # Columns scaled to like errors; known distances add rows.
    scales = _like_errors(arm, full, data, parameters)
    _, _, rows, c, C = linearised(arm, full, data, parameters)
    if data.distances:
        rows = np.vstack([rows, noise * distance_rows(c, C, data, noise)[1]])
    rows = _triangle(rows * scales)

    # Directions of large singular values are observed.
    _, values, Vt = np.linalg.svd(rows)
    floor = THRESHOLD * values[0]
    rank = int(np.sum(values > floor))
    observed, hidden = Vt[:rank], Vt[rank:]
    share = np.sum(hidden**2, axis=0)
    groups = _reasons(arm, hidden, parameters)

    # What a group names is not identifiable alone.
    listed = {name for group in groups for name in group.names}
    listed |= {name for name, s in zip(parameters.names, share, strict=True) if s >= _NAMED**2}

    return RankReport(
        parameters=parameters,
        rank=rank,
        singular_values=values,
        scales=scales,
        directions=observed,
        hidden_directions=hidden,
        hidden=groups,
        identifiable=_chosen(arm, observed, parameters),
        status=tuple(
            "unknowable" if s > _MIXED else "in combination" if name in listed else "known"
            for name, s in zip(parameters.names, share, strict=True)
        ),
        touches=int(np.sum(data.weights > 0.0)),
    )


def _triangle(rows: Array) -> Array:
    """Square matrix (P, P) with the singular values and right singular vectors of `rows` (R, P)."""
    R = np.zeros((rows.shape[1], rows.shape[1]))
    small = np.linalg.qr(rows, mode="r")
    R[: len(small)] = small
    return R


def _like_errors(arm: SerialArm, full: Array, data: Data, parameters: Parameters) -> Array:
    length = _ANGLE * arm.reach / _SHARE
    sizes = {
        "theta": _ANGLE,
        "alpha": _ANGLE,
        "beta": _ANGLE,
        "d": length,
        "a": length,
        "tcp": length,
    }

    if data.load is not None:
        tau = data.load(full[: ROW * arm.n].reshape(-1, ROW))
        sizes["compliance"] = _ANGLE / max(float(np.sqrt(np.mean(tau**2))), 1e-9)

    return np.array([sizes.get(group, 0.0) for group in parameters.groups])


def _chosen(arm: SerialArm, observed: Array, parameters: Parameters) -> np.ndarray:
    """As many independent parameters as the rank, preferably those that are usually left free."""
    # Preferably fixed at nominal: the base, the last frame (the tool point replaces it), the first
    # links of a parallel run, and the longest link (scale).
    n = arm.n
    preference = np.ones(len(parameters.names))
    held = {f"theta{n}", f"d{n}", f"a{n}", f"alpha{n}", "theta1", "d1"}
    held |= {f"d{k + 1}" for k in arm.near_parallel} | {f"a{n - 1}", f"d{n - 1}"}
    lengths = np.abs(arm.table[:, 2])
    if lengths.max() > 0.0:
        held.add(f"a{int(lengths.argmax()) + 1}")

    for i, name in enumerate(parameters.names):
        if name in held:
            preference[i] = 0.3

    # Pivots of QR: independent columns, with the preferred ones first.
    chosen = np.zeros(len(preference), dtype=bool)
    if len(observed):
        chosen[qr(observed * preference, pivoting=True, mode="r")[1][: len(observed)]] = True

    return chosen


def _reasons(arm: SerialArm, hidden: Array, parameters: Parameters) -> tuple[HiddenGroup, ...]:
    """Split hidden directions into groups, the null spaces of a few columns with a common
    reason.
    """
    missing, total = hidden.shape
    explained = np.zeros((0, total))
    groups = []

    for names, reason, handle in _suspects(arm, parameters):
        places = parameters.where(*names)
        if not len(places) or len(explained) >= missing:
            continue

        # The directions of these columns alone that lie in the hidden space: cosines near 1.
        _, cosines, Vt = np.linalg.svd(hidden[:, places], full_matrices=False)
        null = np.zeros((int(np.sum(cosines > _LIES_IN)), total))
        null[:, places] = Vt[: len(null)]
        null -= (null @ explained.T) @ explained
        _, size, new = np.linalg.svd(null, full_matrices=False)
        new = new[size > _EXPLAINS][: missing - len(explained)]

        if len(new):
            inside = [parameters.names[j] for j in range(total) if np.abs(new[:, j]).max() > _NAMED]
            groups.append(
                HiddenGroup(names=tuple(inside), count=len(new), reason=reason, handle=handle)
            )
            explained = np.vstack([explained, new])

    # Hidden directions without a known reason.
    if len(explained) < missing:
        null = hidden - (hidden @ explained.T) @ explained
        _, _, new = np.linalg.svd(null, full_matrices=False)
        new = new[: missing - len(explained)]
        inside = [
            parameters.names[j]
            for j in np.argsort(-np.abs(new).max(axis=0))
            if np.abs(new[:, j]).max() > 0.2
        ]
        groups.append(
            HiddenGroup(
                names=tuple(inside),
                count=len(new),
                reason="these poses do not separate them",
                handle="touch in more varied poses or at more points",
            )
        )

    return tuple(groups)


def _suspects(arm: SerialArm, parameters: Parameters) -> list[tuple[list[str], str, str]]:
    n = arm.n
    last = [f"theta{n}", f"d{n}", f"a{n}", f"alpha{n}", "tcp_x", "tcp_y", "tcp_z"]
    before = [f"theta{n - 1}", f"d{n - 1}", f"a{n - 1}", f"alpha{n - 1}"]
    lengths = [
        name
        for name, group in zip(parameters.names, parameters.groups, strict=True)
        if group in {"d", "a", "tcp"}
    ]

    suspects = [
        (
            ["theta1", "d1"],
            "base gauge: turns about the first axis and shifts along it move all points in the "
            "same way",
            "touching cannot observe the base frame; nothing is lost",
        ),
        (
            [f"c{k + 1}" for k in range(n)],
            "the load moment on these joints does not change",
            "load them otherwise: pull sideways, tilt the base, or hold the load off the axis",
        ),
        (
            last,
            "last frame and tool point: both describe the same tip",
            "nothing is lost for this tool; the flange itself needs a tool of known length",
        ),
    ]

    for run in _parallel_runs(arm):
        names = [f"d{k + 1}" for k in run]
        suspects.append(
            (
                names,
                "parallel axes: only the sum of the shifts along them is observable",
                "nothing is lost: use the sum",
            )
        )

    suspects += [
        (
            lengths,
            f"{SCALE}: the touches of a point coincide equally well with an arm of any size",
            "one known distance between points determines it",
        ),
        (
            [*before, *last],
            f"straight pin: the tip lies on axis {n}, whose direction is then not observable",
            "use a tip 50 to 100 mm off the last axis",
        ),
    ]

    if any(group == "compliance" for group in parameters.groups):
        compliant = [name for name in parameters.names if name.startswith("c")]
        suspects.append(
            (
                [*lengths, *compliant],
                f"{SCALE}: the compliances shrink as the arm grows",
                "a known distance determines it",
            )
        )

    return suspects


def _parallel_runs(arm: SerialArm) -> list[list[int]]:
    """Rows whose d shift along near-parallel axes, grouped in runs."""
    runs: list[list[int]] = []
    for k in arm.near_parallel:
        if runs and runs[-1][-1] == k:
            runs[-1].append(k + 1)
        else:
            runs.append([k, k + 1])
    return runs
