"""Recording of a run: time series filled by the step loop, read by metrics and reports afterwards.

`Recorder` observes `uuv.sim.loop.rollout` and costs a few microseconds a step; `Recording` is its
frozen result. Times are in s from the start of the run. All other quantities are in SI units and W
unless a name says otherwise.
"""

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from uuv.models.naming import HANDLE, body_label, has_gripper, of_geom
from uuv.models.site.sliding_contact import TARGET_BODY
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.messages import (
    AbortCode,
    Command,
    ObjectMotion,
    Promise,
    Reference,
    Target,
    WorkState,
)
from uuv.sim.interfaces.spatial import Array, quat_wxyz_from_rotation, readonly
from uuv.sim.loop.logged_columns import (
    EVERY_STEP,
    OBJECT,
    REFERENCE,
    SCALARS,
    VECTORS,
    Columns,
    slow_columns,
)
from uuv.sim.loop.rollout import Moment, ticks_per_period

STATES = tuple(WorkState)  # the series "state" holds indices into this tuple
_INDEX = {state: i for i, state in enumerate(STATES)}
_ROWS = 1 << 15  # number of steps allocated at the start
_NOWHERE = np.full(3, np.nan)  # no tool position is commanded


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Series:
    """Time series of one quantity."""

    time: Array  # (N,) [s]
    value: Array  # (N, k)
    unit: str
    labels: tuple[str, ...]  # k labels; empty for a scalar

    @property
    def scalar(self) -> Array:
        """Values (N,) of a series with one column.

        Raises:
            ConfigurationError: The series has several columns.
        """
        if self.value.shape[1] != 1:
            raise ConfigurationError(f"series: must have one column, has {self.labels}")
        return self.value[:, 0]


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """Change of the planner's state."""

    time: float  # [s] time of the change
    state: WorkState
    note: str  # reason, if the planner gave one
    abort: AbortCode | None = None  # cause, if the work was aborted


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecordedSeries:
    """Series and events of a run, from memory or read back from its folder."""

    duration: float  # [s]
    series: Mapping[str, Series]
    events: tuple[Event, ...]

    def __getitem__(self, name: str) -> Series:
        """Series `name`.

        Raises:
            ConfigurationError: It was not recorded; the message lists the series.
        """
        if name not in self.series:
            raise ConfigurationError(
                f"no series {name!r} was recorded; there are {', '.join(sorted(self.series))}"
            )
        return self.series[name]

    def __contains__(self, name: str) -> bool:
        return name in self.series

    def within(self, *states: WorkState) -> np.ndarray:
        """Mask (N,) over the steps that is True while the planner was in one of `states`."""
        return np.isin(self["state"].scalar, [_INDEX[state] for state in states])

    @property
    def final(self) -> Event:
        """State in which the run ended."""
        return self.events[-1]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recording(RecordedSeries):
    """Complete, immutable record of one run."""

    timestep: float  # [s] of the loop
    vehicle: Vehicle
    targets: tuple[Target, ...]  # results of the finder, one per frame
    motions: tuple[ObjectMotion, ...] = ()  # of the followed object, one per frame
    goes_by: Target | None = None  # last target that the work used, the mean of several finds
    promise: Promise | None = None  # last promise of the planner
    clouds: Mapping[str, Array]  # (N, 3) [m] in W, added by the scenario
    substeps: int = 1  # physics steps per step of the loop
    interrupted: str = ""  # cause of an early end, such as SIGTERM
    collided: str = ""  # bodies that collided first, and the time; empty if nothing collided
    # electrical supply at the end, in the order of `uuv.sim.plant.supply`; empty if unknown
    supply: Array = field(default_factory=lambda: np.zeros(0))

    def digest(self, names: Iterable[str] = EVERY_STEP) -> str:
        """SHA-256 over the bits of times and values of series, by default of the whole trajectory.

        Names that were not recorded are skipped; the order of `names` has no effect. The digest
        does not depend on the slower series, the byte order, or the bits of NaN.
        """
        digest = hashlib.sha256()

        for name in sorted(set(names) & set(self.series)):
            series = self.series[name]
            digest.update(f"{name}{series.value.shape}".encode())
            for array in (series.time, series.value):
                exact = np.array(array, dtype="<f8", order="C")
                exact[np.isnan(exact)] = np.nan
                digest.update(exact.data)

        return digest.hexdigest()


class _Block:
    """Table of fixed width that grows by doubling; its first column is the time."""

    def __init__(self, width: int, rows: int = 1024) -> None:
        self.width = width
        self._table = np.empty((rows, width))
        self.count = 0

    def row(self) -> Array:
        """Next row, to be filled by the caller."""
        if self.count == len(self._table):
            self._table = _doubled(self._table)

        row = self._table[self.count]
        self.count += 1
        return row

    def table(self) -> Array:
        """Copy (N, width) of the rows so far."""
        return self._table[: self.count].copy()


class RecorderRecord(NamedTuple):
    """Rows for `write_row` at the rate of the loop, and the arrays of the truth that it copies."""

    # (N, 2 + ...) time, index of the reference, SCALARS, VECTORS, and OBJECT if the object can move
    rows: Array
    written: np.ndarray  # (1,) number of rows so far
    p_pad: Array  # (3,)
    R_WG: Array  # (3, 3)
    p_WB: Array  # (3,)
    quat_WB_wxyz: Array  # (4,)
    contact_force_W: Array  # (3,)
    p_WT: Array  # (3,) for an object that can move, else (0,)
    quat_WT_wxyz: Array  # (4,), else (0,)


@kernel
def write_row(record, time, scalars, reference, felt_force, felt_normal):
    """Write the next row of a recording; there must be room for it (`Recorder.ready`).

    Args:
        record: `RecorderRecord`, or its fields as a plain tuple.
        time: [s]
        scalars: True normal force of the contact [N], its smallest and largest value in a substep
            [N], whether a thruster is saturated, and whether there is a collision.
        reference: Index from `Recorder.refer`.
        felt_force: (3,) [N] estimated contact force, W.
        felt_normal: [N] estimated normal force.
    """
    rows, written, p_pad, R_WG, p_WB, quat_WB_wxyz, contact_force_W, p_WT, quat_WT_wxyz = record
    row = rows[written[0]]
    normal, least, most, saturated, collision = scalars

    # Time, index of the reference, and scalars.
    row[0], row[1], row[2], row[3], row[4], row[5], row[6] = (
        time,
        reference,
        normal,
        least,
        most,
        saturated,
        collision,
    )
    row[7] = felt_normal

    # Vectors: tip, tool axis, hull, contact force, estimated contact force, and tool x axis.
    for k in range(3):
        row[8 + k], row[11 + k], row[14 + k] = p_pad[k], R_WG[k, 2], p_WB[k]
        row[21 + k], row[24 + k], row[27 + k] = contact_force_W[k], felt_force[k], R_WG[k, 0]

    for k in range(4):
        row[17 + k] = quat_WB_wxyz[k]

    # An object that can move.
    for k in range(p_WT.shape[0]):
        row[30 + k] = p_WT[k]
    for k in range(quat_WT_wxyz.shape[0]):
        row[33 + k] = quat_WT_wxyz[k]

    written[0] += 1


class Recorder:
    """Observer of `uuv.sim.loop.rollout` that keeps a run in memory.

    At the loop's rate it keeps the series that the metrics need, and the true pose of an object
    that can move. If `full`, it also keeps joints, torques, thrusts, current, the estimate and the
    controller's internal values every `period`, and the poses of all bodies every `pose_period`.
    """

    # bound to one plant, and therefore not saved
    _OF_THE_RUN = frozenset({"_vehicle", "_truth", "_record"})

    def __init__(
        self,
        model: mujoco.MjModel,
        *,
        timestep: float | None = None,
        full: bool = True,
        period: float = 0.02,
        pose_period: float = 0.04,
    ) -> None:
        """Allocate the tables.

        Args:
            model: Model of the plant.
            timestep: Step of the loop [s]; default: the model's.
            full: Also keep the slower series.
            period: Period of the slower series [s].
            pose_period: Period of the body poses [s].

        Raises:
            ConfigurationError: A period is no multiple of `timestep`, or `timestep` no multiple of
                the model's.
        """
        self._timestep = float(model.opt.timestep) if timestep is None else timestep
        self._substeps = ticks_per_period(
            self._timestep, float(model.opt.timestep), "recorder's timestep"
        )

        self._vehicle = vehicle = Vehicle.of(model)
        self._bodies = tuple(body_label(model, b) for b in range(model.nbody))
        self._geoms = tuple(of_geom(model, g) for g in range(model.ngeom))
        self._full = full

        self._ticks = ticks_per_period(period, self._timestep, "recorder's period")
        self._pose_ticks = ticks_per_period(pose_period, self._timestep, "recorder's pose period")
        handle = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, HANDLE) >= 0
        self._slow_columns = slow_columns(vehicle, jaws=has_gripper(model), handle=handle)
        self._written = np.zeros(1, dtype=np.int64)

        # Tables of the slower rates.
        self._references = _Block(1 + _total_width(REFERENCE))
        self._slow = _Block(1 + _total_width(self._slow_columns))
        self._poses = _Block(1 + 7 * model.nbody)

        movable = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, TARGET_BODY)
        self._object = movable if movable >= 0 and model.body_jntnum[movable] else -1
        self._columns = {**SCALARS, **VECTORS, **(OBJECT if self._object >= 0 else {})}
        self._rows = np.empty((_ROWS, 2 + _total_width(self._columns)))

        self._believed: dict[str, _Block] = {}
        # RecorderRecord as a plain tuple, which is passed to a kernel faster
        self._record: tuple[np.ndarray, ...] = ()
        self._truth: Any = None

        # Latest values, and data that are kept unchanged.
        self._reference: Reference | None = None
        self._target: Target | None = None
        self._events: list[Event] = []
        self._targets: list[Target] = []
        self._clouds: dict[str, Array] = {}
        self._goes_by: Target | None = None
        self._promise: Promise | None = None
        self._motions: list[ObjectMotion] = []

    def save(self) -> dict[str, Any]:
        """Everything recorded so far, not copied: copy it before the next step."""
        return {name: entry for name, entry in vars(self).items() if name not in self._OF_THE_RUN}

    def resume(self, saved: dict[str, Any]) -> None:
        """Continue from a copy of the result of `save` of a recorder with an equal plant."""
        vars(self).update(saved)

    def references(self) -> Iterator[tuple[float, WorkState, float]]:
        """Time [s], state and set force [N] at the first step with each reference so far."""
        rows = self._rows[: self._written[0]]
        references = self._references.table()
        for first in np.flatnonzero(np.diff(rows[:, 1], prepend=-1.0)):
            _, state, set_force = references[int(rows[first, 1]), :3]
            yield float(rows[first, 0]), STATES[int(state)], float(set_force)

    def add_cloud(self, name: str, points_W: ArrayLike) -> None:
        """Keep points (N, 3) [m] in W under `name`.

        Raises:
            ConfigurationError: The shape is wrong.
        """
        points = np.asarray(points_W, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise ConfigurationError(f"cloud {name!r}: expected shape (N, 3), got {points.shape}")

        self._clouds[name] = readonly(points)

    def observe(self, moment: Moment) -> None:
        """Record one step."""
        truth = moment.truth
        contact = moment.command.contact
        if truth is not self._truth:
            self._bind(truth)

        if self._written[0] == len(self._rows):
            self.ready(1)

        if moment.target is not None and moment.target is not self._target:
            self._target = moment.target
            self._targets.append(moment.target)
        if moment.motion is not None and (
            not self._motions or moment.motion is not self._motions[-1]
        ):
            self._motions.append(moment.motion)

        scalars = (
            truth.contact_normal,
            truth.contact_least,
            truth.contact_most,
            truth.saturated,
            truth.collision,
        )
        write_row(
            self._record,
            truth.time,
            scalars,
            self.refer(moment.reference),
            contact.force_W,
            contact.normal,
        )

        if not self._full:
            return

        # Slower rows of a full recording.
        if moment.tick % self._ticks == 0:
            self._observe_slow(moment)
        if moment.tick % self._pose_ticks == 0:
            row = self._poses.row()
            row[0] = truth.time
            poses = row[1:].reshape(-1, 7)
            poses[:, :3], poses[:, 3:] = truth.xpos, truth.xquat

    @property
    def slow_ticks(self) -> tuple[int, ...]:
        """Numbers of ticks between the slower rows; empty if no slower series are kept."""
        return (self._ticks, self._pose_ticks) if self._full else ()

    def ready(self, rows: int) -> Array:
        """Make room for `rows` more rows of `write_row`; return their table, which may be new."""
        while self._written[0] + rows > len(self._rows):
            self._rows = _doubled(self._rows)
            self._record = (self._rows, *self._record[1:])
        return self._rows

    def record(self, truth: Any) -> RecorderRecord:
        """Rows of the loop's rate and arrays of `truth` for `write_row`, until `ready` grows them.

        A step that is written in this way must have no new target, and no row of the slower series.
        """
        if truth is not self._truth:
            self._bind(truth)
        return RecorderRecord(*self._record)

    def refer(self, reference: Reference) -> int:
        """Record a reference if it is new, at the planner's rate; return its index."""
        if reference is not self._reference:
            self._refer(reference)
        return self._references.count - 1

    def recording(self, interrupted: str = "") -> Recording:
        """Recording of the steps so far; `interrupted` is the cause of an early end.

        Raises:
            ConfigurationError: No step was recorded.
        """
        if not self._written[0]:
            raise ConfigurationError("the recorder has seen no step yet")
        rows = self._rows[: self._written[0]].copy()
        time = rows[:, 0].copy()
        reference = self._references.table()[rows[:, 1].astype(np.int64)]

        series = _split(time, rows[:, 2:], self._columns) | _split(
            time, reference[:, 1:], REFERENCE
        )

        # Commanded tip, extrapolated by its velocity.
        series["p_command"].value[:] += (time - reference[:, 0])[:, None] * series[
            "v_command"
        ].value

        if self._full:
            slow = self._slow.table()
            poses = self._poses.table()
            for body in range(len(self._bodies)):
                _without_sign_jumps(poses[:, 1 + 7 * body :][:, 3:7])
            series |= _split(slow[:, 0], slow[:, 1:], self._slow_columns)
            series["body_pose"] = Series(
                time=poses[:, 0], value=poses[:, 1:], unit="m, wxyz", labels=self._bodies
            )

        for name, block in self._believed.items():
            table = block.table()
            labels = tuple(map(str, range(block.width - 1))) if block.width > 2 else ()
            series[f"believed.{name}"] = Series(
                time=table[:, 0], value=table[:, 1:], unit="", labels=labels
            )

        for name, record in series.items():
            if name.startswith("quat_"):
                _without_sign_jumps(record.value)
            record.time.setflags(write=False)
            record.value.setflags(write=False)

        return Recording(
            timestep=self._timestep,
            duration=float(time[-1]) + self._timestep,
            vehicle=self._vehicle,
            series=MappingProxyType(series),
            events=tuple(self._events),
            targets=tuple(self._targets),
            motions=tuple(self._motions),
            goes_by=self._goes_by,
            promise=self._promise,
            clouds=MappingProxyType(dict(self._clouds)),
            substeps=self._substeps,
            interrupted=interrupted,
            collided=self._first_collision(),
        )

    def _first_collision(self) -> str:
        vehicle_geom, other, time = self._truth.collided.tolist()
        if vehicle_geom < 0.0:
            return ""
        return f"{self._geoms[int(vehicle_geom)]} met {self._geoms[int(other)]} at {time:.1f} s"

    def _bind(self, truth: Any) -> None:
        """Cache views of `truth`, which stay valid as long as the plant returns the same object."""
        self._truth = truth
        quat_WB_wxyz = truth.xquat[self._vehicle.hull]
        views = truth.p_pad, truth.R_WG, truth.p_WB, quat_WB_wxyz, truth.contact_force_W
        still = np.zeros(0), np.zeros(0)
        moved = still if self._object < 0 else (truth.xpos[self._object], truth.xquat[self._object])

        self._record = (self._rows, self._written, *views, *moved)

    def _refer(self, reference: Reference) -> None:
        """Record a new reference, and an event if it has a new state of the planner."""
        if self._reference is None or reference.state is not self._reference.state:
            event = Event(
                time=reference.time,
                state=reference.state,
                note=reference.note,
                abort=reference.abort,
            )
            self._events.append(event)

        self._reference = reference
        self._goes_by = reference.target or self._goes_by
        self._promise = reference.promise or self._promise

        row = self._references.row()
        row[:4] = reference.time, _INDEX[reference.state], reference.set_force, reference.path_s
        row[4:7] = _NOWHERE if reference.X_WG is None else reference.X_WG[:3, 3]
        row[7:10] = reference.v_WG_W
        row[10:13] = reference.X_WB[:3, 3]

    def _observe_slow(self, moment: Moment) -> None:
        truth = moment.truth
        estimate = moment.estimate
        row = self._slow.row()
        row[0] = truth.time

        np.concatenate(
            (
                truth.q,
                truth.qd,
                truth.tau_drive,
                truth.thrust,
                truth.current_W,
                truth.arm_wrench_B,
                estimate.X_WB[:3, 3],
                quat_wxyz_from_rotation(estimate.X_WB[:3, :3]),
                estimate.position_sigma,
                truth.jaws.row(),
                truth.handle.row(),
            ),
            out=row[1:],
        )

        for name, quantity in _estimates(moment.command).items():
            block = self._believed.get(name)
            if block is None:
                block = self._believed[name] = _Block(1 + np.size(quantity))
            row = block.row()
            row[0] = truth.time
            row[1:] = np.ravel(quantity)


def _estimates(command: Command) -> dict[str, Array]:
    """Estimates of the controller, by name of the series."""
    estimates = dict(command.believed)
    if command.contact.known:
        estimates |= {"f_tip_W": command.contact.force_W, "f_tip_sigma_G": command.contact.sigma_G}

    if command.hull_load is not None:
        load = command.hull_load
        estimates |= {"arm_wrench_B": load.arm_wrench_B, "current_W": load.current_W}
    return estimates


def _doubled(table: Array) -> Array:
    return np.concatenate([table, np.empty_like(table)])


def _without_sign_jumps(quat: Array) -> None:
    """Change signs of unit quaternions (N, 4) in place, so that each is nearest to its predecessor.

    q and -q are the same rotation. Rows of NaN are skipped.
    """
    known = np.flatnonzero(np.isfinite(quat).all(axis=1))
    quat_known = quat[known]
    turned_over = np.sum(quat_known[1:] * quat_known[:-1], axis=1) < 0.0
    quat[known[1:][np.cumsum(turned_over) % 2 == 1]] *= -1.0


def _total_width(columns: Columns) -> int:
    return sum(max(1, len(labels)) for labels, _ in columns.values())


def _split(time: Array, table: Array, columns: Columns) -> dict[str, Series]:
    """Columns of `table` (N, sum of widths) as series, in the order of `columns`."""
    series = {}
    start = 0
    for name, (labels, unit) in columns.items():
        stop = start + max(1, len(labels))
        series[name] = Series(time=time, value=table[:, start:stop], unit=unit, labels=labels)
        start = stop
    return series
