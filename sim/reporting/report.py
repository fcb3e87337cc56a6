"""`report.html`: results, figures and provenance of one run on a self-contained page."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from uuv.sim.evaluation.assessment import Assessment
from uuv.sim.evaluation.bounds import Bounds
from uuv.sim.evaluation.requirement import Requirement
from uuv.sim.evaluation.surface.force_levels import SETTLING
from uuv.sim.interfaces import page
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.page import Html
from uuv.sim.loop.recording import Recording
from uuv.sim.reporting.report_figures import path_by_force_error
from uuv.sim.reporting.results_table import figures_of
from uuv.sim.runs.provenance import provenance_rows
from uuv.sim.runs.saving import write_whole

_WAYS = {"normal": "along its normal", "along": "along the path", "across": "across the path"}


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportedRun:
    """Content of a run's report in addition to its figures."""

    title: str
    options: Mapping[str, Any]  # of the scenario, listed unchanged
    again: str = ""  # command that repeats the run
    stills: Sequence[tuple[str, bytes]] = ()  # pictures of the scene: caption and WebP file


def write_report(
    file: str | Path,
    recording: Recording,
    assessment: Assessment,
    *,
    run: ReportedRun,
    pictures: Iterable[tuple[str, str, Figure]] = (),
    gains: Iterable[tuple[str, str, str, str]] = (),
    bounds: Bounds | None = None,
) -> None:
    """Write the page.

    Args:
        file: File to write.
        recording: The run.
        assessment: Its metrics and acceptance.
        run: Title, options and stills.
        pictures: Title, caption and figure of each picture.
        gains: Part, name, value, unit and meaning of each gain of the controller.
        bounds: Bounds to draw; None: none.

    Raises:
        ConfigurationError: The folder does not exist.
    """
    path = Path(file)
    if not path.parent.is_dir():
        raise ConfigurationError(f"report: there is no folder {str(path.parent)!r}")

    parts = [
        _heading(run.title, recording, assessment),
        page.section("Scene", page.images(run.stills, "image/webp")),
        *(page.figure(*picture) for picture in path_by_force_error(recording)),
        page.section(
            "Figures",
            _checks(assessment),
            _segments(assessment),
            _uncertainty(assessment),
            _motion(assessment),
        ),
        _series(recording, bounds),
        *(page.figure(*picture) for picture in pictures),
        _drives(recording),
        _gains(gains),
        page.provenance(_provenance(recording, assessment, run)),
    ]

    write_whole(path, page.page(run.title, parts))


def _series(recording: Recording, bounds: Bounds | None) -> Html:
    from uuv.sim.reporting.timelines import timelines

    drawn = timelines({"run": recording}, bounds)
    if not drawn:
        return Html()

    about = (
        "The plots begin at the approach. A double-click shows the whole run, dragging zooms all "
        "panels at once. A click on a name hides its line. Shaded: the tool works. Dashed: "
        f"bounds. The force error is judged from {SETTLING:g} s after each change of the set "
        "force; its panel spans what is judged, and grey is what is not."
    )

    return page.section("Time series", Html(drawn), page.caption(about))


def _drives(recording: Recording) -> Html:
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
            commands = recording[name].value[:, i]
            share = np.where(commands > 0.0, commands / high[i], commands / low[i]).max()
            rows.append(
                (
                    label.replace("_", " "),
                    f"{commands.min():.1f}",
                    f"{commands.max():.1f}",
                    unit,
                    f"{share:.0%}",
                )
            )

    if not rows:
        return Html()

    columns = ("drive", "least", "greatest", "unit", "largest share of its limit")
    return page.section("Thrusters and joints against their limits", page.table(columns, rows))


def _gains(gains: Iterable[tuple[str, str, str, str]]) -> Html:
    rows = [(part, name.replace("_", " "), gain, about) for part, name, gain, about in gains]
    if not rows:
        return Html()

    columns = ("part", "gain", "value", "unit, meaning")
    return page.folded("Gains of the controller", page.table(columns, rows, texts=(0, 1, 3)))


def _heading(title: str, recording: Recording, assessment: Assessment) -> Html:
    run = assessment.metrics["run"]
    timings = assessment.metrics["timings"]
    factor = timings["real_time_factor"]
    pace = f", {factor:.1f} × real time" if factor is not None else ""

    # What the check of the vehicle says against an unchecked run.
    refused = "; ".join(assessment.metrics.get("unchecked", ()))
    unchecked = f" Not checked; it would have been refused: {refused}." if refused else ""

    return page.heading(
        title,
        assessment.accepted,
        reasons=assessment.failed,
        about=f"{recording.duration:.1f} s simulated in {timings['wall_s']:.1f} s{pace}; "
        f"seed {run['seed']}; ended in state {run['state']}.{unchecked}",
    )


def _checks(assessment: Assessment) -> Html:
    rows = (
        (check.name, *figures_of(check), check.unit, _verdict(check)) for check in assessment.checks
    )
    return page.table(("figure", "value", "bound", "unit", ""), rows, texts=(0, 3, 4))


def _verdict(check: Requirement) -> Html:
    if check.bound is None:
        return Html()
    return page.verdict(check.ok, ("ok", "missed"))


def _segments(assessment: Assessment) -> Html:
    segments = assessment.metrics.get("contact", {}).get("segments")
    if not segments:
        return Html()

    keys = ("set_n", "force_error_rms_n", "force_error_max_n", "lost_s", "duration_s")
    heads = ("set [N]", "error, RMS [N]", "error, peak [N]", "contact lost [s]", "duration [s]")
    rows = [["–" if s[key] is None else format(s[key], ".2f") for key in keys] for s in segments]

    return page.table(heads, rows, texts=())


def _uncertainty(assessment: Assessment) -> Html:
    """Stated uncertainty of the pose used for the work, and of the path there."""
    stated = assessment.metrics.get("uncertainty", {})
    if stated.get("position_sigma_m") is None:
        return Html()

    def shown(name: str, scale: float) -> str:
        sigma = stated[name]
        return "free" if sigma is None else f"{sigma * scale:.2f}"

    rows = [
        ("position of the centre", shown("position_sigma_m", 1e3), "", "mm"),
        ("orientation", shown("rotation_sigma_rad", float(np.degrees(1.0))), "", "deg"),
    ]

    if any(stated[f"path_{way}_max_m"] is not None for way in _WAYS):
        rows += [
            (
                f"surface under the path, {phrase}",
                shown(f"path_{way}_max_m", 1e3),
                shown(f"path_{way}_p95_m", 1e3),
                "mm",
            )
            for way, phrase in _WAYS.items()
        ]

    columns = ("standard deviation of the object pose", "largest", "95 %", "")
    about = (
        f"Not observable in these views: {stated['free']}. NEES per degree of freedom: "
        f"{stated['normalised_error']:.2f} (1 is consistent)."
    )

    return Html(page.table(columns, rows, texts=(0, 3)) + page.caption(about))


def _motion(assessment: Assessment) -> Html:
    """Motion of the object that was detected while the vehicle scanned the object."""
    motion = assessment.metrics.get("motion")
    if not motion:
        return Html()

    course = "it did not move"
    if motion["noticed_s"] is not None:
        course = (
            f"motion was detected at {motion['noticed_s']:.1f} s; final displacement "
            f"{1e3 * motion['distance_m']:.1f} mm (standard deviation "
            f"{1e3 * motion['distance_sigma_m']:.1f} mm), rotation "
            f"{np.degrees(motion['turn_rad']):.1f} deg"
        )

    return page.paragraph(f"The object was followed in {motion['frames']} frames: {course}.")


def _provenance(recording: Recording, assessment: Assessment, run: ReportedRun) -> dict[str, Any]:
    return provenance_rows(
        {
            **({"replay": run.again} if run.again else {}),
            **{f"option {name}": setting for name, setting in run.options.items()},
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
        f"{recording.timestep / recording.substeps * 1e3:.4g} ms, {recording.substeps} in the "
        f"loop's step of {loop}"
    )
