"""Scenarios: from a description to a run and its assessment.

    from uuv import barrel, run, show

    r = run(barrel(seed=0))
    print(r.assessment.failed)
    show(r, "my_run")

Names are imported on first use, so that `uuv.start` can look at the Python that runs it before anything else.
"""

import os
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
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


@cache
def _check_rooms() -> None:
    """Refuses a module from elsewhere that has the name of one of the project's packages and hides it.

    Raises:
        ImportError: There is one; the message says what hides what.
    """
    here = Path(__file__).resolve().parents[1]  # of the installed packages; in the checkout `scripts`
    home = here if (here / "sim").is_dir() else here.parent
    for room in ("models", "sim", "perception", "controllers", "calib"):
        found = find_spec(room)
        origin = Path(found.origin or next(iter(found.submodule_search_locations or ()), "")) if found else Path()
        if not origin.resolve().is_relative_to(home / room):
            raise ImportError(f"{origin} hides the package {home / room}; rename it, or run from another folder")


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'scenarios' has no attribute {name!r}; it has {__all__}")
    _check_rooms()
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
