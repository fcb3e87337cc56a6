"""Reproduction: ERA's wrist moves through gimbal lock with and without passing [Danilov 2021, figs.
6, 7].

    ./uvw run scripts/experiments/papers/track_singularity.py
    ./uvw run scripts/experiments/papers/track_singularity.py --passing limit --speed 0.05 --view

The arm is the European Robotic Arm (ERA). The lock: at a yaw of 90 deg the wrist's roll axis is
parallel to its pitch axis. Its pitch turns the yaw axis until it points at the shoulder. The tool
then cannot move along the pitch axis, which the published path along y0 requires. The arm has a
seventh joint and may evade the lock. The start is therefore found by tracking the path backwards
from the lock.

Writes metrics.json, track_singularity.png and run.rrd. Exit code 0: a joint exceeds the speed limit
without passing, none does with passing, and the tool ends on its path.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from uuv.arm_identification.arm_log import ArmLog
from uuv.controllers.ik.tracking import Passing
from uuv.controllers.mkps import Chain, Method, Track, track
from uuv.models.arms import published_arms
from uuv.models.arms.published_arms import PublishedArm
from uuv.models.arms.serial_arm import SerialArm
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.palette import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION, rgb
from uuv.sim.interfaces.spatial import Array, pose, rotation_angle
from uuv.sim.runs.provenance import provenance
from uuv.sim.runs.saving import write_json
from uuv.start import new_folder, parse, run_scenario

AT_LOCK = np.radians([90.0, 0.0, -30.0, 60.0, 62.64, 90.0, 0.0])  # [rad]; `lock` refines the fifth
_CURVES = (BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY, "#000000")


@dataclass
class Options:
    """Joint speeds and tool error along a path through the gimbal lock."""

    passing: Passing = "limit"
    """Method of passing the lock, in the run with passing."""
    method: Method = "hybrid"
    """IK method for each pose."""
    reach: float = 1.0
    """Length of the path before and after the lock [m]."""
    speed: float = 0.1
    """Speed of the wrist [m/s]."""
    speed_limit: float = 0.1
    """Speed limit of every joint [rad/s]."""
    period: float = 0.05
    """Time between poses [s]."""
    out: Path | None = None
    """Folder for metrics.json, the picture and run.rrd; default: a new one in
    runs/track_singularity.
    """
    view: bool = False
    """Open the Rerun viewer."""
    quick: bool = False
    """Half the path, twice the period."""
    record: bool = True
    """Write run.rrd (--no-record: metrics.json and the picture only)."""


def lock(arm: SerialArm) -> Array:
    """Joint values (7,) [rad] in the gimbal lock: `AT_LOCK`, the wrist's pitch by bisection.

    The yaw axis passes through the shoulder (joint 2) where the link before it is perpendicular to
    the line to the shoulder.
    """

    def along(pitch: float) -> float:
        frames = arm.joint_frames([*AT_LOCK[:4], pitch, *AT_LOCK[5:]])
        link = frames[5, :3, 3] - frames[4, :3, 3]
        return float(link @ (frames[5, :3, 3] - frames[1, :3, 3]))

    low, high = AT_LOCK[4] - 0.2, AT_LOCK[4] + 0.2

    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if along(low) * along(middle) > 0.0 else (low, middle)
    return np.array([*AT_LOCK[:4], low, *AT_LOCK[5:]])


def start(chain: Chain, q_lock: Array, path: Array, options: Options) -> Array:
    """Joint values at the first pose of `path` from which tracking leads into the lock, found
    backwards from the lock.

    Args:
        chain: The arm.
        q_lock: (7,) [rad] in the lock.
        path: (N, 4, 4) tip poses, the lock in the middle.
        options: Options of the command.

    Raises:
        ConfigurationError: The arm does not return to its path in time.
    """
    back = path[: len(path) // 2][::-1]
    run = track(
        chain, back, q_lock, options.period, speed_limits=4.0 * options.speed_limit, passing="limit"
    )

    if not run.converged[-1]:
        raise ConfigurationError(
            f"--reach {options.reach} at --speed {options.speed}: the arm does not come back to "
            "its path in time"
        )
    return np.array(run.q[-1])


def figures(run: Track, options: Options) -> dict[str, Any]:
    """Figures of one run."""
    fastest = np.abs(run.qd).max(axis=0)
    return {
        "largest_joint_speed": float(fastest.max()),
        "largest_speed_of_each_joint": fastest.tolist(),
        "largest_position_error_m": float(run.position_error.max()),
        "largest_orientation_error_rad": float(run.orientation_error.max()),
        "position_error_at_the_end_m": float(run.position_error[-1]),
        "off_the_path_s": float(options.period * np.sum(~run.converged)),
        "passing_s": float(options.period * sum(way != "none" for way in run.way)),
        "nearness": float(run.nearness.min()),
    }


def write_log(
    file: Path, arm: PublishedArm, runs: dict[str, Track], path: Array, view: bool
) -> None:
    """Writes run.rrd.

    Args:
        file: RRD file.
        arm: Kinematics.
        runs: Runs by name.
        path: (N, 4, 4) tip poses.
        view: Also show it in the Rerun viewer.
    """
    import rerun.blueprint as rrb

    names = list(runs)

    curves = [
        rrb.TimeSeriesView(
            name=f"joint speeds {name} passing [rad/s]", origin=f"series/speed_{name}"
        )
        for name in names
    ]

    blueprint = rrb.Horizontal(
        rrb.Spatial3DView(name="arm", origin="world"),
        rrb.Vertical(
            *curves,
            rrb.TimeSeriesView(name="tool error [mm]", origin="series/error"),
            rrb.TimeSeriesView(name="nearness to the lock", origin="series/nearness"),
        ),
        column_shares=[3, 2],
    )

    with ArmLog(file, f"{arm.title}: gimbal lock", blueprint, view=view) as log:
        log.line("path", path[:, :3, 3], (240, 228, 66), 0.02)

        time = runs[names[0]].time
        for (name, run), color in zip(runs.items(), (rgb(ORANGE), rgb(BLUE)), strict=True):
            log.arm(name, arm, time, run.q, color, stride=2)
            log.series(f"speed_{name}", [f"joint {i + 1}" for i in range(arm.n)], time, run.qd)

        log.series(
            "error",
            names,
            time,
            1e3 * np.column_stack([run.position_error for run in runs.values()]),
        )
        log.series(
            "nearness", names, time, np.column_stack([run.nearness for run in runs.values()])
        )


def draw(runs: dict[str, Track], options: Options, file: Path) -> None:
    """Plots joint values, joint speeds and tool errors over time, one column for each run [Danilov
    2021, fig. 7].

    Args:
        runs: Runs by name.
        options: Options of the command.
        file: PNG file.
    """
    figure = Figure(figsize=(12, 10), layout="constrained")
    grid = figure.subplots(4, len(runs), sharex=True, sharey="row", squeeze=False)

    for column, (name, run) in zip(grid.T, runs.items(), strict=True):
        for i in range(run.q.shape[1]):
            style = {"color": _CURVES[i % len(_CURVES)], "lw": 1.3, "label": f"joint {i + 1}"}
            column[0].plot(run.time, np.degrees(run.q[:, i]), **style)
            column[1].plot(run.time, run.qd[:, i], **style)

        column[0].set_title(f"{name} passing")
        column[1].set_yscale("symlog", linthresh=options.speed_limit)
        for sign in (-1.0, 1.0):
            column[1].axhline(sign * options.speed_limit, color="0.4", lw=0.8, ls="--")

        # Both tool errors in one panel, each with an axis.
        column[2].plot(run.time, 1e3 * run.position_error, color=_CURVES[0])
        turned = column[2].twinx()
        turned.plot(run.time, np.degrees(run.orientation_error), "--", color=_CURVES[3])
        turned.set_ylabel("orientation error [deg]", color=_CURVES[3])

        column[3].semilogy(run.time, run.nearness, color=_CURVES[2])

        # Shaded where joints are clamped or held.
        held = np.array([way == "hold" for way in run.way])
        clamped = np.array([way == "limit" for way in run.way])

        for axes in column:
            axes.grid(alpha=0.3)
            for active, color in ((clamped, _CURVES[1]), (held, _CURVES[4])):
                axes.fill_between(
                    run.time,
                    0,
                    1,
                    where=active,
                    transform=axes.get_xaxis_transform(),
                    color=color,
                    alpha=0.15,
                    lw=0,
                )

        column[3].set_xlabel("time [s]")
        turn = math.degrees(max(float(each.orientation_error.max()) for each in runs.values()))
        turned.set_ylim(0.0, 1.1 * max(turn, 1e-3))

    labels = (
        "joint values [deg]",
        "joint speeds [rad/s]\n(dashed: the limit)",
        "position error [mm]",
        "nearness (0: locked)",
    )

    for axes, label in zip(grid[:, 0], labels, strict=True):
        axes.set_ylabel(label)

    grid[2, 0].set_ylim(bottom=0.0)
    figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=7)
    figure.suptitle(
        "European Robotic Arm: wrist along y0 through the gimbal lock (orange: clamped, pink: a "
        "joint held)"
    )

    figure.savefig(file, dpi=100)


def main() -> int:
    """Runs both tracks and writes their files; exit code as in the module's docstring."""
    options = parse(Options)

    for name in ("reach", "speed", "speed_limit", "period"):
        if not (math.isfinite(value := getattr(options, name)) and value > 0.0):
            raise ConfigurationError(
                f"--{name.replace('_', '-')}: must be positive and finite, got {value}"
            )

    if options.passing == "off":
        raise ConfigurationError(
            "--passing: one run passes the lock; allowed auto, limit, hold, got 'off'"
        )

    if options.quick:
        options.reach, options.period = 0.5 * options.reach, 2.0 * options.period

    folder = new_folder("track_singularity", options.out)
    arm = published_arms.load("era")
    chain = Chain.from_arm(arm)
    q_lock = lock(arm)
    X_lock = arm.joint_frames(q_lock)[-1]

    # The path along y0, the lock in its middle.
    steps = 2 * round(options.reach / (options.speed * options.period))
    y = np.linspace(-options.reach, options.reach, steps + 1)
    path = np.array([pose(X_lock[:3, :3], X_lock[:3, 3] + [0.0, s, 0.0]) for s in y])
    q0 = start(chain, q_lock, path, options)

    console = Console()
    runs: dict[str, Track] = {}
    ways: dict[str, Passing] = {"without": "off", "with": options.passing}

    for name, passing in ways.items():
        with console.status(f"{name} passing"):
            runs[name] = track(
                chain,
                path[1:],
                q0,
                options.period,
                speed_limits=options.speed_limit,
                passing=passing,
                method=options.method,
            )

    told = {name: figures(run, options) for name, run in runs.items()}
    for name, run in runs.items():  # by the arm's own forward kinematics, independent of the solver
        tips = np.array([arm.joint_frames(row)[-1] for row in run.q])
        told[name]["checked_position_error_m"] = float(
            np.linalg.norm(tips[:, :3, 3] - path[1:, :3, 3], axis=1).max()
        )
        turned = [rotation_angle(a[:3, :3], b[:3, :3]) for a, b in zip(tips, path[1:], strict=True)]
        told[name]["checked_orientation_error_rad"] = float(max(turned))

    table = Table(
        title=f"{arm.title}, {2 * options.reach:g} m along y0 at {options.speed:g} m/s",
        title_justify="left",
    )
    table.add_column("")
    table.add_column("without passing", justify="right")
    table.add_column(f"with passing ({options.passing})", justify="right")

    rows = {
        "largest joint speed [rad/s]": ("largest_joint_speed", 1.0),
        "largest position error [mm]": ("checked_position_error_m", 1e3),
        "largest orientation error [deg]": ("checked_orientation_error_rad", math.degrees(1.0)),
        "position error at the end [mm]": ("position_error_at_the_end_m", 1e3),
        "time off the path [s]": ("off_the_path_s", 1.0),
        "time passing [s]": ("passing_s", 1.0),
        "least nearness": ("nearness", 1.0),
    }

    for label, (key, factor) in rows.items():
        table.add_row(escape(label), *(f"{factor * values[key]:.4g}" for values in told.values()))
    console.print(table)

    without, with_passing = told.values()
    accepted = (
        without["largest_joint_speed"] > options.speed_limit
        and with_passing["largest_joint_speed"] <= options.speed_limit * (1.0 + 1e-9)
        and with_passing["position_error_at_the_end_m"] <= 1e-5
    )

    metrics = {
        "runs": told,
        "accepted": accepted,
        "provenance": provenance("track_singularity", options),
    }

    write_json(folder / "metrics.json", metrics)
    draw(runs, options, folder / "track_singularity.png")

    if options.record or options.view:
        write_log(folder / "run.rrd", arm, runs, path, options.view)

    console.print("[green]accepted[/green]" if accepted else "[red]not accepted[/red]")
    console.print(f"written to {folder}/", highlight=False)
    return 0 if accepted else 1


if __name__ == "__main__":
    run_scenario(main)
