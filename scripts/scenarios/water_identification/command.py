"""Identification of a vehicle's water as a command: options, logs, and what is printed and written."""

import datetime
import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import mujoco
import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from calib.water.estimator import WaterFit
from calib.water.findings import Finding, findings, together
from calib.water.logs import ATTITUDE, CHANNELS, POSITION, RATE, WaterLog, log_of, read_log, write_log
from calib.water.named_fit import values_of
from calib.water.planning import Planned
from calib.water.results import write_fit, write_vehicle
from models import hydrodynamics
from models.site.scenes import vehicle_spec
from scenarios.water_identification.log_residuals import NOISE, FitSettings, WaterResiduals, identify
from scenarios.water_identification.manoeuvres import simulated, survey
from scenarios.water_identification.next_manoeuvre import next_manoeuvres
from scenarios.water_identification.vehicle_replay import ReplayVehicle
from sim.interfaces.extras import absent
from sim.interfaces.spatial import Array, finite_number, one_of, whole_number
from sim.runs.command_line import RunOptions
from sim.runs.provenance import provenance
from sim.runs.run_folder import new_folder
from sim.runs.saving import write_json

COMMAND = "identify_water"  # name in the results
_USUAL = (POSITION, ATTITUDE, RATE)  # channels of a log that is planned or simulated
_SHOWN = 4  # manoeuvres in the table of a plan


@dataclass(kw_only=True)
class WaterOptions(RunOptions):
    """Identify added mass, damping, trim and thrust of a vehicle from logs."""

    groups: ClassVar[Mapping[str, str]] = {"comparison": "window rate noise current gust mount"}

    vehicle: str = "bluerov2_heavy"
    """Name of `uuv list vehicle`, an MJCF or URDF file, or MODULE:FUNCTION; its water is the prior."""
    log: tuple[Path, ...] = ()
    """Logs, CSV or Parquet, or folders of recorded runs; none: a survey is simulated, or planned with --plan."""
    water_density: float | None = None
    """Density of the water [kg/m^3]; default: the vehicle's."""
    plan: bool = False
    """Also name the manoeuvre that tells most next; without a log, the one to begin with."""
    aim: tuple[str, ...] = ()
    """Groups of parameters that the plan is for: "added mass", trim, thrusters, ...; default: all."""
    prior: tuple[tuple[str, float], ...] = ()
    """Other prior standard deviations: NAME VALUE, repeatable; of a factor that of its logarithm."""
    window: float = 6.0
    """Length of the windows into which a log is cut [s]."""
    rate: float = 20.0
    """Rate to which samples are averaged [Hz]."""
    noise: tuple[tuple[str, float], ...] = ()
    """Standard deviation of a channel's samples: NAME VALUE, repeatable; default: see the documentation."""
    current: float = 0.1
    """Prior standard deviation of a log's steady current [m/s], each axis."""
    gust: float = 0.02
    """Standard deviation of a window's current about it [m/s]."""
    mount: float = 0.01
    """Standard deviation of the attitude sensor's roll and pitch on the hull [rad]; 0: it is exact."""
    seconds: float = 60.0
    """Length of a simulated survey [s]."""
    seed: int = 0
    """Seed of a simulated vehicle, its survey, gusts and noise."""
    workers: int = 1
    """Threads."""


def main(verb: str, args: Sequence[str]) -> int:
    """The verb `uuv identify-water`."""
    from scenarios.start import parse

    del verb
    options = parse(WaterOptions, args)
    return run(options, console())


def console() -> Console:
    """Terminal; elsewhere wide enough for the tables."""
    return Console(width=None if Console().is_terminal else 140)


def settings_of(options: WaterOptions) -> FitSettings:
    """Settings of the comparison.

    Raises:
        ConfigurationError: A number is out of bounds, or a channel is unknown.
    """
    noise = dict(NOISE)
    for name, value in options.noise:
        noise[one_of(name, tuple(CHANNELS), "--noise")] = finite_number(value, f"--noise {name}", above=0.0)
    return FitSettings(
        window=finite_number(options.window, "--window [s]", least=1.0, most=60.0),
        rate=finite_number(options.rate, "--rate [Hz]", least=1.0, most=200.0),
        noise=noise,
        current=finite_number(options.current, "--current [m/s]", above=0.0, most=3.0),
        gust=finite_number(options.gust, "--gust [m/s]", above=0.0, most=1.0),
        mount=finite_number(options.mount, "--mount [rad]", least=0.0, most=0.5),
        workers=whole_number(options.workers, "--workers", least=1, most=64),
    )


def vehicle_of(options: WaterOptions) -> tuple[mujoco.MjSpec, ReplayVehicle]:
    """The vehicle as it is believed, and for replay with the priors asked for.

    Raises:
        UuvError: There is no such vehicle, or it has no hydrodynamics.
    """
    spec = vehicle_spec(options.vehicle)
    if options.water_density is not None:
        density = finite_number(options.water_density, "--water-density [kg/m^3]", above=0.0, most=3000.0)
        hydrodynamics.attach(spec, {}, density)
    own = ReplayVehicle(spec)
    names = [each.name for each in own.water.parameters]
    for name, sigma in options.prior:
        one_of(name, names, "--prior")
        finite_number(sigma, f"--prior {name}", above=0.0)
    other = dict(options.prior)
    own.water = replace(
        own.water,
        parameters=tuple(replace(each, sigma=other.get(each.name, each.sigma)) for each in own.water.parameters),
    )
    return spec, own


def logs_of(options: WaterOptions, own: ReplayVehicle) -> list[WaterLog]:
    """The logs of the command line.

    Raises:
        UuvError: One cannot be read, or is none.
    """
    limits = zip(own.joints, own.vehicle.q_limits.tolist(), strict=True)
    joints = {name: (float(low), float(high)) for name, (low, high) in limits}
    logs = [
        _of_run(path, own.names, joints) if path.is_dir() else read_log(path, thrusters=own.names, joints=joints)
        for path in options.log
    ]
    names = [log.name for log in logs]  # of the file, which another folder may have too
    return [
        replace(log, name=f"{log.name} ({i})") if names.count(log.name) > 1 else log for i, log in enumerate(logs, 1)
    ]


def _of_run(folder: Path, thrusters: Sequence[str], joints: Mapping[str, tuple[float, float]]) -> WaterLog:
    """Log of a recorded run: thrusts and joints at the rate of its slower table, with the pose at those times."""
    from sim.reporting.series_tables import LOOP, SLOW, PastRun

    past = PastRun.of(folder)
    time = past.column("time", SLOW)
    names = [f"p_WB.{axis}" for axis in "xyz"] + [f"quat_WB_wxyz.{part}" for part in "wxyz"]
    columns = {name: np.interp(time, past.column("time", LOOP), past.column(name, LOOP)) for name in names}
    columns |= {name: past.column(name, SLOW) for name in past.units(SLOW) if name.startswith(("q.", "thrust."))}
    return log_of(f"run {folder.name}", {"time": time, **columns}, thrusters=thrusters, joints=joints)


def run(options: WaterOptions, console: Console) -> int:
    """Identifies or plans, prints and writes; returns the exit code.

    Raises:
        UuvError: Options, vehicle or logs are wrong.
    """
    settings = settings_of(options)
    finite_number(options.seconds, "--seconds [s]", least=10.0, most=3600.0)
    spec, own = vehicle_of(options)
    n = len(own.water.parameters)
    logs = logs_of(options, own)
    if not logs and options.plan:
        folder = new_folder(COMMAND, options.out, options.seed)
        _plan(options, own, np.zeros(n), np.eye(n), settings, _USUAL, folder, console)
        return 0
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
        logs = [simulated(own, values, flown, name="simulated survey", rng=rng, gust=0.25 * settings.gust)]
        write_log(folder / "survey.csv", logs[0])
        hashes = {"survey.csv": _sha256(folder / "survey.csv")}
        console.print("no --log: a vehicle drawn from the prior is simulated; the column 'true' is what it is")
    fit, residuals = identify(own, logs, settings)
    found, combined = findings(fit.named, n, fit.quantile), together(fit.named, n)
    exact = None if truth is None else values_of(own.water.parameters, truth)
    title = (
        f"Water of {options.vehicle}, {len(logs)} log{'s' * (len(logs) > 1)}, {sum(log.duration for log in logs):.0f} s"
    )
    console.print(f"[bold]{title}[/bold]")
    console.print(table_of(found, exact))
    for line in words(found, combined, fit, logs, own):
        console.print(line, highlight=False, soft_wrap=True)
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
    write_json(folder / "metrics.json", {**_metrics(found, fit), "provenance": provenance(COMMAND, asdict(options))})
    if options.plan:
        noise = {
            kind: settings.noise[kind] * max(f for name, f in fit.widened.items() if name.endswith(f": {kind}"))
            for kind in residuals.logs[0].kinds
        }
        sharp = replace(settings, noise={**settings.noise, **noise})
        covariance = fit.named.covariance[:n, :n]
        _plan(options, own, fit.named.deviations[:n], covariance, sharp, tuple(logs[0].channels), folder, console)
    if options.record and not absent("log"):
        from scenarios.water_identification.page import write_page

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
    console.print(f"written to {folder}/: {', '.join(file.name for file in written)}", highlight=False)
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
    for column in ("parameter", "unit", "before", "found", "95 %", *(("true",) if exact else ()), "told", ""):
        table.add_column(
            column, justify="left" if column in ("parameter", "unit", "") else "right", no_wrap=column != "parameter"
        )
    for each in found:
        digits = _digits(each)
        cells = [f"{x:.{digits}f}" for x in (each.nominal, each.value)]
        cells.append(f"{each.low:.{digits}f} to {each.high:.{digits}f}")
        if exact:
            cells.append(f"{exact[each.name]:.{digits}f}")
        table.add_row(Text(each.name), Text(each.unit), *cells, f"{100 * each.told:.0f} %", each.verdict)
    return table


def _digits(each: Finding) -> int:
    width = max(each.high - each.low, 1e-9)
    return int(np.clip(1 - math.floor(math.log10(width)), 0, 6))


def words(
    found: Sequence[Finding], combined: Sequence[str], fit: WaterFit, logs: Sequence[WaterLog], own: ReplayVehicle
) -> list[str]:
    """What the logs cannot tell, in sentences."""
    said = []
    for log in logs:
        if own.names and not log.commands and not log.thrusts:
            said.append(f"{log.name}: no thruster column; the thrusters count as off, and their gains are not told")
        if own.joints and not log.joints:
            said.append(f"{log.name}: no joint column; the arm counts as folded")
    said += [f"only together: {sentence}" for sentence in combined]
    off = all(not log.commands and not log.thrusts for log in logs)
    for verdict in ("not told", "partly"):
        by_help: dict[str, list[str]] = {}
        for each in found:
            if each.verdict == verdict and not (off and each.group == "thrusters"):
                by_help.setdefault(each.helps, []).append(each.name)
        said += [f"{verdict}: {', '.join(names)}; {helps} would tell" for helps, names in by_help.items()]
    wide = {name: factor for name, factor in fit.widened.items() if factor > 1.5}
    if wide:
        worst = max(wide, key=lambda name: wide[name])
        said.append(
            f"residuals exceed the stated noise in {len(wide)} of {len(fit.widened)} channels, and the intervals allow "
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
    ranked, flown = next_manoeuvres(own, deviations, known, settings, channels=channels, aim=options.aim)
    console.print(plan_table(ranked))
    best = ranked[0]
    console.print(
        f"next: [bold]{best.name}[/bold]; the intervals shrink by {best.sharper():.2f} in the mean", highlight=False
    )
    sharpest = np.argsort(-np.where(best.aim, best.before / best.after, 0.0))[:3]
    for i in sharpest:
        each, x = own.water.parameters[i], float(deviations[i])
        low, high = (each.value(x + sign * 1.96 * float(best.after[i])) for sign in (-1.0, 1.0))
        console.print(
            f"  {each.name}: expected {low:.4g} to {high:.4g} {each.unit}, "
            f"{best.before[i] / best.after[i]:.1f} times sharper",
            highlight=False,
        )
    log = simulated(
        own, values_of(own.water.parameters, deviations), flown[best.name], name=best.name, channels=channels
    )
    write_log(folder / "plan.csv", log)
    write_json(
        folder / "plan.json", [{"name": each.name, "sharper": each.sharper(), "left": each.left} for each in ranked]
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
