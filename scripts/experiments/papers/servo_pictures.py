"""Pictures of the experiments with the servo arm: joint values, goals and iterations."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from experiments.papers.servo_motions import (
    ANGLE,
    DEFAULT,
    MOTIONS,
    POSITION,
    goals_of,
    motion,
    motion_values,
    single_solution,
)
from uuv.controllers.mkps import IkResult, Method
from uuv.sim.interfaces.palette import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION

GOALS = ("F_R [m]", "F_alpha1 [rad]", "F_alpha2 [rad]")
LABELS = {"along x": "x [mm]", "in trim": "trim [deg]"}
_CURVES = (BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY, "#000000", "#999999")
_FLOOR = 1e-7  # of goals on a logarithmic axis


def single(methods: Sequence[Method]) -> Figure:
    """Joint values and goals over iterations, a column a method [Danilov 2021, fig. 9]."""
    figure = Figure(figsize=(13, 7), layout="constrained")
    grid = figure.subplots(2, len(methods), sharey="row", squeeze=False)

    for (values, goals), method in zip(grid.T, methods, strict=True):
        result = single_solution(method)
        assert result.history is not None
        marker = "o" if len(result.history) < 40 else ""

        for i, joint in enumerate(np.degrees(result.history.T)):
            values.plot(joint, color=_CURVES[i], marker=marker, ms=3, label=f"joint {i + 1}")
        for k, goal in enumerate(goals_of(result).T):
            shown = np.maximum(goal, _FLOOR)
            goals.semilogy(shown, color=_CURVES[k], marker=marker, ms=3, label=GOALS[k])

        _accuracies(goals)
        values.set_title(f"{method}: {result.iterations} iterations")
        goals.set_xlabel("iteration")
        for axes in (values, goals):
            axes.xaxis.set_major_locator(MaxNLocator(integer=True))
            axes.grid(alpha=0.3)

    grid[0, 0].set_ylabel("joint values [deg]")
    grid[1, 0].set_ylabel("goals (dashed: their accuracies)")
    grid[0, -1].legend(fontsize=8, ncols=2)
    grid[1, -1].legend(fontsize=8)
    grid[1, 0].set_ylim(bottom=1e-5)
    return figure


def motions(methods: Sequence[Method], poses: int) -> Figure:
    """Joint values and goals of the default method and iterations of all, one column for each
    motion.
    """
    figure = Figure(figsize=(12, 9), layout="constrained")
    grid = figure.subplots(3, len(MOTIONS), sharey="row", squeeze=False)

    for column, name in zip(grid.T, MOTIONS, strict=True):
        values = motion_values(name, poses)
        _draw_default(column[0], column[1], values, motion(name, poses, DEFAULT))
        for k, method in enumerate(methods):
            _draw_iterations(column[2], values, motion(name, poses, method), method, _CURVES[k])

        column[0].set_title(name, loc="right")
        column[2].set_xlabel(LABELS[name])
        for axes in column:
            axes.grid(alpha=0.3)
            axes.set_xlim(values[0], values[-1])

    labels = (f"joint values [deg], {DEFAULT}", f"goals, {DEFAULT}", "iterations a pose")
    for axes, label, columns in zip(grid[:, 0], labels, (4, 3, 4), strict=True):
        axes.set_ylabel(label)
        axes.legend(fontsize=8, ncols=columns, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    return figure


def _draw_default(joints: Any, goals: Any, values: np.ndarray, results: list[IkResult]) -> None:
    """Joint values and goals of a motion."""
    for i, joint in enumerate(np.degrees([result.q for result in results]).T):
        joints.plot(values, joint, color=_CURVES[i], label=f"joint {i + 1}")

    for k, goal in enumerate(np.array([goals_of(result)[-1] for result in results]).T):
        goals.semilogy(values, np.maximum(goal, _FLOOR), color=_CURVES[k], label=GOALS[k])
    _accuracies(goals)


def _draw_iterations(
    axes: Any, values: np.ndarray, results: list[IkResult], method: str, color: str
) -> None:
    """Iterations of each pose of a motion; poses that were not reached are crossed."""
    counts = np.array([result.iterations for result in results])
    axes.semilogy(values, np.maximum(counts, 0.5), color=color, label=method)

    lost = np.array([not result.converged for result in results])
    if lost.any():
        axes.plot(values[lost], counts[lost], "x", color=color, label=f"{method}: not reached")


def _accuracies(axes: Any) -> None:
    for k, accuracy in enumerate((POSITION, ANGLE)):
        axes.axhline(accuracy, color=_CURVES[k], linestyle="--", linewidth=0.8)
