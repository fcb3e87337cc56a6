"""Trajectories that a change of structure must leave bit for bit: open loop of three models, and
the loop closed.

Each has a digest of all its numbers and a few samples. The digest holds on the platform that wrote
it (system, processor, MuJoCo, numpy, numba). Elsewhere the samples of the open loop hold to a
tolerance; those of the closed loop do not, for a rounding error grows there until the hull takes
another of two equal places: what differs is said.
"""

import hashlib
import json
import os
import platform
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import llvmlite.binding
import mujoco
import numba
import numpy as np
import pytest

from cases import barrel_longitudinal_run
from uuv import models
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.spatial import Array

FILE = Path(__file__).with_name("traces.json")
# environment variable that leaves trajectories out, e.g. to see what else tells a change
OFF = "UUV_NO_DIGEST"
SECONDS = 3.0  # of the open loop
SAMPLES = 8
OPEN_TOLERANCE = 1e-11  # [m, rad, m/s, rad/s] MuJoCo 3.17.0 and 4.0.0 differ by 1e-13


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trace:
    """Digest of a trajectory, and rows of it evenly spaced in time."""

    digest: str
    samples: Array  # (SAMPLES, k)
    tolerance: float | None  # of the samples on any platform; None: they hold where the bits do

    @classmethod
    def of(cls, table: Array, tolerance: float | None) -> "Trace":
        """Trace of `table` (N, k), one row a step."""
        rows = np.linspace(0, len(table) - 1, SAMPLES + 1).astype(int)[1:]
        return cls(
            digest=hashlib.sha256(table.tobytes()).hexdigest(),
            samples=table[rows],
            tolerance=tolerance,
        )

    def difference(self, held: "Trace") -> str:
        """How this one differs from the one `held`; empty if it is the same bit for bit."""
        if self.digest == held.digest:
            return ""
        if self.samples.shape != held.samples.shape:
            return f"samples of shape {self.samples.shape}, held {held.samples.shape}"
        return f"other bits; the samples are {self.off(held):.2g} off at most"

    def off(self, held: "Trace") -> float:
        """Largest difference of the samples, which are of one shape."""
        return float(np.abs(self.samples - held.samples).max())


def here() -> dict[str, str]:
    """What bits depend on. Hosts of one processor name can offer different instructions, by which
    libraries choose.
    """
    offered = sorted(
        name for name, present in llvmlite.binding.get_host_cpu_features().items() if present
    )
    return {
        "system": f"{platform.system()} {platform.machine()}",
        "processor": llvmlite.binding.get_host_cpu_name(),
        "instructions": hashlib.sha256(",".join(offered).encode()).hexdigest()[:12],
        # of whose byte code numba makes machine code
        "python": ".".join(platform.python_version_tuple()[:2]),
        "mujoco": mujoco.__version__,
        "numpy": np.__version__,
        "numba": numba.__version__,
    }


def open_loop(name: str) -> Trace:
    """Position and velocity of a named model whose actuators swing, each at its own pace, in a
    current.
    """
    hydrodynamics.install()
    model = hydrodynamics.compile(models.load(name))
    model.opt.wind[:] = (0.2, -0.1, 0.05)
    data = mujoco.MjData(model)
    largest = np.where(
        model.actuator_ctrllimited > 0, np.abs(model.actuator_ctrlrange).max(axis=1), 10.0
    )
    pace = 0.5 + 0.3 * np.arange(model.nu)  # [Hz]
    steps = round(SECONDS / model.opt.timestep)
    table = np.empty((steps, model.nq + model.nv))
    for k in range(steps):
        data.ctrl[:] = 0.1 * largest * np.sin(2.0 * np.pi * pace * data.time)
        if not model.nu:
            data.qfrc_applied[:6] = 20.0 * np.sin(2.0 * np.pi * 0.5 * data.time)
        mujoco.mj_step(model, data)
        table[k, : model.nq], table[k, model.nq :] = data.qpos, data.qvel
    return Trace.of(table, OPEN_TOLERANCE)


def closed_loop() -> Trace:
    """Hull and tool in a whole run of the main job."""
    recording = barrel_longitudinal_run(0).recording
    names = ("p_WB", "quat_WB_wxyz", "p_pad")
    table = np.hstack([recording[name].value for name in names])
    return Trace.of(table, None)


OPEN = ("uuv_puma", "bluerov2_heavy_alpha5", "phoenix_smart3s")
CLOSED = "main_job"
TRACES: Mapping[str, Callable[[], Trace]] = {
    **{name: partial(open_loop, name) for name in OPEN},
    CLOSED: closed_loop,
}


def read() -> tuple[dict[str, Trace], bool]:
    """The traces held, and whether bits must agree here."""
    held = json.loads(FILE.read_text(encoding="utf-8"))
    traces = {
        name: Trace(
            digest=row["digest"], samples=np.array(row["samples"]), tolerance=row["tolerance"]
        )
        for name, row in held["traces"].items()
    }
    return traces, held["written_on"] == here()


def rewrite(*, reason: str, date: str) -> Iterator[str]:
    """Write all traces; what differed, a line each."""
    held = read()[0] if FILE.exists() else {}
    rows = {}
    for name, trace_of in TRACES.items():
        trace = trace_of()
        if name not in held:
            yield f"trace {name}: new"
        elif difference := trace.difference(held[name]):
            yield f"trace {name}: {difference}"
        samples = [[float(v) for v in row] for row in trace.samples]
        rows[name] = {"digest": trace.digest, "tolerance": trace.tolerance, "samples": samples}
    text = json.dumps(
        {"date": date, "reason": reason, "written_on": here(), "traces": rows}, indent=1
    )
    FILE.write_text(text + "\n", encoding="utf-8")


def check(name: str) -> None:
    """Fail with a sentence where the trajectory is not that held; skip with one where it need not
    be, or OFF is set.
    """
    if os.environ.get(OFF):
        pytest.skip(f"{OFF} is set")
    held, bits = read()
    trace = TRACES[name]()
    stored = held[name]
    difference = trace.difference(stored)
    if not bits:
        if stored.tolerance is None:
            pytest.skip(
                f"{name}, on another platform than it was written on: "
                f"{difference or 'the same bits'}"
            )
        if trace.samples.shape == stored.samples.shape and trace.off(stored) <= stored.tolerance:
            return
    assert not difference, (
        f"{name}: {difference}; if this is meant: ./uvw run tests/baseline/record.py "
        "--only traces --reason ..."
    )
