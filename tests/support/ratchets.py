"""Limits that only go down: how far folders and files are still from the rules.

They stand in tests/unit/house/ratchets.toml.

    ./uvw run tests/support/ratchets.py              what is worse than its limit, with the places
    ./uvw run tests/support/ratchets.py --tighten    writes limits that have become smaller
    ./uvw run tests/support/ratchets.py uuv/check    every offence in a folder or file

A folder or file that is not listed has no allowance: what is new obeys the rules.
"""

import argparse
import tomllib
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path

from page_counts import RULES, Offence, offences
from second_tables import second_tables
from source_tree import ROOT, name_of, sources

FILE = ROOT / "tests" / "unit" / "house" / "ratchets.toml"
HEAD = """\
# How far folders are from the rules of CONTRIBUTING.md, section "Pages", and files from those
# of "Lists": no number may grow. Written by ./uvw run tests/support/ratchets.py --tighten, which
# only makes them smaller.
"""
TABLES = "tables"  # rule of a file: names of a list that is written elsewhere
Limits = Mapping[str, Mapping[str, int]]  # by folder or file, and rule


def counts(files: Iterable[Path]) -> dict[str, Counter[str]]:
    """Offences of files, summed by folder and rule."""
    sums: dict[str, Counter[str]] = {}
    for path in files:
        folder = sums.setdefault(name_of(path.parent), Counter())
        for rule, several in offences(path).items():
            folder[rule] += sum(offence.amount for offence in several)
    return sums


def table_counts() -> dict[str, Counter[str]]:
    """Second tables, summed by file."""
    by_file = Counter(name_of(table.path) for table in second_tables())
    return {name: Counter({TABLES: number}) for name, number in by_file.items()}


def limits() -> Limits:
    """The limits as they are written down."""
    return tomllib.loads(FILE.read_text(encoding="utf-8"))


def worse(counted: Limits, allowed: Limits) -> list[tuple[str, str, int, int]]:
    """Folder, rule, count and limit wherever the count is above it."""
    return [
        (folder, rule, number, limit)
        for folder, numbers in counted.items()
        for rule, number in numbers.items()
        if number > (limit := allowed.get(folder, {}).get(rule, 0))
    ]


def tightened(counted: Limits, allowed: Limits) -> dict[str, dict[str, int]]:
    """The limits, each lowered to its count; those at zero, and folders that are gone, left out."""
    lowered = {
        folder: {rule: min(limit, counted[folder].get(rule, 0)) for rule, limit in numbers.items()}
        for folder, numbers in allowed.items()
        if folder in counted
    }
    several = {
        folder: {rule: n for rule, n in numbers.items() if n} for folder, numbers in lowered.items()
    }
    return {folder: numbers for folder, numbers in several.items() if numbers}


def as_text(written: Limits) -> str:
    """The file of the limits, a line a folder."""
    lines = []
    for folder, numbers in sorted(written.items()):
        pairs = ", ".join(
            f"{rule} = {numbers[rule]}" for rule in (*RULES, TABLES) if rule in numbers
        )
        lines.append(f'"{folder}" = {{ {pairs} }}')
    return "\n".join([HEAD, *lines]) + "\n"


def listing(files: Iterable[Path], rules: Iterable[str]) -> list[str]:
    """One line for each offence of the files against the rules."""
    return [
        _line(path, rule, offence)
        for path in files
        for rule in rules
        for offence in offences(path)[rule]
    ]


def complaint(excess: Iterable[tuple[str, str, int, int]]) -> str:
    """What is worse than its limit, and where: all offences of that kind in the folder."""
    text = []
    for folder, rule, number, limit in excess:
        if rule == TABLES:
            twice = [table for table in second_tables() if name_of(table.path) == folder]
            text += [f"{table} (a list that there is already)" for table in twice]
            continue

        here = [path for path in sources() if name_of(path.parent) == folder]
        text += [f"{folder}: {rule} is {number}, the limit {limit}", *listing(here, [rule])]
    return "\n".join(text)


def main() -> int:
    """Compares, lists or tightens; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("place", nargs="?", help="a folder or a file: list all of its offences")
    parser.add_argument(
        "--tighten", action="store_true", help="write the limits that have become smaller"
    )
    options = parser.parse_args()
    if options.place:
        inside = [path for path in sources() if path.is_relative_to(Path(options.place).resolve())]
        print("\n".join(listing(inside, RULES)))
        return 0

    counted = {**counts(sources()), **table_counts()}
    if options.tighten:
        FILE.write_text(as_text(tightened(counted, limits())), encoding="utf-8")
    excess = worse(counted, limits())
    print(complaint(excess) or "no folder is worse than its limits")
    return 1 if excess else 0


def _line(path: Path, rule: str, offence: Offence) -> str:
    return f"    {name_of(path)}:{offence.line}: {rule}: {offence.what}"


if __name__ == "__main__":
    raise SystemExit(main())
