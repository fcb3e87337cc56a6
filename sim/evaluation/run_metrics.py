"""Metrics of every run beside those of its kind of work: end, timings, and provenance."""

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
    """How a run went and ended; bit for bit the same for two runs of a command on one machine."""

    simulated_s: float | None = metric(minimum=0)
    seed: int = metric()
    state: str = metric(
        "In which the run ended: done, abort or another of the work's; interrupted, from outside; "
        "crashed, of a trial."
    )
    note: str = metric("Reason of an abort.")
    abort: str | None = metric(
        "The same as a code of uuv.sim.interfaces.messages.AbortCode; null without an abort."
    )
    collision_s: float | None = metric(
        "Time in which another part than the tool touched something.", minimum=0
    )
    trajectory_sha256: str | None = metric(
        "Of times and values of every series recorded at each step (Recording.digest).",
        pattern=SHA256,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Timings:
    """Computing times of one run: all that two runs of one command may differ in."""

    wall_s: float | None = metric("Of the loop.", minimum=0)
    real_time_factor: float | None = metric("Simulated time over it.", minimum=0)
    identification_s: float | None = metric("Of it, of the last identification.", minimum=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class StartMetrics:
    """Compiled kernels until the run was ready; `uuv.sim.interfaces.kernels.store` keeps them."""

    kernels_loaded: int = metric("By the process of the run, from the store.", minimum=0)
    kernels_compiled: int = metric("Anew, by it and by those of the first start.", minimum=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """What the figures were made by (`uuv.sim.runs.provenance`)."""

    scenario: str
    options: Mapping[str, Any] = metric(
        "As given, without those that change no figure, such as --out."
    )
    versions: Mapping[str, str]
    machine: str
    commit: str = metric("Of the project's git checkout; absent where there is none.", default="")
    dirty: bool = metric("The code there is not that of the commit.", default=False)
    model_sha256: str = metric(
        "Of the compiled MuJoCo model as it is saved by this version of MuJoCo.",
        default="",
        pattern=SHA256,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class EveryRun:
    """Entries of every metrics.json beside those of the kind of work."""

    format: int = metric(
        "Of the files in a run's folder; absent from those of the first.",
        default=FORMAT,
        minimum=1,
        maximum=FORMAT,
    )
    run: RunMetrics
    accepted: bool = metric("All of the scenario's bounds hold.")
    failed: list[str] = metric("Missed bounds, one line each.")
    timings: Timings = metric("Of this one time: all that two runs of one command may differ in.")
    energy: EnergyMetrics | None = metric(
        "Energy drawn by the thrusters; absent where their current was not measured.", default=None
    )
    provenance: Provenance = metric("Origin of the figures.", default=None)
    start: StartMetrics = metric(
        "What the command compiled before it; absent for a run from Python.", default=None
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
        description: What the file is.

    Returns:
        The schema.
    """
    about = f"{description}; SI units. Null where the run ended before the figure existed."
    return schema_of((kind, EveryRun), title, about)
