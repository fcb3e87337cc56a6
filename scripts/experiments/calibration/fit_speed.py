"""Benchmark: time of a calibration fit of 63 touches, ours against pybotics with SciPy.

Residuals, prior and start are the same.

    # ours alone
    ./uvw run scripts/experiments/calibration/fit_speed.py

    # with the peer
    python3 -m venv /tmp/peers && /tmp/peers/bin/pip install pybotics scipy
    ./uvw run scripts/experiments/calibration/fit_speed.py --peer-python /tmp/peers/bin/python

pybotics requires numpy below 2, so it runs in a Python of its own, alternating with ours; its
imports are not timed. figaroh is left out: it has no residual of coincidence (its data are measured
poses or planes).
"""

from uuv.start import parse, run_scenario  # isort: skip

import os
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from uuv.arm_identification.calibration_case import nominal
from uuv.arm_identification.simulated_touches import simulated
from uuv.calib import MapFit, identify
from uuv.calib.fit import Data, Problem, solve
from uuv.calib.parameters import prior_deviations, select
from uuv.calib.touches import first_tcp
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, exp_so3, pose

NOISE = 0.092e-3  # [m] standard deviation of a touch along each axis
SAME = "ours, the same fit"
# Standard deviations of the prior: theta, alpha [rad], d, a, tcp [m].
PRIOR = {"theta": np.deg2rad(0.2), "alpha": np.deg2rad(0.2), "d": 0.5e-3, "a": 0.5e-3, "tcp": 0.1}


@dataclass
class Options:
    """Time of a fit of 63 touches of a UR10e, as in [Yukhimets 2023]."""

    rounds: int = 5  # repetitions, alternating between the fits; medians count
    seed: int = 0
    peer_python: Path | None = None  # Python with pybotics and scipy; none: no peer


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
    result = folder / "result.npz"
    script = Path(__file__).with_name("pybotics_peer.py")
    run = subprocess.run(
        [python, script, task, result], capture_output=True, text=True, check=False
    )
    if run.returncode != 0:
        raise ConfigurationError(f"--peer-python {python}: {run.stderr.strip().splitlines()[-1]}")
    return {name: float(value) for name, value in np.load(result).items() if name != "scipy"}


def main() -> int:
    """Runs the benchmark, prints its table and returns the exit code."""
    options = parse(Options)
    os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")
    if hasattr(os, "sched_setaffinity"):
        # one core, whatever the libraries would use
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    if options.peer_python is not None and not options.peer_python.exists():
        raise ConfigurationError(f"--peer-python: there is no {options.peer_python}")
    rng = np.random.default_rng(options.seed)
    source = nominal("ur10e", Path(), None, None)
    case = simulated(
        source, points=3, touches=21, noise=NOISE, pin="off-axis", known=False, errors=0, rng=rng
    )
    series = [np.array(q) for q in case.touches.series]
    tcp = first_tcp(source.arm, series)

    def same() -> float:
        return identify(
            series,
            source.arm,
            free=("theta", "d", "a", "alpha", "tcp"),
            prior=PRIOR,
            method=MapFit(noise=NOISE, robust=False),
            tcp=tcp,
        ).cost

    def all_of_it() -> float:
        return identify(series, source.arm).cost

    parameters = select(source.arm, ("theta", "d", "a", "alpha", "tcp"))
    starts = np.cumsum([0, *(len(q) for q in series[:-1])])
    rows = np.ascontiguousarray(np.vstack(series))
    mean = np.concatenate([source.arm.table.ravel(), tcp, np.zeros(source.arm.n)])
    deviations = prior_deviations(parameters, PRIOR)

    def alone() -> float:
        data = Data(q=rows, starts=starts, weights=np.ones(len(rows)))
        return solve(
            Problem(source.arm, data, parameters, mean), deviations, widest=None, noise=NOISE
        ).cost

    ways = {
        SAME: alone,
        "ours, with checks, intervals and rank report": same,
        "ours, all found from the data": all_of_it,
    }
    seconds: dict[str, list[float]] = {name: [] for name in ways}
    cost: dict[str, float] = {}
    calls = 0
    for way in ways.values():
        way()  # compiles the kernels
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_task(folder / "task.npz", series, np.array(source.arm.table[:, :4]), tcp)
        for _ in range(options.rounds):
            for label, way in ways.items():
                began = time.perf_counter()
                cost[label] = way()
                seconds[label].append(time.perf_counter() - began)
            if options.peer_python is not None:
                answer = peer_fit(options.peer_python, folder / "task.npz", folder)
                label = "pybotics and SciPy, the same fit"
                seconds.setdefault(label, []).append(answer["seconds"])
                cost[label], calls = answer["cost"], int(answer["calls"])
    table = Table(
        title=f"63 touches, 27 parameters, {options.rounds} rounds in turns, one core",
        title_justify="left",
    )
    table.add_column("")
    for column in ("median [ms]", "J [mm²]", "times as long"):
        table.add_column(column, justify="right")
    shortest = float(np.median(seconds[SAME]))
    for label, times in seconds.items():
        median = float(np.median(times))
        table.add_row(
            label, f"{1e3 * median:.1f}", f"{1e6 * cost[label]:.3f}", f"{median / shortest:.1f}"
        )
    console = Console()
    console.print(table)
    if calls:
        console.print(f"the peer called its residuals {calls} times", highlight=False)
    return 0


if __name__ == "__main__":
    run_scenario(main)
