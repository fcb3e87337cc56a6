"""Check of kept rows: the quick subset of an experiment is run again and compared by column."""

import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import replace
from math import isclose
from pathlib import Path
from typing import Any

from uuv.experiment.declaration import Experiment
from uuv.experiment.row_log import about_of, without_log
from uuv.experiment.row_table import Row, read_rows
from uuv.results.kept_rows import KeptRows, checked, file_of, words_of
from uuv.sim.interfaces.errors import ConfigurationError

_TAIL = 300  # number of characters kept of the output of a command that failed


def check(
    experiment: Experiment[Any, Any],
    reference: KeptRows,
    data: Path | None = None,
    workers: int = 0,
) -> KeptRows:
    """Kept rows with a check made now.

    Args:
        experiment: The experiment.
        reference: Kept rows of the experiment.
        data: Folder of measured data, for an experiment that needs it.
        workers: Number of processes, as for every experiment.

    Raises:
        ConfigurationError: The experiment has no quick subset, or its command failed.
    """
    options = dict(experiment.quick)
    if not options:
        raise ConfigurationError(
            f"experiment {experiment.name}: must declare a quick subset (`quick`) to be checked"
        )
    if data is not None and experiment.needs_data:
        options["data"] = data

    with tempfile.TemporaryDirectory(prefix="uuv_check_") as home:
        folder = Path(home) / experiment.name
        words = words_of(experiment.options_with(options))
        command = [sys.executable, str(file_of(experiment)), *words, "--workers", str(workers)]
        run = subprocess.run(
            [*command, "--out", str(folder)], capture_output=True, text=True, check=False
        )
        # exit code 1: done, but out of bounds, which the quick subset need not keep
        if run.returncode not in (0, 1) or not folder.is_dir():
            text = " ".join((run.stderr or run.stdout).split())[-_TAIL:]
            raise ConfigurationError(
                f"experiment {experiment.name}: its quick subset failed: {text}"
            )
        rows = [without_log(row) for row in read_rows(folder)]
        code = about_of(folder).code

    return replace(reference, check=checked(code, list(deviations(experiment, reference, rows))))


def deviations(
    experiment: Experiment[Any, Any], reference: KeptRows, rows: list[Row]
) -> Iterator[str]:
    """Differences between rows and the kept rows of the same cases, with a line for each value.

    Args:
        experiment: The experiment.
        reference: Kept rows of the experiment.
        rows: New rows of some of its cases.
    """
    lacking = [name for name in experiment.columns if name not in reference.columns]
    if lacking:
        yield f"the kept rows have no column {', '.join(lacking)}"
        return

    known = {experiment.row_key(row): row for row in reference.rows}
    for row in rows:
        key = experiment.row_key(row)
        case = ", ".join(f"{name} {row[name]}" for name in experiment.case_names)
        if key not in known:
            yield f"no kept row of {case}"
            continue
        for name, column in experiment.columns.items():
            if column.tolerance is not None and not same(
                known[key][name], row[name], column.tolerance
            ):
                before = column.cell(known[key][name])
                yield f"{column.heading} of {case}: {column.cell(row[name])}, kept was {before}"


def same(reference: Any, value: Any, tolerance: float) -> bool:
    """Whether two values of rows are equal, numbers within a relative tolerance."""
    if isinstance(reference, Mapping) and isinstance(value, Mapping):
        return reference.keys() == value.keys() and all(
            same(reference[key], value[key], tolerance) for key in reference
        )
    if isinstance(reference, list) and isinstance(value, list):
        return len(reference) == len(value) and all(
            same(a, b, tolerance) for a, b in zip(reference, value, strict=True)
        )

    if isinstance(reference, bool) or isinstance(value, bool):
        return reference is value
    if isinstance(reference, int | float) and isinstance(value, int | float):
        return isclose(reference, value, rel_tol=tolerance)
    return reference == value
