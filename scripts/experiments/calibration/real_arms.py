"""Calibration of real arms from their touches, judged by touches that were held out.

Data: a folder an arm, in it a folder a position, in it a file for each socket. Each position is
left out once, and trained on alone once. An error is the distance of a touch from the mean of its
socket, along each axis.
"""

from uuv.start import run_scenario  # isort: skip

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from experiments.calibration.simulated_arm import reduced_touches
from experiments.calibration.touch_folders import (
    arm_folders,
    positions_of,
    sockets,
    sockets_in_rows,
)
from uuv.calib import identify
from uuv.experiment import Page, Row, Table, column, experiment, stat
from uuv.experiment.statistic import Record
from uuv.models.arms import published_arms
from uuv.sim.interfaces.spatial import finite_number

ALONE, OTHERS = "one position", "all others"  # what is trained on


@dataclass(frozen=True, kw_only=True)
class RealTouches:
    """Which touches."""

    data: Path
    """Folder of the arms' folders."""
    robots: tuple[str, ...] = ()
    """Names of arms' folders; default: all."""
    arm: str = "panda"
    """Published arm that touched."""
    socket_distance: float = 0.05
    """Distance of consecutive sockets of a position [m]."""
    aside: tuple[str, ...] = ()
    """Positions that are not tested where another one alone was trained on."""

    def __post_init__(self) -> None:
        finite_number(self.socket_distance, "--socket-distance [m]", above=0.0, most=10.0)


@dataclass(frozen=True, kw_only=True)
class RealArmCase:
    """Calibration of a real arm from the touches at one position, or at all others."""

    folder: str
    position: str
    training: str
    """On what: one position, or all others."""
    arm: str
    socket_distance: float
    """Distance of consecutive sockets of a position [m]."""
    aside: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class RealArmRow:
    """Touches that were trained on, and errors of those held out."""

    robot: str = column("robot")
    touches: int = column("touches")
    reduced: int = column("reduced")
    left_out: int = column("left out")
    held_out: Mapping[str, float] = column(
        "RMS about the socket", "mm", digits=3, factor=1e3, by="tested"
    )
    errors: Sequence[float] = column("errors", "mm", digits=3, factor=1e3)
    half_widths: Sequence[float] = column("half-widths", "mm", digits=3, factor=1e3)


def cases(touches: RealTouches) -> Iterator[RealArmCase]:
    """Each position of each arm left out, and each alone."""
    for folder in arm_folders(touches.data, touches.robots):
        for training in (OTHERS, ALONE):
            for position in positions_of(folder):
                yield RealArmCase(
                    folder=str(folder),
                    position=position,
                    training=training,
                    arm=touches.arm,
                    socket_distance=touches.socket_distance,
                    aside=touches.aside,
                )


@experiment("calibration_real_arms", cases=cases)
def calibration_real_arms(case: RealArmCase) -> RealArmRow:
    """Calibrates one arm, and predicts the touches that were held out."""
    arm = published_arms.load(case.arm)
    folder = Path(case.folder)
    others = tuple(name for name in positions_of(folder) if name != case.position)
    alone = case.training == ALONE

    trained = (case.position,) if alone else others
    tested = [name for name in others if name not in case.aside] if alone else [case.position]
    series, pairs = sockets_in_rows(folder, trained, arm, case.socket_distance)
    calibration = identify(series, arm, distances=pairs)

    # touches held out, about the mean of their socket
    held_out = {}
    errors = []
    half_widths = []
    for position in tested:
        scatter = []
        for q in sockets(folder, position, arm):
            p = calibration.tips(q)
            off = p - p.mean(axis=0)
            scatter.append(np.sqrt((off**2).sum(axis=1).mean()))
            errors.append(np.abs(off).ravel())
            half_widths.append(calibration.half_widths(q).ravel())
        held_out[position] = float(np.mean(scatter))

    return RealArmRow(
        robot=folder.name,
        touches=sum(len(q) for q in series),
        reduced=reduced_touches(calibration),
        left_out=len(calibration.outliers),
        held_out=held_out,
        errors=np.round(np.concatenate(errors), 8).tolist(),
        half_widths=np.round(np.concatenate(half_widths), 8).tolist(),
    )


def _mean_held_out(row: Record) -> float:
    """Mean over the tested positions [mm]."""
    return 1e3 * float(np.mean(list(row["held_out"].values())))


def intervals(rows: list[Row]) -> list[Table | dict]:
    """How many errors the 95 % intervals hold, and how wide the intervals are."""
    cells = []
    metrics = {}
    for robot, training in dict.fromkeys((row["robot"], row["training"]) for row in rows):
        group = [row for row in rows if (row["robot"], row["training"]) == (robot, training)]
        errors = np.concatenate([row["errors"] for row in group])
        halves = np.concatenate([row["half_widths"] for row in group])

        covered = float(np.mean(errors < halves))
        width = float(np.median(halves) / np.quantile(errors, 0.95))
        cells.append((robot, training, f"{100 * covered:.1f}", f"{width:.2f}"))
        metrics[f"{robot}, {training}"] = {"covered": covered, "width_over_spread": width}

    table = Table(
        title="Errors of touches held out, and their 95 % intervals",
        columns=("robot", "trained on", "in the interval [%]", "median interval over errors' 95 %"),
        rows=cells,
        labels=2,
    )
    return [table, {"intervals": metrics}]


def pictures(rows: list[Row]) -> list[tuple[str, str, Figure]]:
    """Touches held out by position, a picture for each robot."""
    shown = []
    for robot in dict.fromkeys(row["robot"] for row in rows):
        group = [row for row in rows if row["robot"] == robot]
        names = list(dict.fromkeys(row["position"] for row in group))
        figure = Figure(figsize=(9.0, 3.6), layout="constrained")
        axes = figure.subplots()

        for k, (training, label, color) in enumerate(
            (
                (ALONE, "trained on it, the others tested", "#999999"),
                (OTHERS, "tested, trained on the others", "#0072B2"),
            )
        ):
            bars = {
                row["position"]: _mean_held_out(row) for row in group if row["training"] == training
            }
            places = [names.index(name) + 0.4 * k - 0.2 for name in bars]
            axes.bar(places, list(bars.values()), 0.38, label=label, color=color)

        axes.set_xticks(range(len(names)), names, rotation=20)
        axes.set_ylabel("held out, RMS [mm]")
        axes.legend(frameon=False)
        caption = "RMS distance from the mean of their socket."
        shown.append((f"Touches held out, {robot}", caption, figure))
    return shown


calibration_real_arms.page = (
    Page()
    .table(
        "Touches of real arms held out about their sockets",
        by=("robot", "training"),
        columns=[
            stat("median", _mean_held_out, "held out, median", unit="mm", digits=3),
            stat("total", "left_out"),
        ],
    )
    .add(intervals)
    .table(
        "The same by position",
        by=("robot", "training", "position"),
        columns=[
            "touches",
            "reduced",
            "left_out",
            stat("mean", _mean_held_out, "held out", unit="mm", digits=3),
        ],
    )
    .add(pictures)
)

if __name__ == "__main__":
    run_scenario(calibration_real_arms.main)
