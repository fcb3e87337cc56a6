"""`report.html`: what a run was worth and how it went, on one page that needs nothing else."""

import base64
import html
import io
import platform
from collections.abc import Iterable, Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from sim.interfaces.errors import ConfigurationError
from sim.metrics import Assessment, Bounds, Check, TrueObject
from sim.recording import Recording
from sim.report_figures import figures
from sim.results_table import figures_of

PACKAGES = ("uuv-arm", "mujoco", "numpy", "scipy", "numba", "open3d-cpu", "open3d", "rerun-sdk")


def write_report(
    file: str | Path,
    recording: Recording,
    truth: TrueObject | None,
    assessment: Assessment,
    *,
    title: str,
    options: Mapping[str, Any],
    bounds: Bounds | None = None,
    pictures: Iterable[tuple[str, str, Figure]] = (),
) -> None:
    """Write the page to `file`. `options` are the scenario's own, shown as they are.

    Its pictures are those of work along a path on the object of `truth`, where there is one, and `pictures` (title,
    caption, figure). Raises ConfigurationError if the folder does not exist.
    """
    path = Path(file)
    if not path.parent.is_dir():
        raise ConfigurationError(f"report: there is no folder {str(path.parent)!r}")
    of_path = () if truth is None else figures(recording, truth, bounds or Bounds())
    drawn = "\n".join(
        f"<section><h2>{_text(name)}</h2>{_picture(figure, name)}<p class=caption>{_text(caption)}</p></section>"
        for name, caption, figure in (*of_path, *pictures)
    )
    body = "\n".join(
        (
            _headline(title, recording, assessment),
            "<section><h2>Figures</h2>",
            _checks(assessment),
            _segments(assessment),
            "</section>",
            drawn,
            f"<section><h2>How the run was made</h2>{_provenance(recording, assessment, options)}</section>",
        )
    )
    page = (
        f"<!doctype html>\n<html lang=en><head><meta charset=utf-8><title>{_text(title)}</title>"
        f'<meta name=viewport content="width=device-width"><style>{_STYLE}</style></head>'
        f"<body><main>{body}</main></body></html>\n"
    )
    path.write_text(page, encoding="utf-8")


def _headline(title: str, recording: Recording, assessment: Assessment) -> str:
    verdict = "accepted" if assessment.accepted else "not accepted"
    reasons = "".join(f"<li>{_text(line)}</li>" for line in assessment.failed)
    run = assessment.metrics["run"]
    factor = run["real_time_factor"]
    pace = f", {factor:.1f} × real time" if factor is not None else ""
    return (
        f"<header><h1>{_text(title)} <span class='{verdict.replace(' ', '-')}'>{verdict}</span></h1>"
        + (f"<ul class=reasons>{reasons}</ul>" if reasons else "")
        + f"<p class=caption>{recording.duration:.1f} s simulated in {run['wall_s']:.1f} s{pace}; seed {run['seed']}; "
        f"ended in state {_text(recording.final.state.value)}.</p></header>"
    )


def _checks(assessment: Assessment) -> str:
    rows = "".join(
        f"<tr><td>{_text(check.name)}</td><td class=n>{value}</td><td class=n>{bound}</td>"
        f"<td>{_text(check.unit)}</td><td>{_verdict(check)}</td></tr>"
        for check in assessment.checks
        for value, bound in (figures_of(check),)
    )
    head = "<tr><th>figure</th><th class=n>value</th><th class=n>bound</th><th>unit</th><th></th></tr>"
    return f"<table>{head}{rows}</table>"


def _verdict(check: Check) -> str:
    if check.bound is None:
        return ""
    return "<span class=accepted>ok</span>" if check.ok else "<span class=not-accepted>missed</span>"


def _segments(assessment: Assessment) -> str:
    segments = assessment.metrics.get("contact", {}).get("segments")
    if not segments:
        return ""
    keys = ("set_n", "force_error_rms_n", "force_error_max_n", "lost_s", "duration_s")
    heads = ("set [N]", "error, RMS [N]", "error, peak [N]", "contact lost [s]", "duration [s]")
    rows = "".join(
        "<tr>" + "".join(f"<td class=n>{'–' if s[k] is None else format(s[k], '.2f')}</td>" for k in keys) + "</tr>"
        for s in segments
    )
    return f"<table><tr>{''.join(f'<th class=n>{head}</th>' for head in heads)}</tr>{rows}</table>"


def _provenance(recording: Recording, assessment: Assessment, options: Mapping[str, Any]) -> str:
    rows = {
        **{f"option {name}": value for name, value in options.items()},
        "seed": assessment.metrics["run"]["seed"],
        "physics step": f"{recording.timestep * 1e3:g} ms",
        "Python": platform.python_version(),
        **{name: found for name in PACKAGES if (found := _version(name)) is not None},
        "machine": f"{platform.system()} {platform.machine()}",
    }
    cells = "".join(f"<tr><td>{_text(name)}</td><td>{_text(value)}</td></tr>" for name, value in rows.items())
    return f"<table>{cells}</table>"


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _picture(figure: Figure, name: str) -> str:
    """As an image of its own, since the ids of several drawings on one page would clash."""
    drawing = io.BytesIO()
    figure.savefig(drawing, format="svg", dpi=160, metadata={"Date": None})
    data = base64.b64encode(drawing.getvalue()).decode("ascii")
    return f'<img alt="{_text(name)}" src="data:image/svg+xml;base64,{data}">'


def _text(value: Any) -> str:
    return html.escape(str(value))


_STYLE = """
body { font: 16px/1.5 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; color: #222; background: #fff; margin: 0 }
main { max-width: 1000px; margin: 2rem auto; padding: 0 1rem }
h1 { font-size: 1.6rem; margin: 0 } h2 { font-size: 1.15rem; margin: 2.2rem 0 .6rem }
.accepted, .not-accepted { font-weight: 600; padding: .05em .5em; border-radius: .25em; white-space: nowrap }
.accepted { color: #00563e; background: #d9f2e9 } .not-accepted { color: #8a3a00; background: #fde3d2 }
.reasons { margin: .6rem 0; color: #8a3a00 } .caption { color: #555; font-size: .9rem; margin: .3rem 0 }
table { border-collapse: collapse; margin: .6rem 0; font-size: .92rem }
td, th { padding: .22rem .9rem .22rem 0; text-align: left; border-bottom: 1px solid #e6e6e6; font-weight: normal }
th { color: #555; border-bottom-color: #aaa } .n { text-align: right; font-variant-numeric: tabular-nums }
img { width: 100%; height: auto; display: block }
"""
