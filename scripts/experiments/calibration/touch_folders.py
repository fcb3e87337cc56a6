"""Touches of real arms: a folder an arm, in it a folder a position, in it a CSV file for each
socket.
"""

from pathlib import Path

from uuv.calib.touch_files import read_touches
from uuv.models.arms.serial_arm import SerialArm
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array

Pair = tuple[int, int, float]  # point, point, distance [m]


def arm_folders(data: Path, names: tuple[str, ...] = ()) -> list[Path]:
    """Folders of arms below `data`: those with these names, or all.

    Raises:
        ConfigurationError: There is none.
    """
    folders = [data / name for name in names] if names else _folders_in(data)
    if not folders:
        raise ConfigurationError(f"--data {data}: must be a folder with one for each arm")
    return folders


def positions_of(folder: Path) -> tuple[str, ...]:
    """Names of the positions at which an arm touched.

    Raises:
        ConfigurationError: There are fewer than two.
    """
    names = tuple(entry.name for entry in _folders_in(folder))
    if len(names) < 2:
        raise ConfigurationError(
            f"--data: {folder} needs at least two folders of touches, got {len(names)}"
        )
    return names


def sockets(folder: Path, position: str, arm: SerialArm) -> list[Array]:
    """Touches (m, n) [rad] of each socket of a position."""
    files = [file for file in sorted((folder / position).glob("*.csv")) if "pose" not in file.stem]
    return list(read_touches(files, joint_types=arm.joint_types, limits=arm.limits).series)


def sockets_in_rows(
    folder: Path, positions: tuple[str, ...], arm: SerialArm, length: float
) -> tuple[list[Array], list[Pair]]:
    """Touches of all sockets of some positions, and the known distances.

    Args:
        folder: Of the arm.
        positions: Names.
        arm: Its table.
        length: Distance [m] of consecutive sockets of a position.
    """
    series: list[Array] = []
    pairs: list[Pair] = []

    for position in positions:
        first = len(series)
        series += sockets(folder, position, arm)
        pairs += [(k, k + 1, length) for k in range(first, len(series) - 1)]
    return series, pairs


def _folders_in(folder: Path) -> list[Path]:
    """Folders in a folder by name; none where it is none."""
    if not folder.is_dir():
        return []
    return [entry for entry in sorted(folder.iterdir()) if entry.is_dir()]
