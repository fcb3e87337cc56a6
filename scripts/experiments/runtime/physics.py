"""Cost of the exact hydrodynamics over bare MuJoCo and other fluid models, on one core.

A hull with an arm of six joints, chains and trees of more links, and one rigid body. The models of
a case take turns, and the best of many rounds counts: only ratios within a case are comparable.
Processor time of the thread: other load on the machine does not count.

    # adds the simulator auv-sim-bench from PyPI
    ./uvw run --with auv-sim-bench scripts/experiments/runtime/physics.py --workers 1
"""

from uuv.start import run_scenario  # isort: skip

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from experiments.runtime.physics_peers import auv_sim_bench, fossen_loop, numpy_callback
from uuv.experiment import Page, Row, column, experiment, stat
from uuv.experiment.one_core import one_core
from uuv.experiment.options import at_least
from uuv.experiment.statistic import Record
from uuv.models import hydrodynamics as water
from uuv.sim import hydrodynamics

LINK = np.array([0.3, 0.0, 0.0])  # [m] from joint to joint
JOINTS = 6  # of the arm
MOST_OVER_BARE, MOST_OVER_ELLIPSOID = 1.6, 0.3  # goals of the exact water
VEHICLE = "vehicle"
GROWTH = "growth"
ONE_BODY = "one body"
BARE = "bare"
EXACT = "exact"
ELLIPSOID = "ellipsoid fluid"
CALLBACK = "numpy callback, drag only"
OURS = "ours, full step"


@dataclass(frozen=True, kw_only=True)
class SteppedModels:
    """Which models, and how long they are timed."""

    steps: int = 2000
    """Steps of a round."""
    rounds: int = 15
    """Number of rounds, interleaved over the models; the fastest counts."""
    links: tuple[int, ...] = (10, 30, 100)
    """Number of links of the growing chains and trees."""

    def __post_init__(self) -> None:
        at_least(self, steps=1, rounds=1)


@dataclass(frozen=True, kw_only=True)
class PhysicsCase:
    """Models that take turns."""

    table: str
    """Of what: vehicle, growth, one body."""
    integrator: str = "implicitfast"
    shape: str = "serial"
    """One chain, serial, or chains of at most ten links, branched."""
    link_count: int = JOINTS
    steps: int
    """Steps of a round."""
    rounds: int


@dataclass(frozen=True, kw_only=True)
class PhysicsRow:
    """Times by model, the first of which is the reference."""

    step: Mapping[str, float] = column(
        "a step", "µs", digits=2, factor=1e6, by="model", tolerance=None
    )
    ratio: Mapping[str, float] = column("over the first", digits=2, by="model", tolerance=None)


@dataclass(slots=True)
class Contender:
    """A stepped model, with its passive callback (None: the installed one)."""

    run: Callable[[int], object]
    callback: Callable[[mujoco.MjModel, mujoco.MjData], None] | None = None
    best: float = np.inf  # [s] for a step


def cases(models: SteppedModels) -> Iterator[PhysicsCase]:
    """The vehicle by integrator, its growth by shape, and one body."""
    steps = models.steps
    rounds = models.rounds
    for integrator in ("Euler", "implicitfast"):
        yield PhysicsCase(table=VEHICLE, integrator=integrator, steps=steps, rounds=rounds)
    for shape in ("serial", "branched"):
        for links in models.links:
            few = max(steps * JOINTS // links, 20)
            yield PhysicsCase(table=GROWTH, shape=shape, link_count=links, steps=few, rounds=rounds)
    yield PhysicsCase(table=ONE_BODY, integrator="Euler", link_count=0, steps=steps, rounds=rounds)


@experiment("step_cost", cases=cases, quick={"rounds": SteppedModels.rounds, "links": (10,)})
def step_cost(case: PhysicsCase) -> PhysicsRow:
    """Times the models of a case."""
    models = one_body() if case.table == ONE_BODY else vehicles(case)
    with one_core():
        measure(list(models.values()), case.steps, case.rounds)

    first = next(iter(models.values())).best
    return PhysicsRow(
        step={name: model.best for name, model in models.items()},
        ratio={name: model.best / first for name, model in models.items()},
    )


def vehicles(case: PhysicsCase) -> dict[str, Contender]:
    """The vehicle of a case, bare and with water; the one with an arm with other fluids too."""

    def spec() -> mujoco.MjSpec:
        return vehicle(case.link_count, case.integrator, branched=case.shape == "branched")

    bare = spec().compile()
    models = {BARE: Contender(stepping(bare)), EXACT: Contender(stepping(with_water(spec())))}
    if case.table == VEHICLE:
        models[ELLIPSOID] = Contender(stepping(with_ellipsoids(spec())))
        models[CALLBACK] = Contender(stepping(bare), numpy_callback(bare))
    return models


def one_body() -> dict[str, Contender]:
    """One rigid body, and loops that step it in Python."""
    spec = mujoco.MjSpec.from_string(
        '<mujoco><option timestep="0.002"/><worldbody><body name="hull"><freejoint/><geom '
        'type="box" size=".7 .4 .3" mass="680"/></body></worldbody></mujoco>'
    )
    body = water.box([1.4, 0.8, 0.6])
    water.attach(spec, {"hull": body})
    model = hydrodynamics.compile(spec)

    mass = float(model.body_mass[1])
    loop = fossen_loop(mass, model.body_inertia[1], body, 0.002, water.SEA_WATER)
    models = {OURS: Contender(stepping(model)), "numpy loop after Fossen": Contender(loop)}
    if peer := auv_sim_bench(0.002):
        models["auv-sim-bench (no added mass)"] = Contender(peer)
    return models


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
    """The vehicle with the exact hydrodynamics: full added masses, drag, strips on the links."""
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
    spec.option.density = water.SEA_WATER
    spec.option.viscosity = 1e-3
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
            begin = time.thread_time()
            contender.run(steps)
            contender.best = min(contender.best, (time.thread_time() - begin) / steps)

            if contender.callback:
                mujoco.set_mjcb_passive(None)
                hydrodynamics.install()


def _over(row: Record, model: str, other: str) -> float | None:
    """Time of a model over that of another one; None if the case has not both."""
    times = row["step"]
    return times[model] / times[other] if model in times and other in times else None


def growth(rows: list[Row]) -> list[str]:
    """How much of the ratio to a bare step is gained from the fewest links to the most."""
    lines = []
    for shape in ("serial", "branched"):
        chains = [row for row in rows if (row["table"], row["shape"]) == (GROWTH, shape)]
        chains.sort(key=lambda row: row["link_count"])
        if len(chains) > 1:
            few = chains[0]
            many = chains[-1]
            gain = many["ratio"][EXACT] / few["ratio"][EXACT]
            lines.append(
                f"{shape}: exact / bare with {many['link_count']} links over that with "
                f"{few['link_count']}: {gain:.2f}"
            )
    return lines


step_cost.page = (
    Page()
    .table(
        "A step: 12 degrees of freedom, 7 bodies, no contact; times over the bare one",
        by="integrator",
        columns=[
            stat("value", lambda row: 1e6 * row["step"][BARE], "bare", unit="µs", digits=2),
            *(
                stat("value", lambda row, model=model: row["ratio"][model], model, digits=2)
                for model in (EXACT, ELLIPSOID, CALLBACK)
            ),
            stat("value", lambda row: _over(row, EXACT, ELLIPSOID), "exact / ellipsoid", digits=2),
        ],
        where=lambda row: row["table"] == VEHICLE,
    )
    .table(
        "Growth with the number of links (implicitfast)",
        by=("shape", "link_count"),
        columns=[
            stat("value", lambda row: 1e6 * row["step"][BARE], "bare", unit="µs", digits=1),
            stat("value", lambda row: 1e6 * row["step"][EXACT], "exact", unit="µs", digits=1),
            stat("value", lambda row: row["ratio"][EXACT], "exact / bare", digits=2),
        ],
        where=lambda row: row["table"] == GROWTH,
    )
    .add(growth)
    .table(
        "One rigid body, 6 degrees of freedom",
        by="model",
        columns=["step", "ratio"],
        where=lambda row: row["table"] == ONE_BODY,
    )
    .accept(
        stat("largest", lambda row: _over(row, EXACT, BARE), "exact over bare"),
        most=MOST_OVER_BARE,
        where=lambda row: row["table"] == VEHICLE,
    )
    .accept(
        stat("largest", lambda row: _over(row, EXACT, ELLIPSOID), "exact over ellipsoid fluid"),
        most=MOST_OVER_ELLIPSOID,
        where=lambda row: row["table"] == VEHICLE and row["integrator"] == "implicitfast",
    )
)

if __name__ == "__main__":
    run_scenario(step_cost.main)
