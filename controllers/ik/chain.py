"""Serial chains for inverse kinematics, built from DH rows, vectors, MJCF or URDF.

Joints are hinges [rad], slides [m] and pantograph links [rad]. A pantograph link swings while the
body that it carries keeps its orientation. The base frame is the one that the chain was given in;
the tip frame is the tool frame G.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Self

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuv.controllers.ik import chain_kernels as kernels
from uuv.controllers.ik.entries import entry
from uuv.controllers.ik.mjcf_chain import chain_fields
from uuv.models.arms.kinematics import THETA, A, D
from uuv.models.arms.serial_arm import SerialArm, tilt_of
from uuv.models.files.urdf import CHAIN_TIP, model_from_urdf
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import (
    FARTHEST,
    Array,
    checked,
    checked_pose,
    checked_rows,
    exp_so3,
    pose,
    readonly,
    real_array,
    shown,
)

_KINDS = {"r": kernels.HINGE, "p": kernels.SLIDE, "o": kernels.PANTOGRAPH}
_JOINT_LETTERS = "r (hinge), p (slide), o (pantograph link)"


@dataclass(frozen=True, kw_only=True, eq=False)
class Chain:
    """A serial chain from a base frame to a tip frame, described with all joint values zero.

    Build it by `from_dh`, `from_arm`, `from_vectors`, `from_mjcf` or `from_urdf`. All arrays are
    read-only, in base axes.
    """

    joint_types: str  # one letter a joint: r hinge [rad], p slide [m], o pantograph link [rad]
    axes: Array  # (n, 3) unit joint axes
    points: Array  # (n, 3) [m] one point on each axis
    links: Array  # (n, 3) [m] the swinging vector of each pantograph link, zero elsewhere
    X_base_tip0: Array  # (4, 4) tip pose at zero
    limits: Array  # (n, 2) [rad] or [m] lower and upper joint limits, infinite for none
    travels: Array  # (n,) [m] of the tip per [m] of a slide that others follow; 1 elsewhere
    names: tuple[str, ...]  # of the joints
    n: int = field(init=False)  # number of joint values
    _scale: float = field(init=False, repr=False)
    # kernel memory; only calls that hold the GIL may use it
    _memory: Array = field(init=False, repr=False)
    # the same in single precision, once needed
    _single: list[NDArray[np.float32]] = field(init=False, repr=False)
    _no_trail: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        set_field = partial(object.__setattr__, self)
        if not (np.isfinite(self.axes).all() and np.isfinite(self.X_base_tip0).all()):
            raise ConfigurationError(
                "a chain's axes and its tip at zero must be finite: a length or angle is beyond "
                "reason"
            )

        largest = float(
            max(np.abs(self.points).max(initial=0.0), np.abs(self.X_base_tip0[:3, 3]).max())
        )
        if not largest <= FARTHEST:
            raise ConfigurationError(
                f"a chain must lie within {FARTHEST:g} m of its base, got {largest:g} m"
            )

        set_field("n", len(self.joint_types))
        set_field("_scale", _scale(self))
        set_field("_memory", memory_of(self, self._scale))
        set_field("_single", [])
        set_field("_no_trail", np.empty((0, self.n)))

    @classmethod
    def from_dh(
        cls,
        dh: ArrayLike,
        joint_types: str | None = None,
        limits: ArrayLike | None = None,
        tool: ArrayLike | None = None,
    ) -> Self:
        """Build a chain from standard DH rows (theta0 [rad], d [m], a [m], alpha [rad]).

        A hinge row moves by Rz(theta0 + q) Tz(d) Tx(a) Rx(alpha). A slide has Tz(d + q) instead. A
        pantograph link moves by Rz(theta0 + q) Tz(d) Tx(a) Rz(-q) Rx(alpha).

        Args:
            dh: (n, 4) rows, base to tip.
            joint_types: one letter per row: r (hinge), p (slide) or o (pantograph link); default
                all r.
            limits: (n, 2) [rad] or [m] lower and upper limits, infinite for none; default none.
            tool: (4, 4) pose of the tip in the last frame; default that frame.

        Returns:
            The chain, its joints named joint1 to jointn.

        Raises:
            ConfigurationError: for wrong shapes, numbers that are not finite, unknown letters, or
                crossed limits.
        """
        rows = checked_rows(dh, 4, "dh")
        if np.abs(rows).max() > FARTHEST:
            raise ConfigurationError(
                f"dh: numbers must lie within {FARTHEST:g}, got {np.abs(rows).max():g}"
            )

        return cls._along_rows(
            np.column_stack([rows, np.zeros(len(rows))]),
            _letters(joint_types, len(rows)),
            np.eye(4),
            checked_pose(np.eye(4) if tool is None else tool, "tool"),
            _checked_limits(limits, len(rows)),
            tuple(f"joint{i + 1}" for i in range(len(rows))),
        )

    @classmethod
    def from_arm(cls, arm: SerialArm) -> Self:
        """Build the chain of a serial arm, base to flange, with its limits and joint names.

        Args:
            arm: kinematics, as read from a file or a model, or published (`uuv.models.arms`).

        Returns:
            The chain.

        Raises:
            ConfigurationError: crossed limits, or an arm that is no `SerialArm`.
        """
        if not isinstance(arm, SerialArm):
            raise ConfigurationError(f"arm: expected a SerialArm, got {shown(arm)}")

        limits = _checked_limits(arm.limits, arm.n)
        return cls._along_rows(
            arm.table, arm.joint_types, arm.X_base_0, arm.X_n_flange, limits, arm.joint_names
        )

    @classmethod
    def _along_rows(
        cls,
        table: Array,
        types: str,
        X_base_0: Array,
        X_n_tip: Array,
        limits: Array,
        names: tuple[str, ...],
    ) -> Self:
        """Build the chain of validated table rows (n, 5) of `uuv.models.arms.serial_arm`."""
        axes, points, links = np.empty((3, len(table), 3))
        X = X_base_0
        for i, row in enumerate(table):
            axes[i] = X[:3, 2]
            points[i] = X[:3, 3]
            X = X @ pose(exp_so3([0.0, 0.0, row[THETA]]))
            links[i] = X[:3, :3] @ [row[A], 0.0, 0.0] if types[i] == "o" else 0.0
            X = X @ pose(tilt_of(row), [row[A], 0.0, row[D]])

        return cls(
            joint_types=types,
            axes=readonly(axes),
            points=readonly(points),
            links=readonly(links),
            X_base_tip0=readonly(X @ X_n_tip),
            limits=limits,
            travels=readonly(np.ones(len(table))),
            names=names,
        )

    @classmethod
    def from_vectors(
        cls,
        M: ArrayLike,
        e: ArrayLike,
        p: ArrayLike,
        L: ArrayLike | None = None,
        tool: ArrayLike | None = None,
    ) -> Self:
        """Build a chain from the vector model of [Danilov 2021, chapter 2, fig. 1] in initial pose.

        Joint 1 is at the base origin. A slide moves its link by +q e. The tip's z is along the last
        link (E_x of [Danilov 2021]). Its x is along the part of e_n perpendicular to z (E_z of
        [Danilov 2021]). If the two are parallel, x is derived from the base axis most perpendicular
        to z.

        Args:
            M: (n, 3) [m] link vector from each joint to the next, the last one to the tip.
            e: (n, 3) joint axes, of any length but zero.
            p: (n,) joint kinds: 1 hinge, 0 slide, 2 pantograph link.
            L: (2, n) [rad] or [m] lower limits over upper ones; default none.
            tool: (4, 4) pose of the tip in the frame described above; default that frame.

        Returns:
            The chain, its joints named joint1 to jointn.

        Raises:
            ConfigurationError: for wrong shapes, zero axes, a last link without length, unknown
                kinds, or crossed limits.
        """
        vectors = checked_rows(M, 3, "M")
        n = len(vectors)
        directions = checked(e, (n, 3), "e")
        directions = directions / np.maximum(np.abs(directions).max(axis=1, keepdims=True), 1e-9)
        kinds = checked(p, (n,), "p")

        lengths = np.linalg.norm(directions, axis=1)
        if not np.all(lengths > 1e-9):
            raise ConfigurationError(
                f"e: every joint axis needs a length, row {int(np.argmin(lengths))} has none"
            )
        if not np.all(np.isin(kinds, (0.0, 1.0, 2.0))):
            raise ConfigurationError(
                f"p: allowed 1 (hinge), 0 (slide), 2 (pantograph link), got {kinds.tolist()}"
            )

        last = float(np.linalg.norm(vectors[-1]))
        if not last > 1e-12:
            raise ConfigurationError("M: the last link needs a length, for it is the tool's axis")

        # Each joint stands where the link before it ends
        axes = directions / lengths[:, None]
        points = np.vstack([np.zeros(3), np.cumsum(vectors, axis=0)])
        X_base_tip0 = pose(_tip_rotation(vectors[-1] / last, axes[-1]), points[-1])
        limits = None if L is None else _bounds(L, (2, n), "L").T
        return cls(
            joint_types="".join("pro"[int(kind)] for kind in kinds),
            axes=readonly(axes),
            points=readonly(points[:-1]),
            links=readonly(np.where(kinds[:, None] == 2.0, vectors, 0.0)),
            X_base_tip0=readonly(
                X_base_tip0 @ checked_pose(np.eye(4) if tool is None else tool, "tool")
            ),
            limits=_checked_limits(limits, n),
            travels=readonly(np.ones(n)),
            names=tuple(f"joint{i + 1}" for i in range(n)),
        )

    @classmethod
    def from_mjcf(
        cls, model: mujoco.MjModel, base_body: str, tip_site: str, exclude: Sequence[str] = ()
    ) -> Self:
        """Build the chain between a body and a site of a compiled model, in the frame of that body.

        The body's own joints do not count. Joint values are MuJoCo's (`qpos`), limits its ranges
        where limited. Two consecutive hinges that an active joint equality turns against each other
        are one pantograph link. It has the name and the joint value of the first hinge. Slides that
        follow a slide, with only slides between them, are one slide with the name and the value of
        the leader (a telescope).

        Args:
            model: compiled model.
            base_body: name of the body whose frame is the base.
            tip_site: name of the site that is the tip.
            exclude: names of joints (springs, compliant tools) that stay at their `qpos0` and take
                no part.

        Returns:
            The chain, its joints named as in the model.

        Raises:
            ConfigurationError: for an unknown body, site or joint, a site that is not beyond the
                body, ball and free joints or other couplings of two joints between them, or a chain
                without joints.
        """
        fields = chain_fields(model, base_body, tip_site, exclude)
        fields["limits"] = _checked_limits(fields["limits"], len(fields["names"]))
        return cls(**fields)

    @classmethod
    def from_urdf(
        cls, urdf: str | Path, base_link: str, tip_link: str, exclude: Sequence[str] = ()
    ) -> Self:
        """Build the chain between two links of a URDF, from link frame to link frame.

        Fixed joints take no part, `continuous` ones have no limits. Two consecutive hinges are one
        pantograph link where the second mimics the first, turning the other way about the same
        direction; slides that mimic a slide are one slide with their leader.

        Args:
            urdf: path of a file, or its text.
            base_link: name of the link whose frame is the base.
            tip_link: name of the link whose frame is the tip.
            exclude: names of joints that stay at zero and take no part.

        Returns:
            The chain, its joints named as in the URDF.

        Raises:
            ConfigurationError: as `from_mjcf`, and for a file that is not a URDF of one tree (see
                `uuv.models.files.urdf`).
        """
        model, root = model_from_urdf(urdf, base_link, tip_link)
        return cls.from_mjcf(model, "world" if base_link == root else base_link, CHAIN_TIP, exclude)

    @property
    def motions(self) -> Array:
        """Motion (n, 3) along or about its axis per joint value, in base axes."""
        return self.axes * self.travels[:, None]

    def forward(self, q: ArrayLike) -> Array:
        """Tip pose X_base_tip (4, 4) at `q` (n,) [rad] or [m]; ConfigurationError for a bad `q`."""
        return self.kinematics(q)[0]

    def jacobian(self, q: ArrayLike) -> Array:
        """Jacobian (6, n) of the tip (linear; angular) in base axes; as `forward` for a bad `q`."""
        return self.kinematics(q)[1]

    def kinematics(self, q: ArrayLike) -> tuple[Array, Array]:
        """Return `forward` and `jacobian` at `q` (n,) from one computation."""
        X_base_tip = np.empty((4, 4))
        J = np.empty((6, self.n))
        entry("kinematics")(self._memory, checked(q, (self.n,), "q"), X_base_tip, J)
        return X_base_tip, J

    def memory(self) -> Array:
        """Own copy of the chain's kernel memory, for compiled loops that solve without the GIL."""
        return self._memory.copy()

    def single(self) -> NDArray[np.float32]:
        """Kernel memory in single precision, its limits rounded inwards."""
        if not self._single:
            memory = self._memory.astype(np.float32)
            for column, bounds, inwards in (
                (kernels.LOWER, self.limits[:, 0], np.inf),
                (kernels.UPPER, self.limits[:, 1], -np.inf),
            ):
                rounded = bounds.astype(np.float32)
                beyond = rounded < bounds if inwards > 0 else rounded > bounds
                rounded[beyond] = np.nextafter(rounded[beyond], np.float32(inwards))
                set_limits(memory, column, rounded)

            self._single.append(memory)
        return self._single[0]


def _scale(chain: Chain) -> float:
    """Power of two by which lengths are multiplied, so that the chain is about one unit long."""
    size = _length(chain)
    return 2.0 ** -round(np.log2(size)) if size > 0.0 else 1.0


def _length(chain: Chain) -> float:
    """Length [m] of the line from joint to joint to the tip, at zero."""
    path = np.vstack([chain.points, chain.X_base_tip0[:3, 3]])
    return float(np.sum(np.linalg.norm(np.diff(path, axis=0), axis=1)))


def set_limits(
    memory: NDArray[np.floating], column: int, bounds: Array | NDArray[np.float32]
) -> None:
    """Write joint limits into kernel memory.

    Args:
        memory: kernel memory of a chain (see `uuv.controllers.ik.chain_kernels`), changed in place.
        column: LOWER or UPPER of `uuv.controllers.ik.chain_kernels`.
        bounds: (n,) [rad] or [m] the limits.
    """
    n = len(bounds)
    memory[: (kernels.HEAD + n) * kernels.COLUMNS].reshape(-1, kernels.COLUMNS)[
        kernels.HEAD :, column
    ] = bounds


def memory_of(chain: Chain, scale: float) -> Array:
    """Kernel memory (`uuv.controllers.ik.chain_kernels`) of a chain, lengths times `scale`."""
    n = chain.n
    memory = np.zeros(kernels.memory_size(n))
    table = memory[: (kernels.HEAD + n) * kernels.COLUMNS].reshape(-1, kernels.COLUMNS)
    joints = table[kernels.HEAD :]

    # Frame of the first joint: z on the joint's axis, x free
    path = np.vstack([chain.points, chain.X_base_tip0[:3, 3]])
    R = _frame_with_z(chain.axes[0])
    table[0, :12] = np.column_stack([R, scale * chain.points[0]]).ravel()
    for i in range(n):
        axis = chain.axes[i]
        x = R[:, 0]
        following = chain.axes[i + 1] if i + 1 < n else axis
        across = np.cross(axis, following)
        sine = float(np.linalg.norm(across))

        # Parallel axes have no unique common normal: keep x. A small cross product still gives an
        # exact normal.
        x_after = across / sine if sine > 1e-15 else x
        x_after = x_after - (x_after @ axis) * axis
        x_after /= np.linalg.norm(x_after)

        # Offset about z and alpha about x lead to the frame of the next joint
        offset = np.arctan2(axis @ np.cross(x, x_after), x @ x_after)
        alpha = np.arctan2(x_after @ across, axis @ following)
        R_after = np.column_stack([x_after, np.cross(axis, x_after), axis])

        # Link vector in that frame; of a pantograph link the swinging part, and the rest
        link = R_after.T @ (path[i + 1] - path[i])
        after = np.zeros(3)
        if chain.joint_types[i] == "o":
            swinging = R_after.T @ chain.links[i]
            after = link - swinging
            link = swinging

        joints[i, kernels.KIND] = _KINDS[chain.joint_types[i]]
        joints[i, kernels.OFFSET] = offset
        joints[i, kernels.COS_OFFSET] = np.cos(offset)
        joints[i, kernels.SIN_OFFSET] = np.sin(offset)
        joints[i, kernels.COS_ALPHA] = np.cos(alpha)
        joints[i, kernels.SIN_ALPHA] = np.sin(alpha)
        joints[i, kernels.LINK : kernels.LINK + 3] = scale * link
        if chain.joint_types[i] == "p":
            joints[i, kernels.TRAVEL] = chain.travels[i]
        else:
            joints[i, kernels.AFTER : kernels.AFTER + 3] = scale * after
        joints[i, kernels.LOWER], joints[i, kernels.UPPER] = chain.limits[i]
        R = R_after @ exp_so3([alpha, 0.0, 0.0])

    # Tip in the last joint frame, and the scalars of the head
    table[1, :9] = (R.T @ chain.X_base_tip0[:3, :3]).ravel()
    strokes = [
        chain.travels[i] * np.max(np.abs(chain.limits[i]))
        for i in range(n)
        if chain.joint_types[i] == "p"
    ]
    table[0, kernels.SCALE] = scale
    table[0, kernels.REACH] = scale * (_length(chain) + sum(strokes)) * (1.0 + 1e-9)
    table[1, kernels.SWEEPS] = _sweeps_pay_off(chain)
    return memory


def _sweeps_pay_off(chain: Chain) -> bool:
    """True if a full sweep from a far start saves time.

    Measured: sweeps curl the tip of chains of more than 8 joints, and drive joints onto narrow
    limits.
    """
    turns = chain.limits[:, 1] - chain.limits[:, 0] >= 2.0 * np.pi - 1e-9
    revolute = (turns[i] for i in range(chain.n) if chain.joint_types[i] != "p")
    return chain.n <= 8 and all(revolute)


def _tip_rotation(z: Array, last_axis: Array) -> Array:
    """Rotation (3, 3) with `z` along the last link, x across it towards the last joint's axis."""
    across = last_axis - (last_axis @ z) * z
    if np.linalg.norm(across) < 1e-6:
        across = np.eye(3)[int(np.argmin(np.abs(z)))]
        across = across - (across @ z) * z

    x = across / np.linalg.norm(across)
    return np.column_stack([x, np.cross(z, x), z])


def _frame_with_z(z: Array) -> Array:
    """A rotation (3, 3) whose third column is the unit vector `z` (3,)."""
    across = np.cross(z, np.eye(3)[int(np.argmin(np.abs(z)))])
    x = across / np.linalg.norm(across)
    return readonly(np.column_stack([x, np.cross(z, x), z]))


def _letters(joint_types: str | None, n: int) -> str:
    """Validated joint letters, one per joint; all hinges where none are given."""
    if joint_types is None:
        return "r" * n
    if (
        not isinstance(joint_types, str)
        or len(joint_types) != n
        or not set(joint_types) <= set(_KINDS)
    ):
        raise ConfigurationError(
            f"joint_types: expected {n} letters out of {_JOINT_LETTERS}, got {shown(joint_types)}"
        )
    return joint_types


def _bounds(values: ArrayLike, shape: tuple[int, ...], name: str) -> Array:
    """Validate like `checked`, except that infinities mean "no limit"."""
    bounds = real_array(values, name, f"{shape} numbers")
    checked(np.nan_to_num(bounds, nan=np.nan, posinf=0.0, neginf=0.0), shape, name)
    return readonly(bounds)


def _checked_limits(limits: ArrayLike | None, n: int) -> Array:
    """Validated joint limits (n, 2); infinite where none are given."""
    if limits is None:
        return readonly(np.tile([-np.inf, np.inf], (n, 1)))
    bounds = _bounds(limits, (n, 2), "limits")
    for i, (lower, upper) in enumerate(bounds):
        if not lower <= upper:
            raise ConfigurationError(
                f"limits: row {i} must not have its lower limit {lower} above its upper one {upper}"
            )
    return bounds
