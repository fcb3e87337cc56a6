"""ERA's wrist moves through gimbal lock, by each recipe and method [Danilov 2021, figs. 6, 7].

The arm is the European Robotic Arm (ERA). The lock: at a yaw of 90 deg the wrist's roll axis is
parallel to its pitch axis. Its pitch turns the yaw axis until it points at the shoulder. The tool
then cannot move along the pitch axis, which the published path along y0 requires. The arm has a
seventh joint and may evade the lock. The start is therefore found by tracking the path backwards
from the lock. Errors of the tool are checked by the arm's own forward kinematics.

The recipes are those of recipes.py beside this file: without passing, the two of the paper, and
those of this project. The default one moves the seventh joint, so that the lock is never met.
Accepted, by the default method: a joint exceeds the speed limit without passing, and none does by
any recipe; by the default recipe the tool stays on its path within 0.01 mm, at half of the limit.
"""

from uuv.start import run_scenario  # isort: skip

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.papers.recipes import (
    DEFAULT,
    NARROWED,
    RECIPES,
    WITHOUT,
    RecipePath,
    begun,
    line,
    tip_errors,
    tracked,
)
from uuv.controllers.mkps import Chain, Method, Track
from uuv.experiment import Page, Row, column, experiment, stat
from uuv.models.arms import published_arms
from uuv.models.arms.serial_arm import SerialArm
from uuv.sim.interfaces.palette import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION
from uuv.sim.interfaces.spatial import Array, finite_number, one_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

AT_LOCK = np.radians([90.0, 0.0, -30.0, 60.0, 62.64, 90.0, 0.0])  # [rad]; `lock` refines the fifth
ARM = "era"
METHODS: tuple[Method, ...] = ("plain", "jacobian_free", "hybrid")
DRAWN = ("plain", "hybrid"), (WITHOUT, NARROWED, DEFAULT)  # methods and recipes of the picture
_CURVES = (BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY, "#000000")
_DEGREES = math.degrees(1.0)


@dataclass(frozen=True, kw_only=True)
class TrackCase:
    """The path by one recipe and method."""

    recipe: str
    """How the lock is passed."""
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

    def __post_init__(self) -> None:
        one_of(self.recipe, RECIPES, "--recipe")
        for name in ("reach", "speed", "speed_limit", "period"):
            finite_number(getattr(self, name), f"--{name.replace('_', '-')}", above=0.0)


@dataclass(frozen=True, kw_only=True)
class TrackRow:
    """Figures of the run, and its joint values, speeds and errors at each pose."""

    joint_speed: float = column("largest joint speed", "rad/s")
    position_error: float = column("tool off", "mm", factor=1e3)
    orientation_error: float = column("tool turned off", "deg", factor=_DEGREES)
    end_error: float = column("tool off at the end", "mm", factor=1e3, tolerance=None)
    share_off: float = column("of the path off", "%", factor=100.0)
    passed: float = column("passing", "s")
    nearness: float = column("least nearness to the lock")


@experiment(
    "track_singularity",
    vary={"recipe": tuple(RECIPES), "method": METHODS},
    quick={"recipe": (WITHOUT, NARROWED, DEFAULT)},
)
def track_singularity(case: TrackCase) -> TrackRow:
    """Tracks the path through the lock."""
    path, run = passed_lock(case)
    arm = published_arms.load(ARM)
    errors = tip_errors(arm, run, path)
    return TrackRow(
        joint_speed=float(np.abs(run.qd).max()),
        position_error=float(errors.position.max()),
        orientation_error=float(errors.orientation.max()),
        end_error=float(errors.position[-1]),
        share_off=errors.share_off,
        passed=float(case.period * sum(way != "none" for way in run.way)),
        nearness=float(run.nearness.min()),
    )


def passed_lock(case: TrackCase) -> tuple[Array, Track]:
    """Tip poses (N, 4, 4) after the first one, and the run along them."""
    arm = published_arms.load(ARM)
    chain = Chain.from_arm(arm)
    q_lock = lock(arm)
    X_lock = arm.joint_frames(q_lock)[-1]

    # The path along y0, the lock in its middle
    path = line(X_lock, np.array([0.0, 1.0, 0.0]), case.reach, case.speed * case.period)
    back = path[: len(path) // 2][::-1]
    q0 = begun(chain, back, q_lock, case.period, speed_limits=4.0 * case.speed_limit)
    tool_path = RecipePath(poses=path[1:], q0=q0, period=case.period, speed_limit=case.speed_limit)
    run = tracked(arm, tool_path, case.recipe, case.method)
    return path[1:], run


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


def picture(rows: list[Row]) -> "Figure":
    """Joint values, joint speeds and tool errors over time, one column for each run [Danilov 2021,
    fig. 7]; the runs are done again.
    """
    from matplotlib.figure import Figure

    names = [entry.name for entry in fields(TrackCase)]
    methods, recipes = DRAWN
    drawn = [row for row in rows if row["method"] in methods and row["recipe"] in recipes]
    if not drawn:
        figure = Figure(figsize=(6, 1))
        figure.text(0.5, 0.5, f"drawn: {', '.join(methods)} by {', '.join(recipes)}", ha="center")
        return figure
    cases = [TrackCase(**{name: row[name] for name in names}) for row in drawn]
    runs = [passed_lock(case)[1] for case in cases]

    figure = Figure(figsize=(5 * len(cases), 10), layout="constrained")
    grid = figure.subplots(4, len(cases), sharex=True, sharey="row", squeeze=False)
    largest = _DEGREES * max(float(run.orientation_error.max()) for run in runs)
    for panels, case, run in zip(grid.T, cases, runs, strict=True):
        _draw_run(panels, case, run, 1.1 * max(largest, 1e-3))

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
    return figure


def _draw_run(panels: Sequence[Any], case: TrackCase, run: Track, most_turned: float) -> None:
    """Four panels of a run; the axis of orientation errors goes to `most_turned` [deg]."""
    values, speeds, errors, near = panels

    for i in range(run.q.shape[1]):
        style = {"color": _CURVES[i % len(_CURVES)], "linewidth": 1.3, "label": f"joint {i + 1}"}
        values.plot(run.time, np.degrees(run.q[:, i]), **style)
        speeds.plot(run.time, run.qd[:, i], **style)

    values.set_title(f"{case.recipe}\n{case.method}")
    speeds.set_yscale("symlog", linthresh=case.speed_limit)
    for sign in (-1.0, 1.0):
        speeds.axhline(sign * case.speed_limit, color="0.4", linewidth=0.8, linestyle="--")

    # Both tool errors in one panel, each with an axis.
    errors.plot(run.time, 1e3 * run.position_error, color=_CURVES[0])
    turned = errors.twinx()
    turned.plot(run.time, np.degrees(run.orientation_error), "--", color=_CURVES[3])
    turned.set_ylabel("orientation error [deg]", color=_CURVES[3])
    turned.set_ylim(0.0, most_turned)
    near.semilogy(run.time, run.nearness, color=_CURVES[2])
    near.set_xlabel("time [s]")

    # Shaded where joints are clamped or held.
    for axes in panels:
        axes.grid(alpha=0.3)
        for word, color in (("limit", _CURVES[1]), ("hold", _CURVES[4])):
            axes.fill_between(
                run.time,
                0,
                1,
                where=np.array([way == word for way in run.way]),
                transform=axes.get_xaxis_transform(),
                color=color,
                alpha=0.15,
                linewidth=0,
            )


def _over_limit(row: Row) -> float:
    return row["joint_speed"] / row["speed_limit"]


FIGURES = (
    "joint_speed",
    "position_error",
    "orientation_error",
    "share_off",
    "end_error",
    "passed",
    "nearness",
)


def _by(recipe: str) -> Callable[[Mapping[str, Any]], bool]:
    """Rows of a recipe by the default method."""
    return lambda row: row["recipe"] == recipe and row["method"] == TrackCase.method


track_singularity.page = (
    Page()
    .table("Through the gimbal lock", by=("recipe", "method"), columns=FIGURES)
    .accept(
        stat("least", _over_limit, "joint speed over the limit, without passing"),
        least=1.0 + 1e-9,
        where=_by(WITHOUT),
    )
    .accept(
        stat("largest", _over_limit, "joint speed over the limit, with passing"),
        most=1.0 + 1e-9,
        where=lambda row: row["recipe"] != WITHOUT and row["method"] == TrackCase.method,
    )
    .accept(
        stat("largest", _over_limit, "joint speed over the limit, by default"),
        most=0.5 + 1e-9,
        where=_by(DEFAULT),
    )
    .accept(
        stat("largest", "position_error", "tool off, by default"), most=1e-5, where=_by(DEFAULT)
    )
    .add(
        lambda rows: (
            "Wrist along y0 through the gimbal lock",
            "A column for each recipe and method. Orange: joints clamped.",
            lambda: picture(rows),
        )
    )
)

if __name__ == "__main__":
    run_scenario(track_singularity.main)
