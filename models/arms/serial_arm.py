"""Serial arms as a table of Denavit-Hartenberg rows, with Hayati's beta between near-parallel axes.

    arm = SerialArm.from_dh(dh)                                 # (n, 4): theta0, d, a, alpha
    arm = SerialArm.from_axes(axes, points, X_base_flange0)     # any serial chain, at zero

Row k takes frame k - 1, whose z is the axis of joint k, to frame k by Rz(theta0 + q) Tz(d) Tx(a)
Rx(alpha) Ry(beta). For a slide Rz(theta0) Tz(d + q) replaces the first two factors. Four numbers
per joint describe every serial chain, but not every small change of one: if one of two parallel
axes is tilted about y, standard rows need links of hundreds of metres. beta describes that tilt
instead [Hayati 1985].
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from uuv.models.arms import kinematics
from uuv.models.arms.kinematics import ALPHA, BETA, ROW, THETA, A, D
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import (
    Array,
    checked,
    checked_place,
    checked_pose,
    checked_rows,
    exp_so3,
    inverse,
    pose,
    readonly,
    shown,
)

# [rad] between neighbouring axes; for smaller angles d and theta0 of the common normal diverge
NEAR_PARALLEL = np.deg2rad(5.0)
# [rad] between axes; for smaller angles the previous common normal is kept
_EXACTLY_PARALLEL = 1e-9
_LARGEST = 50.0  # [m] a longer link is taken to be stated in millimetres


def _identity() -> Array:
    return readonly(np.eye(4))


@dataclass(frozen=True, kw_only=True, eq=False)
class SerialArm:
    """Kinematics of a serial arm of n joints, from base frame to flange frame; arrays read-only.

    Raises:
        ConfigurationError: the number of joint types, limits or names differs from the number of
            rows of the table.
    """

    table: Array  # (n, 5) theta0 [rad], d [m], a [m], alpha [rad], beta [rad]
    joint_types: str  # one letter per joint: r for a hinge, p for a slide
    # (4, 4) frame 0, whose z is the first joint's axis, in the base
    X_base_0: Array = field(default_factory=_identity)
    # (4, 4) the flange, or the tip of a fixed tool, in frame n
    X_n_flange: Array = field(default_factory=_identity)
    # (n, 2) [rad], for slides [m]; infinite by default
    limits: Array = field(default_factory=lambda: np.empty((0, 2)))
    joint_names: tuple[str, ...] = ()  # by default joint1 to jointn

    def __post_init__(self) -> None:
        n = len(self.table)
        if not len(self.limits):
            object.__setattr__(self, "limits", readonly(np.tile([-np.inf, np.inf], (n, 1))))
        if not self.joint_names:
            object.__setattr__(self, "joint_names", tuple(f"joint{k + 1}" for k in range(n)))

        _checked_letters(self.joint_types, n)
        if self.limits.shape != (n, 2):
            raise ConfigurationError(f"limits: expected shape {(n, 2)}, got {self.limits.shape}")
        if len(self.joint_names) != n:
            raise ConfigurationError(
                f"joint_names: expected {n} names, got {shown(self.joint_names)}"
            )

    @classmethod
    def from_dh(
        cls,
        dh: ArrayLike,
        joint_types: str | None = None,
        beta: ArrayLike | None = None,
        *,
        name: str = "dh",
    ) -> Self:
        """Build an arm from Denavit-Hartenberg rows; its base is frame 0, its flange frame n.

        Args:
            dh: (n, 4) standard rows theta0 [rad], d [m], a [m], alpha [rad].
            joint_types: one letter per joint, r for a hinge and p for a slide; default all r.
            beta: (n,) [rad] Hayati's angle; default zero.
            name: name of `dh` at the beginning of its error messages.

        Returns:
            The arm, without limits.

        Raises:
            ConfigurationError: a shape is wrong, a number is not finite, a joint letter is unknown,
                or the numbers are so large that they must be degrees or millimetres.
        """
        rows = checked_rows(dh, 4, name)
        _check_units(rows, name)
        tilt = np.zeros(len(rows)) if beta is None else checked(beta, (len(rows),), "beta")
        return cls(
            table=readonly(np.column_stack([rows, tilt])),
            joint_types=_checked_letters(joint_types, len(rows)),
        )

    @classmethod
    def from_axes(
        cls,
        axes: ArrayLike,
        points: ArrayLike,
        X_base_flange0: ArrayLike,
        joint_types: str | None = None,
    ) -> Self:
        """Build an arm from its joint axes and its flange at zero, all in base coordinates.

        If two neighbouring axes are nearly parallel, the given point on the later axis is the
        origin of its frame.

        Args:
            axes: (n, 3) directions of the axes, of any length but zero.
            points: (n, 3) [m] a point on each axis.
            X_base_flange0: (4, 4) the flange at zero.
            joint_types: one letter per joint, r for a hinge and p for a slide; default all r.

        Returns:
            The arm, without limits.

        Raises:
            ConfigurationError: wrong shapes, zero directions, unknown joint letters, or points
                farther away than the arm can be long.
        """
        directions = checked_rows(axes, 3, "axes")
        n = len(directions)
        o = checked(points, (n, 3), "points")
        X_flange = checked_pose(X_base_flange0, "X_base_flange0")
        types = _checked_letters(joint_types, n)
        z = _unit_axes(directions)
        _check_length(n, o, X_flange)

        # Frame 0 has its origin on the first axis.
        X_base_0 = np.eye(4)
        X_base_0[:3, :3] = _rotation_with_z(z[0], np.eye(3)[int(np.argmin(np.abs(z[0])))])
        X_base_0[:3, 3] = o[0]

        # One row leads from each axis to the next; the last row is zero.
        table = np.zeros((n, ROW))
        X = X_base_0
        for k in range(n - 1):
            z_next = X[:3, :3].T @ z[k + 1]
            o_next = X[:3, :3].T @ (o[k + 1] - X[:3, 3])
            table[k] = _row_between(z_next, o_next)
            X = X @ _step(table[k])
        X = X @ _step(table[-1])

        return cls(
            table=readonly(table),
            joint_types=types,
            X_base_0=readonly(X_base_0),
            X_n_flange=readonly(inverse(X) @ X_flange),
        )

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.table)

    @property
    def slides(self) -> np.ndarray:
        """Mask (n,) of the joints that are slides."""
        return np.array([letter == "p" for letter in self.joint_types])

    @property
    def reach(self) -> float:
        """Length [m] of the arm from its first joint to the flange, as the sum of its links."""
        return float(
            np.hypot(self.table[:, D], self.table[:, A]).sum()
            + np.linalg.norm(self.X_n_flange[:3, 3])
        )

    @property
    def near_parallel(self) -> tuple[int, ...]:
        """Joints (from 0) whose axis is nearly parallel to that of the next joint, so that their
        rows need beta.
        """
        alpha = self.table[:, ALPHA]
        beta = self.table[:, BETA]
        tilt = np.hypot(np.sin(alpha), np.sin(beta))
        hinges = ~self.slides
        return tuple(
            k
            for k in range(self.n - 1)
            if tilt[k] < np.sin(NEAR_PARALLEL) and hinges[k] and hinges[k + 1]
        )

    @property
    def dh(self) -> Array:
        """Standard DH rows (n, 4) of exactly this arm, without beta.

        Rows without beta stay as they are. Where beta is not zero, the common normal of the two
        almost parallel axes is far away, so d of that joint and of the next may be many metres.
        Such rows are exact but cannot be read as dimensions of the arm.
        """
        table = np.array(self.table)
        turn = 0.0  # [rad] turn of the new frame k - 1 about its z, relative to the old one
        shift = 0.0  # [m] shift of the new frame along that z
        for k in range(self.n):
            row = table[k].copy()
            row[THETA] -= turn
            row[D] -= shift
            if row[BETA] == 0.0:
                turn = 0.0
                shift = 0.0
                table[k] = row
                continue

            # Row of the common normal; the remaining turn and shift go into the next row.
            X = _step(row)
            new = _row_between(X[:3, 2], X[:3, 3], parallel=_EXACTLY_PARALLEL, hint=row)
            rest = inverse(_step(new)) @ X  # Rz(-turn) Tz(-shift)
            turn = float(np.arctan2(rest[0, 1], rest[0, 0]))
            shift = -float(rest[2, 3])
            table[k] = new

        return readonly(table[:, :4])

    def axes(self) -> tuple[Array, Array, Array]:
        """Joint axes (n, 3), points on them (n, 3) [m] and flange (4, 4) at zero, base frame."""
        X = kinematics.frames(self.table, self.slides, self.X_base_0, np.zeros((1, self.n)))[0]
        return readonly(X[:-1, :3, 2]), readonly(X[:-1, :3, 3]), readonly(X[-1] @ self.X_n_flange)

    def origins(self) -> list[Array]:
        """Poses (n + 1, 4, 4) at zero as URDF and MJCF state them, each in the frame before it.

        The first n are those of the joints' frames, with z along the axis; the last is that of the
        flange.
        """
        poses = [self.X_base_0]
        for row in self.table:
            turn = exp_so3([0.0, 0.0, row[THETA]])
            poses.append(pose(turn @ tilt_of(row), turn @ [row[A], 0.0, row[D]]))

        poses[-1] = poses[-1] @ self.X_n_flange
        return poses

    def joint_frames(self, q: ArrayLike) -> Array:
        """Poses (n + 1, 4, 4) in the base of the joints' frames of `origins`, moved by `q`, and of
        the flange.

        Args:
            q: (n,) joint values [rad], slides [m].

        Returns:
            The poses, base to flange.

        Raises:
            ConfigurationError: `q` is not n finite numbers within 1e9.
        """
        joint_values = checked_place(q, (self.n,), "q")
        *joints, flange = self.origins()

        X = np.eye(4)
        frames = []
        for origin, kind, joint_value in zip(joints, self.joint_types, joint_values, strict=True):
            X = (
                X
                @ origin
                @ (
                    pose(p=[0.0, 0.0, joint_value])
                    if kind == "p"
                    else pose(exp_so3([0.0, 0.0, joint_value]))
                )
            )
            frames.append(X)
        return np.array([*frames, X @ flange])

    def flange(self, q: ArrayLike) -> Array:
        """Flange poses (M, 4, 4) in the base for joint values `q` (M, n) [rad], slides [m].

        Raises:
            ConfigurationError: `q` is not (M, n) finite numbers.
        """
        q_rows = np.ascontiguousarray(checked_rows(q, self.n, "q"))
        return (
            kinematics.frames(self.table, self.slides, self.X_base_0, q_rows)[:, -1]
            @ self.X_n_flange
        )

    def tips(self, q: ArrayLike, tcp: ArrayLike) -> Array:
        """Positions (M, 3) [m] in the base of the point `tcp` (3,) [m] of the flange, at `q` (M,
        n).
        """
        from uuv.models.arms.tip_places import NO_JACOBIAN, tips

        q_rows = np.ascontiguousarray(q, dtype=np.float64)
        point = np.ascontiguousarray(tcp, dtype=np.float64)
        return tips(
            self.table, self.slides, self.X_base_0, self.X_n_flange, point, q_rows, NO_JACOBIAN
        )

    def tips_and_jacobian(self, q: Array, tcp: Array) -> tuple[Array, Array]:
        """Tips (M, 3) [m], and their derivatives (M, 5 n + 3, 3) with respect to the table's rows,
        then to `tcp`.
        """
        from uuv.models.arms.tip_places import tips

        J = np.empty((len(q), ROW * self.n + 3, 3))
        return tips(self.table, self.slides, self.X_base_0, self.X_n_flange, tcp, q, J), J

    def with_table(self, table: Array) -> Self:
        """Copy of the arm with another table (n, 5)."""
        return replace(self, table=readonly(table))

    def with_tip(self, tcp: Array) -> Self:
        """Copy whose flange has its origin at the point `tcp` (3,) [m] of this arm's flange."""
        X = np.array(self.X_n_flange)
        X[:3, 3] += X[:3, :3] @ tcp
        return replace(self, X_n_flange=readonly(X))


def tilt_of(row: Sequence[float] | Array) -> Array:
    """Rotation (3, 3) Rx(alpha) Ry(beta) at the end of a table row (5,)."""
    return exp_so3([row[ALPHA], 0.0, 0.0]) @ exp_so3([0.0, row[BETA], 0.0])


def _checked_letters(joint_types: str | None, n: int) -> str:
    """Validated joint letters, one per joint; all hinges by default."""
    if joint_types is None:
        return "r" * n
    if not isinstance(joint_types, str) or len(joint_types) != n or set(joint_types) - {"r", "p"}:
        raise ConfigurationError(
            f"joint_types: expected {n} letters, each r (hinge) or p (slide), got "
            f"{shown(joint_types)}"
        )
    return joint_types


def _check_units(rows: Array, name: str) -> None:
    """Refuse a table (n, 4) whose numbers are so large that they must be degrees or millimetres."""
    # An angle of more than two turns, or a link of more than 50 m, shows that the table has other
    # units.
    for columns, most, unit, looks, needed in (
        ((THETA, ALPHA), 4.0 * np.pi, "rad", "degrees", "radians"),
        ((D, A), _LARGEST, "m", "millimetres", "metres"),
    ):
        sizes = np.abs(rows[:, columns])
        if sizes.max() > most:
            k, i = np.unravel_index(int(sizes.argmax()), sizes.shape)
            column = columns[i]
            raise ConfigurationError(
                f"{name}: {('theta0', 'd', 'a', 'alpha')[column]} of joint {k + 1} is "
                f"{rows[k, column]:g} {unit}; the table seems to be in {looks}, but must be in "
                f"{needed} (columns theta0, d, a, alpha)"
            )


def _unit_axes(axes: Array) -> Array:
    """Unit vectors (n, 3) along `axes` (n, 3); ConfigurationError for a vector of length zero."""
    # Scaled first, because the square of a huge axis overflows.
    z = axes / np.maximum(np.abs(axes).max(axis=1, keepdims=True), 1e-300)
    norms = np.linalg.norm(z, axis=1)
    if not np.all(norms > 1e-9):
        raise ConfigurationError(
            f"axes: every joint axis must be longer than zero, row {int(np.argmin(norms))} is zero"
        )
    return z / norms[:, None]


def _check_length(n: int, points: Array, X_flange: Array) -> None:
    """Refuse points (n, 3) or a flange (4, 4) that are farther away than an arm of `n` joints can
    be long.
    """
    farthest = float(max(np.abs(points).max(), np.abs(X_flange[:3, 3]).max()))
    if farthest > n * _LARGEST:
        raise ConfigurationError(
            f"points: an arm of {n} joints is at most {n * _LARGEST:g} m long, got a distance of "
            f"{farthest:g} m; are the points in millimetres?"
        )


def _step(row: Array) -> Array:
    """Pose (4, 4) of the frame after one row in the frame before it, at q = 0."""
    return kinematics.frames(row[None], np.array([False]), np.eye(4), np.zeros((1, 1)))[0, 1]


def _rotation_with_z(z: Array, hint: Array) -> Array:
    """Rotation with z axis `z`, whose x axis is the part of `hint` that is perpendicular to `z`."""
    x = hint - (hint @ z) * z
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _row_between(
    z: Array, o: Array, parallel: float = NEAR_PARALLEL, hint: Array | None = None
) -> Array:
    """Row that leads to a frame with z along `z`, on the line through `o` (3,).

    `z` and `o` are in the frame before the row. If the two axes differ by less than `parallel`
    [rad], the next origin is `o` itself and beta describes part of the tilt; otherwise the origin
    is the foot of the common normal. The common normal has the sense that it has in the row `hint`.
    """
    sine = float(np.hypot(z[0], z[1]))
    if sine < np.sin(parallel):
        theta = float(np.arctan2(o[1], o[0])) if np.hypot(o[0], o[1]) > 1e-9 else 0.0
        c, s = np.cos(theta), np.sin(theta)

        # z seen along x and y of the turned frame
        across = np.array([c * z[0] + s * z[1], c * z[1] - s * z[0]])
        # Rx(alpha) Ry(beta) e_z = (sin beta, -sin alpha cos beta, cos alpha cos beta)
        beta = float(np.arcsin(across[0]))
        alpha = float(np.arctan2(-across[1], z[2]))
        return np.array([theta, o[2], np.hypot(o[0], o[1]), alpha, beta])

    # x along the common normal of the two axes.
    x = np.array([-z[1], z[0]]) / sine  # e_z x z
    a = float(x @ o[:2])
    along = a + 1e-12 if hint is None else float(x @ [np.cos(hint[THETA]), np.sin(hint[THETA])])
    if along < 0.0:
        x = -x
        a = -a

    theta = float(np.arctan2(x[1], x[0]))
    alpha = float(np.arctan2(x[1] * z[0] - x[0] * z[1], z[2]))

    # The line o + t z meets the plane through e_z and x where its component perpendicular to the
    # plane vanishes.
    across = np.array([-x[1], x[0]])
    t = -float(across @ o[:2]) / float(across @ z[:2])
    return np.array([theta, o[2] + t * z[2], a, alpha, 0.0])
