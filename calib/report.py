"""`report.html` of a calibration: results, limits of identifiability, and figures, on one page."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from uuv.calib.identification import Calibration
from uuv.calib.report_figures import figures
from uuv.calib.verification import Cloud
from uuv.sim.interfaces import page
from uuv.sim.interfaces.page import Html
from uuv.sim.interfaces.spatial import Array

_SHOWN = {"rad": (1.0e3, "mrad"), "m": (1.0e3, "mm"), "rad/(N m)": (1.0e6, "µrad/(N m)")}
_MEANING = {
    "known": "known",
    "in combination": "not identifiable alone: changes with others, held by the prior",
    "unknowable": "not observable: stays at nominal",
}
_LEAST_OBSERVABLE = 3  # combinations of parameters that are listed


def shown(unit: str) -> tuple[float, str]:
    """Display factor and name of the unit for numbers in `unit` (rad, m, rad/(N m))."""
    return _SHOWN[unit]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Statement:
    """Content of the report besides the result of the calibration."""

    title: str
    accepted: bool  # verdict, shown next to the title
    # name and value of each figure, in order of reading
    figures_of_merit: Sequence[tuple[str, str]]
    notes: Iterable[str] = ()  # warnings shown before those of the calibration
    # settings of the run and versions of the packages
    provenance: Mapping[str, Any] = field(default_factory=dict)


def report_page(
    calibration: Calibration,
    statement: Statement,
    *,
    series: Sequence[Array],
    point_names: Sequence[str],
    clouds: Mapping[str, Cloud] | None = None,
    rigid: Calibration | None = None,
) -> str:
    """The report in HTML.

    Args:
        calibration: result to report.
        statement: title, verdict, figures and settings.
        series: touches (m_i, n) used for the identification.
        point_names: names of the touched points.
        clouds: point clouds of `uuv.calib.verification.compare`, by name.
        rigid: the same touches identified without compliances, for comparison.
    """
    notes = [*statement.notes, *calibration.warnings]
    pictures = figures(calibration, series, point_names, clouds or {})

    parts = [
        page.heading(statement.title, statement.accepted, notes=notes),
        page.section("Figures", page.table((), statement.figures_of_merit)),
        page.section("Observability of the parameters", *_rank(calibration)),
        page.section("Compliance of the joints", *_compliances(calibration, series, rigid)),
        *(page.figure(*picture) for picture in pictures),
        page.section("Parameters", _parameters(calibration)),
        page.provenance(statement.provenance),
    ]

    return page.page(statement.title, parts)


def _rank(calibration: Calibration) -> list[Html]:
    """Sentence on the rank, table of the unobservable directions, and the least observable ones."""
    rank = calibration.rank

    sentence = (
        f"{page.strong(f'{rank.rank} of {rank.total}')} directions of the parameters move the "
        f"touched tips relative to each other, and are identified; condition {rank.condition:.3g}, "
        f"observability index O1 {rank.observability:.3g} m."
    )

    columns = ("directions", "in", "why they are not observable", "what helps")
    rows = [
        (group.count, ", ".join(group.names), group.reason, group.handle) for group in rank.hidden
    ]

    least = range(max(rank.rank - _LEAST_OBSERVABLE, 0), rank.rank)
    return [
        page.paragraph(Html(sentence)),
        page.table(columns, rows, texts=(1, 2, 3)) if rows else Html(),
        page.caption(
            "Least observable of the identified directions, in shares of comparable errors: more "
            "touches improve these most."
        ),
        page.items((rank.combination(i) for i in least), "caption"),
    ]


def _compliances(
    calibration: Calibration, series: Sequence[Array], rigid: Calibration | None
) -> list[Html]:
    """Compliances with intervals, joints that are not identified, and residuals by payload; empty
    for a rigid arm.
    """
    if calibration.loads is None:
        return []
    touches = np.ascontiguousarray(np.vstack(series))
    moments = calibration.loads.at(touches)(calibration.arm.table)
    names = [f"c{k + 1}" for k in range(calibration.arm.n)]

    columns = (
        "",
        "compliance [µrad/(N m)]",
        "95 %",
        "95 % over value",
        "stiffness [N m/rad]",
        "moments [N m]",
    )

    rows = []
    for k, name in enumerate(names):
        span = f"{_zero(moments[:, k].min()):.1f} to {_zero(moments[:, k].max()):.1f}"
        rows.append((name, *_compliance(calibration, name), span))
    parts = [page.table(columns, rows)]

    lines = []
    for group in calibration.rank_free.hidden:
        if joints := [name for name in group.names if name in names]:
            why = page.text(f": {group.reason}. Remedy: {group.handle}.")
            lines.append(Html(page.strong(", ".join(joints)) + why))
    if lines:
        parts.append(page.paragraph("Not identified; their values are those of the prior:"))
        parts.append(page.items(lines))
    return [*parts, *_payloads(calibration, rigid)]


def _compliance(calibration: Calibration, name: str) -> tuple[str, str, str, str]:
    """Cells of one compliance: value, half of its 95 % interval, their quotient, stiffness."""
    if name not in calibration.names:
        return "fixed", "", "", ""
    i = calibration.names.index(name)
    compliance = calibration.estimate.values[i]
    half = calibration.quantile() * calibration.sigma[i]
    cells = f"{_zero(1e6 * compliance):.1f}", f"± {1e6 * half:.1f}"

    if any(name in group.names for group in calibration.rank_free.hidden):
        return *cells, "not identified", ""
    if not compliance > half:
        return *cells, "not significantly different from zero", ""
    return *cells, f"{100.0 * half / compliance:.1f} %", f"{1.0 / compliance:.0f}"


def _zero(value: float) -> float:
    """`value` rounded to one digit, without the sign of a zero."""
    return round(float(value), 1) + 0.0


def _payloads(calibration: Calibration, rigid: Calibration | None) -> list[Html]:
    """Table of the RMS distance of touches from their points by payload, for the rigid and the
    elastic arm.
    """
    assert calibration.loads is not None
    payload = calibration.loads.payload
    used = np.concatenate(calibration.weights) > 0.0
    models = {"elastic": calibration} if rigid is None else {"rigid": rigid, "elastic": calibration}
    distances = [np.concatenate(model.residuals) for model in models.values()]

    rows = []

    for mass in np.unique(payload):
        counted = used & (payload == mass)
        rms = [f"{1e3 * np.sqrt(np.mean(d[counted] ** 2)):.3f}" for d in distances if counted.any()]
        rows.append((f"{mass:g}", int(counted.sum()), *rms))

    columns = ("payload [kg]", "touches", *(f"{name} [mm]" for name in models))
    return [
        page.paragraph("Distance of the touches from their points, RMS, by the model:"),
        page.table(columns, rows, texts=()),
    ]


def _parameters(calibration: Calibration) -> Html:
    half = calibration.quantile() * calibration.sigma
    status = dict(zip(calibration.rank.parameters.names, calibration.rank.status, strict=True))
    estimate = calibration.estimate

    rows = []
    for name, unit, value, change, width in zip(
        estimate.names,
        estimate.parameters.units,
        estimate.values,
        estimate.changes,
        half,
        strict=True,
    ):
        factor, word = shown(unit)
        rows.append(
            (
                name,
                f"{factor * value:.4f}",
                f"{factor * change:+.4f}",
                f"± {factor * width:.4f}",
                word,
                _MEANING.get(status.get(name, ""), ""),
            )
        )

    columns = ("", "identified", "change", "95 %", "", "")
    return page.table(columns, rows, texts=(0, 4, 5))
