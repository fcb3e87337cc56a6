"""Scenarios: from a description to a run and its assessment.

    from scenarios import barrel, run, show

    r = run(barrel(seed=0))
    print(r.assessment.failed)
    show(r, "my_run")

Names are imported on first use, so that `scenarios.start` can look at the Python that runs it before anything else.
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
    from scenarios.assembly import Assembly, assemble
    from scenarios.command import show
    from scenarios.options import barrel
    from scenarios.perturbations.perturbation import Loop, Perturbation
    from scenarios.runner import Run, run, saved
    from scenarios.saving.saved_run import SavedRun
    from scenarios.scenario import Scenario
    from scenarios.scenario_file import read_scenario, write_scenario
    from sim.reporting.series_tables import PastRun

_HOME = {
    "Assembly": "scenarios.assembly",
    "Loop": "scenarios.perturbations.perturbation",
    "PastRun": "sim.reporting.series_tables",
    "Perturbation": "scenarios.perturbations.perturbation",
    "Run": "scenarios.runner",
    "SavedRun": "scenarios.saving.saved_run",
    "Scenario": "scenarios.scenario",
    "assemble": "scenarios.assembly",
    "barrel": "scenarios.options",
    "read_scenario": "scenarios.scenario_file",
    "run": "scenarios.runner",
    "saved": "scenarios.runner",
    "show": "scenarios.command",
    "write_scenario": "scenarios.scenario_file",
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
