"""Studies: many cases of one experiment in worker processes, resumed after an interruption, summed
up and reported.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from uuv.experiment.harness import Study, Summary, Table
    from uuv.experiment.options import HarnessOptions, StudyOptions
    from uuv.experiment.row_table import Row, read_rows

__all__ = ["HarnessOptions", "Row", "Study", "StudyOptions", "Summary", "Table", "read_rows"]
_HOME = {  # imported when asked for: rows need pyarrow, which a single run does without
    "HarnessOptions": "options",
    "Row": "row_table",
    "Study": "harness",
    "StudyOptions": "options",
    "Summary": "harness",
    "Table": "harness",
    "read_rows": "row_table",
}


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}; it has {__all__}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
