"""Time of a calibration fit of 63 touches, ours against pybotics with SciPy.

A UR10e touches as in [Yukhimets 2023]; residuals, prior and start are the same. pybotics requires
numpy below 2, so it runs in a Python of its own, in turns with ours; its imports are not timed:

    python3 -m venv /tmp/peers && /tmp/peers/bin/pip install pybotics scipy
    ./uvw run scripts/experiments/calibration/fit_speed.py --peer-python /tmp/peers/bin/python

figaroh is left out: it has no residual of coincidence (its data are measured poses or planes).
"""

from uuv.start import run_scenario  # isort: skip

import os
import subprocess
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from uuv.arm_identification.calibration_case import nominal
from uuv.arm_identification.simulated_touches import simulated
from uuv.calib import MapFit, identify
from uuv.calib.fit import Data, Problem, solve
from uuv.calib.parameters import prior_deviations, select
from uuv.calib.touches import first_tcp
from uuv.experiment import Page, column, experiment
from uuv.experiment.one_core import one_core
from uuv.experiment.options import at_least
from uuv.models.arms.serial_arm import SerialArm
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, exp_so3, pose

NOISE = 0.092e-3  # [m] standard deviation of a touch along each axis
ALONE = "ours, the same fit"
WITH_REPORT = "ours, with checks, intervals and rank report"
WHOLE = "ours, all found from the data"
PEER = "pybotics and SciPy, the same fit"
FREE = ("theta", "d", "a", "alpha", "tcp")
# Standard deviations of the prior: theta, alpha [rad], d, a, tcp [m].
PRIOR = {"theta": np.deg2rad(0.2), "alpha": np.deg2rad(0.2), "d": 0.5e-3, "a": 0.5e-3, "tcp": 0.1}


@dataclass(frozen=True, kw_only=True)
class FitSpeedCase:
    """All fits in turns."""

    rounds: int = 5
    """Number of rounds; medians count."""
    seed: int = 0
    """Seed of the touches."""
    peer_python: str = ""
    """Python with pybotics and scipy; default: no peer."""

    def __post_init__(self) -> None:
        at_least(self, rounds=1)
        if self.peer_python and not Path(self.peer_python).exists():
            raise ConfigurationError(f"--peer-python: there is no {self.peer_python}")


@dataclass(frozen=True, kw_only=True)
class FitSpeedRow:
    """Times and costs by fit."""

    median: Mapping[str, float] = column(
        "median", "ms", digits=1, factor=1e3, by="fit", tolerance=None
    )
    times_as_long: Mapping[str, float] = column("times as long", digits=1, by="fit", tolerance=None)
    cost: Mapping[str, float] = column("J", "mm²", digits=3, factor=1e6, by="fit")
    calls: int | None = column("calls of the peer's residuals")


@experiment("fit_speed", quick={"rounds": FitSpeedCase.rounds})
def fit_speed(case: FitSpeedCase) -> FitSpeedRow:
    """Times all fits."""
    source = nominal("ur10e", Path(), None, None)
    touched = simulated(
        source,
        points=3,
        touches=21,
        noise=NOISE,
        pin="off-axis",
        known=False,
        errors=0,
        rng=np.random.default_rng(case.seed),
    )
    series = [np.array(q) for q in touched.touches.series]
    tcp = first_tcp(source.arm, series)

    fits = fits_of(source.arm, series, tcp)
    for fit in fits.values():
        fit()  # compiles the kernels

    with one_core(), tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_task(folder / "task.npz", series, np.array(source.arm.table[:, :4]), tcp)

        calls = None
        seconds: dict[str, list[float]] = {}
        cost: dict[str, float] = {}
        for _ in range(case.rounds):
            for label, fit in fits.items():
                began = time.perf_counter()
                cost[label] = fit()
                seconds.setdefault(label, []).append(time.perf_counter() - began)
            if case.peer_python:
                answer = peer_fit(Path(case.peer_python), folder / "task.npz", folder)
                seconds.setdefault(PEER, []).append(answer["seconds"])
                cost[PEER] = answer["cost"]
                calls = int(answer["calls"])

    median = {label: float(np.median(times)) for label, times in seconds.items()}
    return FitSpeedRow(
        median=median,
        times_as_long={label: duration / median[ALONE] for label, duration in median.items()},
        cost=cost,
        calls=calls,
    )


def fits_of(arm: SerialArm, series: list[Array], tcp: Array) -> dict[str, Callable[[], float]]:
    """Our fits by name; each returns its cost [m^2].

    Args:
        arm: Nominal arm.
        series: Touches (m, n) [rad], one array for each point.
        tcp: (3,) [m] start of the tool point.
    """
    parameters = select(arm, FREE)
    starts = np.cumsum([0, *(len(q) for q in series[:-1])])
    rows = np.ascontiguousarray(np.vstack(series))
    mean = np.concatenate([arm.table.ravel(), tcp, np.zeros(arm.n)])
    deviations = prior_deviations(parameters, PRIOR)
    method = MapFit(noise=NOISE, robust=False)

    def alone() -> float:
        touches = Data(q=rows, starts=starts, weights=np.ones(len(rows)))
        problem = Problem(arm, touches, parameters, mean)
        return solve(problem, deviations, widest=None, noise=NOISE).cost

    def with_report() -> float:
        return identify(series, arm, free=FREE, prior=PRIOR, method=method, tcp=tcp).cost

    def whole() -> float:
        return identify(series, arm).cost

    return {ALONE: alone, WITH_REPORT: with_report, WHOLE: whole}


def craig(dh: Array) -> tuple[Array, Array]:
    """DH rows (n, 4) in Craig's convention (alpha, a, theta, d); the rest of the last standard row
    as a tool (4, 4).
    """
    theta, d, a, alpha = dh.T
    rows = np.column_stack([np.append(0.0, alpha[:-1]), np.append(0.0, a[:-1]), theta, d])
    return rows, pose(exp_so3([alpha[-1], 0.0, 0.0]), [a[-1], 0.0, 0.0])


def write_task(file: Path, series: list[Array], dh: Array, tcp: Array) -> None:
    """Writes the peer's input.

    Args:
        file: NPZ file.
        series: Touches (m, n) [rad], one array for each point.
        dh: (n, 4) standard rows: theta [rad], d [m], a [m], alpha [rad].
        tcp: (3,) [m] start of the tool point.
    """
    rows, rest = craig(dh)
    sigma = np.tile([PRIOR["alpha"], PRIOR["a"], PRIOR["theta"], PRIOR["d"]], (len(rows), 1))
    np.savez(
        file,
        q=np.vstack(series),
        starts=np.cumsum([0, *(len(q) for q in series[:-1])]),
        mdh=rows,
        tool=rest @ pose(p=tcp),
        sigma=np.append(sigma.ravel(), [PRIOR["tcp"]] * 3),
        noise=NOISE,
    )


def peer_fit(python: Path, task: Path, folder: Path) -> dict[str, float]:
    """Runs one fit by the peer.

    Args:
        python: Python with pybotics and scipy.
        task: Input of `write_task`.
        folder: Folder for the result.

    Returns:
        "seconds", "cost" [m^2] and "calls" of the residuals.

    Raises:
        ConfigurationError: The peer failed.
    """
    output = folder / "result.npz"
    script = Path(__file__).with_name("pybotics_peer.py")
    run = subprocess.run(
        [python, script, task, output],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
    )
    if run.returncode != 0:
        raise ConfigurationError(f"--peer-python {python}: {run.stderr.strip().splitlines()[-1]}")
    return {name: float(duration) for name, duration in np.load(output).items() if name != "scipy"}


fit_speed.page = (
    Page()
    .table(
        "63 touches, 27 parameters, in turns on one core",
        by="fit",
        columns=["median", "cost", "times_as_long"],
    )
    .add(
        lambda rows: [
            f"the peer called its residuals {row['calls']} times" for row in rows if row["calls"]
        ]
    )
)

if __name__ == "__main__":
    run_scenario(fit_speed.main)
