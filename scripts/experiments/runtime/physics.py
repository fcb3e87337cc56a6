"""Benchmark: cost of the exact hydrodynamics over bare MuJoCo and other fluid models.

    # one core; then a batch on one and two threads
    ./uvw run scripts/experiments/runtime/physics.py

    # adds the simulator auv-sim-bench from PyPI
    ./uvw run --with auv-sim-bench scripts/experiments/runtime/physics.py

Each time is the best of many rounds. Only ratios within one run are comparable; the batch needs an
idle machine. Writes bench_physics.json and .md into --out.
"""

import json
import os
import platform
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import mujoco.batch
import numpy as np
from rich.console import Console

from experiments.runtime.physics_peers import auv_sim_bench, fossen_loop, numpy_callback
from uuv.experiment import Table
from uuv.models import hydrodynamics as water
from uuv.sim import hydrodynamics
from uuv.sim.runs.saving import write_whole
from uuv.start import new_folder, parse, run_scenario

LINK = np.array([0.3, 0.0, 0.0])  # [m] from joint to joint
# Goals: exact over bare and over ellipsoid fluid, at most; two threads over one, at least.
GOALS = {"bare": 1.6, "ellipsoid": 0.3, "threads": 1.8}


@dataclass
class Options:
    """Cost of one step of a hull with a six-joint arm, its growth with the number of links, and
    cost of a batch.
    """

    steps: int = 2000
    """Steps of a round."""
    rounds: int = 15
    """Number of rounds, interleaved over the models; the fastest counts."""
    links: tuple[int, ...] = (10, 30, 100)
    """Number of links of the growing chains and trees."""
    sims: int = 64
    """Number of simulations of the batch."""
    out: Path | None = None
    """Folder for the results."""


@dataclass
class Contender:
    """A stepped model, with its passive callback (None: the installed one)."""

    run: Callable[[int], object]
    callback: Callable[[mujoco.MjModel, mujoco.MjData], None] | None = None
    best: float = np.inf  # [s] for a step


@dataclass
class Report:
    """Collects tables for the terminal and for a file, and the numbers."""

    console: Console
    numbers: dict[str, Any] = field(default_factory=dict)
    markdown: list[str] = field(default_factory=list)

    def table(self, title: str, columns: tuple[str, ...], rows: list[list[str]]) -> None:
        """Prints a table and adds it to the file as markdown.

        Args:
            title: Title.
            columns: Headings.
            rows: Cells.
        """
        table = Table(title=title, columns=columns, rows=rows)
        self.console.print(table.printed())
        self.markdown.append(table.markdown())


def vehicle(links: int, integrator: str, *, branched: bool = False) -> mujoco.MjSpec:
    """A free hull with `links` capsules on hinges.

    Args:
        links: Number of links.
        integrator: MuJoCo's integrator.
        branched: Chains of at most ten links; False: one chain.
    """
    spec = mujoco.MjSpec.from_string(
        f'<mujoco><option timestep="0.002" integrator="{integrator}"/></mujoco>'
    )
    spec.option.disableflags = mujoco.mjtDisableBit.mjDSBL_CONTACT
    hull = spec.worldbody.add_body(name="hull")
    hull.add_freejoint()
    hull.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.7, 0.4, 0.3], pos=[0, 0, -0.05], mass=300)
    parent = hull
    for i in range(links):
        if branched and i % 10 == 0:
            parent = hull
        parent = parent.add_body(name=f"link{i}", pos=[0.7, 0, 0] if parent is hull else LINK)
        parent.add_joint(axis=[0, 0, 1] if i % 2 else [0, 1, 0], damping=[1.0, 0.0, 0.0])
        parent.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[0.05, 0, 0], fromto=[0, 0, 0, *LINK], mass=3
        )
    return spec


def with_water(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """The vehicle compiled with the exact hydrodynamics: full 6x6 added masses, drag, strips on the
    links.
    """
    link = water.cylinder(0.05, np.zeros(3), LINK)
    hull = water.box([1.4, 0.8, 0.6])
    water.attach(
        spec, {body.name: hull if body.name == "hull" else link for body in spec.bodies[1:]}
    )
    return hydrodynamics.compile(spec)


def with_ellipsoids(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """The vehicle with MuJoCo's fluid model: drag, lift and velocity terms of added mass, no added
    inertia.
    """
    spec.option.density, spec.option.viscosity = water.SEA_WATER, 1e-3
    for geom in spec.geoms:
        geom.fluid_ellipsoid = 1.0
    return spec.compile()


def stepping(model: mujoco.MjModel) -> Callable[[int], object]:
    """Function that takes steps of `model`, each time from the same moving state."""
    data = mujoco.MjData(model)

    def run(steps: int) -> None:
        mujoco.mj_resetData(model, data)
        data.qvel = 0.05
        mujoco.mj_step(model, data, steps)

    return run


def measure(contenders: list[Contender], steps: int, rounds: int) -> None:
    """Updates `best` of all contenders, round by round, so that a slow moment of the machine
    affects all alike.

    Args:
        contenders: Models to step.
        steps: Steps of a round.
        rounds: Number of rounds.
    """
    for _ in range(rounds):
        for contender in contenders:
            if contender.callback:
                hydrodynamics.uninstall()
                mujoco.set_mjcb_passive(contender.callback)
            contender.run(20)
            # processor time of this thread: other load on the machine does not count
            begin = time.thread_time()
            contender.run(steps)
            contender.best = min(contender.best, (time.thread_time() - begin) / steps)
            if contender.callback:
                mujoco.set_mjcb_passive(None)
                hydrodynamics.install()


def verdict(value: float, goal: float, *, most: bool = True) -> str:
    """A ratio formatted with its goal.

    Args:
        value: The ratio.
        goal: Its bound.
        most: The bound is an upper one.
    """
    held = value <= goal if most else value >= goal
    return f"{value:.2f} x ({'' if held else 'NOT '}{'at most' if most else 'at least'} {goal:g})"


def one_vehicle(options: Options, report: Report) -> None:
    """Adds the table of the six-joint vehicle: bare, exact, ellipsoid fluid, numpy callback."""
    rows = []
    for integrator in ("Euler", "implicitfast"):
        bare = vehicle(6, integrator).compile()
        contenders = [
            Contender(stepping(bare)),
            Contender(stepping(with_water(vehicle(6, integrator)))),
            Contender(stepping(with_ellipsoids(vehicle(6, integrator)))),
            Contender(stepping(bare), numpy_callback(bare)),
        ]
        measure(contenders, options.steps, options.rounds)
        base, exact, ellipsoid, python = (contender.best for contender in contenders)
        share = f"{exact / ellipsoid:.2f} x"
        if integrator == "implicitfast":
            share = verdict(exact / ellipsoid, GOALS["ellipsoid"])
        cells = [f"{base * 1e6:.2f}", verdict(exact / base, GOALS["bare"])]
        rows.append(
            [integrator, *cells, f"{ellipsoid / base:.2f} x", f"{python / base:.1f} x", share]
        )
        keys = ("bare_s", "exact_s", "ellipsoid_s", "numpy_callback_s")
        report.numbers[integrator] = dict(zip(keys, (base, exact, ellipsoid, python), strict=True))
    columns = (
        "integrator",
        "bare [us]",
        "exact",
        "ellipsoid fluid",
        "numpy callback, drag only",
        "exact / ellipsoid",
    )
    report.table("A step: 12 degrees of freedom, 7 bodies, no contact", columns, rows)


def growth(options: Options, report: Report) -> None:
    """Adds the table of the cost over the number of links."""
    rows, numbers = [], []
    for branched in (False, True):
        shape, first = "branched" if branched else "serial", 0.0
        for links in options.links:
            bare = vehicle(links, "implicitfast", branched=branched).compile()
            wet = with_water(vehicle(links, "implicitfast", branched=branched))
            pair = [Contender(stepping(bare)), Contender(stepping(wet))]
            measure(pair, max(options.steps * 6 // links, 20), options.rounds)
            base, exact = (contender.best for contender in pair)
            first = first or exact / base
            times = [f"{base * 1e6:.1f}", f"{exact * 1e6:.1f}"]
            rows.append(
                [
                    shape,
                    str(links),
                    *times,
                    f"{exact / base:.2f} x",
                    f"{exact / base / first:.2f} x",
                ]
            )
            numbers.append({"shape": shape, "links": links, "bare_s": base, "exact_s": exact})
    report.numbers["growth"] = numbers
    columns = (
        "shape",
        "links",
        "bare [us]",
        "exact [us]",
        "exact / bare",
        f"that over {options.links[0]} links",
    )
    report.table("Growth with the number of links (implicitfast)", columns, rows)


def one_body(options: Options, report: Report) -> None:
    """Adds the table of one rigid body, against loops that step it in Python."""
    spec = mujoco.MjSpec.from_string(
        '<mujoco><option timestep="0.002"/><worldbody><body name="hull"><freejoint/>'
        '<geom type="box" size=".7 .4 .3" mass="680"/></body></worldbody></mujoco>'
    )
    body = water.box([1.4, 0.8, 0.6])
    water.attach(spec, {"hull": body})
    model = hydrodynamics.compile(spec)
    loop = fossen_loop(
        float(model.body_mass[1]), model.body_inertia[1], body, 0.002, water.SEA_WATER
    )
    contenders = {
        "ours, full step": Contender(stepping(model)),
        "numpy loop after Fossen": Contender(loop),
    }
    if peer := auv_sim_bench(0.002):
        contenders["auv-sim-bench (no added mass)"] = Contender(peer)
    measure(list(contenders.values()), options.steps, options.rounds)
    ours = next(iter(contenders.values())).best
    rows = [
        [name, f"{each.best * 1e6:.2f}", f"{each.best / ours:.1f} x"]
        for name, each in contenders.items()
    ]
    report.numbers["one_body"] = {name: each.best for name, each in contenders.items()}
    report.table(
        "One rigid body, 6 degrees of freedom", ("simulator", "step [us]", "over ours"), rows
    )


def resident() -> int:
    """Resident memory of this process [bytes]; 0 where the system does not report it."""
    statm = Path("/proc/self/statm")
    return int(statm.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") if statm.exists() else 0


def batch(options: Options, report: Report) -> None:
    """Adds the table of many simulations of the vehicle on one and two threads, by wall-clock
    time.
    """
    model = with_water(vehicle(6, "implicitfast"))
    starts = 0.1 * np.random.default_rng(0).normal(size=(options.sims, model.nv))
    batches = {n: mujoco.batch.Batch(model, nsim=options.sims, nthread=n) for n in (1, 2)}
    best, busy, ends = dict.fromkeys(batches, np.inf), dict.fromkeys(batches, np.inf), {}
    steps = max(options.steps // 8, 20)
    for _ in range(options.rounds):
        for threads, each in batches.items():
            each.reset()
            qpos, qvel = each.bind("qpos"), each.bind("qvel")
            qvel[:] = starts
            begin, used = time.perf_counter(), time.process_time()
            each.step(nstep=steps)
            taken, used = time.perf_counter() - begin, time.process_time() - used
            best[threads] = min(best[threads], taken / (steps * options.sims))
            busy[threads] = min(busy[threads], used / (steps * options.sims))
            ends[threads] = np.hstack([qpos, qvel])
    row_bytes = 8 * batches[1].nstate
    before = resident()
    keeping = mujoco.batch.Batch(model, nsim=options.sims, nthread=1, persistent=True)
    keeping.step(nstep=2)
    kept = (resident() - before) / options.sims
    identical = bool(np.array_equal(ends[1], ends[2]))
    gain = best[1] / best[2]
    rows = [
        ["steps/s on 1 thread, 2 threads", f"{1 / best[1]:,.0f}, {1 / best[2]:,.0f}"],
        ["2 threads over 1", verdict(gain, GOALS["threads"], most=False)],
        ["processor time of a step, 2 threads over 1", f"{busy[2] / busy[1]:.2f} x"],
        ["bit for bit the same", "yes" if identical else "NO"],
        ["memory of a simulation: state row", f"{row_bytes / 1024:.1f} KiB"],
        [
            "memory of a persistent one, its MjData in use",
            f"{kept / 1024:.0f} KiB" if kept else "not told here",
        ],
        [
            "memory reserved by one MjData",
            f"{(mujoco.MjData(model).nbuffer + model.narena) / 1024:.0f} KiB",
        ],
    ]
    numbers = {"step_s_1": best[1], "step_s_2": best[2], "identical": identical}
    numbers |= {"processor_s_1": busy[1], "processor_s_2": busy[2]}
    report.numbers["batch"] = numbers | {"row_bytes": row_bytes, "persistent_bytes": kept}
    report.table(f"Batch of {options.sims}, 12 degrees of freedom each", ("", "figure"), rows)


def main() -> int:
    """Runs the benchmark, writes its files and returns the exit code."""
    options = parse(Options)
    folder = new_folder("bench_physics", options.out)
    report = Report(Console())
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    head = (
        f"MuJoCo {mujoco.__version__}, Python {platform.python_version()}, {os.cpu_count()} "
        f"cores, load {load:.1f}"
    )
    report.numbers |= {"mujoco": mujoco.__version__, "load_before": load}
    report.console.print(head)
    report.markdown.append(head)
    hydrodynamics.install()
    if cores:
        os.sched_setaffinity(0, cores[:1])  # one core, whatever the libraries would use
    one_vehicle(options, report)
    growth(options, report)
    one_body(options, report)
    if cores:
        os.sched_setaffinity(0, cores)
    batch(options, report)
    write_whole(folder / "bench_physics.json", json.dumps(report.numbers, indent=1) + "\n")
    (folder / "bench_physics.md").write_text("\n\n".join(report.markdown) + "\n")
    report.console.print(f"written to {folder}")
    return 0


if __name__ == "__main__":
    run_scenario(main)
