"""Vehicles beside the default one in all jobs: what `uuv check` promises, and what they keep.

A promise is the share of drawn poses at which a job can begin and be carried through. The runs have
other poses, which the check has not seen. A job that the check refuses is run all the same, to see
whether the refusal was right. Hovering is simulated by the check itself.

    ./uvw run scripts/experiments/vehicles/vehicles.py --vehicles girona500_arm4 my.urdf:pad:20
"""

from uuv.start import run_scenario  # isort: skip

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from math import nan
from pathlib import Path

import numpy as np

from uuv.check.check import check_vehicle
from uuv.check.checked_jobs import HOVERING, JOBS
from uuv.check.conditions import Conditions
from uuv.check.findings import JobVerdict
from uuv.check.jobs import ArmJobs
from uuv.experiment import Page, column, experiment, stat
from uuv.experiment.columns import metric_at
from uuv.experiment.options import at_least
from uuv.runner import Run, run
from uuv.sim.interfaces.errors import ConfigurationError, UuvError
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.spatial import finite_number, one_of

# Vehicle: tool, set forces [N]; None: its own tool, the jobs' own forces.
VEHICLES: dict[str, tuple[str | None, tuple[float, ...]]] = {
    "bluerov2_heavy_alpha5": ("small_pad", (8.0,)),
    "bluerov2_alpha5": ("small_pad", (4.0,)),
    "girona500_arm4": ("pad", (20.0,)),
    "phoenix_smart3s": ("pad", ()),
    "rexrov2_arm7": (None, ()),
    "rexrov_oberon7": (None, ()),
    "uuv_puma_two_sway": (None, ()),
}
FIRST_SEED = 1000  # of the runs; the check draws its poses from seeds below


_ARM_JOBS = tuple(job for job in JOBS if job not in HOVERING)


@dataclass(frozen=True, kw_only=True)
class VehicleJobs:
    """Which vehicles and jobs."""

    vehicles: tuple[str, ...] = tuple(VEHICLES)
    """Names that the experiment knows, or FILE:TOOL:FORCE with the set force [N] last."""
    jobs: tuple[str, ...] = _ARM_JOBS
    """Jobs of the arm; those of the hull alone are always checked."""
    seeds: int = 5
    """Runs of each job, at poses that the check has not drawn."""

    def __post_init__(self) -> None:
        at_least(self, seeds=1)
        for vehicle in self.vehicles:
            _setup(vehicle)
        for job in self.jobs:
            one_of(job, _ARM_JOBS, "--jobs")


@dataclass(frozen=True, kw_only=True)
class VehicleJobCase:
    """One run of one job."""

    vehicle: str
    job: str
    seed: int


@dataclass(frozen=True, kw_only=True)
class VehicleJobRow:
    """What the check says, and what the run gives."""

    promised: bool | None = column("promised")  # None: the process died
    share: float = column("share of poses", digits=2, default=0.0)  # that the check promises
    code: str = column("refused for", default="")
    accepted: bool = column("kept", default=False)
    reason: str = column("figures, or why not", default="")
    force_error: float | None = column("force error, RMS", "N", digits=2, default=None)
    path_deviation: float | None = column("path", "mm", digits=1, factor=1e3, default=None)
    tilt: float | None = column("tilt", "rad", digits=3, default=None)
    felt_error: float | None = column("felt force, RMS error", "N", digits=2, default=None)
    felt_sigma: float | None = column("its stated sigma", "N", digits=2, default=None)


def cases(jobs: VehicleJobs) -> Iterator[VehicleJobCase]:
    """Hovering once, each job of the arm with each seed."""
    for vehicle in jobs.vehicles:
        for job in HOVERING:
            yield VehicleJobCase(vehicle=vehicle, job=job, seed=0)
        for job in jobs.jobs:
            for seed in range(jobs.seeds):
                yield VehicleJobCase(vehicle=vehicle, job=job, seed=FIRST_SEED + seed)


def _setup(vehicle: str) -> tuple[str, str | None, tuple[float, ...]]:
    """Name or file of a vehicle, its tool and set forces [N], from an entry of `--vehicles`.

    Raises:
        ConfigurationError: the entry is neither a known name nor a file with tool and force.
    """
    file, first, rest = vehicle.partition(":")
    tool, second, force = rest.partition(":")
    if not first:
        return one_of(vehicle, tuple(VEHICLES), "--vehicles"), *VEHICLES[vehicle]

    if not Path(file).is_file() or not tool or not second:
        raise ConfigurationError(
            "--vehicles: must be a name or an existing FILE:TOOL:FORCE, as in my.urdf:pad:20, got "
            f"{vehicle!r}"
        )
    try:
        push = float(force)
    except ValueError:
        push = nan
    return file, tool, (finite_number(push, f"--vehicles {vehicle}: force [N]", above=0.0),)


def died(case: VehicleJobCase, error: str) -> VehicleJobRow:
    """Row of a run whose process died."""
    del case
    return VehicleJobRow(promised=None, reason=error)


@experiment(
    "vehicles",
    cases=cases,
    failed=died,
    quick={"vehicles": ("rexrov2_arm7",), "jobs": ("tap",), "seeds": 1},
)
def vehicles(case: VehicleJobCase) -> VehicleJobRow:
    """Checks a job and runs it."""
    verdict = _verdict(case.vehicle, case.job)

    # A verdict that no pose decides is yes or no.
    share = float(verdict.promised) if verdict.share is None else verdict.share
    row = VehicleJobRow(promised=verdict.promised, share=share, code=verdict.code)
    if case.job in HOVERING:
        return replace(row, accepted=verdict.promised, reason=verdict.said)

    name, tool, forces = _setup(case.vehicle)
    jobs = ArmJobs(name, tool=tool, conditions=Conditions(forces=forces))
    try:
        done = run(replace(jobs.scenario(case.job), seed=case.seed))
    except UuvError as error:
        return replace(row, reason=str(error))

    metrics = done.assessment.metrics
    return replace(
        row,
        accepted=done.assessment.accepted,
        reason="; ".join(done.assessment.failed)[:300],
        force_error=metric_at(metrics, "contact.force_error_rms_n"),
        path_deviation=metric_at(metrics, "tool.path_deviation_max_m"),
        tilt=metric_at(metrics, "hull.tilt_max_rad"),
        felt_error=metric_at(metrics, "force_estimate.normal_error_rms_n"),
        felt_sigma=_stated_sigma(done),
    )


@lru_cache(maxsize=8)
def _verdict(vehicle: str, job: str) -> JobVerdict:
    """What the check says of a job; made once in a process."""
    name, tool, forces = _setup(vehicle)
    check = check_vehicle(name, tool=tool, jobs=(job,), conditions=Conditions(forces=forces))
    return next(verdict for verdict in check.jobs if verdict.job == job)


def _stated_sigma(done: Run) -> float | None:
    """Standard deviation [N] of the normal force that the controller stated, mean over the work;
    None without work.
    """
    name = "believed.f_tip_sigma_G"
    if name not in done.recording:
        return None

    events = [(event.time, event.state) for event in done.recording.events]
    work = [
        (begin, end) for (begin, state), (end, _) in pairwise(events) if state is WorkState.WORK
    ]
    series = done.recording[name]
    inside = [k for k, t in enumerate(series.time) if any(begin <= t < end for begin, end in work)]
    return float(np.nanmean(series.value[inside, 2])) if inside else None


vehicles.page = (
    Page()
    .table(
        "Vehicles in all jobs: largest of the runs",
        by=("vehicle", "job", "promised", "code"),
        columns=[
            stat("count", "accepted", "runs kept"),
            stat("count", lambda row: row["seed"] is not None, "of"),
            stat("largest", "force_error", "force error, RMS"),
            stat("largest", "path_deviation", "path"),
            stat("largest", "tilt", "tilt"),
            stat("largest", "felt_error", "felt force, RMS error"),
            stat("largest", "felt_sigma", "its stated sigma"),
        ],
        where=lambda row: row["job"] not in HOVERING,
    )
    .table(
        "Promises against runs",
        columns=[
            stat("count", lambda row: row["promised"] is not None, "runs"),
            stat(
                "share",
                lambda row: row["accepted"] if row["promised"] else None,
                "kept, of those promised",
            ),
            stat(
                "share",
                lambda row: row["accepted"] if row["promised"] is False else None,
                "kept, of those refused",
            ),
            stat("mean", lambda row: (row["share"] - row["accepted"]) ** 2, "Brier score"),
        ],
        where=lambda row: row["job"] not in HOVERING,
    )
    .table(
        "Hover",
        by=("vehicle", "job"),
        columns=["accepted", "reason"],
        where=lambda row: row["job"] in HOVERING,
    )
    .accept(
        stat(
            "share",
            lambda row: row["accepted"] if row["promised"] else None,
            "kept, of those promised",
        ),
        least=0.92,
        where=lambda row: row["job"] not in HOVERING,
    )
    .accept(
        stat(
            "share",
            lambda row: row["accepted"] if row["promised"] is False else None,
            "kept, of those refused",
        ),
        most=0.15,
        where=lambda row: row["job"] not in HOVERING,
    )
)
vehicles.line = lambda row: (
    f"{row['vehicle']} {row['job']} {row['seed']}: {'kept' if row['accepted'] else row['reason']}"[
        :160
    ]
)

if __name__ == "__main__":
    run_scenario(vehicles.main)
