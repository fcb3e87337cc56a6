"""Rows of an operator's inputs, written shortly: seconds, and what is not zero meanwhile."""

from collections.abc import Iterable, Mapping

from uuv.controllers.driving.operator_inputs import COLUMNS

Steps = Iterable[tuple[float, Mapping[str, float]]]


def rows_of(steps: Steps, begin: float = 0.5) -> list[list[float]]:
    """Rows in the order of COLUMNS, the clutch closed unless stated; the last one ends them.

    Args:
        steps: duration [s] of each, and values by column.
        begin: [s] time of the first.
    """
    rows = []
    time = begin
    for seconds, values in steps:
        rows.append([{"clutch": 1.0, "time": time, **values}.get(name, 0.0) for name in COLUMNS])
        time += seconds
    rows.append([{"time": time}.get(name, 0.0) for name in COLUMNS])
    return rows


def text_of(rows: Iterable[Iterable[float]], head: Iterable[str] = tuple(COLUMNS)) -> str:
    """Content of an inputs file."""
    lines = [",".join(str(number) for number in row) for row in rows]
    return "\n".join([",".join(head), *lines, ""])
