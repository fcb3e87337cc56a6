"""Studies: many cases of one experiment in worker processes, resumed after an interruption, summed up and reported."""

from scenarios.study.harness import Study, Summary, Table
from scenarios.study.options import HarnessOptions, StudyOptions
from scenarios.study.row_table import Row, read_rows

__all__ = ["HarnessOptions", "Row", "Study", "StudyOptions", "Summary", "Table", "read_rows"]
