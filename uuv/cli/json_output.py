"""JSON output of the verbs: one document on stdout, and nothing else."""

import contextlib
import io
import json
import math
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from uuv.sim.interfaces.documents import json_of
from uuv.sim.runs.run_folder import claimed_folder


def print_json(document: Any) -> None:
    """Prints a document; numbers that are not finite, which JSON lacks, are printed as text."""
    json.dump(_plain(document), sys.stdout, indent=2, allow_nan=False)
    print()


def folder_of(work: Callable[[], int]) -> tuple[int, Path]:
    """Exit code of `work`, which prints nothing, and the folder that it wrote its results to.

    Raises:
        UuvError: As `work` does.
    """
    with contextlib.redirect_stdout(io.StringIO()):
        code = work()
    return code, claimed_folder()


def file_alone(work: Callable[[], int], name: str) -> int:
    """Carries out `work` silently, prints the file `name` of its folder; returns the exit code.

    Raises:
        UuvError: As `work` does.
    """
    code, folder = folder_of(work)
    print_json(json_of(folder / name, "result"))
    return code


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(entry) for entry in value]

    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value if value is None or isinstance(value, bool | int | float | str) else str(value)
