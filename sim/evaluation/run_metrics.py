"""Metrics of every run, besides those of its kind of work: end, timings, and provenance."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from uuv.sim.evaluation.energy_metrics import EnergyMetrics
from uuv.sim.evaluation.schemas import metric, schema_of
from uuv.sim.runs.run_folder import FORMAT

SHA256 = "^[0-9a-f]{64}$"
# entries of a file that are left out, not null
OPTIONAL = ("energy", "provenance", "start", "unchecked")


@dataclass(frozen=True, slots=True, kw_only=True)
class RunMetrics:
    """How a run went and ended. Two runs of one command on one machine agree in every bit."""

    simulated_s: float | None = metric(minimum=0)
    seed: int = metric()
    state: str = metric(
        "State in which the run ended: done, abort or another state of the work; interrupted if "
        "ended from outside; crashed for a trial that failed with an error."
    )
    note: str = metric("Reason of an abort.")
    abort: str | None = metric(
        "Name of the abort code (uuv.sim.interfaces.messages.AbortCode); null without an abort."
    )
    collision_s: float | None = metric(
        "Time in which a part other than the tool was in contact.", minimum=0
    )
    trajectory_sha256: str | None = metric(
        "Hash of the times and values of every series that is recorded at each step "
        "(Recording.digest).",
        pattern=SHA256,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Timings:
    """Computing times of one run, the only values in which two runs of one command may differ."""

    wall_s: float | None = metric("Wall time of the loop.", minimum=0)
    real_time_factor: float | None = metric(
        "Simulated time over the wall time of the loop.", minimum=0
    )
    identification_s: float | None = metric(
        "Wall time of the last identification, which is part of the loop's.", minimum=0
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class StartMetrics:
    """Numbers of kernels loaded and compiled until the run began
    (`uuv.sim.interfaces.kernels.store`).
    """

    kernels_loaded: int = metric(
        "Kernels that the process of the run loaded from the store.", minimum=0
    )
    kernels_compiled: int = metric(
        "Kernels that were compiled by this process and by the processes of the first start.",
        minimum=0,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """Origin of the figures: scenario, options, versions and code (`uuv.sim.runs.provenance`)."""

    scenario: str
    options: Mapping[str, Any] = metric(
        "Options as given, without those that change no figure, such as --out."
    )
    versions: Mapping[str, str]
    machine: str
    commit: str = metric(
        "Commit of the project's git checkout; absent if there is none.", default=""
    )
    dirty: bool = metric("True if the code in the checkout differs from the commit.", default=False)
    model_sha256: str = metric(
        "Hash of the compiled MuJoCo model as this version of MuJoCo saves it.",
        default="",
        pattern=SHA256,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class EveryRun:
    """Entries of every metrics.json, besides those of the kind of work."""

    format: int = metric(
        "Format number of the files in a run's folder; absent in files of the first format.",
        default=FORMAT,
        minimum=1,
        maximum=FORMAT,
    )
    run: RunMetrics
    accepted: bool = metric("True if all of the scenario's bounds hold.")
    failed: list[str] = metric("Missed bounds, one line each.")
    timings: Timings = metric(
        "Computing times of this run, the only values in which two runs of one command may differ."
    )
    energy: EnergyMetrics | None = metric(
        "Energy drawn by the thrusters; absent if their current was not measured.", default=None
    )
    provenance: Provenance = metric("Origin of the figures.", default=None)
    start: StartMetrics = metric(
        "Kernels loaded and compiled before the run; absent for a run started from Python.",
        default=None,
    )
    unchecked: list[str] = metric(
        "Why the check of the vehicle would have refused the run; absent of a checked run.",
        default=None,
    )


def run_schema(kind: type, title: str, description: str) -> dict[str, Any]:
    """JSON Schema of a run's metrics.json.

    Args:
        kind: Dataclass of the metrics of its kind of work.
        title: Title of the schema.
        description: Description of the file.

    Returns:
        The schema.
    """
    about = f"{description}; SI units. Null where the run ended before the figure existed."
    return schema_of((kind, EveryRun), title, about)
