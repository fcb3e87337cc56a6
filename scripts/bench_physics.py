"""What exact hydrodynamics costs: one core, one run, every model stepped in turn, the best of many rounds.

`./uvw run scripts/bench_physics.py` prints times a step and ratios to the bare step; only ratios of one run compare.
"""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from _start import parse, run_scenario
from rich.console import Console
from rich.table import Table

from models import hydrodynamics as water
from sim import hydrodynamics
from sim.interfaces.spatial import Array

LINK = np.array([0.3, 0.0, 0.0])  # [m] from joint to joint


@dataclass
class Options:
    """Cost of a step of a hull with a six-joint arm, and how it grows with the number of links."""

    steps: int = 2000  # steps a round
    rounds: int = 9  # rounds, interleaved over the models; the fastest counts
    links: tuple[int, ...] = (10, 30, 100)  # lengths of the growing chains and trees


@dataclass
class Contender:
    """One model, and the passive callback that it runs with (None: the one that is installed)."""

    model: mujoco.MjModel
    callback: Callable[[mujoco.MjModel, mujoco.MjData], None] | None = None
    best: float = np.inf  # [s] a step


def vehicle(links: int, integrator: str, *, branched: bool = False) -> mujoco.MjSpec:
    """A free hull and `links` capsules on hinges, in one chain or in chains of at most ten."""
    spec = mujoco.MjSpec.from_string(f'<mujoco><option timestep="0.002" integrator="{integrator}"/></mujoco>')
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
        parent.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[0.05, 0, 0], fromto=[0, 0, 0, *LINK], mass=3)
    return spec


def with_water(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """The vehicle with the exact hydrodynamics: full 6x6 added masses, drag, strips on the links."""
    link = water.cylinder(0.05, np.zeros(3), LINK)
    hull = water.box([1.4, 0.8, 0.6])
    water.attach(spec, {body.name: hull if body.name == "hull" else link for body in spec.bodies[1:]})
    return hydrodynamics.compile(spec)


def with_ellipsoids(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """MuJoCo's own fluid: drag, lift and the velocity terms of added mass, without the added inertia."""
    spec.option.density, spec.option.viscosity = water.SEA_WATER, 1e-3
    for geom in spec.geoms:
        geom.fluid_ellipsoid = 1.0
    return spec.compile()


def cross(a: Array, b: Array) -> Array:
    """Row by row; numpy's own costs ten times as much on a few rows."""
    return a[:, [1, 2, 0]] * b[:, [2, 0, 1]] - a[:, [2, 0, 1]] * b[:, [1, 2, 0]]


def numpy_callback(model: mujoco.MjModel) -> Callable[[mujoco.MjModel, mujoco.MjData], None]:
    """Quadratic drag and buoyancy alone, vectorised over the bodies in numpy: what a Python callback costs."""
    roots, drag, lift = model.body_rootid[1:], 5.0, np.array([0.0, 0.0, 10.0])
    below = np.eye(model.nbody)  # below[i, j]: body j is i or hangs from it
    for i in range(model.nbody - 1, 0, -1):
        below[model.body_parentid[i]] += below[i]
    below = below[model.dof_bodyid][:, 1:]

    def passive(_: mujoco.MjModel, d: mujoco.MjData) -> None:
        R = d.xmat[1:].reshape(-1, 3, 3)
        r = d.xpos[1:] - d.subtree_com[roots]
        w = d.cvel[1:, :3]
        nu = np.stack([d.cvel[1:, 3:] + cross(w, r), w], axis=2)
        nu = R.transpose(0, 2, 1) @ nu
        f = R @ (-drag * np.abs(nu) * nu)
        force = f[:, :, 0] + lift
        wrench = np.concatenate([f[:, :, 1] + cross(r, force), force], axis=1)
        d.qfrc_passive += np.sum(d.cdof * (below @ wrench), axis=1)

    return passive


def measure(contenders: list[Contender], steps: int, rounds: int) -> None:
    """Fill in `best`, round by round over all contenders, so that a slow moment of the machine hits all alike."""
    for _ in range(rounds):
        for contender in contenders:
            data = mujoco.MjData(contender.model)
            data.qvel = 0.05
            if contender.callback:
                hydrodynamics.uninstall()
                mujoco.set_mjcb_passive(contender.callback)
            mujoco.mj_step(contender.model, data, 20)
            begin = time.perf_counter()
            mujoco.mj_step(contender.model, data, steps)
            contender.best = min(contender.best, (time.perf_counter() - begin) / steps)
            if contender.callback:
                mujoco.set_mjcb_passive(None)
                hydrodynamics.install()


def main() -> int:
    options = parse(Options)
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # one core, whatever the libraries would take
    console = Console()
    console.print(f"MuJoCo {mujoco.__version__}")
    hydrodynamics.install()

    table = Table(title="12 degrees of freedom, 7 bodies, no contact", title_justify="left")
    for column in ("integrator", "bare [us]", "exact", "ellipsoid fluid", "numpy callback", "exact / ellipsoid"):
        table.add_column(column, justify="right")
    for integrator in ("Euler", "implicitfast"):
        bare = vehicle(6, integrator).compile()
        contenders = [
            Contender(bare),
            Contender(with_water(vehicle(6, integrator))),
            Contender(with_ellipsoids(vehicle(6, integrator))),
            Contender(bare, numpy_callback(bare)),
        ]
        measure(contenders, options.steps, options.rounds)
        base, exact, ellipsoid, python = (contender.best for contender in contenders)
        ratios = [f"{x / base:.2f} x" for x in (exact, ellipsoid, python)]
        table.add_row(integrator, f"{base * 1e6:.2f}", *ratios, f"{exact / ellipsoid:.2f} x")
    console.print(table)

    table = Table(title="Growth with the number of links (implicitfast)", title_justify="left")
    for column in ("links", "shape", "bare [us]", "exact [us]", "exact / bare"):
        table.add_column(column, justify="right")
    for branched in (False, True):
        for links in options.links:
            pair = [
                Contender(vehicle(links, "implicitfast", branched=branched).compile()),
                Contender(with_water(vehicle(links, "implicitfast", branched=branched))),
            ]
            measure(pair, max(options.steps * 6 // links, 20), options.rounds)
            base, exact = (contender.best for contender in pair)
            shape = "branched" if branched else "serial"
            table.add_row(str(links), shape, f"{base * 1e6:.1f}", f"{exact * 1e6:.1f}", f"{exact / base:.2f} x")
    console.print(table)
    return 0


if __name__ == "__main__":
    run_scenario(main)
