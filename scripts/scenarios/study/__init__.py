"""Studies: many cases of one experiment in worker processes, resumed after an interruption, summed up and reported."""

from scenarios.study.harness import Study
from scenarios.study.options import StudyOptions
from scenarios.study.summary import Row, Summary, Table

__all__ = ["Row", "Study", "StudyOptions", "Summary", "Table"]
