"""`report.html`: results, figures and provenance of one run on a self-contained page."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from uuv.sim.evaluation.bounds import Bounds
from uuv.sim.evaluation.force_levels import SETTLING
from uuv.sim.evaluation.metrics import Assessment, Requirement
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.loop.recording import Recording
from uuv.sim.reporting.report_page import page, provenance, section, table, text
from uuv.sim.reporting.results_table import figures_of
from uuv.sim.runs.saving import write_whole

_WAYS = {"normal": "along its normal", "along": "along the path", "across": "across the path"}


def write_report(
    file: str | Path,
    recording: Recording,
    assessment: Assessment,
    *,
    title: str,
    options: Mapping[str, Any],
    pictures: Iterable[tuple[str, str, Figure]] = (),
    gains: Iterable[tuple[str, str, str, str]] = (),
    bounds: Bounds | None = None,
    again: str = "",
) -> None:
    """Write the page.

    Args:
        file: File to write.
        recording: The run.
        assessment: Its metrics and acceptance.
        title: Title of the page.
        options: Options of the scenario, listed unchanged.
        pictures: Title, caption and figure of each picture.
        gains: Part, name, value, unit and meaning of each gain of the controller.
        bounds: Bounds to draw; None: none.
        again: Command that repeats the run.

    Raises:
        ConfigurationError: The folder does not exist.
    """
    path = Path(file)
    if not path.parent.is_dir():
        raise ConfigurationError(f"report: there is no folder {str(path.parent)!r}")
    drawn = "\n".join(section(name, figure, caption) for name, caption, figure in pictures)
    body = "\n".join(
        (
            _headline(title, recording, assessment),
            "<section><h2>Figures</h2>",
            _checks(assessment),
            _segments(assessment),
            _uncertainty(assessment),
            _motion(assessment),
            "</section>",
            _series(recording, bounds),
            drawn,
            _drives(recording),
            _gains(list(gains)),
            "<section><h2>How the run was "
            f"made</h2>{_provenance(recording, assessment, options, again)}</section>",
        )
    )
    write_whole(path, page(title, body))


def _series(recording: Recording, bounds: Bounds | None) -> str:
    from uuv.sim.reporting.timelines import timelines

    drawn = timelines({"run": recording}, bounds)
    if not drawn:
        return ""
    about = (
        "First shown from the approach on: double-click to see the whole run, drag to zoom, in "
        "all panels at once. A "
        "click on a name hides its line. Shaded: the tool works. Dashed: bounds; a force error "
        "counts from "
        f"{SETTLING:g} s after each change of the set force."
    )
    return f"<section><h2>Time series</h2>{drawn}<p class=caption>{about}</p></section>"


def _drives(recording: Recording) -> str:
    """Range of each thruster and joint over the run, and the largest share of its limit."""
    rows = []
    forward, reverse = np.asarray(recording.vehicle.thruster_table)[:, :2].T
    limits = np.asarray(recording.vehicle.torque_limits)
    for name, unit, low, high in (
        ("thrust", "N", -reverse, forward),
        ("tau_drive", "N m", -limits, limits),
    ):
        if name not in recording or not recording[name].labels:
            continue
        for i, label in enumerate(recording[name].labels):
            value = recording[name].value[:, i]
            share = np.where(value > 0.0, value / high[i], value / low[i]).max()
            rows.append(
                (
                    label.replace("_", " "),
                    f"{value.min():.1f}",
                    f"{value.max():.1f}",
                    unit,
                    f"{share:.0%}",
                )
            )
    if not rows:
        return ""
    columns = ("drive", "least", "greatest", "unit", "most of its limit")
    return (
        "<section><h2>Thrusters and joints against their "
        f"limits</h2>{table(columns, rows)}</section>"
    )


def _gains(rows: list[tuple[str, str, str, str]]) -> str:
    if not rows:
        return ""
    cells = "".join(
        f"<tr><td>{text(part)}</td><td>{text(name.replace('_', ' '))}</td><td "
        f"class=n>{text(value)}</td>"
        f"<td>{text(about)}</td></tr>"
        for part, name, value, about in rows
    )
    head = "<tr><th>part</th><th>gain</th><th class=n>value</th><th>unit, meaning</th></tr>"
    return (
        "<section><details><summary>Gains of the "
        f"controller</summary><table>{head}{cells}</table></details></section>"
    )


def _headline(title: str, recording: Recording, assessment: Assessment) -> str:
    verdict = "accepted" if assessment.accepted else "not accepted"
    reasons = "".join(f"<li>{text(line)}</li>" for line in assessment.failed)
    run, timings = assessment.metrics["run"], assessment.metrics["timings"]
    factor = timings["real_time_factor"]
    pace = f", {factor:.1f} × real time" if factor is not None else ""
    return (
        f"<header><h1>{text(title)} <span class='{verdict.replace(' ', '-')}'>{verdict}</span></h1>"
        + (f"<ul class=reasons>{reasons}</ul>" if reasons else "")
        + f"<p class=caption>{recording.duration:.1f} s simulated in {timings['wall_s']:.1f} "
        f"s{pace}; "
        f"seed {run['seed']}; ended in state {text(run['state'])}.</p></header>"
    )


def _checks(assessment: Assessment) -> str:
    rows = "".join(
        f"<tr><td>{text(check.name)}</td><td class=n>{value}</td><td class=n>{bound}</td>"
        f"<td>{text(check.unit)}</td><td>{_verdict(check)}</td></tr>"
        for check in assessment.checks
        for value, bound in (figures_of(check),)
    )
    head = (
        "<tr><th>figure</th><th class=n>value</th><th class=n>bound</th><th>unit</th><th></th></tr>"
    )
    return f"<table>{head}{rows}</table>"


def _verdict(check: Requirement) -> str:
    if check.bound is None:
        return ""
    return (
        "<span class=accepted>ok</span>" if check.ok else "<span class=not-accepted>missed</span>"
    )


def _segments(assessment: Assessment) -> str:
    segments = assessment.metrics.get("contact", {}).get("segments")
    if not segments:
        return ""
    keys = ("set_n", "force_error_rms_n", "force_error_max_n", "lost_s", "duration_s")
    heads = ("set [N]", "error, RMS [N]", "error, peak [N]", "contact lost [s]", "duration [s]")
    rows = "".join(
        "<tr>"
        + "".join(f"<td class=n>{'–' if s[k] is None else format(s[k], '.2f')}</td>" for k in keys)
        + "</tr>"
        for s in segments
    )
    return f"<table><tr>{''.join(f'<th class=n>{head}</th>' for head in heads)}</tr>{rows}</table>"


def _uncertainty(assessment: Assessment) -> str:
    """Stated uncertainty of the pose that the work went by, and of the path on it."""
    stated = assessment.metrics.get("uncertainty", {})
    if stated.get("position_sigma_m") is None:
        return ""

    def shown(name: str, scale: float) -> str:
        value = stated[name]
        return "free" if value is None else f"{value * scale:.2f}"

    rows = [
        ("position of the centre", shown("position_sigma_m", 1e3), "", "mm"),
        ("orientation", shown("rotation_sigma_rad", float(np.degrees(1.0))), "", "deg"),
    ]
    if any(stated[f"path_{way}_max_m"] is not None for way in _WAYS):
        rows += [
            (
                f"surface under the path, {said}",
                shown(f"path_{way}_max_m", 1e3),
                shown(f"path_{way}_p95_m", 1e3),
                "mm",
            )
            for way, said in _WAYS.items()
        ]
    cells = "".join(
        f"<tr><td>{text(name)}</td><td class=n>{most}</td><td "
        f"class=n>{p95}</td><td>{unit}</td></tr>"
        for name, most, p95, unit in rows
    )
    head = (
        "<tr><th>stated standard deviation, mean of the finds</th><th class=n>largest</th><th "
        "class=n>95 %</th>"
        "<th></th></tr>"
    )
    error = stated["normalised_error"]
    return (
        f"<table>{head}{cells}</table><p class=caption>Not determined by what was in view: "
        f"{text(stated['free'])}. The "
        "mean's true error squared, over the covariance and per degree of freedom: "
        f"{error:.2f}.</p>"
    )


def _motion(assessment: Assessment) -> str:
    """Motion of the object that was noticed while the vehicle looked at it."""
    motion = assessment.metrics.get("motion")
    if not motion:
        return ""
    said = "it rested"
    if motion["noticed_s"] is not None:
        said = (
            f"at {motion['noticed_s']:.1f} s it was seen to have moved; in the end by "
            f"{1e3 * motion['distance_m']:.1f} "
            f"mm (standard deviation {1e3 * motion['distance_sigma_m']:.1f} mm), turned by "
            f"{np.degrees(motion['turn_rad']):.1f} deg"
        )
    return f"<p>The object was followed in {motion['frames']} frames: {text(said)}.</p>"


def _provenance(
    recording: Recording, assessment: Assessment, options: Mapping[str, Any], again: str
) -> str:
    return provenance(
        {
            **({"run it again": again} if again else {}),
            **{f"option {name}": value for name, value in options.items()},
            "seed": assessment.metrics["run"]["seed"],
            "trajectory, SHA-256": assessment.metrics["run"]["trajectory_sha256"],
            "physics step": _physics_step(recording),
        }
    )


def _physics_step(recording: Recording) -> str:
    loop = f"{recording.timestep * 1e3:g} ms"
    if recording.substeps == 1:
        return loop
    return (
        f"{recording.timestep / recording.substeps * 1e3:.4g} ms, {recording.substeps} to the "
        f"loop's step of {loop}"
    )
