"""Pool trials [Kolano 2022]: a floating vehicle moves its arm, its thrusters off, and what it does
is recorded.

Files of a trial NAME: NAME_joint_states.csv, NAME_imu.csv and NAME_mocap.csv, also with .gz behind;
times in s.
"""

import gzip
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, shown

# touches the ground; marked bad by their authors
EXCLUDED = ("traj003-1", "traj012-3", "traj014-0", "traj014-1")
START = 0.5  # [s] from which the start is taken
RATE = 10.0  # [Hz] at which trial and simulation are compared
SHORTEST = 5.0  # [s]
_KINDS = ("joint_states", "imu", "mocap")
_JOINTS = ("axis_e_pos", "axis_d_pos", "axis_c_pos", "axis_b_pos")  # joints 1 to 4
_ZEROS = (3.07, 0.0, 0.0, 2.879)  # [rad] of their encoders, as their authors state
# Joint 1 turns the other way than the axis of our model: with the stated sign every roll comes out
# mirrored.
_SIGNS = (-1.0, 1.0, 1.0, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoolTrial:
    """One trial: joint angles to replay, the start, and what was measured."""

    name: str
    group: str  # trajectory number: trials that begin alike and share their commands
    times: Array  # (k,) [s] at which it is compared
    joint_times: Array  # (j,) [s]
    joints: Array  # (j, 4) [rad] of our model
    R_start: Array  # (3, 3) attitude at the start; its heading is that of the motion capture
    w_start: Array  # (3,) [rad/s] hull axes
    v_start: Array  # (3,) [m/s] world axes
    attitude: Array  # (k, 3) [rad] roll, pitch, yaw of the IMU
    position: Array  # (k, 3) [m] from the start, world axes, z up

    @property
    def duration(self) -> float:
        """Time [s] from first to last comparison."""
        return float(self.times[-1] - self.times[0])


def names_in(folder: Path) -> tuple[str, ...]:
    """Names of the trials in a folder, those EXCLUDED left out.

    Raises:
        ConfigurationError: There is none.
    """
    names = {path.name.partition("_joint_states")[0] for path in folder.glob("*_joint_states.csv*")}
    chosen = tuple(
        sorted(name for name in names if name.startswith("traj") and name not in EXCLUDED)
    )

    if not chosen:
        raise ConfigurationError(
            f"--data {shown(str(folder))}: holds no pool trials (traj*_joint_states.csv.gz)"
        )
    return chosen


def read_trials(folder: Path, names: Iterable[str] | None = None) -> list[PoolTrial]:
    """Trials of a folder; None: all but those EXCLUDED.

    Raises:
        ConfigurationError: A file is missing, cannot be read, or lacks a column; a number is not
            finite, times do not increase, or a trial is too short.
    """
    return [read_trial(folder, name) for name in (names_in(folder) if names is None else names)]


def read_trial(folder: Path, name: str) -> PoolTrial:
    """One trial; as `read_trials`."""
    joints, imu, mocap = (_table(folder, f"{name}_{kind}") for kind in _KINDS)
    t_joints, t_imu, t_mocap = (_times(table, name) for table in (joints, imu, mocap))

    begin, end = (
        max(t[0] for t in (t_joints, t_imu, t_mocap)),
        min(t[-1] for t in (t_joints, t_imu, t_mocap)),
    )

    if end - begin < SHORTEST:
        raise ConfigurationError(
            f"pool trial {name}: its records have {end - begin:.1f} s in common, {SHORTEST} needed"
        )

    times = np.arange(begin, end, 1.0 / RATE)

    # Attitude by the IMU, position and heading by motion capture.
    attitude = Rotation.from_quat(_columns(imu, ("x_ori", "y_ori", "z_ori", "w_ori"), name))
    angles = np.unwrap(attitude.as_euler("ZYX"), axis=0)[:, ::-1]  # roll, pitch, yaw

    p = _columns(mocap, ("x_pose", "y_pose", "z_pose"), name)
    yaw = np.unwrap(_columns(mocap, ("yaw",), name)[:, 0])

    # The start: means over its first samples.
    first_imu, first_mocap = (_first(t, begin) for t in (t_imu, t_mocap))
    heading = float(yaw[first_mocap].mean())
    roll, pitch = angles[first_imu, :2].mean(axis=0)

    rates = _columns(imu, ("x_angvel", "y_angvel", "z_angvel"), name)
    origin = np.median(p[first_mocap], axis=0)
    moved = np.column_stack([np.interp(times, t_mocap, p[:, i]) for i in range(3)]) - origin

    return PoolTrial(
        name=name,
        group=name.partition("-")[0],
        times=times,
        joint_times=t_joints,
        joints=(_columns(joints, _JOINTS, name) - _ZEROS) * _SIGNS,
        R_start=Rotation.from_euler("ZYX", [heading, pitch, roll]).as_matrix(),
        w_start=rates[first_imu].mean(axis=0),
        v_start=np.polyfit(t_mocap[first_mocap], p[first_mocap], 1)[0],
        attitude=np.column_stack([np.interp(times, t_imu, angles[:, i]) for i in range(3)]),
        position=moved,
    )


def _first(times: Array, begin: float) -> np.ndarray:
    """Mask of the samples that give the start: those of the first START, five at least."""
    mask = (times >= begin) & (times <= begin + START)

    if mask.sum() < 5:
        mask[np.flatnonzero(times >= begin)[:5]] = True
    return mask


def _table(folder: Path, stem: str) -> dict[str, Array]:
    trials = [
        path for ending in (".csv.gz", ".csv") if (path := folder / f"{stem}{ending}").exists()
    ]

    if not trials:
        raise ConfigurationError(
            f"pool trial: there is no {stem}.csv or .csv.gz in {shown(str(folder))}"
        )

    path = trials[0]
    try:
        with gzip.open(path, "rt") if path.suffix == ".gz" else path.open() as file:
            head = file.readline().strip().split(",")
            rows = np.loadtxt(file, delimiter=",", ndmin=2)
    except (OSError, ValueError, EOFError) as error:
        raise ConfigurationError(f"pool trial {path.name}: cannot be read: {error}") from error

    if rows.ndim != 2 or len(rows) < 10 or rows.shape[1] != len(head):
        raise ConfigurationError(
            f"pool trial {path.name}: expected ten rows of {len(head)} numbers at least"
        )

    return dict(zip(head, rows.T, strict=True))


def _columns(table: dict[str, Array], names: tuple[str, ...], trial: str) -> Array:
    missing = [name for name in names if name not in table]

    if missing:
        raise ConfigurationError(
            f"pool trial {trial}: lacks the column {missing[0]!r}; it has {', '.join(table)}"
        )

    columns = np.column_stack([table[name] for name in names])
    if not np.all(np.isfinite(columns)):
        bad = names[int(np.flatnonzero(~np.isfinite(columns).all(axis=0))[0])]
        raise ConfigurationError(
            f"pool trial {trial}: column {bad!r} holds numbers that are not finite"
        )

    return columns


def _times(table: dict[str, Array], trial: str) -> Array:
    times = _columns(table, ("time_secs",), trial)[:, 0]
    if not np.all(np.diff(times) > 0.0):
        raise ConfigurationError(f"pool trial {trial}: its times must increase")
    return times
