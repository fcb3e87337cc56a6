"""Pages of results in HTML: title with verdict and reasons, sections, tables, figures, provenance.

The reports of runs, experiments, calibrations, water identifications and comparisons are made of
these parts. A page is one file that loads nothing from elsewhere. This module uses only the
standard library, so that every package can show its results. Figures come from Matplotlib.
"""

import base64
import html
import io
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any, Protocol


class Html(str):
    """Text that is HTML already; any other text is escaped when it is put into a page."""

    __slots__ = ()


class Drawing(Protocol):
    """Figure that writes itself to a file, as figures of Matplotlib do."""

    def savefig(self, fname: Any, /, **kwargs: Any) -> None:
        """Write the figure to a file, in a format named `format`."""


def page(title: str, parts: Iterable[Html]) -> str:
    """Complete HTML document of `parts`, one after the other.

    Args:
        title: Title of the browser's window.
        parts: Heading and sections; empty ones are left out.
    """
    body = "\n".join(filter(None, parts))
    return (
        f"<!doctype html>\n<html lang=en><head><meta charset=utf-8><title>{text(title)}</title>"
        f'<meta name=viewport content="width=device-width"><style>{_STYLE}</style></head>'
        f"<body><main>{body}</main></body></html>\n"
    )


def heading(
    title: str,
    accepted: bool | None = None,
    *,
    reasons: Iterable[str] = (),
    notes: Iterable[str] = (),
    about: str = "",
) -> Html:
    """Head of a page: title, verdict, reasons, warnings and remarks.

    Args:
        title: Title.
        accepted: Verdict next to the title; None for no verdict.
        reasons: Why the result was not accepted.
        notes: Warnings.
        about: Small print below.
    """
    word = "" if accepted is None else f" {verdict(accepted)}"
    warnings = "".join(f"<p class=note>{text(line)}</p>" for line in notes)

    return Html(
        f"<header><h1>{text(title)}{word}</h1>"
        f"{items(reasons, 'reasons')}{warnings}{caption(about)}</header>"
    )


def verdict(accepted: bool, words: tuple[str, str] = ("accepted", "not accepted")) -> Html:
    """Verdict in a coloured box: the first of `words`, or the second."""
    kind, word = ("accepted", words[0]) if accepted else ("not-accepted", words[1])
    return Html(f"<span class='{kind}'>{text(word)}</span>")


def card(
    title: str,
    accepted: bool,
    reasons: Iterable[Any],
    rows: Iterable[tuple[str, str, str]],
    words: tuple[str, str] = ("accepted", "not accepted"),
) -> str:
    """Result for display in a notebook, without a style sheet; readable on light and dark
    backgrounds.

    Args:
        title: Title.
        accepted: Verdict.
        reasons: Why it was not accepted.
        rows: Name, value and unit of each figure.
        words: For the verdict.
    """
    word = words[0] if accepted else f"{words[1]}: {'; '.join(map(str, reasons))}"
    return plain_card(title, word, rows, colour="#2e9e5b" if accepted else "#d1495b")


def plain_card(
    title: str, about: str, rows: Iterable[tuple[str, str, str]], *, colour: str = "#888888"
) -> str:
    """Card of figures without a verdict, for display in a notebook.

    Args:
        title: Title.
        about: Line below it.
        rows: Name, value and unit of each figure.
        colour: Of that line and of the bar beside all.
    """
    # Without a style sheet each cell must state its alignment.
    right = ' style="text-align:right"'
    cells = "".join(_row("td", row, (0, 2), right) for row in rows)

    return (
        f'<div style="border-left:4px solid {colour};padding:2px 10px">{strong(title)}'
        f'<div style="color:{colour}">{text(about)}</div><table>{cells}</table></div>'
    )


def section(title: str, *parts: Html) -> Html:
    """Section under its own heading; empty if it has no content."""
    body = "".join(parts)
    return Html(f"<section><h2>{text(title)}</h2>{body}</section>" if body else "")


def folded(title: str, *parts: Html) -> Html:
    """Section that opens when its title is clicked; empty if it has no content."""
    body = "".join(parts)
    return Html(
        f"<section><details><summary>{text(title)}</summary>{body}</details></section>"
        if body
        else ""
    )


def figure(title: str, about: str, drawing: Drawing) -> Html:
    """Section of a figure with a caption.

    The SVG is embedded as an image, since the element ids of inline SVGs would clash.
    """
    svg = io.BytesIO()
    # A page states the time of a result where that matters, so its figures do not.
    drawing.savefig(svg, format="svg", dpi=160, metadata={"Date": None})
    encoded = base64.b64encode(svg.getvalue()).decode("ascii")

    image = Html(f'<img alt="{text(title)}" src="data:image/svg+xml;base64,{encoded}">')
    return section(title, image, caption(about))


def images(pictures: Iterable[tuple[str, bytes]], media: str) -> Html:
    """Pictures in rows of two, each with a caption; none without pictures.

    Args:
        pictures: Caption and content of the file of each.
        media: Its media type, such as "image/webp".
    """
    shown = "".join(
        f'<figure><img alt="{text(about)}" src="data:{media};base64,'
        f'{base64.b64encode(content).decode("ascii")}"><figcaption>{text(about)}</figcaption>'
        "</figure>"
        for about, content in pictures
    )
    return Html(f"<div class=images>{shown}</div>" if shown else "")


def table(
    columns: Sequence[Any], rows: Iterable[Sequence[Any]], *, texts: Collection[int] = (0,)
) -> Html:
    """Table of cells, with numbers aligned right; empty if there are no heads and no rows.

    Args:
        columns: Heads of the columns; empty: a table without heads.
        rows: Cells of each row.
        texts: Indices of the columns that hold text, aligned left.
    """
    head = [_row("th", columns, texts)] if columns else []
    lines = head + [_row("td", row, texts) for row in rows]
    return Html(f"<table>{''.join(lines)}</table>" if lines else "")


def provenance(rows: Mapping[str, Any]) -> Html:
    """Section with the settings and versions of a result."""
    return section("Settings and versions", table((), rows.items(), texts=(0, 1)))


def paragraph(content: Any) -> Html:
    """Paragraph of text."""
    return Html(f"<p>{text(content)}</p>")


def caption(content: Any) -> Html:
    """Paragraph in small print below the part that it explains; empty if there is no text."""
    return Html(f"<p class=caption>{text(content)}</p>" if content else "")


def items(lines: Iterable[Any], kind: str = "") -> Html:
    """List of lines; empty if there are no lines.

    Args:
        lines: Text of each line.
        kind: Style of the lines, "reasons" or "caption".
    """
    body = "".join(f"<li>{text(line)}</li>" for line in lines)
    opening = f"<ul class={kind}>" if kind else "<ul>"
    return Html(f"{opening}{body}</ul>" if body else "")


def strong(content: Any) -> Html:
    """Text in bold type."""
    return Html(f"<b>{text(content)}</b>")


def text(content: Any) -> Html:
    """`content` as text, escaped unless it is HTML already."""
    return content if isinstance(content, Html) else Html(html.escape(str(content)))


def _row(tag: str, cells: Sequence[Any], texts: Collection[int], number: str = " class=n") -> str:
    """Row of a table; `number` is the HTML attribute of the columns that hold numbers."""
    inner = (
        f"<{tag}{'' if i in texts else number}>{text(cell)}</{tag}>" for i, cell in enumerate(cells)
    )
    return f"<tr>{''.join(inner)}</tr>"


_STYLE = """
:root { color-scheme: light dark }
body {
  font: 16px/1.5 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; margin: 0;
  color: #222; background: #fff;
}
main { max-width: 1000px; margin: 2rem auto; padding: 0 1rem }
.images { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(25rem, 100%), 1fr));
  gap: .6rem }
figure { margin: 0 }
figcaption { font-size: .85rem; opacity: .75 }
h1 { font-size: 1.6rem; margin: 0 }
h2, summary { font-size: 1.15rem; margin: 2.2rem 0 .6rem }
.accepted, .not-accepted {
  font-weight: 600; padding: .05em .5em; border-radius: .25em; white-space: nowrap;
}
.accepted { color: #00563e; background: #d9f2e9 }
.not-accepted { color: #8a3a00; background: #fde3d2 }
.reasons, .note { margin: .6rem 0; color: #8a3a00 }
.caption { color: #555; font-size: .9rem; margin: .3rem 0 }
table { border-collapse: collapse; margin: .6rem 0; font-size: .92rem }
td, th {
  padding: .22rem .9rem .22rem 0; border-bottom: 1px solid #e6e6e6;
  text-align: left; vertical-align: top; font-weight: normal;
}
th { color: #555; border-bottom-color: #aaa }
.n { text-align: right; font-variant-numeric: tabular-nums }
img { width: 100%; height: auto; display: block }
@media screen and (prefers-color-scheme: dark) {
  body { color: #ddd; background: #161a1f }
  th, .caption { color: #aaa }
  td, th { border-bottom-color: #333 }
  .accepted { color: #9fe3c5; background: #10382a }
  .not-accepted { color: #ffc49b; background: #45240d }
  .reasons, .note { color: #ffc49b }
  img { background: #fff; border-radius: .4em }
}
@media print {
  main { max-width: none }
  img, tr { break-inside: avoid }
  .modebar { display: none !important }
}
"""
