"""Plan of touches: the most informative of many candidate postures, with the expected error."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from uuv.arm_identification.calibration_case import CalibrationCase
from uuv.arm_identification.simulated_touches import LOOKING_DOWN, TOOLS
from uuv.arm_identification.tracked_moves import moves
from uuv.calib import Arm, Calibration, identify
from uuv.calib.arm_files import ArmSource
from uuv.calib.parameters import DEFAULT_FREE
from uuv.calib.planner import Plan, design, plan, random_merits
from uuv.calib.simulation import Postures, touch
from uuv.calib.touch_files import write_touch_list
from uuv.components.deck_calibration import CONE, DOWN, touched
from uuv.sim.interfaces.spatial import Array, whole_number
from uuv.sim.runs.saving import write_json
from uuv.sim.runs.terminal import verdict

NOT_ACCEPTED = 1  # exit code
FILE = "plan.csv"
MOST = 200  # largest number of planned touches
# smallest number of candidates of each point; number of candidates of all points for each planned
# touch
_CANDIDATES, _PER_TOUCH = 60, 3
_RANDOM = 50  # number of random choices to compare with
_TARGETS = 20  # number of flange points of the moves whose expected error is computed


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TouchPlan:
    """Planned touches with the expected RMS error of relative flange moves, without scale."""

    names: tuple[str, ...]  # names of the points
    points: Array  # (S, 3) [m] in the arm's base
    so_far: tuple[int, ...]  # number of touches already made of each point
    tcp: Array  # (3,) [m] tool point in the flange
    found: Plan
    random: Array  # (k,) [m] expected errors for as many random choices of touches

    @property
    def order(self) -> list[tuple[int, Array]]:
        """Point and joint values (n,) of each planned touch, ordered by point."""
        return [(i, q) for i, series in enumerate(self.found.series) for q in series]


@dataclass(frozen=True, slots=True, kw_only=True)
class NewPoints:
    """Points to draw if none was touched yet, and the tool and noise of their touches."""

    count: int
    # name in TOOLS; None: the tool point in the file, or the off-axis pin for a DH table
    pin: str | None
    noise: float  # [m] standard deviation of a touch along each axis


def planned(
    source: ArmSource,
    so_far: CalibrationCase | NewPoints,
    count: int,
    *,
    free: Sequence[str],
    prior: dict[str, float],
    rng: np.random.Generator,
) -> TouchPlan:
    """Plan touches of the points so far, with the arm identified from them, or of drawn points.

    Args:
        source: Nominal arm.
        so_far: Touches already made, or the points to draw.
        count: Number of touches to plan.
        free: Free parameters; empty: all.
        prior: Prior standard deviations by name; empty: from the data or, without data,
            `uuv.calib.parameters.DEFAULT_PRIOR`.
        rng: Draws points, candidates, moves and random choices.

    Raises:
        UuvError: The touches so far do not determine the arm, or the arm does not reach enough
            postures.
    """
    whole_number(count, "--plan", least=1, most=MOST)
    hangs = source.kind == "mjcf"
    how: dict[str, Any] = {"free": list(free) or DEFAULT_FREE, "prior": prior or None}

    if isinstance(so_far, NewPoints):
        # Drawn points, touched with the nominal arm.
        arm = source.arm
        tcp = _tool(source, so_far.pin)
        points = so_far.count
        per_point = max(_CANDIDATES, -(-_PER_TOUCH * count // points))
        way = DOWN if hangs else LOOKING_DOWN
        candidates, places = touched(
            arm, tcp, source.arm.limits, rng, points=points, touches=per_point, noise=0.0, way=way
        )
        model: Calibration | Arm = arm
        names = tuple(f"point{k + 1}" for k in range(points))
        done = [np.zeros((0, arm.n))] * points
        how |= {"tcp": tcp, "noise": so_far.noise}
    else:
        # Points so far, touched with the arm that they identify.
        model = identify(
            so_far.touches.series,
            source.arm,
            free=list(free) or None,
            prior=prior or None,
            distances=so_far.distances,
        )
        arm = model.arm
        tcp = model.tcp
        names = so_far.touches.names
        done = _without_outliers(model, so_far.touches.series)
        per_point = max(_CANDIDATES, -(-_PER_TOUCH * count // len(names)))
        candidates, places = _candidates(model, done, source.arm.limits, per_point, rng)
        how = {
            "free": model.names,
            "prior": dict(zip(model.names, model.estimate.prior, strict=True)),
            "done": done,
        }

    # Candidates are chosen for the error of the flange in other poses.
    targets = moves(arm, source.arm.limits, hangs, candidates, rng, _TARGETS)
    choice = design(model, candidates, targets=targets, **how)
    return TouchPlan(
        names=names,
        points=places,
        so_far=tuple(len(q) for q in done),
        tcp=np.array(tcp),
        found=plan(choice, count),
        random=random_merits(choice, count, rng, _RANDOM),
    )


def _tool(source: ArmSource, pin: str | None) -> Array:
    """Tool point (3,) [m] in the flange, the same as for the simulated touches."""
    if source.kind == "mjcf":  # the tip site is the tip of the vehicle's own tool
        return np.array([TOOLS[pin or "straight"][0], 0.0, 0.0])
    if pin is None and source.kind != "dh":
        return np.array(source.tcp)
    return np.array(TOOLS[pin or "off-axis"])


def _without_outliers(calibration: Calibration, series: Sequence[Array]) -> list[Array]:
    return [
        np.delete(
            q, [outlier.touch for outlier in calibration.outliers if outlier.series == i], axis=0
        )
        for i, q in enumerate(series)
    ]


def _candidates(
    calibration: Calibration,
    done: Sequence[Array],
    limits: Array,
    per_point: int,
    rng: np.random.Generator,
) -> tuple[list[Array], Array]:
    """Postures that touch the same points with the flange within CONE of its mean direction.

    Returns:
        Joint values (each, n) for each point, and the points (S, 3) [m] in the arm's base.
    """
    bounds = np.clip(limits, -np.pi, np.pi)
    places = np.array([calibration.tips(q).mean(axis=0) for q in done])

    # The flange stays about the mean direction of the touches so far.
    series: list[Array] = []
    for q, p in zip(done, places, strict=True):
        way = calibration.arm.flange(q)[:, :3, 2].mean(axis=0)
        series += touch(
            calibration.arm,
            calibration.tcp,
            rng,
            points=p[None],
            touches=per_point,
            noise=0.0,
            postures=Postures(approach=way / np.linalg.norm(way), cone=CONE, limits=bounds),
        )
    return series, places


def run(
    touch_plan: TouchPlan,
    source: ArmSource,
    seed: int,
    provenance: dict[str, Any],
    folder: Path,
    out: Console,
) -> int:
    """Print a plan, write plan.csv and metrics.json, and return the exit code.

    Args:
        touch_plan: The plan.
        source: Nominal arm.
        seed: Seed of the run.
        provenance: Options and versions.
        folder: Folder of results.
        out: Terminal.
    """
    count = len(touch_plan.order)
    planned_m = touch_plan.found.merit[-1]
    random_m = float(np.median(touch_plan.random))
    accepted = planned_m < float(np.median(touch_plan.random))
    title = f"Plan of {count} touches for {source.path.stem}"

    out.print(Text(title, style="bold"), f"with the tool point at {_mm(touch_plan.tcp)} mm")
    out.print(_points(touch_plan))
    out.print(_touches(touch_plan, source))
    out.print(_errors(touch_plan))
    out.print("Postures are within the joint limits; collisions are not checked.")
    if not any(touch_plan.so_far):
        out.print(
            "The points are examples within reach: touch your own points as close to these "
            "postures as possible."
        )

    point_names = [touch_plan.names[i] for i, _ in touch_plan.order]
    q = np.array([values for _, values in touch_plan.order])
    write_touch_list(folder / FILE, point_names, q, source.arm.joint_names, source.arm.joint_types)

    figures = {
        "expected_error_m": {
            "before": touch_plan.found.before,
            "planned": planned_m,
            "random_median": random_m,
            "random_least": float(touch_plan.random.min()),
        },
        "tool_point_m": touch_plan.tcp.tolist(),
        "points": [
            {"name": name, "position_m": p.tolist(), "so_far": before, "planned": len(series)}
            for name, p, before, series in zip(
                touch_plan.names,
                touch_plan.points,
                touch_plan.so_far,
                touch_plan.found.series,
                strict=True,
            )
        ],
    }

    content = {"title": title, "seed": seed, "accepted": accepted}
    write_json(folder / "metrics.json", {**content, "plan": figures, "provenance": provenance})

    no_gain = "these touches are not more informative than random ones; plan more"
    out.print(verdict("" if accepted else no_gain))
    out.print(f"written to {folder}/: {FILE}", highlight=False)
    return 0 if accepted else NOT_ACCEPTED


def _mm(p: Array) -> str:
    return "(" + ", ".join(f"{1e3 * value:.0f}" for value in p) + ")"


def _points(touch_plan: TouchPlan) -> Table:
    table = Table(title="points in the arm's base", title_justify="left")
    table.add_column("point")
    for column in ("x [m]", "y [m]", "z [m]", "touches so far", "planned"):
        table.add_column(Text(column), justify="right")

    for name, p, before, series in zip(
        touch_plan.names, touch_plan.points, touch_plan.so_far, touch_plan.found.series, strict=True
    ):
        table.add_row(name, *(f"{value:.3f}" for value in p), str(before), str(len(series)))
    return table


def _touches(touch_plan: TouchPlan, source: ArmSource) -> Table:
    slides = np.asarray(source.arm.slides)
    units = "[deg], slides [mm]" if slides.any() else "[deg]"
    table = Table(title=Text(f"planned touches {units}"), title_justify="left")
    table.add_column("point")
    for name in source.arm.joint_names:
        table.add_column(name, justify="right")

    last = len(touch_plan.order) - 1
    for k, (i, q) in enumerate(touch_plan.order):
        cells = np.where(slides, 1e3 * q, np.degrees(q))
        ends = k == last or touch_plan.order[k + 1][0] != i
        table.add_row(touch_plan.names[i], *(f"{value:.1f}" for value in cells), end_section=ends)
    return table


def _errors(touch_plan: TouchPlan) -> Table:
    table = Table(title="expected error of moves of the flange", title_justify="left")
    table.add_column("RMS without scale, after")
    table.add_column(Text("[mm]"), justify="right")

    before = (
        f"the {sum(touch_plan.so_far)} touches so far"
        if any(touch_plan.so_far)
        else "none: the nominal arm, by its prior"
    )
    count = len(touch_plan.order)
    planned_m = touch_plan.found.merit[-1]
    random_m = float(np.median(touch_plan.random))

    for words, error_m in (
        (before, touch_plan.found.before),
        (f"{count} random touches, median of {len(touch_plan.random)} choices", random_m),
        ("the best of these choices", float(touch_plan.random.min())),
        (f"the {count} planned touches", planned_m),
    ):
        table.add_row(words, f"{1e3 * error_m:.4f}")
    table.add_row("planned against random", f"{100.0 * (planned_m / random_m - 1.0):+.0f} %")
    return table
