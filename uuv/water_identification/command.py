"""Identification of a vehicle's hydrodynamics as run by a command: input, fit, plan and files."""

import datetime
import hashlib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from uuv.calib.water.estimator import WaterFit
from uuv.calib.water.findings import Finding, findings, together
from uuv.calib.water.logs import ATTITUDE, POSITION, RATE, WaterLog, write_log
from uuv.calib.water.named_fit import values_of
from uuv.calib.water.planning import Planned, planned
from uuv.calib.water.results import write_fit, write_vehicle
from uuv.models import hydrodynamics
from uuv.own_vehicle import vehicle_spec
from uuv.sim.evaluation.intervals import SIGMAS
from uuv.sim.interfaces.extras import absent
from uuv.sim.interfaces.spatial import Array, finite_number, one_of
from uuv.sim.runs.provenance import provenance
from uuv.sim.runs.run_folder import new_folder
from uuv.sim.runs.saving import write_json
from uuv.water_identification.log_residuals import WaterResiduals, identify
from uuv.water_identification.manoeuvres import simulated, survey
from uuv.water_identification.next_manoeuvre import next_manoeuvres
from uuv.water_identification.options import COMMAND, WaterOptions, check_aim, logs_of, settings_of
from uuv.water_identification.replayed_parts import ranges_of
from uuv.water_identification.settings import FitSettings
from uuv.water_identification.vehicle_replay import ReplayVehicle

_USUAL = (POSITION, ATTITUDE, RATE)  # channels of a planned or simulated log
_PIECE = 1 << 20  # [bytes] of a file that are read at once
_SHOWN = 4  # number of manoeuvres in the table of a plan


def vehicle_of(options: WaterOptions) -> tuple[mujoco.MjSpec, ReplayVehicle]:
    """The believed vehicle, and the vehicle for replay with the requested priors.

    Raises:
        UuvError: There is no such vehicle, or it has no hydrodynamics.
    """
    check_aim(options)
    spec = vehicle_spec(options.vehicle)
    if options.water_density is not None:
        density = finite_number(
            options.water_density, "--water-density [kg/m^3]", above=0.0, most=3000.0
        )
        hydrodynamics.attach(spec, {}, density)

    replay = ReplayVehicle(spec)
    names = [parameter.name for parameter in replay.water.parameters]
    planned(np.eye(len(names)), {}, replay.water.parameters, options.aim)  # it has such a group
    for name, sigma in options.prior:
        one_of(name, names, "--prior")
        finite_number(sigma, f"--prior {name}", above=0.0)

    other = dict(options.prior)
    replay.water = replace(
        replay.water,
        parameters=tuple(
            replace(parameter, sigma=other.get(parameter.name, parameter.sigma))
            for parameter in replay.water.parameters
        ),
    )
    return spec, replay


def run(options: WaterOptions, console: Console) -> int:
    """Identify or plan, print and write the results, and return the exit code.

    Raises:
        UuvError: Options, vehicle or logs are wrong.
    """
    settings = settings_of(options)
    finite_number(options.seconds, "--seconds [s]", least=10.0, most=3600.0)
    spec, replay = vehicle_of(options)
    n = len(replay.water.parameters)
    logs = logs_of(options, replay.vehicle, replay.names, ranges_of(replay.vehicle))

    if not logs and options.plan:
        folder = new_folder(COMMAND, options.out, options.seed)
        _plan(options, replay, np.zeros(n), np.eye(n), settings, _USUAL, folder, console)
        return 0

    # Logs of the user, or of a simulated vehicle that is drawn from the prior.
    truth: Array | None = None
    if logs:
        _check(replay, logs, settings)
        folder = new_folder(COMMAND, options.out, options.seed)
        hashes = {str(path): sha256_of(path) for path in options.log}
    else:
        folder = new_folder(COMMAND, options.out, options.seed)
        truth, log = _simulated_survey(options, replay, settings)
        logs = [log]
        write_log(folder / "survey.csv", log)
        hashes = {"survey.csv": sha256_of(folder / "survey.csv")}
        console.print(
            "no --log: a vehicle drawn from the prior is simulated; 'true' has its values"
        )

    # The fit, on the terminal.
    fit, residuals = identify(replay, logs, settings)
    outcome = _Identified(
        title=(
            f"Water of {options.vehicle}, {len(logs)} log{'s' * (len(logs) > 1)}, "
            f"{sum(log.duration for log in logs):.0f} s"
        ),
        fit=fit,
        identified=findings(fit.named, n, fit.quantile),
        combined=together(fit.named, n),
    )
    exact = None if truth is None else values_of(replay.water.parameters, truth)
    lines = words(outcome.identified, outcome.combined, fit, logs, replay)

    console.print(Text(outcome.title, style="bold"))
    console.print(table_of(outcome.identified, exact))
    for line in lines:
        console.print(line, highlight=False, soft_wrap=True)

    # Its files, and the next manoeuvre.
    written = _write_fit(folder, outcome, options, hashes)
    compiled = spec.copy().compile()
    written += write_vehicle(folder, "fitted", spec, compiled, replay.water, fit.named.values)
    if options.plan:
        noise = _widened(settings, fit, residuals.logs[0].kinds)
        covariance = fit.named.covariance[:n, :n]
        channels = tuple(logs[0].channels)
        before = fit.named.deviations[:n]
        _plan(options, replay, before, covariance, noise, channels, folder, console)

    if options.record and not absent("log"):
        from uuv.water_identification.page import write_page

        page = folder / "report.html"
        write_page(page, outcome.title, outcome.identified, lines, fit, residuals, asdict(options))
        written.append(page)

    names = ", ".join(file.name for file in written)
    console.print(f"written to {folder}/: {names}", highlight=False)
    return 0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Identified:
    """What a fit says of the parameters."""

    title: str
    fit: WaterFit
    identified: Sequence[Finding]
    combined: Sequence[str]  # sentences on what is observable only together


def _write_fit(
    folder: Path, outcome: _Identified, options: WaterOptions, hashes: Mapping[str, str]
) -> list[Path]:
    """Write fit.yaml and metrics.json; `hashes` are those of the logs. Returns what is listed."""
    date = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    fit = write_fit(
        folder / "fit.yaml",
        outcome.identified,
        vehicle=options.vehicle,
        date=date,
        logs=hashes,
        widened=outcome.fit.widened,
        combined=outcome.combined,
    )
    origin = provenance(COMMAND, asdict(options))
    figures = _metrics(outcome.identified, outcome.fit)
    write_json(folder / "metrics.json", {**figures, "provenance": origin})
    return [fit]


def _widened(settings: FitSettings, fit: WaterFit, kinds: Iterable[str]) -> FitSettings:
    """Settings with the noise of the residuals, for the plan of the next manoeuvre."""
    noise = {
        kind: settings.noise[kind]
        * max(f for name, f in fit.widened.items() if name.endswith(f": {kind}"))
        for kind in kinds
    }
    return replace(settings, noise={**settings.noise, **noise})


def _simulated_survey(
    options: WaterOptions, replay: ReplayVehicle, settings: FitSettings
) -> tuple[Array, WaterLog]:
    """True deviations (n,) of a vehicle drawn from the prior, and the log of its survey."""
    rng = np.random.default_rng(options.seed)
    parameters = replay.water.parameters
    n = len(parameters)
    truth = rng.standard_normal(n)

    flown = survey(replay, values_of(parameters, np.zeros(n)), options.seconds, rng)
    log = simulated(
        replay,
        values_of(parameters, truth),
        flown,
        name="simulated survey",
        rng=rng,
        gust=0.25 * settings.gust,
    )
    return truth, log


def _check(replay: ReplayVehicle, logs: Sequence[WaterLog], settings: FitSettings) -> None:
    """Refuse invalid logs before a folder is made for them."""
    WaterResiduals(replay, logs, replace(settings, every=10_000))


def _metrics(identified: Sequence[Finding], fit: WaterFit) -> dict[str, Any]:
    return {
        "rounds": fit.named.rounds,
        "noise_over_stated": fit.widened,
        "told": {finding.name: finding.told for finding in identified},
        "value": {finding.name: finding.value for finding in identified},
    }


def table_of(identified: Sequence[Finding], exact: Mapping[str, float] | None = None) -> Table:
    """Table of the parameters with intervals; `exact` adds the true values."""
    table = Table()
    for column in (
        "parameter",
        "unit",
        "prior",
        "estimate",
        "95 %",
        *(("true",) if exact else ()),
        "variance removed",
        "",
    ):
        table.add_column(
            column,
            justify="left" if column in ("parameter", "unit", "") else "right",
            no_wrap=column != "parameter",
        )

    for finding in identified:
        digits = _digits(finding)
        cells = [f"{x:.{digits}f}" for x in (finding.nominal, finding.value)]
        cells.append(f"{finding.low:.{digits}f} to {finding.high:.{digits}f}")
        if exact:
            cells.append(f"{exact[finding.name]:.{digits}f}")

        table.add_row(
            Text(finding.name),
            Text(finding.unit),
            *cells,
            f"{100 * finding.told:.0f} %",
            finding.verdict,
        )
    return table


def _digits(finding: Finding) -> int:
    width = max(finding.high - finding.low, 1e-9)
    return int(np.clip(1 - math.floor(math.log10(width)), 0, 6))


def words(
    identified: Sequence[Finding],
    combined: Sequence[str],
    fit: WaterFit,
    logs: Sequence[WaterLog],
    replay: ReplayVehicle,
) -> list[str]:
    """Sentences about parameters that the logs do not identify."""
    lines = []

    for log in logs:
        if replay.names and not log.commands and not log.thrusts:
            lines.append(
                f"{log.name}: no thruster column; the thrusters count as off, and their gains are "
                "not identifiable"
            )
        if replay.joints and not log.joints:
            lines.append(f"{log.name}: no joint column; the arm counts as folded")

    lines += [f"identifiable only together: {sentence}" for sentence in combined]
    off = all(not log.commands and not log.thrusts for log in logs)
    for verdict in ("not identifiable", "partly identified"):
        by_help: dict[str, list[str]] = {}
        for finding in identified:
            if finding.verdict == verdict and not (off and finding.group == "thrusters"):
                by_help.setdefault(finding.helps, []).append(finding.name)
        lines += [
            f"{verdict}: {', '.join(names)}; {helps} would identify them"
            for helps, names in by_help.items()
        ]

    wide = {name: factor for name, factor in fit.widened.items() if factor > 1.5}
    if wide:
        worst = max(wide, key=lambda name: wide[name])
        lines.append(
            f"residuals exceed the stated noise in {len(wide)} of {len(fit.widened)} channels, "
            f"and the intervals allow for it; most in {worst}, {wide[worst]:.1f} times"
        )

    return lines


def _plan(
    options: WaterOptions,
    replay: ReplayVehicle,
    deviations: Array,
    known: Array,
    settings: FitSettings,
    channels: Sequence[str],
    folder: Path,
    console: Console,
) -> None:
    """Name the next manoeuvre, and write its expected log, which contains the commands to fly."""
    ranked, flown = next_manoeuvres(
        replay, deviations, known, settings, channels=channels, aim=options.aim
    )
    console.print(plan_table(ranked))

    best = ranked[0]
    console.print(
        f"next: {best.name}; the intervals shrink by {best.sharper():.2f} on average",
        highlight=False,
    )

    # Parameters whose intervals shrink the most.
    sharpest = np.argsort(-np.where(best.aim, best.before / best.after, 0.0))[:3]
    for i in sharpest:
        parameter = replay.water.parameters[i]
        x = float(deviations[i])
        low, high = (
            parameter.value(x + sign * SIGMAS * float(best.after[i])) for sign in (-1.0, 1.0)
        )
        console.print(
            f"  {parameter.name}: expected {low:.4g} to {high:.4g} {parameter.unit}, "
            f"{best.before[i] / best.after[i]:.1f} times sharper",
            highlight=False,
        )

    log = simulated(
        replay,
        values_of(replay.water.parameters, deviations),
        flown[best.name],
        name=best.name,
        channels=channels,
    )
    write_log(folder / "plan.csv", log)
    write_json(
        folder / "plan.json",
        [{"name": plan.name, "sharper": plan.sharper(), "left": plan.left} for plan in ranked],
    )


def plan_table(ranked: Sequence[Planned]) -> Table:
    """Table of the best manoeuvres."""
    table = Table(title="expected information of each manoeuvre of 20 s", title_justify="left")
    for column in ("manoeuvre", "intervals sharper, mean", "prior variance left"):
        table.add_column(column, justify="left" if column == "manoeuvre" else "right")
    for plan in ranked[:_SHOWN]:
        table.add_row(plan.name, f"{plan.sharper():.2f}", f"{100 * plan.left:.1f} %")
    return table


def sha256_of(path: Path) -> str:
    """Hash of a file, or in sequence of the tables of a run or of all files of a bag."""
    files = [path]
    if path.is_dir():
        every = (file for file in path.rglob("*") if file.is_file())
        files = sorted(path.glob("series_*")) or sorted(every)

    digest = hashlib.sha256()
    for file in files:
        with file.open("rb") as stream:
            while piece := stream.read(_PIECE):
                digest.update(piece)
    return digest.hexdigest()
