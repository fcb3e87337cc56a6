"""Reproduction of the three experiments with the eight-joint servo arm of [Danilov 2021, ch. 4,
table 1, fig. 9].

    ./uvw run scripts/experiments/papers/servo_arm.py

1, a single solution from the first row of table 1 to the second; 2, motion along x; 3, motion in
trim. All use the three methods, to the published accuracy of 0.001 m and 0.01 rad for each goal.

What was measured on the real arm is simulated: the joint values go to proportional drives, and the
arm rests beside them under its own weight (`uuv.models.arms.servo_drives`). Masses and gains are
those of common servos, for the paper gives none.

The arm's dimensions are not public: `uuv.models.arms.published_arms.SERVO_ARM` is a stand-in. The
ranges of the two
motions are ours. So is the order of the angles: course about y, which is up, then trim about z,
then roll about x. With this order, the arm of the first row hangs straight down.

Writes metrics.json and two pictures. Exit code 0: every method reached the single solution, and the
default one all poses.
"""

import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from rich.console import Console
from rich.table import Table

from uuv.controllers.mkps import Chain, IkOptions, IkResult, Method, solve
from uuv.models.arms import published_arms
from uuv.models.arms.servo_drives import Servo, rest, servo_model
from uuv.sim.interfaces.palette import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION
from uuv.sim.interfaces.spatial import Array, exp_so3, pose, rotation_angle
from uuv.sim.runs.provenance import provenance
from uuv.sim.runs.saving import write_json
from uuv.start import new_folder, parse, run_scenario

# x, y, z [mm], course, trim, roll [deg]
INITIAL = np.array([-11.8, -498.9, -73.4, 239.782, 272.244, 239.270])
GIVEN = np.array([100.0, -400.0, 0.0, 5.0, -50.0, 0.0])  # the same, second row of table 1
SOLVED = np.array([99.5, -399.4, -0.3, 5.074, -50.491, -0.138])  # third row of table 1
# fourth row; y and z by the measuring scheme of fig. 10
MEASURED = np.array([89.0, 95.0, 66.0, 3.0, -45.0, 2.0])
UP = (0.0, 1.0, 0.0)  # y
POSITION, ANGLE = 1e-3, 1e-2  # [m], [rad] published accuracy of each goal
ALONG_X = (100.0, -100.0)  # [mm] first and last x of experiment 2
IN_TRIM = (-50.0, -10.0)  # [deg] first and last trim of experiment 3
METHODS: tuple[Method, ...] = ("plain", "jacobian_free", "hybrid")
GOALS = ("F_R [m]", "F_alpha1 [rad]", "F_alpha2 [rad]")
# by motion: label, values, results by method
Runs = dict[str, tuple[str, Array, dict[Method, list[IkResult]]]]
_CURVES = (BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY, "#000000", "#999999")


@dataclass
class Options:
    """Joint values and goals over iterations, for the three methods."""

    poses: int = 101
    """Number of poses of each motion."""
    out: Path | None = None
    """Folder for metrics.json and the pictures; default: a new one in runs/servo_arm."""
    quick: bool = False
    """Fewer poses."""


def tool_pose(row: Array) -> Array:
    """Pose (4, 4) of the tip for a row of table 1.

    The published E_x is along the tool and E_z across it; ours are z and x.
    """
    course, trim, roll = np.radians(row[3:])
    R = exp_so3([0.0, course, 0.0]) @ exp_so3([0.0, 0.0, trim]) @ exp_so3([roll, 0.0, 0.0])
    return pose(np.column_stack([R[:, 2], np.cross(R[:, 0], R[:, 2]), R[:, 0]]), 1e-3 * row[:3])


def row_of(X: Array) -> Array:
    """The row of table 1 for a pose, inverse of `tool_pose`; angles in (-180, 180] deg, trim in
    [-90, 90] deg.
    """
    R = np.column_stack([X[:3, 2], np.cross(X[:3, 0], X[:3, 2]), X[:3, 0]])
    course, roll = math.atan2(-R[2, 0], R[0, 0]), math.atan2(-R[1, 2], R[1, 1])

    return np.array(
        [
            *(1e3 * X[:3, 3]),
            *np.degrees([course, math.atan2(R[1, 0], math.hypot(R[0, 0], R[2, 0])), roll]),
        ]
    )


def solved(chain: Chain, row: Array, q: Array, method: Method, *, track: bool) -> IkResult:
    """Solves for one row of table 1 with the published accuracies.

    Args:
        chain: The arm.
        row: x, y, z [mm], course, trim, roll [deg].
        q: (n,) [rad] start.
        method: Method of the solver.
        track: Keep the branch of the start.
    """
    return solve(
        chain,
        tool_pose(row),
        q,
        POSITION,
        ANGLE,
        method=method,
        branch="keep" if track else "free",
        options=IkOptions(history=True, stage_tolerances=(ANGLE, ANGLE)),
    )


def motion(chain: Chain, rows: Array, q: Array, method: Method) -> list[IkResult]:
    """Solves each row in turn, each from the result before.

    Args:
        chain: The arm.
        rows: (N, 6) rows as in table 1.
        q: (n,) [rad] start.
        method: Method of the solver.
    """
    found = []
    for row in rows:
        found.append(solved(chain, row, q, method, track=True))
        q = np.array(found[-1].q)

    return found


def goals_of(result: IkResult) -> Array:
    """The three goals (iterations + 1, 3) of a result of `solved`."""
    assert result.goals is not None
    return result.goals


def draw_single(results: dict[str, IkResult], file: Path) -> None:
    """Plots joint values and goals over iterations, a column a method [Danilov 2021, fig. 9]."""
    figure = Figure(figsize=(13, 7), layout="constrained")
    grid = figure.subplots(2, len(results), sharey="row", squeeze=False)

    for column, (method, result) in zip(grid.T, results.items(), strict=True):
        assert result.history is not None
        marker = "o" if len(result.history) < 40 else ""

        for i, values in enumerate(np.degrees(result.history.T)):
            column[0].plot(values, color=_CURVES[i], marker=marker, ms=3, label=f"joint {i + 1}")

        for k, (goal, values) in enumerate(zip(GOALS, goals_of(result).T, strict=True)):
            column[1].semilogy(
                np.maximum(values, 1e-7), color=_CURVES[k], marker=marker, ms=3, label=goal
            )

        column[1].axhline(POSITION, color=_CURVES[0], ls="--", lw=0.8)
        column[1].axhline(ANGLE, color=_CURVES[1], ls="--", lw=0.8)

        column[1].xaxis.set_major_locator(MaxNLocator(integer=True))
        column[0].xaxis.set_major_locator(MaxNLocator(integer=True))
        column[0].set_title(f"{method}: {result.iterations} iterations")
        column[1].set_xlabel("iteration")

        for axes in column:
            axes.grid(alpha=0.3)

    grid[0, 0].set_ylabel("joint values [deg]")
    grid[1, 0].set_ylabel("goals (dashed: their accuracies)")
    grid[0, -1].legend(fontsize=8, ncols=2)
    grid[1, -1].legend(fontsize=8)
    grid[1, 0].set_ylim(bottom=1e-5)

    figure.suptitle("Experiment 1: a single solution")
    figure.savefig(file, dpi=100)


def draw_motions(runs: Runs, file: Path) -> None:
    """Plots joint values and goals of the default method and all iterations, one column for each
    motion.
    """
    figure = Figure(figsize=(12, 9), layout="constrained")
    grid = figure.subplots(3, len(runs), sharey="row", squeeze=False)

    for column, (label, values, by_method) in zip(grid.T, runs.values(), strict=True):
        default = by_method["hybrid"]

        for i, joint in enumerate(np.degrees([result.q for result in default]).T):
            column[0].plot(values, joint, color=_CURVES[i], label=f"joint {i + 1}")

        for k, goal in enumerate(np.array([goals_of(result)[-1] for result in default]).T):
            column[1].semilogy(values, np.maximum(goal, 1e-7), color=_CURVES[k], label=GOALS[k])
        column[1].axhline(POSITION, color=_CURVES[0], ls="--", lw=0.8)
        column[1].axhline(ANGLE, color=_CURVES[1], ls="--", lw=0.8)

        for k, (method, results) in enumerate(by_method.items()):
            column[2].semilogy(
                values,
                np.maximum([result.iterations for result in results], 0.5),
                color=_CURVES[k],
                label=method,
            )

            lost = np.array([not result.converged for result in results])
            if lost.any():
                column[2].plot(
                    values[lost],
                    np.array([r.iterations for r in results])[lost],
                    "x",
                    color=_CURVES[k],
                    label=f"{method}: not reached",
                )

        column[2].set_xlabel(label)
        for axes in column:
            axes.grid(alpha=0.3)
            axes.set_xlim(values[0], values[-1])

    for axes, label in zip(
        grid[:, 0],
        ("joint values [deg], hybrid", "goals, hybrid", "iterations a pose"),
        strict=True,
    ):
        axes.set_ylabel(label)

    for axes, columns in zip(grid[:, 0], (4, 3, 4), strict=True):
        axes.legend(fontsize=8, ncols=columns, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    for axes, title in zip(grid[0], runs, strict=True):
        axes.set_title(title, loc="right")
    figure.savefig(file, dpi=100)


def figures(results: list[IkResult], q: Array) -> dict[str, Any]:
    """Figures of a motion that began at `q`."""
    steps = np.abs(np.diff(np.vstack([q, *(result.q for result in results)]), axis=0))
    counts = [result.iterations for result in results]
    return {
        "reached": float(np.mean([result.converged for result in results])),
        "iterations_median": float(np.median(counts)),
        "iterations_most": max(counts),
        "largest_position_error_m": max(result.position_error for result in results),
        "largest_orientation_error_rad": max(result.orientation_error for result in results),
        "largest_joint_step_deg": math.degrees(float(steps.max())),
    }


def at_rest(chain: Chain, drives: mujoco.MjModel, results: list[IkResult]) -> dict[str, float]:
    """Largest static errors of the tip on proportional drives, over the poses of a motion."""
    pairs = [(chain.forward(result.q), chain.forward(rest(drives, result.q))) for result in results]
    return {
        "largest_static_error_m": max(float(np.linalg.norm(a[:3, 3] - b[:3, 3])) for a, b in pairs),
        "largest_static_error_rad": max(rotation_angle(a[:3, :3], b[:3, :3]) for a, b in pairs),
    }


def main() -> int:
    """Runs the experiments and writes their files; exit code as in the module's docstring."""
    options = parse(Options)
    count = max(2, options.poses // 8 if options.quick else options.poses)
    folder = new_folder("servo_arm", options.out)
    arm = published_arms.SERVO_ARM
    chain = Chain.from_vectors(arm.M, arm.e, arm.p, arm.L)
    console = Console(width=None if sys.stdout.isatty() else 120)
    # All methods start from the same joint values, solved to a tight tolerance.
    q_initial = np.array(solve(chain, tool_pose(INITIAL), np.full(chain.n, 0.1), 1e-6, 1e-6).q)
    single = {method: solved(chain, GIVEN, q_initial, method, track=False) for method in METHODS}

    table = Table(title="1. A single solution ([Danilov 2021], table 1)", title_justify="left")
    for heading in ("", "X mm", "Y mm", "Z mm", "course deg", "trim deg", "roll deg", "iterations"):
        table.add_column(heading, justify="right" if heading else "left")

    rows = {"initial": row_of(chain.forward(q_initial)), "given": GIVEN}
    rows |= {method: row_of(chain.forward(result.q)) for method, result in single.items()}

    drives = servo_model(arm, Servo(), UP)
    measured = {method: rest(drives, result.q) for method, result in single.items()}
    rows |= {f"measured, {method}": row_of(chain.forward(q)) for method, q in measured.items()}
    rows |= {"published: solved": SOLVED, "published: measured": MEASURED}

    for name, row in rows.items():
        counted = str(single[name].iterations) if name in single else ""
        table.add_row(
            name,
            *(f"{value:.1f}" for value in row[:3]),
            *(f"{value:.3f}" for value in row[3:]),
            counted,
        )

    console.print(table)

    x, trim = np.linspace(*ALONG_X, count), np.linspace(*IN_TRIM, count)
    q_given = np.array(solve(chain, tool_pose(GIVEN), single["hybrid"].q, 1e-6, 1e-6).q)
    motions = {"2. motion along x": ("x [mm]", x, 0), "3. motion in trim": ("trim [deg]", trim, 4)}
    runs: Runs = {}
    told: dict[str, Any] = {}

    for title, (label, values, index) in motions.items():
        poses = np.tile(GIVEN, (count, 1))
        poses[:, index] = values

        runs[title] = (
            label,
            values,
            {method: motion(chain, poses, q_given, method) for method in METHODS},
        )

        told[title] = {
            method: figures(results, q_given) | at_rest(chain, drives, results)
            for method, results in runs[title][2].items()
        }

        table = Table(title=title, title_justify="left")
        for heading in (
            "",
            "reached %",
            "iterations: median",
            "most",
            "position mm",
            "orientation deg",
            "joint step deg",
            "at rest mm",
            "at rest deg",
        ):
            table.add_column(heading, justify="right" if heading else "left")

        for method, found in told[title].items():
            table.add_row(
                method,
                f"{100 * found['reached']:.1f}",
                f"{found['iterations_median']:.0f}",
                str(found["iterations_most"]),
                f"{1e3 * found['largest_position_error_m']:.2f}",
                f"{math.degrees(found['largest_orientation_error_rad']):.3f}",
                f"{found['largest_joint_step_deg']:.2f}",
                f"{1e3 * found['largest_static_error_m']:.1f}",
                f"{math.degrees(found['largest_static_error_rad']):.1f}",
            )

        console.print(table)

    accepted = all(result.converged for result in single.values()) and all(
        by_method["hybrid"]["reached"] == 1.0 for by_method in told.values()
    )

    metrics = {
        "scenario": "servo_arm",
        "poses": count,
        "accepted": accepted,
        "single": {
            method: {
                "row": row_of(chain.forward(result.q)).tolist(),
                "iterations": result.iterations,
                "converged": result.converged,
                "goals": goals_of(result)[-1].tolist(),
                "cause": result.cause,
                "measured": rows[f"measured, {method}"].tolist(),
            }
            for method, result in single.items()
        },
        "motions": told,
        "provenance": provenance("servo_arm", options),
    }

    write_json(folder / "metrics.json", metrics)
    draw_single(dict(single), folder / "single_solution.png")
    draw_motions(runs, folder / "motions.png")

    console.print("[green]accepted[/green]" if accepted else "[red]not accepted[/red]")
    console.print(f"written to {folder}/", highlight=False)
    return 0 if accepted else 1


if __name__ == "__main__":
    run_scenario(main)
