"""Statements of the papers, read from statements.toml beside this file."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from uuv.sim.interfaces.documents import toml_of
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.tables import TableReader

FILE = Path(__file__).with_name("statements.toml")
_FIELD = re.compile(r"\{([^}*:]+)(?:\*([^}:]+))?(?::([^}]+))?\}")  # name, factor, format


@dataclass(frozen=True, kw_only=True)
class PaperStatement:
    """One statement of a paper, and where the figure of this project is from: a command or an
    experiment; neither: `ours` is a reason.
    """

    place: str  # in the paper
    stated: str  # by it
    ours: str  # text with {name*factor:format} of figures
    command: str = ""  # a job, after `./uvw run scripts/`
    experiment: str = ""  # name; `ours` has figures of its page
    printed: str = ""  # regular expression of what the command prints; its named groups are figures
    remark: str = ""

    def __post_init__(self) -> None:
        if self.command and self.experiment:
            raise ConfigurationError(f"{self.place}: has a command or an experiment, not both")
        if self.printed and not self.command:
            raise ConfigurationError(f"{self.place}: printed: needs a command")
        if self.printed and not re.compile(self.printed).groupindex:
            raise ConfigurationError(
                f"{self.place}: printed: has no named group, as (?P<range_m>...)"
            )

    @property
    def names(self) -> list[str]:
        """Names of the figures in the text."""
        return [match[1] for match in _FIELD.finditer(self.ours)]

    def figures_of(self, metrics: Mapping[str, Any], output: str) -> dict[str, Any]:
        """Figures of the text from what its command gave; those that metrics.json lacks are left
        out.

        Args:
            metrics: Leaves of metrics.json by name.
            output: What the command printed.

        Raises:
            ConfigurationError: `printed` is not in the output.
        """
        known = dict(metrics)
        if self.printed:
            match = re.search(self.printed, output)
            if match is None:
                raise ConfigurationError(
                    f"{self.place}: {self.command!r} printed nothing like {self.printed!r}"
                )
            known |= {name: float(group) for name, group in match.groupdict().items()}

        return {name: known[name] for name in self.names if name in known}

    def text(self, figures: Mapping[str, Any]) -> str:
        """The text with its figures.

        Raises:
            KeyError: One is lacking.
        """

        def shown(match: re.Match[str]) -> str:
            value = figures[match[1]]
            if value is None:
                return "none"
            if isinstance(value, int) and not match[2] and not match[3]:
                return str(value)
            return format(float(value) * float(match[2] or 1.0), match[3] or "g")

        return _FIELD.sub(shown, self.ours)


@dataclass(frozen=True, kw_only=True)
class Paper:
    """One paper with its statements."""

    title: str
    text: str
    row: tuple[PaperStatement, ...]
    source: str = ""  # key of docs/references.md; empty: no paper, but a group of comparisons


@dataclass(frozen=True, kw_only=True)
class Statements:
    """All papers."""

    intro: str
    paper: tuple[Paper, ...]

    @property
    def rows(self) -> list[PaperStatement]:
        """Statements of all papers."""
        return [row for paper in self.paper for row in paper.row]

    def of(self, command: str) -> list[PaperStatement]:
        """Those of a command."""
        return [row for row in self.rows if row.command == command]


def read(file: Path = FILE) -> Statements:
    """The statements of a file.

    Raises:
        ConfigurationError: The file cannot be read, or a statement lacks something.
    """
    reader = TableReader(file.name, places_faults=True)
    return reader.made(Statements, toml_of(file, "statements"))


def leaves(tree: Any, above: str = "") -> Iterable[tuple[str, Any]]:
    """Leaves of nested tables and lists, as ("contact.segments.0.set_n", 60.0)."""
    if not isinstance(tree, dict | list):
        yield above, tree
        return
    for key, value in tree.items() if isinstance(tree, dict) else enumerate(tree):
        yield from leaves(value, f"{above}.{key}" if above else str(key))
