"""A job is called with its own arguments and with the options of its scenario, by keyword and on
the command line.
"""

import inspect
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuv import assemble, jobs
from uuv.catalogue import things
from uuv.cli.run_job import EveryJob
from uuv.controllers.planning.promise import StopLimits
from uuv.inputs import check_inputs
from uuv.jobs import (
    Job,
    clean_barrel,
    clean_object,
    clean_pile,
    collect,
    insert_sampler,
    inspect_object,
    open_water,
    sample_seabed,
    turn_valve,
)
from uuv.jobs.command_line import options_class, parsed, typed
from uuv.jobs.job import as_job
from uuv.jobs.scenario_options import every_option
from uuv.scenario import Scenario, Task
from uuv.scenario_file import from_dict
from uuv.sensors.arm_camera import ArmCameraSetup
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.options import option
from uuv.site import Barrel, HoleManifold, KnownObject, OpenWater, Site
from uuv.tasks.insertion import InsertionTask
from uuv.tasks.seabed_sampling import SeabedSamplingTask
from uuv.tasks.station_keeping import StationKeepingTask
from uuv.tasks.surface_work import SurfaceWorkTask, ToolTurn

ALL = [jobs.named(name) for name in jobs.JOBS.names()]


def work(scenario: Scenario) -> SurfaceWorkTask:
    return scenario.task_of(SurfaceWorkTask)


@pytest.mark.parametrize("job", ALL, ids=lambda job: job.name)
def test_every_option_has_its_word_and_its_key(job: Job):
    options = job.options()
    nested = job()
    assert {"seed", "current", "gust", "wave", "vehicle", "controller", "quick"} <= {*options}
    for word, option_of_job in options.items():
        assert option_of_job.about.endswith("."), word
        if option_of_job.key:
            nested_value: Any = nested
            for name in option_of_job.key.split("."):
                assert name in {field.name for field in fields(nested_value)}
                nested_value = getattr(nested_value, name)
                if nested_value is None:  # a table that is absent
                    break


@pytest.mark.parametrize("job", ALL, ids=lambda job: job.name)
def test_defaults_that_are_given_change_nothing(job: Job):
    options = {word: entry for word, entry in job.options().items() if word != "quick"}
    for word, option_of_job in options.items():
        scenario = job(**{word: option_of_job.default})
        if option_of_job.key:
            assert scenario == job(), word


def test_own_arguments_come_before_the_options_of_the_scenario():
    scenario = clean_barrel(
        path="transverse", arc=90.0, seed=4, azimuth=10.0, current=(0.0, 0.2, 0.0)
    )
    assert isinstance(scenario.site.object, Barrel)
    assert scenario.site.object.arc == np.radians(90.0)
    assert scenario.site.object.azimuth == np.radians(10.0)
    assert (scenario.seed, scenario.site.current) == (4, (0.0, 0.2, 0.0))
    assert work(scenario).forces == (60.0, 90.0)  # those of a path around the object
    assert work(clean_barrel(path="transverse", forces=(60.0, 90.0, 60.0))).forces == (
        60.0,
        90.0,
        60.0,
    )


def test_units_are_those_of_the_command_line():
    hole = insert_sampler(clearance=1.5, depth=40.0, error=(2.5, -1.0))
    assert isinstance(hole.site.object, HoleManifold)
    assert hole.site.object.clearance == 1e-3 * 1.5
    assert hole.site.object.depth == pytest.approx(0.06)
    shown = insert_sampler.options()
    assert (shown["clearance"].default, shown["error"].default) == (2.0, (0.0, 0.0))
    assert clean_barrel.options()["corner"].default == 90.0


def test_a_table_that_is_absent_is_made_by_the_option_that_it_needs():
    assert work(clean_barrel(turn=30.0, blend=0.05)).turn == ToolTurn(
        angle=float(np.radians(30.0)), blend=0.05
    )
    assert work(clean_barrel(turn=None)).turn is None
    assert work(clean_barrel(stop_every=2.0)).promise.stops == StopLimits(every=2.0)
    assert work(clean_barrel(stop_every=0.0)).promise.stops is None
    assert clean_barrel(arm_camera=True).sensing.arm_camera == ArmCameraSetup()
    with pytest.raises(
        ConfigurationError,
        match=r"^task\.turn\.blend 0\.05: needs "
        r"task\.turn\.angle too$",
    ):
        clean_barrel(blend=0.05)


def test_an_option_that_a_task_does_not_heed_is_none_of_its_jobs():
    assert "sensor" in clean_barrel.options()
    for job in (insert_sampler, sample_seabed, open_water):
        assert "sensor" not in job.options()
    with pytest.raises(
        ConfigurationError,
        match=r"job insert-sampler has no 'sensor'.*; it has "
        r"depth, quick, ",
    ):
        insert_sampler(sensor="sonar")


@pytest.mark.parametrize(
    "job", [insert_sampler, sample_seabed, collect, turn_valve, inspect_object, open_water]
)
@pytest.mark.parametrize(("key", "choice"), [("sensor", "sonar"), ("looks", 4)])
def test_a_scenario_with_a_sensor_that_its_task_does_not_use_is_refused(job, key, choice):
    scenario = job()
    check_inputs(scenario)
    other = replace(scenario, sensing=replace(scenario.sensing, **{key: choice}))
    task = type(scenario.task).__name__
    with pytest.raises(
        ConfigurationError, match=rf"^sensing\.{key}: {task} does not use it; .*, got '?{choice}"
    ):
        check_inputs(other)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"spede": 3.0}, "has no 'spede' .did you mean speed.*; it has path, arc"),
        ({"speed": "fast"}, "^speed: must be a number, got 'fast'"),
        ({"forces": 60.0}, "^forces: must be a list, got 60.0"),
        ({"current": (1.0, 2.0)}, "^current: must be 3 values"),
        ({"path": "round"}, "^path: allowed longitudinal, transverse, corner, got 'round'"),
        ({"seed": 1.5}, "^seed: must be a whole number"),
        ({"quick": 1}, "^quick: must be true or false"),
        ({"speed": float("nan")}, r"^task\.speed \[m/s\]"),
        ({"line": (0.0, 0.0, 1.0, 0.0)}, "has no 'line'"),
        ({"arc": 0.0}, r"^arc \[deg\]: must be positive"),
        ({"path": "transverse", "arc": -20.0}, r"^arc \[deg\]: must be positive"),
    ],
)
def test_a_wrong_argument_is_refused_at_the_call(given: dict[str, Any], message: str):
    with pytest.raises(ConfigurationError, match=message):
        clean_barrel(**given)


def test_numbers_of_numpy_and_paths_are_taken():
    scenario = clean_object(forces=np.array([40.0, 50.0]), seed=np.int64(3), arm=Path("a.yaml"))
    assert (work(scenario).forces, scenario.seed, scenario.belief.arm) == (
        (40.0, 50.0),
        3,
        "a.yaml",
    )
    assert type(scenario.seed) is int


def test_the_signature_is_that_of_all_options():
    parameters = inspect.signature(clean_pile).parameters
    assert [*parameters] == [*clean_pile.options()]
    assert parameters["range"].default == 1.8
    assert (clean_pile.about, clean_pile.name) == (
        "Clean a vertical pile with a set force.",
        "clean-pile",
    )


def test_what_a_quick_job_changes_is_told():
    options = clean_barrel.options()
    assert options["length"].about.endswith("With --quick by default 0.2.")
    assert clean_barrel(quick=True).site.object == replace(
        Barrel(), length=0.2, arc=float(np.radians(60.0))
    )


def test_the_command_line_passes_on_what_was_typed_and_nothing_else():
    options, _ = parsed(clean_barrel, ["--path", "transverse", "--no-calibrated", "--stop_every=2"])
    assert options == {"path": "transverse", "calibrated": False, "stop_every": 2.0}
    assert typed(["--a-b", "--c=1", "--no-d", "x"]) == {"a_b", "c", "no_d", "d"}
    kind = options_class(clean_barrel)
    assert vars(kind)["keys"]["turn"] == "task.turn.angle"


OWN = '''
from typing import Literal
from uuv.jobs import job
from uuv.scenario import Scenario
from uuv.site import KnownObject, Site
from uuv.tasks.surface_work import SurfaceWorkTask


@job
def sweep_rock(*, width: float = 0.2, way: Literal["across", "along"] = "across") -> Scenario:
    """Sweep a rock.

    Args:
        width: Of the sweep [m].
        way: Across its
            path, or along.
    """
    x, y = (0.0, 0.5 * width) if way == "across" else (0.5 * width, 0.0)
    site = Site(object=KnownObject(line=(-x, -y, x, y)))
    return Scenario(name="sweep_rock", site=site, task=SurfaceWorkTask(least=0.5))


def plain(*, seconds: float = 3.0):
    """Plain."""
    from uuv.tasks.station_keeping import StationKeepingTask
    from uuv.site import OpenWater
    task = StationKeepingTask(seconds=seconds)
    return Scenario(name="plain", site=Site(object=OpenWater()), task=task)


def nothing():
    return 3


def needs(width):
    return None
'''


@pytest.fixture
def own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Runs `uuv` beside a module of the user's own."""
    (tmp_path / "own_jobs_here.py").write_text(OWN)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)

    def uuv(*args: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "uuv", *args], capture_output=True, text=True, check=False
        )

    return uuv


def test_a_job_of_ones_own_has_its_options_and_help(
    own: Callable[..., subprocess.CompletedProcess[str]],
):
    sweep = jobs.named("own_jobs_here:sweep_rock")
    scenario = sweep(width=0.4, way="along", seed=5, speed=0.03)
    assert isinstance(scenario.site.object, KnownObject)
    assert scenario.site.object.line == (-0.2, 0.0, 0.2, 0.0)
    assert (scenario.seed, work(scenario).speed) == (5, 0.03)
    text = " ".join(
        own("run", "own_jobs_here:sweep_rock", "--help").stdout.replace("│", " ").split()
    )
    for part in (
        "Sweep a rock.",
        "--width FLOAT Of the sweep [m].",
        "Across its path, or along.",
        "--current",
    ):
        assert part in text
    wrong = own("run", "own_jobs_here:sweep_rock", "--widht", "3")
    assert (wrong.returncode, "did you mean --width?" in wrong.stderr) == (2, True)


def test_a_plain_function_is_a_job_too(own: Callable[..., subprocess.CompletedProcess[str]]):
    del own
    plain = jobs.named("own_jobs_here:plain")
    assert plain(seconds=5.0, gust=0.0).task == StationKeepingTask(seconds=5.0)
    assert plain.about == "Plain."


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("own_jobs_here:nothing", "job nothing: must return a uuv.Scenario, got int"),
        ("own_jobs_here:needs", "job needs: width must be a keyword argument with a default"),
        ("own_jobs_here:OWN_NAME", "cannot be imported"),
        ("own_jobs_here:Scenario", "must be a function that returns a uuv.Scenario"),
        ("no_such_module:job", "cannot be imported"),
        ("clean-barel", "did you mean clean-barrel"),
    ],
)
def test_what_is_no_job_is_one_line(
    own: Callable[..., subprocess.CompletedProcess[str]], name: str, message: str
):
    with pytest.raises(ConfigurationError, match=message):
        jobs.named(name)()
    ran = own("run", name)
    assert ran.returncode == 2
    assert ran.stderr.count("\n") == 1
    assert message in ran.stderr


@dataclass(frozen=True, kw_only=True)
class Drift(Task):
    """Drift for some time."""

    seconds: float = option(4.0, "Time to drift [s].", word="drifting")
    depth: float = 1.0

    def place(self, scenario, own, rng):
        raise NotImplementedError


def test_a_task_of_ones_own_brings_its_options():
    base = replace(open_water(), task=Drift())
    assert open_water.options(base)["drifting"].key == "task.seconds"
    assert "seconds" not in open_water.options(base)
    kind = options_class(open_water, base=base)
    assert "drifting" in {field.name for field in fields(kind)}
    scenario = open_water.scenario(
        {"drifting": 9.0, "seed": 2}, lambda made: replace(made, task=Drift())
    )
    assert (scenario.task, scenario.seed) == (Drift(seconds=9.0), 2)


def test_open_water_has_no_object():
    scenario = open_water(seconds=12.0, current=(0.2, 0.0, 0.0))
    assert isinstance(scenario.site.object, OpenWater)
    assert scenario.task == StationKeepingTask(seconds=12.0)
    assert from_dict(
        {"name": "a", "task": {"kind": "StationKeeping"}, "site": {"object": {"kind": "OpenWater"}}}
    )
    with pytest.raises(ConfigurationError, match=r"^task\.seconds \[s\]"):
        open_water(seconds=0.0)


def test_an_argument_without_a_type_takes_anything():
    def made(*, site=None) -> Scenario:
        return replace(open_water(), site=site or Site(object=OpenWater()))

    assert as_job(made, "made")(site=Site(object=OpenWater(), gust=0.0)).site.gust == 0.0


@pytest.mark.parametrize(
    "kind",
    [SurfaceWorkTask, StationKeepingTask, InsertionTask, SeabedSamplingTask],
    ids=lambda kind: kind.__name__,
)
def test_what_a_task_heeds_are_options(kind: type[Task]):
    """A word that is none would be passed over in silence."""
    everything = {option.word for job in ALL for option in every_option(job())}
    assert {*kind.heeds} <= everything


def test_the_list_of_jobs_is_the_registry():
    assert dict(things("job")) == {job.name: job.about for job in ALL}


def test_a_word_with_two_meanings_is_refused():
    def loud(*, json: bool = True) -> Scenario:
        return open_water(quick=json)

    @dataclass(frozen=True, kw_only=True)
    class Stream(Drift):
        fast: float = option(1.0, "Of the stream [m/s].", word="current")

    with pytest.raises(ConfigurationError, match="job loud: json is also an option of every run"):
        options_class(Job(loud), EveryJob)
    with pytest.raises(
        ConfigurationError,
        match=r"^task\.fast and site\.current: both are the "
        r"option 'current'",
    ):
        open_water.options(replace(open_water(), task=Stream()))


def test_a_task_that_is_placed_nowhere_is_one_line():
    @dataclass(frozen=True, kw_only=True)
    class Nowhere(Drift):
        def place(self, scenario, own, rng):
            return None

    with pytest.raises(
        ConfigurationError,
        match=r"^task Nowhere: place must return a PlacedTask, "
        r"got NoneType",
    ):
        assemble(replace(open_water(), task=Nowhere()))
