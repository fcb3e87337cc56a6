"""Cases of the benchmark: seeded scenarios of contact work, public by version or drawn afresh.

Water, sensors, vehicle and pad of case i are those of `uuv.benchmark.first_draw`. The job belongs
to the family with index i modulo the number of families. Its variant and numbers are drawn from the
seed and i only.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from uuv.benchmark.first_draw import FirstDraw
from uuv.controllers.planning.promise import MOST_THRUST
from uuv.experiment.harness import as_json, key_of
from uuv.jobs import clean_barrel, clean_object, clean_pile, insert_sampler
from uuv.scenario import Belief, Control, Scenario
from uuv.sim.interfaces.spatial import whole_number
from uuv.site import Site

VERSION = 1  # version of cases, briefing and score; a change of one of them gets a new number
PUBLIC_SEED = 20261123  # seed of the public cases
CASES = 100  # number of the public cases
_CLEARANCE = (1.0, 3.0)  # [mm] radial clearance between sampler and hole


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchmarkCase:
    """One case, whose scenario is determined by the version, the seed and the index."""

    version: int = VERSION
    seed: int = PUBLIC_SEED
    index: int

    def __post_init__(self) -> None:
        whole_number(self.index, "case", least=0)
        whole_number(self.seed, "seed", least=0)

    @property
    def family(self) -> str:
        """Name of the family of jobs."""
        return tuple(FAMILIES)[self.index % len(FAMILIES)]

    def scenario(self, control: Control) -> Scenario:
        """The scenario of the case with this control."""
        drawn = FirstDraw.of(self.seed, self.index)
        job = FAMILIES[self.family](np.random.default_rng([self.seed, self.index, 1]))
        # the tool of an insertion has no pad, and its finder no path
        rigid = self.family == INSERTION

        return Scenario(
            name="contact_benchmark",
            task=job.task,
            seed=drawn.seed,
            site=Site(object=job.site.object, current=drawn.current, gust=drawn.gust),
            vehicle=job.vehicle,
            belief=Belief(water_error=0.0),
            sensing=drawn.sensing,
            control=control,
            perturbations=drawn.of_vehicle + (() if rigid else drawn.of_surface),
            perturbation_seed=drawn.perturbation_seed,
        )


def _barrel(rng: np.random.Generator) -> Scenario:
    """Path along the top of the barrel or around it."""
    if rng.random() < 0.5:
        return clean_barrel(path="longitudinal", quick=True)
    return clean_barrel(path="transverse", quick=True)


def _pile(rng: np.random.Generator) -> Scenario:
    """Path up the pile, around it, or both."""
    choices = (
        clean_pile(path="vertical", quick=True),
        clean_pile(path="ring", quick=True),
        clean_pile(path="helix", quick=True),
    )
    return choices[rng.integers(len(choices))]


def _rock(_: np.random.Generator) -> Scenario:
    return clean_object(object="rock", quick=True)


def _plate(rng: np.random.Generator) -> Scenario:
    """Path over the free middle of a stiffened plate, along it or across it, or next to a
    stiffener.
    """
    paths = ("middle", "along_bar", "across")
    return clean_object(object="plate", path=paths[rng.integers(len(paths))], quick=True)


def _insertion(rng: np.random.Generator) -> Scenario:
    """Insertion of a sampler into one of two holes, with a drawn clearance."""
    clearance = float(rng.uniform(*_CLEARANCE))
    if rng.random() < 0.5:
        return insert_sampler(hole="a", clearance=clearance, quick=True)
    return insert_sampler(hole="b", clearance=clearance, quick=True)


INSERTION = "insertion"
FAMILIES: dict[str, Callable[[np.random.Generator], Scenario]] = {
    "barrel": _barrel,
    "pile": _pile,
    "rock": _rock,
    "plate": _plate,
    INSERTION: _insertion,
}


def cases(count: int = CASES, *, seed: int = PUBLIC_SEED) -> tuple[BenchmarkCase, ...]:
    """The first `count` cases of a seed; the default seed gives the public ones.

    Raises:
        ConfigurationError: The count or the seed is out of range.
    """
    whole_number(count, "--cases", least=1)
    return tuple(BenchmarkCase(seed=seed, index=index) for index in range(count))


def digest(chosen: tuple[BenchmarkCase, ...]) -> str:
    """Digest of the scenarios of these cases with default control."""
    return key_of(
        [[type(part).__name__ for part in _kinds(case)] + [_described(case)] for case in chosen]
    )


def _described(case: BenchmarkCase) -> dict[str, Any]:
    """Scenario of a case with default control, limited to the keys of the pinned cases."""
    scenario = case.scenario(Control())
    described = as_json(scenario)

    # Keys that came later are left out at their defaults, so that the digest stays.
    if not scenario.vehicle.unchecked:
        del described["vehicle"]["unchecked"]
    if scenario.vehicle.battery is None:
        del described["vehicle"]["battery"]
    if described["task"].get("hull_place") is None:
        described["task"].pop("hull_place", None)
    if scenario.control.operator is None:
        del described["control"]["operator"]
    if scenario.control.force_from == Control.force_from:
        del described["control"]["force_from"]
    if not scenario.sensing.follow:
        del described["sensing"]["follow"]
    if scenario.site.flow is None:
        del described["site"]["flow"]

    of = described["site"]["object"]
    for later in ("line", "scale"):
        if of.get(later, ...) is None:
            del of[later]

    for later in ("tool", "parts"):
        if described["vehicle"].get(later, ...) is None:
            del described["vehicle"][later]

    promised = described["task"].get("promise", {})
    for later, usual in (("stops", None), ("most_thrust", MOST_THRUST)):
        if promised.get(later, ...) == usual:
            del promised[later]

    return described


def _kinds(case: BenchmarkCase) -> tuple[object, ...]:
    """Components whose class cannot be recognised by their fields."""
    scenario = case.scenario(Control())
    return (scenario.task, scenario.site.object, *scenario.perturbations)
