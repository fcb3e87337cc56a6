"""Speed of a batch of simulations on one and two threads, by wall-clock time.

The vehicle is that of physics.py: a hull with an arm of six joints in water. The best of many
rounds counts; the machine must be idle.
"""

from uuv.start import run_scenario  # isort: skip

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import mujoco.batch
import numpy as np

from experiments.runtime.physics import JOINTS, vehicle, with_water
from uuv.experiment import Page, column, experiment, stat
from uuv.experiment.options import at_least

THREADS = (1, 2)
LEAST_GAIN = 1.8  # goal of two threads over one


@dataclass(frozen=True, kw_only=True)
class BatchCase:
    """One batch."""

    sims: int = 64
    """Number of simulations of the batch."""
    steps: int = 250
    """Steps of a round."""
    rounds: int = 15
    """Number of rounds; the fastest counts."""

    def __post_init__(self) -> None:
        at_least(self, sims=1, steps=1, rounds=1)


@dataclass(frozen=True, kw_only=True)
class BatchRow:
    """Times by number of threads, and memory of a simulation."""

    step: Mapping[str, float] = column(
        "a step", "µs", digits=2, factor=1e6, by="threads", tolerance=None
    )
    processor: Mapping[str, float] = column(
        "its processor time", "µs", digits=2, factor=1e6, by="threads", tolerance=None
    )
    identical: bool = column("bit for bit the same on all threads")
    state: int = column("state row", "KiB", digits=1, factor=1.0 / 1024)
    persistent: float | None = column(
        "persistent one, its MjData in use", "KiB", digits=0, factor=1.0 / 1024, tolerance=None
    )
    reserved: int = column("reserved by one MjData", "KiB", digits=0, factor=1.0 / 1024)


@experiment("batch_speed", quick={"rounds": BatchCase.rounds})
def batch_speed(case: BatchCase) -> BatchRow:
    """Steps one batch, the numbers of threads in turns."""
    model = with_water(vehicle(JOINTS, "implicitfast"))
    starts = 0.1 * np.random.default_rng(0).normal(size=(case.sims, model.nv))
    batches = {n: mujoco.batch.Batch(model, nsim=case.sims, nthread=n) for n in THREADS}

    wall = {str(n): np.inf for n in THREADS}
    busy = dict(wall)
    ends = []
    for _ in range(case.rounds):
        ends = []
        for threads, batch in batches.items():
            batch.reset()
            qpos = batch.bind("qpos")
            qvel = batch.bind("qvel")
            qvel[:] = starts
            begin = time.perf_counter()
            used = time.process_time()
            batch.step(nstep=case.steps)
            taken = time.perf_counter() - begin
            used = time.process_time() - used
            count = case.steps * case.sims
            wall[str(threads)] = min(wall[str(threads)], taken / count)
            busy[str(threads)] = min(busy[str(threads)], used / count)
            ends.append(np.hstack([qpos, qvel]))

    # memory of simulations that keep their MjData
    before = resident()
    keeping = mujoco.batch.Batch(model, nsim=case.sims, nthread=1, persistent=True)
    keeping.step(nstep=2)
    held = (resident() - before) / case.sims

    return BatchRow(
        step=wall,
        processor=busy,
        identical=all(np.array_equal(end, ends[0]) for end in ends),
        state=8 * batches[1].nstate,
        persistent=held or None,
        reserved=mujoco.MjData(model).nbuffer + model.narena,
    )


def resident() -> int:
    """Resident memory of this process [bytes]; 0 where the system does not report it."""
    statm = Path("/proc/self/statm")
    return int(statm.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") if statm.exists() else 0


batch_speed.page = (
    Page()
    .table(
        "A batch, 12 degrees of freedom each",
        by=("sims", "threads"),
        columns=[
            stat("value", lambda row: 1.0 / row["step"], "steps per s", digits=0),
            "step",
            "processor",
        ],
    )
    .table(
        "Memory of a simulation",
        by="sims",
        columns=["identical", "state", "persistent", "reserved"],
    )
    .accept(stat("share", "identical"), least=1.0)
    .accept(
        stat("least", lambda row: row["step"]["1"] / row["step"]["2"], "2 threads over 1"),
        least=LEAST_GAIN,
    )
)

if __name__ == "__main__":
    run_scenario(batch_speed.main)
