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
# name, factor, format
_FIELD = re.compile(r"\{([^}*]+?)(?:\*([\d.e+-]+))?(?::(#?\.?\d*[a-z]))?\}")


@dataclass(frozen=True, kw_only=True)
class PaperStatement:
    """One statement of a paper, and where the figures of this project are from: a command or an
    experiment; neither: `ours` is a reason.
    """

    place: str  # in the paper
    stated: str  # by it
    ours: str  # by default: text with {name*factor:format} of figures
    published: str = ""  # by the method as published: likewise
    command: str = ""  # a job, after `./uvw run scripts/`
    published_command: str = ""  # of `published`, where it is another one
    experiment: str = ""  # name; both texts have figures of its page
    printed: str = ""  # regular expression of what the command prints; its named groups are figures
    remark: str = ""  # why they differ: likewise

    def __post_init__(self) -> None:
        if self.command and self.experiment:
            raise ConfigurationError(f"{self.place}: has a command or an experiment, not both")
        if self.published_command and not (self.published and self.command):
            raise ConfigurationError(
                f"{self.place}: published_command: needs published and command"
            )
        if self.printed and not self.command:
            raise ConfigurationError(f"{self.place}: printed: needs a command")
        if self.printed and not re.compile(self.printed).groupindex:
            raise ConfigurationError(
                f"{self.place}: printed: has no named group, as (?P<range_m>...)"
            )

    @property
    def commands(self) -> list[str]:
        """Those that its figures are from."""
        return [command for command in (self.command, self.published_command) if command]

    def names(self, command: str) -> list[str]:
        """Names of the figures of a command in the texts; "": of the experiment."""
        return [
            match[1]
            for text, source in self._texts()
            if source == command
            for match in _FIELD.finditer(text)
        ]

    def _texts(self) -> list[tuple[str, str]]:
        """Both texts and the remark, each with the command that its figures are from."""
        published_by = self.published_command or self.command
        texts = [(self.published, published_by), (self.ours, self.command)]
        return [*texts, (self.remark, self.command)]

    def figures_of(self, command: str, metrics: Mapping[str, Any], output: str) -> dict[str, Any]:
        """Figures of the texts from what a command gave; those that metrics.json lacks are left
        out.

        Args:
            command: One of `commands`.
            metrics: Leaves of metrics.json by name.
            output: What the command printed.

        Raises:
            ConfigurationError: `printed` is not in the output.
        """
        known = dict(metrics)

        # Named groups of what was printed
        if self.printed:
            match = re.search(self.printed, output)
            if match is None:
                raise ConfigurationError(
                    f"{self.place}: {command!r} printed nothing like {self.printed!r}"
                )
            known |= {name: float(group) for name, group in match.groupdict().items()}

        return {name: known[name] for name in self.names(command) if name in known}

    def texts(self, figures: Mapping[str, Mapping[str, Any]]) -> tuple[str, str, str]:
        """The texts by the method as published and by default, and the remark, with their figures.

        Args:
            figures: By command, or by name of the experiment.

        Raises:
            KeyError: One is lacking.
        """
        published, ours, remark = (
            _filled(text, figures.get(source or self.experiment, {}))
            for text, source in self._texts()
        )
        return published, ours, remark


def _filled(text: str, figures: Mapping[str, Any]) -> str:
    """A text with its figures; KeyError if one is lacking."""

    def shown(match: re.Match[str]) -> str:
        value = figures[match[1]]
        if value is None:
            return "none"

        # A count stays one
        if isinstance(value, int) and not match[2] and not match[3]:
            return str(value)
        return format(float(value) * float(match[2] or 1.0), match[3] or "g")

    return _FIELD.sub(shown, text)


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
        return [row for row in self.rows if command in row.commands]


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
