"""An underwater vehicle that works with its arm: from a description to a run and its assessment.

    from uuv import barrel, run, show

    r = run(barrel(seed=0))
    print(r.assessment.failed)
    show(r, "my_run")

Names are imported on first use, so that `uuv.start` can look at the Python that runs it before anything else.
"""

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

# All matrices are small: a second thread of BLAS saves no time and burns a core. Read when numpy is first imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

if TYPE_CHECKING:
    from uuv.assembly import Assembly, assemble
    from uuv.command import show
    from uuv.jobs import barrel
    from uuv.perturbations.perturbation import Loop, Perturbation
    from uuv.runner import Run, run, saved
    from uuv.saved_run import SavedRun
    from uuv.scenario import Scenario
    from uuv.scenario_file import read_scenario, write_scenario
    from uuv.sim.reporting.series_tables import PastRun

_HOME = {
    "Assembly": "uuv.assembly",
    "Loop": "uuv.perturbations.perturbation",
    "PastRun": "uuv.sim.reporting.series_tables",
    "Perturbation": "uuv.perturbations.perturbation",
    "Run": "uuv.runner",
    "SavedRun": "uuv.saved_run",
    "Scenario": "uuv.scenario",
    "assemble": "uuv.assembly",
    "barrel": "uuv.jobs",
    "read_scenario": "uuv.scenario_file",
    "run": "uuv.runner",
    "saved": "uuv.runner",
    "show": "uuv.command",
    "write_scenario": "uuv.scenario_file",
}
__all__ = [
    "Assembly",
    "Loop",
    "PastRun",
    "Perturbation",
    "Run",
    "SavedRun",
    "Scenario",
    "assemble",
    "barrel",
    "read_scenario",
    "run",
    "saved",
    "show",
    "write_scenario",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'uuv' has no attribute {name!r}; it has {__all__}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
