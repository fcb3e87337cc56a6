"""Statements of the papers, and comparisons with measurements, from the files beside this one."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from uuv.sim.interfaces.documents import toml_of
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.tables import TableReader

FOLDER = Path(__file__).parent
FILE = FOLDER / "statements.toml"
# name, source, factor, format
FIELD = re.compile(r"\{([^}*@]+?)(?:@([^}*:]+))?(?:\*([\d.e+-]+))?(?::(#?\.?\d*[a-z]))?\}")


class StatedFigure(NamedTuple):
    """A figure that a text names."""

    name: str
    source: str  # command or experiment


def is_command(source: str) -> bool:
    """Whether a source of figures is a command; else it is the name of an experiment."""
    return " " in source or source.endswith(".py")


@dataclass(frozen=True, kw_only=True)
class PaperStatement:
    """One statement of a paper, and where the figures of this project are from: a command or an
    experiment; neither: `ours` is a reason. A figure may name another source.
    """

    place: str  # in the paper
    stated: str  # by it
    ours: str  # by default: text with {name@source*factor:format} of figures
    published: str = ""  # by the method as published: likewise
    command: str = ""  # a job, after `./uvw run scripts/`
    published_command: str = ""  # of `published`, where it is another one
    experiment: str = ""  # name; both texts have figures of its page
    printed: str = ""  # regular expression of what `command` prints; its named groups are figures
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
        for figure in self.figures:
            if not figure.source:
                raise ConfigurationError(
                    f"{self.place}: {{{figure.name}}} needs a source: a command, an experiment, or "
                    "{name@source}"
                )

    @property
    def figures(self) -> list[StatedFigure]:
        """Figures of both texts and the remark."""
        return [
            StatedFigure(match[1], match[2] or source)
            for text, source in self._texts()
            for match in FIELD.finditer(text)
        ]

    @property
    def sources(self) -> list[str]:
        """Commands and experiments that its figures are from: that of the method as published, that
        of the default one, and others that figures name.
        """
        first = (self.published_command, self.command, self.experiment)
        named = (figure.source for figure in self.figures)
        return list(dict.fromkeys(source for source in (*first, *named) if source))

    @property
    def commands(self) -> list[str]:
        """The commands among the sources."""
        return [source for source in self.sources if is_command(source)]

    def names(self, source: str) -> list[str]:
        """Names of the figures of a source."""
        return [figure.name for figure in self.figures if figure.source == source]

    def _texts(self) -> list[tuple[str, str]]:
        """Both texts and the remark, each with the source that its figures are from."""
        usual = self.command or self.experiment
        return [
            (self.published, self.published_command or usual),
            (self.ours, usual),
            (self.remark, usual),
        ]

    def figures_of(self, command: str, metrics: Mapping[str, Any], output: str) -> dict[str, Any]:
        """Figures of the texts from what a command gave; those that metrics.json lacks are left
        out.

        Args:
            command: One of `commands`.
            metrics: Leaves of metrics.json by name.
            output: What the command printed.

        Raises:
            ConfigurationError: `printed` is not in the output of `self.command`.
        """
        known = dict(metrics)

        # Named groups of what was printed
        if self.printed and command == self.command:
            match = re.search(self.printed, output)
            if match is None:
                raise ConfigurationError(
                    f"{self.place}: {command!r} printed nothing like {self.printed!r}"
                )
            groups = match.groupdict().items()
            known |= {name: float(group) for name, group in groups if group is not None}

        return {name: known[name] for name in self.names(command) if name in known}

    def texts(self, figures: Mapping[str, Mapping[str, Any]]) -> tuple[str, str, str]:
        """The texts by the method as published and by default, and the remark, with their figures.

        Args:
            figures: By command, or by name of the experiment.

        Raises:
            KeyError: One is lacking.
        """
        published, ours, remark = (_filled(text, source, figures) for text, source in self._texts())
        return published, ours, remark


def _filled(text: str, usual: str, figures: Mapping[str, Mapping[str, Any]]) -> str:
    """A text with its figures, those without a source from the usual one; KeyError if one is
    lacking.
    """

    def shown(match: re.Match[str]) -> str:
        name, source, factor, form = match.groups()
        value = figures[source or usual][name]
        if value is None:
            return "none"

        # Words and counts stay as they are
        if isinstance(value, str) or (isinstance(value, int) and not factor and not form):
            return str(value)
        return format(float(value) * float(factor or 1.0), form or "g")

    return FIELD.sub(shown, text)


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


def read(file: Path = FILE) -> Statements:
    """The statements of a file.

    Raises:
        ConfigurationError: The file cannot be read, or a statement lacks something.
    """
    reader = TableReader(file.name, places_faults=True)
    return reader.made(Statements, toml_of(file, "statements"))


def all_rows() -> list[PaperStatement]:
    """Statements of all files."""
    return [row for file in sorted(FOLDER.glob("*.toml")) for row in read(file).rows]


def leaves(tree: Any, above: str = "") -> Iterable[tuple[str, Any]]:
    """Leaves of nested tables and lists, as ("contact.segments.0.set_n", 60.0)."""
    if not isinstance(tree, dict | list):
        yield above, tree
        return
    for key, value in tree.items() if isinstance(tree, dict) else enumerate(tree):
        yield from leaves(value, f"{above}.{key}" if above else str(key))
