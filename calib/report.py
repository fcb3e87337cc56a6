"""`report.html` of a calibration: results, limits of identifiability, and figures, on one page."""

import base64
import html
import io
import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from uuv.calib.identification import Calibration
from uuv.calib.report_figures import figures
from uuv.calib.verification import Cloud
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array

PACKAGES = ("uuv-arm", "numpy", "scipy", "numba", "mujoco")
_SHOWN = {"rad": (1.0e3, "mrad"), "m": (1.0e3, "mm"), "rad/(N m)": (1.0e6, "µrad/(N m)")}
_MEANING = {
    "known": "known",
    "in combination": "in combination: changes with others, held by the prior",
    "unknowable": "unknowable: stays at nominal",
}


def shown(unit: str) -> tuple[float, str]:
    """Display factor and name of the unit for numbers in `unit` (rad, m, rad/(N m))."""
    return _SHOWN[unit]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Statement:
    """What the report says of a calibration, beside the result itself."""

    title: str
    accepted: bool  # verdict, shown next to the title
    figures_of_merit: Sequence[tuple[str, str]]  # name and value, in order of reading
    notes: Iterable[str] = ()  # shown before the calibration's own warnings
    # settings of the run, shown with the versions of the packages
    options: Mapping[str, Any] | None = None


def write_report(
    file: str | Path,
    calibration: Calibration,
    said: Statement,
    *,
    series: Sequence[Array],
    point_names: Sequence[str],
    clouds: Mapping[str, Cloud] | None = None,
    rigid: Calibration | None = None,
) -> None:
    """Write the report page to `file`.

    Args:
        file: path of the HTML page, in an existing folder.
        calibration: result to report.
        said: title, verdict, figures and settings.
        series: touches (m_i, n) used for the identification.
        point_names: names of the touched points.
        clouds: point clouds of `uuv.calib.verification.compare`, by name.
        rigid: the same touches identified without compliances, for comparison.

    Raises:
        ConfigurationError: the folder does not exist.
    """
    path = Path(file)
    if not path.parent.is_dir():
        raise ConfigurationError(f"report: there is no folder {str(path.parent)!r}")
    verdict = "accepted" if said.accepted else "not accepted"
    notes = [*said.notes, *calibration.warnings]
    merit = "".join(
        f"<tr><td>{_text(name)}</td><td class=n>{_text(value)}</td></tr>"
        for name, value in said.figures_of_merit
    )
    pictures = "\n".join(
        f"<section><h2>{_text(name)}</h2>{_picture(figure, name)}<p "
        f"class=caption>{_text(caption)}</p></section>"
        for name, caption, figure in figures(calibration, series, point_names, clouds or {})
    )
    body = "\n".join(
        (
            f"<header><h1>{_text(said.title)} <span "
            f"class='{verdict.replace(' ', '-')}'>{verdict}</span></h1>",
            "".join(f"<p class=note>{_text(line)}</p>" for line in notes) + "</header>",
            f"<section><h2>Figures</h2><table>{merit}</table></section>",
            "<section><h2>What touching told, and what it "
            f"cannot</h2>{_rank(calibration)}</section>",
            _compliance_section(calibration, series, rigid),
            pictures,
            f"<section><h2>Parameters</h2>{_parameters(calibration)}</section>",
            f"<section><h2>How it was made</h2>{_provenance(said.options or {})}</section>",
        )
    )
    path.write_text(
        "<!doctype html>\n<html lang=en><head><meta "
        f"charset=utf-8><title>{_text(said.title)}</title>"
        f'<meta name=viewport content="width=device-width"><style>{_STYLE}</style></head>'
        f"<body><main>{body}</main></body></html>\n",
        encoding="utf-8",
    )


def _rank(calibration: Calibration) -> str:
    rank = calibration.rank
    rows = "".join(
        f"<tr><td class=n>{group.count}</td><td>{_text(', '.join(group.names))}</td>"
        f"<td>{_text(group.reason)}</td><td>{_text(group.handle)}</td></tr>"
        for group in rank.hidden
    )
    head = (
        "<tr><th class=n>directions</th><th>in</th><th>why they are not seen</th><th>what "
        "helps</th></tr>"
    )
    least_seen = range(max(rank.rank - 3, 0), rank.rank)
    combinations = "".join(f"<li>{_text(rank.combination(i))}</li>" for i in least_seen)
    return (
        f"<p><b>{rank.rank} of {rank.total}</b> directions of the parameters move the touched "
        "tips apart, and are "
        f"identified; condition {rank.condition:.3g}, observability index O1 "
        f"{rank.observability:.3g} m.</p>"
        + (f"<table>{head}{rows}</table>" if rows else "")
        + "<p class=caption>Least seen of the seen, in shares of like errors: more touches help "
        "here most.</p>"
        f"<ul class=caption>{combinations}</ul>"
    )


def _compliance_section(
    calibration: Calibration, series: Sequence[Array], rigid: Calibration | None
) -> str:
    """Compliances with intervals, joints that the loads do not show, and what is left at each
    payload.
    """
    if calibration.loads is None:
        return ""
    every = np.ascontiguousarray(np.vstack(series))
    moments = calibration.loads.at(every)(calibration.arm.table)
    rows = []
    for k, name in enumerate(names := [f"c{k + 1}" for k in range(calibration.arm.n)]):
        span = f"{_zero(moments[:, k].min()):.1f} to {_zero(moments[:, k].max()):.1f}"
        rows.append(
            f"<tr><td>{name}</td>{_compliance(calibration, name)}<td class=n>{span}</td></tr>"
        )
    head = (
        "<tr><th></th><th class=n>compliance [µrad/(N m)]</th><th class=n>95 %</th><th class=n>95 "
        "% over value</th>"
        "<th class=n>stiffness [N m/rad]</th><th class=n>moments [N m]</th></tr>"
    )
    hidden = [group for group in calibration.rank_free.hidden if set(group.names) & set(names)]
    why = "".join(
        f"<li><b>{_text(', '.join(name for name in group.names if name in names))}</b>: "
        f"{_text(group.reason)}. "
        f"What helps: {_text(group.handle)}.</li>"
        for group in hidden
    )
    not_seen = (
        f"<p>Not identified; their values stay with the prior:</p><ul>{why}</ul>" if why else ""
    )
    return (
        f"<section><h2>Compliance of the joints</h2><table>{head}{''.join(rows)}</table>{not_seen}"
        f"{_payloads(calibration, rigid)}</section>"
    )


def _compliance(calibration: Calibration, name: str) -> str:
    """Cells of one compliance: value, half of its 95 % interval, their quotient and the
    stiffness.
    """
    hidden = any(name in group.names for group in calibration.rank_free.hidden)
    if name not in calibration.names:
        return "<td class=n>fixed</td><td></td><td></td><td></td>"
    i = calibration.names.index(name)
    value = calibration.estimate.values[i]
    half = calibration.quantile() * calibration.sigma[i]
    cells = f"<td class=n>{_zero(1e6 * value):.1f}</td><td class=n>± {1e6 * half:.1f}</td>"
    if hidden or not value > half:
        doubt = "not identified" if hidden else "not told from zero"
        return f"{cells}<td class=n>{doubt}</td><td></td>"
    return f"{cells}<td class=n>{100.0 * half / value:.1f} %</td><td class=n>{1.0 / value:.0f}</td>"


def _zero(value: float) -> float:
    """`value` rounded to one digit, without the sign of a zero."""
    return round(float(value), 1) + 0.0


def _payloads(calibration: Calibration, rigid: Calibration | None) -> str:
    """Table of the RMS distance of the touches from their points at each payload, rigid and
    elastic.
    """
    assert calibration.loads is not None
    payload = calibration.loads.payload
    used = np.concatenate(calibration.weights) > 0.0
    models = {"rigid": rigid, "elastic": calibration}
    rows = []
    for mass in np.unique(payload):
        mine = used & (payload == mass)
        squares = [
            np.mean(np.concatenate(model.residuals)[mine] ** 2)
            for model in models.values()
            if model is not None and mine.any()
        ]
        cells = "".join(f"<td class=n>{1e3 * np.sqrt(square):.3f}</td>" for square in squares)
        rows.append(f"<tr><td class=n>{mass:g}</td><td class=n>{int(mine.sum())}</td>{cells}</tr>")
    heads = "".join(
        f"<th class=n>{name} [mm]</th>" for name, model in models.items() if model is not None
    )
    return (
        "<p>Distance of the touches from their points, RMS, by the model:</p><table><tr><th "
        "class=n>payload [kg]</th>"
        f"<th class=n>touches</th>{heads}</tr>{''.join(rows)}</table>"
    )


def _parameters(calibration: Calibration) -> str:
    half = calibration.quantile() * calibration.sigma
    status = dict(zip(calibration.rank.parameters.names, calibration.rank.status, strict=True))
    rows = []
    found = calibration.estimate
    for name, unit, value, change, width in zip(
        found.names, found.parameters.units, found.values, found.changes, half, strict=True
    ):
        factor, word = shown(unit)
        rows.append(
            f"<tr><td>{_text(name)}</td><td class=n>{factor * value:.4f}</td><td "
            f"class=n>{factor * change:+.4f}</td>"
            f"<td class=n>± {factor * width:.4f}</td><td>{word}</td>"
            f"<td>{_text(_MEANING.get(status.get(name, ''), ''))}</td></tr>"
        )
    head = (
        "<tr><th></th><th class=n>identified</th><th class=n>change</th><th class=n>95 "
        "%</th><th></th><th></th></tr>"
    )
    return f"<table>{head}{''.join(rows)}</table>"


def _provenance(options: Mapping[str, Any]) -> str:
    rows = {
        **options,
        "Python": platform.python_version(),
        **{name: found for name in PACKAGES if (found := _version(name)) is not None},
        "machine": f"{platform.system()} {platform.machine()}",
    }
    cells = "".join(
        f"<tr><td>{_text(name)}</td><td>{_text(value)}</td></tr>" for name, value in rows.items()
    )
    return f"<table>{cells}</table>"


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _picture(figure: Figure, name: str) -> str:
    """Embed the figure as an image of its own, since the ids of several drawings on one page would
    clash.
    """
    drawing = io.BytesIO()
    figure.savefig(drawing, format="svg", dpi=160, metadata={"Date": None})
    data = base64.b64encode(drawing.getvalue()).decode("ascii")
    return f'<img alt="{_text(name)}" src="data:image/svg+xml;base64,{data}">'


def _text(value: Any) -> str:
    return html.escape(str(value))


_STYLE = """
body { font: 16px/1.5 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; margin: 0;
  color: #222; background: #fff }
main { max-width: 1000px; margin: 2rem auto; padding: 0 1rem }
h1 { font-size: 1.6rem; margin: 0 } h2 { font-size: 1.15rem; margin: 2.2rem 0 .6rem }
.accepted, .not-accepted { font-weight: 600; padding: .05em .5em; border-radius: .25em;
  white-space: nowrap }
.accepted { color: #00563e; background: #d9f2e9 }
.not-accepted { color: #8a3a00; background: #fde3d2 }
.note { margin: .4rem 0; color: #8a3a00 }
.caption { color: #555; font-size: .9rem; margin: .3rem 0 }
table { border-collapse: collapse; margin: .6rem 0; font-size: .92rem }
td, th { padding: .22rem .9rem .22rem 0; border-bottom: 1px solid #e6e6e6;
  text-align: left; font-weight: normal; vertical-align: top }
th { color: #555; border-bottom-color: #aaa }
.n { text-align: right; font-variant-numeric: tabular-nums }
img { width: 100%; height: auto; display: block }
"""
