"""Writes docs/papers.md: what the papers state in numbers, and what this project gives.

    # runs the commands whose figures are missing
    ./uvw run scripts/experiments/papers/page.py

    # runs them all; an hour
    ./uvw run scripts/experiments/papers/page.py --anew

    # only commands that contain the word; the others keep their figures
    ./uvw run scripts/experiments/papers/page.py --only force

The rows stand in statements.toml beside this file. A row names a command and takes its figures from
the metrics.json that it writes, or from what it prints. The figures are kept in docs/papers.json.
Exit code 1: a command failed, or a row found no figure.
"""

import json
import re
import shlex
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.start import parse, run_scenario

HERE = Path(__file__).resolve()
DOCS = HERE.parents[3] / "docs"
STATEMENTS, FIGURES, PAGE = (
    HERE.with_name("statements.toml"),
    DOCS / "papers.json",
    DOCS / "papers.md",
)
_LOST = (0, 1)  # exit codes of a run with figures: accepted, or done outside its bounds


@dataclass
class Options:
    """Statements of the papers beside the figures of this project."""

    anew: bool = False
    """Run every command again."""
    only: str = ""
    """Run again the commands that contain this word."""


@dataclass(frozen=True, kw_only=True)
class PaperStatement:
    """One statement of a paper."""

    place: str  # in the paper
    stated: str  # by it
    ours: str  # text with {group.name} of metrics.json, or {0}, {1} ... of `printed`
    command: str = ""  # after `./uvw run scripts/`; none: `ours` is a reason
    printed: str = ""  # regular expression of the output
    remark: str = ""


def main() -> int:
    """Runs what is missing and writes the page; 1 if a figure is lacking."""
    options = parse(Options)
    console = Console(highlight=False)
    papers = tomllib.loads(STATEMENTS.read_text(encoding="utf-8"))
    rows = [row for paper in papers["paper"] for row in _rows(paper)]
    kept: dict[str, dict[str, str]] = (
        json.loads(FIGURES.read_text(encoding="utf-8")) if FIGURES.exists() else {}
    )

    figures: dict[str, dict[str, str]] = {}
    for command in dict.fromkeys(row.command for row in rows if row.command):
        wanted = [row for row in rows if row.command == command]
        known = kept.get(command, {})
        again = options.anew or bool(options.only and options.only in command)
        if again or not all(row.ours in known for row in wanted):
            console.print(f"[bold]{command}[/]")
            known = _figures(command, wanted)
        figures[command] = {row.ours: known[row.ours] for row in wanted if row.ours in known}

    FIGURES.write_text(json.dumps(figures, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    PAGE.write_text("\n".join(_page(papers, figures)) + "\n", encoding="utf-8")

    lacking = [row for row in rows if row.command and row.ours not in figures[row.command]]
    for row in lacking:
        console.print(f"no figure: {row.place}: {row.ours}", style="red")
    console.print(f"{len(rows) - len(lacking)} of {len(rows)} statements written to {PAGE}")
    return 1 if lacking else 0


def _rows(paper: Mapping[str, Any]) -> list[PaperStatement]:
    try:
        return [PaperStatement(**row) for row in paper["row"]]
    except TypeError as error:
        raise ConfigurationError(f"{STATEMENTS.name}: {paper['source']}: {error}") from None


def _figures(command: str, rows: list[PaperStatement]) -> dict[str, str]:
    """Texts with figures of the rows of one command, by their patterns; those that it does not give
    are left out.
    """
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        call = [sys.executable, *_program(command), "--out", str(out)]
        done = subprocess.run(
            call, cwd=HERE.parents[3], capture_output=True, text=True, check=False
        )
        file = out / "metrics.json"
        metrics = dict(_flat(json.loads(file.read_text(encoding="utf-8")))) if file.exists() else {}

    if done.returncode not in _LOST:
        Console(stderr=True).print(done.stderr[-2000:], markup=False)

    # What was printed, without colours.
    printed = re.sub(r"\x1b\[[0-9;]*m", "", done.stdout)
    texts: dict[str, str] = {}
    for row in rows:
        found = re.search(row.printed, printed) if row.printed else None
        groups = found.groups() if found else ()
        try:
            texts[row.ours] = _filled(row.ours, groups, metrics)
        except (KeyError, IndexError):
            continue

    return texts


def _program(command: str) -> list[str]:
    """What Python runs: the command `uuv`, or a file of scripts/."""
    first, *rest = shlex.split(command)
    return ["-m", "uuv", *rest] if first == "uuv" else [str(HERE.parents[2] / first), *rest]


def _filled(text: str, groups: tuple[str, ...], metrics: Mapping[str, Any]) -> str:
    """`text` with its figures; raises KeyError or IndexError if there is none."""
    return re.sub(r"\{([^}]+)\}", lambda match: _value(match[1], groups, metrics), text)


def _value(field: str, groups: tuple[str, ...], metrics: Mapping[str, Any]) -> str:
    """The figure that `field` names: NAME*FACTOR:FORMAT, or the number of a group."""
    if field.isdigit():
        return groups[int(field)].strip()
    name, _, form = field.partition(":")
    name, _, factor = name.partition("*")

    value = metrics[name]
    if value is None:
        return "none"
    return format(float(value) * float(factor or 1.0), form) if form else str(value)


def _flat(tree: Any, above: str = "") -> Iterator[tuple[str, Any]]:
    """Leaves of nested tables and lists, as ("contact.segments.0.set_n", 60.0)."""
    if not isinstance(tree, dict | list):
        yield above, tree
        return
    for key, value in tree.items() if isinstance(tree, dict) else enumerate(tree):
        yield from _flat(value, f"{above}.{key}" if above else str(key))


def _page(papers: Mapping[str, Any], figures: Mapping[str, Mapping[str, str]]) -> Iterator[str]:
    yield from ("# The papers, statement by statement", "", papers["intro"].strip(), "")
    yield from ("```", "./uvw run scripts/experiments/papers/page.py", "```")
    for paper in papers["paper"]:
        yield from ("", f"## [{paper['source']}] {paper['title']}", "", paper["text"].strip(), "")
        yield from ("| place | stated | here | command | difference |", "|---|---|---|---|---|")
        for row in _rows(paper):
            ours = figures[row.command].get(row.ours, "no figure") if row.command else row.ours
            command = f"`{row.command}`" if row.command else ""
            yield f"| {row.place} | {row.stated} | {ours} | {command} | {row.remark} |"


if __name__ == "__main__":
    run_scenario(main)
