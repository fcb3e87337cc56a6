"""Scenarios: from a description to a run and its assessment.

    from scenarios import barrel, run, show

    r = run(barrel(seed=0))
    print(r.assessment.failed)
    show(r, "my_run")

Names are imported on first use, so that `scenarios.start` can look at the Python that runs it before anything else.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from scenarios.assembly import Assembly, assemble
    from scenarios.command import show
    from scenarios.options import barrel
    from scenarios.perturbations.perturbation import Perturbation
    from scenarios.runner import Run, run
    from scenarios.scenario import Scenario
    from scenarios.scenario_file import read_scenario, write_scenario

_HOME = {
    "Assembly": "scenarios.assembly",
    "Perturbation": "scenarios.perturbations.perturbation",
    "Run": "scenarios.runner",
    "Scenario": "scenarios.scenario",
    "assemble": "scenarios.assembly",
    "barrel": "scenarios.options",
    "read_scenario": "scenarios.scenario_file",
    "run": "scenarios.runner",
    "show": "scenarios.command",
    "write_scenario": "scenarios.scenario_file",
}
__all__ = [
    "Assembly",
    "Perturbation",
    "Run",
    "Scenario",
    "assemble",
    "barrel",
    "read_scenario",
    "run",
    "show",
    "write_scenario",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'scenarios' has no attribute {name!r}; it has {__all__}")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
