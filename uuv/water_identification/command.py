"""Identification of a vehicle's water as a command runs it, and what is printed and written."""

import datetime
import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
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
from uuv.calib.water.planning import Planned
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
from uuv.water_identification.options import COMMAND, WaterOptions, logs_of, settings_of
from uuv.water_identification.replayed_parts import ranges_of
from uuv.water_identification.settings import FitSettings
from uuv.water_identification.vehicle_replay import ReplayVehicle

_USUAL = (POSITION, ATTITUDE, RATE)  # channels of a log that is planned or simulated
_SHOWN = 4  # manoeuvres in the table of a plan


def vehicle_of(options: WaterOptions) -> tuple[mujoco.MjSpec, ReplayVehicle]:
    """The vehicle as it is believed, and for replay with the priors asked for.

    Raises:
        UuvError: There is no such vehicle, or it has no hydrodynamics.
    """
    spec = vehicle_spec(options.vehicle)
    if options.water_density is not None:
        density = finite_number(
            options.water_density, "--water-density [kg/m^3]", above=0.0, most=3000.0
        )
        hydrodynamics.attach(spec, {}, density)

    own = ReplayVehicle(spec)
    names = [each.name for each in own.water.parameters]
    for name, sigma in options.prior:
        one_of(name, names, "--prior")
        finite_number(sigma, f"--prior {name}", above=0.0)

    other = dict(options.prior)
    own.water = replace(
        own.water,
        parameters=tuple(
            replace(each, sigma=other.get(each.name, each.sigma)) for each in own.water.parameters
        ),
    )
    return spec, own


def run(options: WaterOptions, console: Console) -> int:
    """Identifies or plans, prints and writes; returns the exit code.

    Raises:
        UuvError: Options, vehicle or logs are wrong.
    """
    settings = settings_of(options)
    finite_number(options.seconds, "--seconds [s]", least=10.0, most=3600.0)
    spec, own = vehicle_of(options)
    n = len(own.water.parameters)
    logs = logs_of(options, own.names, ranges_of(own.vehicle))

    if not logs and options.plan:
        folder = new_folder(COMMAND, options.out, options.seed)
        _plan(options, own, np.zeros(n), np.eye(n), settings, _USUAL, folder, console)
        return 0

    # Logs of the user, or of a simulated vehicle that is drawn from the prior.
    truth: Array | None = None
    folder: Path
    if logs:
        hashes = {str(path): _sha256(path) for path in options.log}
        _check(own, logs, settings)
        folder = new_folder(COMMAND, options.out, options.seed)
    else:
        rng = np.random.default_rng(options.seed)
        truth = rng.standard_normal(n)
        folder = new_folder(COMMAND, options.out, options.seed)

        flown = survey(own, values_of(own.water.parameters, np.zeros(n)), options.seconds, rng)
        values = values_of(own.water.parameters, truth)
        logs = [
            simulated(
                own, values, flown, name="simulated survey", rng=rng, gust=0.25 * settings.gust
            )
        ]
        write_log(folder / "survey.csv", logs[0])
        hashes = {"survey.csv": _sha256(folder / "survey.csv")}

        console.print(
            "no --log: a vehicle drawn from the prior is simulated; the column 'true' is what it is"
        )

    # The fit, on the terminal.
    fit, residuals = identify(own, logs, settings)
    found, combined = findings(fit.named, n, fit.quantile), together(fit.named, n)
    exact = None if truth is None else values_of(own.water.parameters, truth)
    title = (
        f"Water of {options.vehicle}, {len(logs)} log{'s' * (len(logs) > 1)}, "
        f"{sum(log.duration for log in logs):.0f} s"
    )

    console.print(Text(title, style="bold"))
    console.print(table_of(found, exact))
    for line in words(found, combined, fit, logs, own):
        console.print(line, highlight=False, soft_wrap=True)

    # Files of the fit, and the fitted vehicle.
    date = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    written = [
        write_fit(
            folder / "fit.yaml",
            found,
            vehicle=options.vehicle,
            date=date,
            logs=hashes,
            widened=fit.widened,
            combined=combined,
        )
    ]

    compiled = spec.copy().compile()
    written += write_vehicle(folder, "fitted", spec, compiled, own.water, fit.named.values)
    write_json(
        folder / "metrics.json",
        {**_metrics(found, fit), "provenance": provenance(COMMAND, asdict(options))},
    )

    # The next manoeuvre, planned with the noise that the residuals show.
    if options.plan:
        noise = {
            kind: settings.noise[kind]
            * max(f for name, f in fit.widened.items() if name.endswith(f": {kind}"))
            for kind in residuals.logs[0].kinds
        }
        sharp = replace(settings, noise={**settings.noise, **noise})

        covariance = fit.named.covariance[:n, :n]
        _plan(
            options,
            own,
            fit.named.deviations[:n],
            covariance,
            sharp,
            tuple(logs[0].channels),
            folder,
            console,
        )

    if options.record and not absent("log"):
        from uuv.water_identification.page import write_page

        write_page(
            folder / "report.html",
            title,
            found,
            words(found, combined, fit, logs, own),
            fit,
            residuals,
            asdict(options),
        )
        written.append(folder / "report.html")

    console.print(
        f"written to {folder}/: {', '.join(file.name for file in written)}", highlight=False
    )
    return 0


def _check(own: ReplayVehicle, logs: Sequence[WaterLog], settings: FitSettings) -> None:
    """Refuse logs before a folder is made for them."""
    WaterResiduals(own, logs, replace(settings, every=10_000))


def _metrics(found: Sequence[Finding], fit: WaterFit) -> dict[str, Any]:
    return {
        "rounds": fit.named.rounds,
        "noise_over_stated": fit.widened,
        "told": {each.name: each.told for each in found},
        "value": {each.name: each.value for each in found},
    }


def table_of(found: Sequence[Finding], exact: Mapping[str, float] | None = None) -> Table:
    """Table of the parameters with intervals; `exact` adds what is true."""
    table = Table()
    for column in (
        "parameter",
        "unit",
        "before",
        "found",
        "95 %",
        *(("true",) if exact else ()),
        "told",
        "",
    ):
        table.add_column(
            column,
            justify="left" if column in ("parameter", "unit", "") else "right",
            no_wrap=column != "parameter",
        )

    for each in found:
        digits = _digits(each)
        cells = [f"{x:.{digits}f}" for x in (each.nominal, each.value)]
        cells.append(f"{each.low:.{digits}f} to {each.high:.{digits}f}")
        if exact:
            cells.append(f"{exact[each.name]:.{digits}f}")

        table.add_row(
            Text(each.name), Text(each.unit), *cells, f"{100 * each.told:.0f} %", each.verdict
        )
    return table


def _digits(each: Finding) -> int:
    width = max(each.high - each.low, 1e-9)
    return int(np.clip(1 - math.floor(math.log10(width)), 0, 6))


def words(
    found: Sequence[Finding],
    combined: Sequence[str],
    fit: WaterFit,
    logs: Sequence[WaterLog],
    own: ReplayVehicle,
) -> list[str]:
    """What the logs cannot tell, in sentences."""
    said = []

    for log in logs:
        if own.names and not log.commands and not log.thrusts:
            said.append(
                f"{log.name}: no thruster column; the thrusters count as off, and their "
                "gains are not told"
            )
        if own.joints and not log.joints:
            said.append(f"{log.name}: no joint column; the arm counts as folded")

    said += [f"only together: {sentence}" for sentence in combined]
    off = all(not log.commands and not log.thrusts for log in logs)
    for verdict in ("not told", "partly"):
        by_help: dict[str, list[str]] = {}
        for each in found:
            if each.verdict == verdict and not (off and each.group == "thrusters"):
                by_help.setdefault(each.helps, []).append(each.name)
        said += [
            f"{verdict}: {', '.join(names)}; {helps} would tell" for helps, names in by_help.items()
        ]

    wide = {name: factor for name, factor in fit.widened.items() if factor > 1.5}
    if wide:
        worst = max(wide, key=lambda name: wide[name])
        said.append(
            f"residuals exceed the stated noise in {len(wide)} of {len(fit.widened)} channels, "
            "and the intervals allow "
            f"for it; most in {worst}, {wide[worst]:.1f} times"
        )

    return said


def _plan(
    options: WaterOptions,
    own: ReplayVehicle,
    deviations: Array,
    known: Array,
    settings: FitSettings,
    channels: Sequence[str],
    folder: Path,
    console: Console,
) -> None:
    """Names the next manoeuvre, and writes its log as expected: the commands to fly."""
    ranked, flown = next_manoeuvres(
        own, deviations, known, settings, channels=channels, aim=options.aim
    )
    console.print(plan_table(ranked))

    best = ranked[0]
    console.print(
        f"next: {best.name}; the intervals shrink by {best.sharper():.2f} in the mean",
        highlight=False,
    )

    # Parameters whose intervals shrink most.
    sharpest = np.argsort(-np.where(best.aim, best.before / best.after, 0.0))[:3]
    for i in sharpest:
        each, x = own.water.parameters[i], float(deviations[i])
        low, high = (each.value(x + sign * SIGMAS * float(best.after[i])) for sign in (-1.0, 1.0))
        console.print(
            f"  {each.name}: expected {low:.4g} to {high:.4g} {each.unit}, "
            f"{best.before[i] / best.after[i]:.1f} times sharper",
            highlight=False,
        )

    log = simulated(
        own,
        values_of(own.water.parameters, deviations),
        flown[best.name],
        name=best.name,
        channels=channels,
    )
    write_log(folder / "plan.csv", log)
    write_json(
        folder / "plan.json",
        [{"name": each.name, "sharper": each.sharper(), "left": each.left} for each in ranked],
    )


def plan_table(ranked: Sequence[Planned]) -> Table:
    """Table of the best manoeuvres."""
    table = Table(title="what each manoeuvre of 20 s would tell", title_justify="left")
    for column in ("manoeuvre", "intervals sharper, mean", "prior variance left"):
        table.add_column(column, justify="left" if column == "manoeuvre" else "right")
    for each in ranked[:_SHOWN]:
        table.add_row(each.name, f"{each.sharper():.2f}", f"{100 * each.left:.1f} %")
    return table


def _sha256(path: Path) -> str:
    """Hash of a file, or of the tables of a run one after the other."""
    files = sorted(path.glob("series_*")) if path.is_dir() else [path]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
