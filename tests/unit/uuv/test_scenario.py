"""Scenarios as values and as files, perturbations of one's own, and objects of another package."""

import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, get_args, get_type_hints

import mujoco
import numpy as np
import pytest

from untyped import untyped
from uuv import Perturbation, Scenario, assemble, jobs, models, read_scenario, run, write_scenario
from uuv.cli.carry_out import values_of
from uuv.cli.run_job import file_options
from uuv.jobs import (
    clean_object,
    clean_pile,
    identify_friction,
    insert_sampler,
    inspect_object,
    sample_seabed,
)
from uuv.models.objects.targets import OBJECTS
from uuv.own_vehicle import OwnVehicle, vehicle_spec
from uuv.perturbations import perturbation
from uuv.perturbations.loop import MisplacedSurface, SensorFailure, ThrusterFailure
from uuv.perturbations.pad import Pad
from uuv.perturbations.perturbation import perturb
from uuv.perturbations.vehicle import Gears, Payload, ThrusterSpread, Water
from uuv.scenario import Task
from uuv.scenario_file import as_dict, from_dict, registries, to_toml, with_values
from uuv.sim.interfaces.errors import LONGEST, ConfigurationError
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.plant.faults import FaultyPlant
from uuv.sim.runs.command_line import parse
from uuv.site import KnownObject, Site
from uuv.tasks import registry as tasks
from uuv.tasks.insertion import InsertionTask
from uuv.tasks.surface_work import PlacedSurfaceWork, SurfaceWorkTask

ALL = (
    Water(spread=0.3),
    Payload(spread=0.1, trim_error=-0.05),
    ThrusterSpread(lag=0.2, gain=0.1),
    Gears(spread=0.3),
    Pad(friction=0.3, stiffness=1e5),
    MisplacedSurface(offset=-0.01),
    ThrusterFailure(thruster="heave_front", state="work", after=1.0),
    SensorFailure(sensor="torque", effect="frozen", field="tau", index=1, at=30.0),
)


def scenarios() -> Iterator[Scenario]:
    yield jobs.clean_barrel(
        seed=2, arc=77.7, without=("fusion", "compensation"), arm_errors=3, fouled=0.031
    )
    yield replace(jobs.clean_barrel(), perturbations=ALL, perturbation_seed=5)
    pose = assemble_pose(jobs.clean_barrel(seed=4))
    yield replace(jobs.clean_barrel(seed=4), site=Site(X_WT=tuple(map(tuple, pose.tolist()))))
    yield clean_pile(path="helix", quick=True, arm=Path('a "b"/ä.yaml'))
    yield clean_object(contactless=0.05, arm_camera=True, least_chance=0.7)
    yield insert_sampler(error=(1.0, -0.3), compliance=False)
    yield sample_seabed(work="drag", dead_beams=(1, 4), terrain="any", cloud=Path("c.ply"))
    yield inspect_object(object="valve")
    yield identify_friction(seed=3)


def assemble_pose(scenario: Scenario) -> np.ndarray:
    return scenario.site.pose(np.random.default_rng(scenario.seed))


@pytest.mark.parametrize("scenario", list(scenarios()), ids=lambda one: one.name)
def test_a_file_reads_as_what_was_written(scenario, tmp_path):
    write_scenario(scenario, tmp_path / "scenario.toml")
    assert read_scenario(tmp_path / "scenario.toml") == scenario


def test_random_numbers_keep_all_their_bits(rng):
    for _ in range(50):
        numbers = rng.standard_normal(3) * 10.0 ** rng.integers(-12, 12, 3)
        site = Site(current=tuple(numbers.tolist()), gust=float(np.abs(rng.normal())))
        scenario = replace(jobs.clean_barrel(), site=site, seed=int(rng.integers(2**31)))
        assert from_dict(tomllib.loads(to_toml(scenario))) == scenario


def test_every_class_that_a_file_can_name_is_registered():
    for base, registry in (
        (perturbation.Perturbation, perturbation.registry()),
        (Task, tasks.registry()),
    ):
        named = {registry.maker(name) for name in registry.names()}
        ours = {subclass for subclass in subclasses(base) if subclass.__module__.startswith("uuv.")}
        nameless = {
            subclass
            for subclass in ours
            if subclass.__name__.startswith("_") or subclass.__subclasses__()
        }
        assert ours - nameless <= named <= ours


def test_what_may_be_none_is_none_by_default():
    """A file cannot say None: what is None is left out of it, and must be None again when it is
    read.
    """
    kinds_seen: set[type] = set()
    named = (
        registry.maker(name) for registry in registries().values() for name in registry.names()
    )
    pending: list[Any] = [Scenario, *named]
    while pending:
        kind = pending.pop()
        pending += get_args(kind)
        if not (isinstance(kind, type) and is_dataclass(kind)) or kind in kinds_seen:
            continue
        kinds_seen.add(kind)
        hints = get_type_hints(kind)
        pending += hints.values()
        may_be_none = [field for field in fields(kind) if type(None) in get_args(hints[field.name])]
        assert not [field.name for field in may_be_none if field.default is not None], kind
    assert len(kinds_seen) > 30


def subclasses(kind: type) -> Iterator[type]:
    for subclass in kind.__subclasses__():
        yield subclass
        yield from subclasses(subclass)


WORK = 'name = "x"\n[task]\nkind = "SurfaceWork"\n'


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("seed = ", "cannot be read"),
        ("seed = 1", "the file: name, task are missing"),
        ('name = "x"\nseeds = 1', "the file has no 'seeds'; it has name, task, seed, site"),
        ('name = "x"', "the file: task is missing"),
        ('name = "x"\n[task]\nspeed = 1', r"\[task\]: must have a kind, one of .*SurfaceWork"),
        (
            'name = "x"\n[task]\nkind = "Dance"',
            "unknown task 'Dance'; there are Collect, GearIdentification",
        ),
        (WORK + 'speed = "fast"', "task.speed: must be a number, got 'fast'"),
        (WORK + "speed = 9", "speed .m/s.: must be finite, >= 0.0001, <= 1, got 9"),
        (WORK + "forces = 9", "task.forces: must be a list, got 9"),
        (WORK + "forces = []", r"forces \[N\]: needs at least one set force, got none"),
        (
            'name = "x"\nseed = true\n[task]\nkind = "SurfaceWork"',
            "seed: must be a whole number, got True",
        ),
        (WORK + "[site]\ncurrent = [1]", "site.current: must be 3 values"),
        (WORK + "[site]\ncurrent = [nan, 0, 0]", r"site.current\[0\]: must not be NaN"),
        (
            WORK + '[[perturbations]]\nkind = "Water"\nspraed = 2',
            r"perturbations\[0\] has no 'spraed'; "
            r"it has spread",
        ),
        (WORK + '[control]\nwithout = ["luck"]', "allowed compensation, .*got 'luck'"),
        (WORK + '[site.object]\nkind = "Barrel"\nlenght = 1', r"\[site.object\] has no 'le"),
        (WORK + '[[perturbations]]\nkind = "Water"\nspread = 2', "Water spread: must be in"),
        (WORK + "[site]\nX_WT = [[1, 0, 0, 0]]", "X_WT"),
        (
            'name = "x"\nperturbations = 3\n[task]\nkind = "SurfaceWork"',
            "perturbations: must be a list, got 3",
        ),
    ],
)
def test_a_bad_file_is_one_line_that_says_what_is_allowed(text, said, tmp_path):
    file = tmp_path / "s.toml"
    file.write_text(text)
    with pytest.raises(ConfigurationError, match=f"scenario .*s.toml': .*{said}") as refused:
        read_scenario(file)
    assert "\n" not in str(refused.value)
    assert len(str(refused.value)) <= LONGEST


def test_values_are_set_by_the_keys_of_the_file():
    scenario = with_values(
        jobs.clean_barrel(seed=3),
        ["seed=5", "task.speed = 0.03", "site.current=[0, 0.2, 0]", "belief.arm=a=b.yaml"],
    )
    assert isinstance(scenario.task, SurfaceWorkTask)
    assert (scenario.seed, scenario.task.speed, scenario.site.current) == (5, 0.03, (0.0, 0.2, 0.0))
    assert scenario.belief.arm == "a=b.yaml"  # absent in the file of the base
    back = replace(
        scenario,
        seed=3,
        task=jobs.clean_barrel().task,
        site=jobs.clean_barrel().site,
        belief=jobs.clean_barrel().belief,
    )
    assert back == jobs.clean_barrel(seed=3)


def test_set_may_be_repeated_and_takes_several():
    typed = ["--set", "seed=5", "--set", "task.speed=1", "seed=6"]
    assert values_of(parse(file_options(), typed).set) == ("seed=5", "task.speed=1", "seed=6")
    assert values_of(parse(file_options(), []).set) == ()


@pytest.mark.parametrize(
    ("assignment", "said"),
    [
        ("task.speed", "must be KEY=VALUE .*got 'task.speed'"),
        ("seed.x=1", "unknown parameter 'seed.x': no table of a scenario has this key"),
        ("tsak.speed=1", "the file has no 'tsak'; it has name, task"),
        ("task.sped=1", r"\[task\] has no 'sped'; it has"),
        ("task.speed=fast", "task.speed: must be a number, got 'fast'"),
        ("seed=" + "[" * 50_000, r"seed: must be a whole number, got '\[\[\["),
        ("seed=" + "9" * 5000, "seed: must be a whole number, got '999"),
        ("seed=4\nname='a'", "seed: must be a whole number, got "),
        ("site.current=[nan,0,0]", r"site.current\[0\]: must not be NaN"),
    ],
)
def test_a_value_that_cannot_be_set_is_refused(assignment, said):
    with pytest.raises(ConfigurationError, match=f"--set: {said}"):
        with_values(jobs.clean_barrel(), [assignment])


def test_a_task_at_the_wrong_site_is_refused():
    scenario = replace(jobs.clean_barrel(), site=sample_seabed().site)
    with pytest.raises(
        ConfigurationError, match="task SurfaceWorkTask: needs a Workpiece at the site, got Ground"
    ):
        assemble(scenario)


def placed(scenario: Scenario) -> PlacedSurfaceWork:
    assert isinstance(scenario.task, SurfaceWorkTask)
    vehicle = OwnVehicle.of(vehicle_spec(scenario.vehicle.vehicle))
    return scenario.task.place(scenario, vehicle, np.random.default_rng(scenario.seed))


def test_a_set_pose_is_the_true_one_and_moves_no_later_draw():
    drawn = jobs.clean_barrel(seed=7)
    pose = np.eye(4)
    pose[:3, 3] = [0.1, 0.2, -1.4]
    with_pose = replace(drawn, site=replace(drawn.site, X_WT=tuple(map(tuple, pose.tolist()))))
    first, other = placed(drawn), placed(with_pose)
    assert np.array_equal(other.truth.X_WT, pose)
    off = first.approach_W - first.truth.X_WT[:3, 3]
    assert np.allclose(other.approach_W - pose[:3, 3], off, rtol=0.0, atol=1e-15)  # measured 2e-16


# A perturbation of one's own, whole: eleven lines.


@dataclass(frozen=True, kw_only=True)
class HeavyPad(Perturbation):
    """A pad heavier than believed."""

    spread: float = 0.5  # largest share of its mass

    def on_vehicle(self, spec: mujoco.MjSpec, rng: np.random.Generator) -> dict[str, float]:
        factor = rng.uniform(1.0, 1.0 + self.spread)
        spec.body("pad").mass = factor * spec.body("pad").mass
        return {"pad_mass": factor}


def test_a_new_perturbation_acts_and_changes_no_draw_of_others():
    plain, alone, both = (models.load("uuv_puma") for _ in range(3))
    before = perturb(alone, [Water(spread=0.3), Gears(spread=0.3)], seed=3)
    drawn = perturb(both, [HeavyPad(), Gears(spread=0.3), Water(spread=0.3)], seed=3)
    assert {name: drawn[name] for name in before} == before
    was, changed = plain.compile(), both.compile()
    assert changed.body("pad").mass[0] == pytest.approx(
        drawn["pad_mass"] * was.body("pad").mass[0], rel=1e-12
    )
    assert 1.0 < drawn["pad_mass"] < 1.5
    assert np.array_equal(alone.compile().body_user, changed.body_user)
    assert perturb(models.load("uuv_puma"), [HeavyPad()], seed=4)["pad_mass"] != drawn["pad_mass"]
    run(assemble(replace(jobs.clean_barrel(quick=True), perturbations=(HeavyPad(),))), longest=0.01)


# An object of another package, whole: its module, and the entry point that a wheel of it would
# bring.

MODULE = """
import numpy as np
from uuv.models.meshes.closed_shells import sphere
from uuv.models.objects.targets import TargetModel

def buoy(radius=0.25):
    unit, triangles = sphere(3)
    return TargetModel(name="buoy", vertices=radius * unit, triangles=triangles)
"""


def test_an_object_of_another_package_is_worked_on(tmp_path, monkeypatch):
    dist_info = tmp_path / "buoys-1.0.dist-info"
    dist_info.mkdir()
    (dist_info / "METADATA").write_text("Metadata-Version: 2.1\nName: buoys\nVersion: 1.0\n")
    (dist_info / "entry_points.txt").write_text("[uuv_arm.object]\nbuoy = buoys:buoy\n")
    (tmp_path / "buoys.py").write_text(MODULE)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(OBJECTS, "_found", None)  # what is installed is looked up once
    monkeypatch.delitem(sys.modules, "buoys", raising=False)
    scenario = replace(
        jobs.clean_barrel(),
        site=Site(object=KnownObject(object="buoy")),
        task=SurfaceWorkTask(least=0.5),
    )
    work = placed(scenario)
    assert (work.target.name, work.truth.path) == ("buoy", "over")
    assert from_dict(as_dict(scenario)) == scenario
    model = work.scene(models.load("uuv_puma")).compile()
    assert model.body("target").id > 0
    monkeypatch.setattr(OBJECTS, "_found", None)


# -- failures --------------------------------------------------------------------------------------


def test_failures_compose_on_one_plant_and_wait_for_their_event():
    failures = (
        ThrusterFailure(thruster="heave_front", at=1.0),
        ThrusterFailure(thruster="heave_back", state="work", share=0.5),
        SensorFailure(sensor="vision", at=0.5, duration=1.0),
    )
    names = assemble(jobs.clean_barrel(quick=True)).plant.vehicle.thruster_names
    failures = (failures[0], replace(failures[1], thruster=names[-1]), failures[2])
    built = assemble(replace(jobs.clean_barrel(quick=True), perturbations=failures))
    assert isinstance(built.loop.plant, FaultyPlant)
    assert [fault.thruster for fault in built.loop.plant.faults] == [
        names.index("heave_front"),
        len(names) - 1,
    ]
    assert [fault.onset.began for fault in built.loop.plant.faults] == [1.0, np.inf]
    assert [getattr(observer, "state", None) for observer in built.loop.observers] == [
        WorkState.WORK
    ]


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: ThrusterFailure(thruster="x"), "must have either `at` .s. or `state`"),
        (lambda: ThrusterFailure(thruster="x", at=1.0, state="work"), "must have either"),
        (lambda: SensorFailure(sensor="dvl", state="lunch"), "allowed settle, .*got 'lunch'"),
        (lambda: SensorFailure(sensor="dvl", at=-1.0), "onset at: must be >= 0"),
        (
            lambda: SensorFailure(sensor="dvl", effect="turned", index=0, at=1.0),
            "allowed for sensor 'imu'.*got 'dvl'",
        ),
        (
            lambda: SensorFailure(sensor="imu", effect="turned", at=1.0),
            "about index 0, 1 or 2.*and None",
        ),
        (
            lambda: SensorFailure(
                sensor="imu", effect="turned", index=2, value=float("inf"), at=1.0
            ),
            "value .rad.",
        ),
        (
            lambda: SensorFailure(sensor="dvl", rate=1.0, at=1.0),
            "rate: only allowed for the effects 'offset' and 'turned', got 'lost'",
        ),
        (lambda: MisplacedSurface(offset=float("nan")), "MisplacedSurface offset"),
    ],
)
def test_a_failure_that_cannot_be_is_refused(make, said):
    with pytest.raises(ConfigurationError, match=said):
        make()


def test_an_unknown_thruster_is_named_with_those_there_are():
    scenario = replace(
        jobs.clean_barrel(quick=True), perturbations=(ThrusterFailure(thruster="stern", at=0.0),)
    )
    with pytest.raises(ConfigurationError, match=r"allowed .*heave_front.*got 'stern'"):
        assemble(scenario)


def test_a_scenario_is_no_more_than_a_run_needs():
    for kind in (Scenario, Site, Water):
        assert len(fields(kind)) <= 10, kind
    assert len(fields(SurfaceWorkTask)) <= 11  # work, limits, promise, and a hull's place of choice


def test_perturbations_can_be_appended_to_a_file_that_has_none(tmp_path):
    write_scenario(jobs.clean_barrel(), tmp_path / "a.toml")
    with (tmp_path / "a.toml").open("a") as written:
        written.write('\n[[perturbations]]\nkind = "Water"\nspread = 0.3\n')
    assert read_scenario(tmp_path / "a.toml").perturbations == (Water(spread=0.3),)


def test_a_thruster_cannot_fail_inside_a_plant_of_ones_own():
    class Wrapped(Perturbation):
        def on_loop(self, loop):
            return replace(
                loop, plant=untyped(SimpleNamespace(plant=loop.plant, timestep=loop.plant.timestep))
            )

    scenario = replace(
        jobs.clean_barrel(quick=True),
        perturbations=(Wrapped(), ThrusterFailure(thruster="sway", at=0.0)),
    )
    with pytest.raises(
        ConfigurationError, match="must be listed before perturbations that wrap the plant"
    ):
        assemble(scenario)


def test_a_task_of_another_kind_is_refused():
    scenario = jobs.clean_barrel()
    assert scenario.task_of(SurfaceWorkTask) is scenario.task
    with pytest.raises(
        ConfigurationError, match="'clean_barrel': needs InsertionTask, has SurfaceWorkTask"
    ):
        scenario.task_of(InsertionTask)
