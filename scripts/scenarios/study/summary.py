"""What a study makes of its rows: figures, tables and plots, and their printed and HTML forms."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table as RichTable

from sim.runs.saving import write_whole

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Row = dict[str, Any]  # result of one case, of JSON types


@dataclass(frozen=True, slots=True)
class Table:
    """Table of text cells, for the terminal and the report."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""
    labels: int = 1  # number of leading columns that are text, aligned left

    def printed(self) -> RichTable:
        """The table for the terminal."""
        table = RichTable(title=escape(self.title) or None, caption=escape(self.caption) or None, title_justify="left")
        for i, column in enumerate(self.columns):
            table.add_column(escape(column), justify="left" if i < self.labels else "right", no_wrap=i == 0)
        for row in self.rows:
            table.add_row(*map(escape, row))
        return table

    def markdown(self) -> str:
        """The table as markdown."""
        lines = [self.columns, ["---" if i < self.labels else "---:" for i in range(len(self.columns))], *self.rows]
        return f"**{self.title}**\n\n" + "\n".join(f"| {' | '.join(line)} |" for line in lines)


@dataclass(frozen=True, slots=True, kw_only=True)
class Summary:
    """Summary of all rows of a study."""

    metrics: Mapping[str, Any]  # for metrics.json
    tables: Sequence[Table] = ()
    lines: Sequence[str] = ()  # printed below the tables
    pictures: Iterable[tuple[str, str, "Figure"]] = ()  # title, caption and figure, for the report
    caption: str = ""  # below the title of the report
    failed: Sequence[str] | None = None  # missed bounds; None: the study has no bounds

    @property
    def accepted(self) -> bool:
        """True if no bound was missed."""
        return not self.failed

    @property
    def verdict(self) -> dict[str, Any]:
        """Entries "accepted" and "failed" of metrics.json; empty for a study without bounds."""
        return {} if self.failed is None else {"accepted": self.accepted, "failed": list(self.failed)}

    def print_to(self, console: Console) -> None:
        """Prints tables, lines and verdict."""
        for table in self.tables:
            console.print(table.printed())
        for line in self.lines:
            console.print(line, highlight=False, markup=False)
        if self.failed is not None:
            reasons = escape("; ".join(self.failed))
            said = "[green]accepted[/green]" if self.accepted else f"[red]not accepted[/red]: {reasons}"
            console.print(said, highlight=False)

    def write_page(self, file: Path, title: str, made_by: Mapping[str, Any], pace: str) -> None:
        """Writes report.html.

        Args:
            file: HTML file.
            title: Title of the page.
            made_by: Options of the study.
            pace: Sentence about the computing time.

        Raises:
            ConfigurationError: The file cannot be written.
        """
        from sim.reporting.report_page import page, provenance, section, table, text

        verdict = ""
        if self.failed is not None:
            word = "accepted" if self.accepted else "not accepted"
            verdict = f" <span class='{word.replace(' ', '-')}'>{word}</span>"
        reasons = "".join(f"<li>{text(line)}</li>" for line in self.failed or ())
        body = [
            f"<header><h1>{text(title)}{verdict}</h1>",
            f"<ul class=reasons>{reasons}</ul>" if reasons else "",
            f"<p class=caption>{text(' '.join(filter(None, (self.caption, pace))))}</p></header>",
            *(
                f"<section><h2>{text(each.title)}</h2>{table(each.columns, each.rows)}"
                f"{f'<p class=caption>{text(each.caption)}</p>' if each.caption else ''}</section>"
                for each in self.tables
            ),
            *(f"<p>{text(line)}</p>" for line in self.lines),
            *(section(name, figure, caption) for name, caption, figure in self.pictures),
            f"<section><h2>How the runs were made</h2>{provenance(made_by)}</section>",
        ]
        write_whole(file, page(title, "\n".join(body)))
