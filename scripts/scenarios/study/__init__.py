"""Studies: many cases of one experiment in worker processes, resumed after an interruption, summed up and reported."""

from scenarios.study.harness import Row, Study, Summary, Table
from scenarios.study.options import StudyOptions

__all__ = ["Row", "Study", "StudyOptions", "Summary", "Table"]
