"""Calibration of an arm as run by a command: its input, and printed and written results."""

import datetime
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from uuv.arm_identification import touch_plan
from uuv.arm_identification.calibration_case import CalibrationCase, Loading, from_files, nominal
from uuv.arm_identification.calibration_figures import figures_of_merit, metrics, most_changed
from uuv.arm_identification.calibration_options import COMMAND, CalibrationOptions
from uuv.arm_identification.calibration_outcome import CalibrationOutcome, failed, solve
from uuv.arm_identification.calibration_remarks import remarks
from uuv.arm_identification.simulated_touches import RealEffects, by_contact, simulated
from uuv.arm_identification.touching import touching_scenario
from uuv.calib import report
from uuv.calib.results import write_results
from uuv.calib.touch_files import write_touches
from uuv.scenario import VehicleSetup
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import finite_number, whole_number
from uuv.sim.runs.provenance import provenance, provenance_rows
from uuv.sim.runs.saving import write_json, write_whole
from uuv.sim.runs.terminal import verdict
from uuv.site import OpenWater, Site

_MOST_POINTS, _MOST_POSES = 100, 10_000


def case_of(options: CalibrationOptions, folder: Path, rng: np.random.Generator) -> CalibrationCase:
    """The arm and its touches, from files or simulated.

    Args:
        options: Command line.
        folder: Folder of results, for a vehicle's MJCF and the log, too.
        rng: Draws the simulated touches.

    Raises:
        UuvError: The files cannot be read, the options contradict each other, or the arm does not
            reach the points.
    """
    # Deviations of a simulated arm.
    real = RealEffects(
        compliance=finite_number(
            options.true_compliance, "--true-compliance [rad/(N m)]", least=0.0, most=0.01
        ),
        gears=finite_number(options.true_gears, "--true-gears [rad]", least=0.0, most=0.1),
        seating=finite_number(options.true_seating, "--true-seating [m]", least=0.0, most=0.01),
    )
    if options.touches and real != RealEffects():
        raise ConfigurationError(
            "--touches or --true-compliance, --true-gears, --true-seating: not both"
        )
    if (options.payload or options.link_mass) and not (options.compliance or real.compliance > 0.0):
        raise ConfigurationError("--payload and --link-mass: only with --compliance")

    source = nominal(options.arm, folder, options.base, options.tip)
    if options.touches:
        if options.touching != "noise":
            raise ConfigurationError("--touches and --touching: give only one of the two")
        held, units, limits = options.held_out, options.units, options.limits
        return from_files(source, options.touches, held, units, options.distance, limits)

    if options.distance or options.held_out:
        raise ConfigurationError("--distance and --held-out: only with --touches")
    contact = options.touching != "noise"
    if contact and (options.compliance or real != RealEffects()):
        raise ConfigurationError("--compliance and --true-...: not with touching by contact")

    # Sizes of the simulated session.
    few = options.quick and contact
    points = options.points if options.points is not None else 3 if few or not contact else 4
    poses = options.poses if options.poses is not None else 5 if few else 10 if contact else 21
    whole_number(points, "--points", least=1, most=_MOST_POINTS)
    whole_number(poses, "--poses", least=2, most=_MOST_POSES)
    finite_number(options.noise, "--noise [m]", above=0.0, most=0.1)

    errors = whole_number(
        options.seed if options.arm_errors is None else options.arm_errors, "--arm-errors"
    )
    known = options.arm != "ur10e" if options.known_length is None else options.known_length
    pin = options.pin or ("straight" if source.kind == "mjcf" else "off-axis")

    if not contact:
        if options.view:
            raise ConfigurationError("--view: only allowed with --touching clamped or hovering")
        return simulated(
            source,
            points=points,
            touches=poses,
            noise=options.noise,
            pin=pin,
            known=known,
            errors=errors,
            rng=rng,
            real=real,
            loading=loading_of(options),
        )

    if source.kind != "mjcf":
        raise ConfigurationError(
            f"--touching {options.touching}: needs a vehicle or its MJCF, got --arm {options.arm}"
        )

    logs: list[Any] = []

    def watch(model: mujoco.MjModel) -> Any:
        from uuv.sim.reporting.rerun_log import RerunLog

        logs.append(
            RerunLog(
                folder / "run.rrd", model, title=f"Touching, {options.touching}", view=options.view
            )
        )
        return logs[0]

    hovering = options.touching == "hovering"
    site = replace(options.site(), object=OpenWater())
    scenario = touching_scenario(
        VehicleSetup(vehicle=options.arm, arm_errors=errors),
        site if hovering else Site(object=OpenWater(), current=(0.0, 0.0, 0.0), gust=0.0),
        hovering=hovering,
        nests=points,
        touches=poses,
        seed=options.seed,
    )

    shown = watch if options.record or options.view else None
    try:
        return by_contact(source, scenario, known=known, rng=rng, watch=shown)
    finally:
        for log in logs:
            log.close()


def loading_of(options: CalibrationOptions) -> Loading:
    """Loads on the arm from the options."""
    return Loading(link_masses=options.link_mass, payload=options.payload)


def plan_touches(
    options: CalibrationOptions, folder: Path, console: Console, rng: np.random.Generator
) -> int:
    """Plan touches, print and write them, and return the exit code.

    Args:
        options: Command line.
        folder: Folder of results.
        console: Terminal.
        rng: Draws points, candidates and random choices.

    Raises:
        UuvError: Options contradict each other, files cannot be read, or the arm does not reach
            enough postures.
    """
    # Options that have no effect on a plan.
    simulated = {"--touching": options.touching != "noise", "--poses": options.poses is not None}
    judged = {
        "--held-out": bool(options.held_out),
        "--method paper": options.method == "paper",
        "--view": options.view,
    }
    for name, option in {**simulated, **judged}.items():
        if option:
            raise ConfigurationError(f"--plan and {name}: give only one of the two")

    if options.distance and not options.touches:
        raise ConfigurationError("--distance and --held-out: only with --touches")
    points = whole_number(
        3 if options.points is None else options.points, "--points", least=1, most=_MOST_POINTS
    )
    noise = finite_number(options.noise, "--noise [m]", above=0.0, most=0.1)

    source = nominal(options.arm, folder, options.base, options.tip)
    so_far = touch_plan.NewPoints(count=points, pin=options.pin, noise=noise)
    if options.touches:
        so_far = from_files(
            source, options.touches, (), options.units, options.distance, options.limits
        )

    for note in source.notes if isinstance(so_far, touch_plan.NewPoints) else so_far.notes:
        console.print(note, style="yellow", highlight=False)
    plan = touch_plan.planned(
        source, so_far, options.plan or 0, free=options.free, prior=dict(options.prior), rng=rng
    )
    return touch_plan.run(plan, source, options.seed, provenance(COMMAND, options), folder, console)


def calibrate(
    options: CalibrationOptions, folder: Path, console: Console, rng: np.random.Generator
) -> int:
    """Calibrate, print and write the results, and return the exit code.

    Args:
        options: Command line.
        folder: Folder of results.
        console: Terminal.
        rng: Draws the simulated touches.

    Raises:
        UuvError: As for `case_of`, or the touches do not determine the arm.
    """
    case = case_of(options, folder, rng)

    if options.compliance:
        if options.method == "paper":
            raise ConfigurationError("--compliance and --method paper: give only one of the two")
        case = replace(case, loads=loading_of(options).on(case.source, len(case.touches.series)))

    for note in case.notes:
        console.print(note, style="yellow", highlight=False)

    outcome = solve(case, free=options.free, prior=dict(options.prior), method=options.method)
    reasons = failed(outcome, options.method)
    _say(case, outcome, console)
    undetermined = (*outcome.examined.untold, *remarks(case, outcome))
    files = _write(case, outcome, options, folder, undetermined)

    console.print(verdict("; ".join(reasons)))
    for line in undetermined:
        console.print(f"undetermined: {line}", style="yellow", highlight=False)
    console.print(
        f"written to {folder}/: {', '.join(file.name for file in files)}", highlight=False
    )
    return touch_plan.NOT_ACCEPTED if reasons else 0


def _say(case: CalibrationCase, outcome: CalibrationOutcome, console: Console) -> None:
    """Print the figures of merit, the parameters that changed most and the undetermined ones."""
    calibration = outcome.calibration
    console.print(Text(case.title, style="bold"))
    for warning in calibration.warnings:
        console.print(warning, style="yellow", highlight=False)

    table = Table()
    table.add_column("figure")
    table.add_column("value", justify="right")
    for name, text in figures_of_merit(case, outcome):
        table.add_row(Text(name), text)
    console.print(table)

    console.print(_most_changed(outcome))
    for group in calibration.rank.hidden:
        console.print(f"not observable: {group}", highlight=False)


def _write(
    case: CalibrationCase,
    outcome: CalibrationOutcome,
    options: CalibrationOptions,
    folder: Path,
    undetermined: Sequence[str],
) -> list[Path]:
    """Write arm, simulated touches, metrics and report, and return the files of the arm."""
    calibration = outcome.calibration
    accepted = not failed(outcome, options.method)
    date = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    source, arm, sha256 = case.source, outcome.arm, case.touches.sha256
    files = write_results(
        folder, calibration, source, arm=arm, tcp=outcome.tcp, sha256=sha256, date=date
    )

    if case.truth is not None:
        write_touches(
            folder / "touches", case.touches.names, case.touches.series, source.arm.joint_names
        )

    content = metrics(case, outcome, accepted, options.seed)
    write_json(folder / "metrics.json", {**content, "provenance": provenance(COMMAND, options)})

    if options.record:
        settings = {**asdict(options), "date": date, "touches sha256": sha256}
        statement = report.Statement(
            title=case.title,
            accepted=accepted,
            figures_of_merit=figures_of_merit(case, outcome),
            notes=(*case.notes, *(f"undetermined: {line}" for line in undetermined)),
            provenance=provenance_rows(settings),
        )

        page = report.report_page(
            calibration,
            statement,
            series=outcome.series,
            point_names=case.touches.names,
            clouds=outcome.clouds,
            rigid=outcome.rigid,
        )
        write_whole(folder / "report.html", page)
    return list(files)


def _most_changed(outcome: CalibrationOutcome) -> Table | str:
    """Table of the parameters with significant changes, most significant first."""
    rows = most_changed(outcome.calibration)
    if not rows:
        return "no parameter of the arm changed significantly: every 95 % interval contains nominal"
    table = Table(title="largest significant changes", title_justify="left")
    for column in ("", "change", "95 %", "unit"):
        table.add_column(column, justify="right" if column in ("change", "95 %") else "left")
    for row in rows:
        table.add_row(*row)
    return table
