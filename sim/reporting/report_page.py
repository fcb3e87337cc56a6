"""HTML layout common to all reports: style, embedded figures and provenance, in one self-contained
file.
"""

import base64
import html
import io
import platform
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure

from uuv.sim.runs.provenance import commit, versions


def page(title: str, body: str) -> str:
    """Complete HTML document around `body`, which is HTML."""
    return (
        f"<!doctype html>\n<html lang=en><head><meta charset=utf-8><title>{text(title)}</title>"
        f'<meta name=viewport content="width=device-width"><style>{STYLE}</style></head>'
        f"<body><main>{body}</main></body></html>\n"
    )


def section(title: str, figure: Figure, caption: str) -> str:
    """HTML section of a figure.

    Args:
        title: Heading.
        figure: The figure.
        caption: Text below it.

    Returns:
        HTML.
    """
    return (
        f"<section><h2>{text(title)}</h2>{picture(figure, title)}<p "
        f"class=caption>{text(caption)}</p></section>"
    )


def picture(figure: Figure, name: str) -> str:
    """Figure as an embedded SVG image; inline SVGs would clash by their element ids."""
    drawing = io.BytesIO()
    figure.savefig(drawing, format="svg", dpi=160, metadata={"Date": None})
    data = base64.b64encode(drawing.getvalue()).decode("ascii")
    return f'<img alt="{text(name)}" src="data:image/svg+xml;base64,{data}">'


def table(columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """HTML table of text cells; all columns but the first are right-aligned numbers."""
    head = "".join(f"<th{_class(i)}>{text(name)}</th>" for i, name in enumerate(columns))
    lines = (
        "<tr>"
        + "".join(f"<td{_class(i)}>{text(cell)}</td>" for i, cell in enumerate(row))
        + "</tr>"
        for row in rows
    )
    return f"<table><tr>{head}</tr>{''.join(lines)}</table>"


def provenance(given: Mapping[str, Any]) -> str:
    """HTML table of `given`, the package versions, the commit and the machine."""
    rows = {
        **given,
        **versions(),
        **commit(),
        "machine": f"{platform.system()} {platform.machine()}",
    }
    cells = "".join(
        f"<tr><td>{text(name)}</td><td>{text(value)}</td></tr>" for name, value in rows.items()
    )
    return f"<table>{cells}</table>"


def text(value: Any) -> str:
    """`value` as text, escaped for HTML."""
    return html.escape(str(value))


def _class(column: int) -> str:
    return " class=n" if column else ""


STYLE = """
:root { color-scheme: light dark }
body { font: 16px/1.5 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; margin: 0;
  color: #222; background: #fff }
main { max-width: 1000px; margin: 2rem auto; padding: 0 1rem }
h1 { font-size: 1.6rem; margin: 0 } h2, summary { font-size: 1.15rem; margin: 2.2rem 0 .6rem }
.accepted, .not-accepted { font-weight: 600; padding: .05em .5em; border-radius: .25em;
  white-space: nowrap }
.accepted { color: #00563e; background: #d9f2e9 }
.not-accepted { color: #8a3a00; background: #fde3d2 }
.reasons { margin: .6rem 0; color: #8a3a00 }
.caption { color: #555; font-size: .9rem; margin: .3rem 0 }
table { border-collapse: collapse; margin: .6rem 0; font-size: .92rem }
td, th { padding: .22rem .9rem .22rem 0; border-bottom: 1px solid #e6e6e6;
  text-align: left; font-weight: normal }
th { color: #555; border-bottom-color: #aaa }
.n { text-align: right; font-variant-numeric: tabular-nums }
img { width: 100%; height: auto; display: block }
@media screen and (prefers-color-scheme: dark) {
  body { color: #ddd; background: #161a1f }
  th, .caption { color: #aaa } td, th { border-bottom-color: #333 }
  .accepted { color: #9fe3c5; background: #10382a }
  .not-accepted { color: #ffc49b; background: #45240d }
  .reasons { color: #ffc49b } img { background: #fff; border-radius: .4em }
}
@media print {
  main { max-width: none } img, tr { break-inside: avoid }
  .modebar { display: none !important }
}
"""
