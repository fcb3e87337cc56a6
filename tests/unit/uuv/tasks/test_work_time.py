"""Work too short for its forces or its speed is refused with what would do, and that then
passes.
"""

import re
from dataclasses import replace

import numpy as np
import pytest

from uuv import assemble, jobs
from uuv.controllers.planning.trajectories import Progress
from uuv.jobs import insert_sampler, sample_seabed
from uuv.scenario import Scenario
from uuv.sim.evaluation.surface.force_levels import long_enough
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.site import Barrel, Pile
from uuv.tasks.insertion import InsertionTask
from uuv.tasks.seabed_sampling import SeabedSamplingTask
from uuv.tasks.surface_work import SurfaceWorkTask
from uuv.tasks.work_time import WorkTime

QUICK = WorkTime(length=0.2, speed=0.02, forces=(60.0, 90.0, 60.0), force_rate=60.0)


@pytest.mark.parametrize("length", [0.05, 0.6])
def test_time_is_the_inverse_of_the_way(length: float, within):
    """Where the speed is reached, and where it is not."""
    progress = Progress(length, 0.1, 1.0)
    times = np.linspace(0.0, progress.duration, 50)
    # 1e-8 at the ends
    within("time [s]", [progress.time(progress.at(t)[0]) - t for t in times], 1e-6)


def test_time_judged_of_each_force():
    """Third parts of 2 m at 0.1 m/s: half a second is lost to the ramps, 1 s after each change."""
    third = 2.0 / 0.1 / 3.0
    work = replace(QUICK, length=2.0, speed=0.1)
    assert work.judged() == pytest.approx([third + 0.5, third - 1.0, third + 0.5 + 0.5 - 1.0])
    alike = replace(work, forces=(60.0, 60.0, 90.0))
    assert alike.judged() == pytest.approx([2.0 * third + 0.5, third + 0.5 + 0.5 - 1.0])
    slowly = replace(work, force_rate=10.0)  # 3 s, and half a second more
    assert slowly.judged()[1] == pytest.approx(third - 3.5)


@pytest.mark.parametrize(
    "work",
    [
        replace(QUICK, speed=0.08),
        replace(QUICK, speed=0.3, length=0.6),
        replace(QUICK, forces=(40.0, 50.0) * 8),
        replace(QUICK, force_rate=3.0),
        replace(QUICK, forces=(), speed=0.3),
        replace(QUICK, forces=(60.0,), length=0.02),
    ],
)
def test_what_a_refusal_proposes_would_do(work: WorkTime):
    with pytest.raises(ConfigurationError, match="would suffice") as refused:
        work.check()
    line = str(refused.value)
    for pattern, name in (
        (r"task.speed ([0-9.e-]+)[, ](?!over)", "speed"),
        (r"a path of ([0-9.]+) m", "length"),
    ):
        (proposed,) = re.findall(pattern, line.partition(";")[2])
        better = replace(work, **{name: float(proposed)})
        better.check()
        assert not better.forces or long_enough(min(better.judged()))


@pytest.mark.parametrize("speed", [0.01, 0.02, 0.04, 0.05, 0.08])
def test_usual_speeds_are_not_refused(speed: float):
    QUICK.slowed(min(speed, 0.04) / QUICK.speed).check()
    replace(QUICK, length=0.6, speed=speed).check()


def test_it_is_refused_at_the_door():
    from uuv.inputs import check_inputs

    with pytest.raises(
        ConfigurationError,
        match=r"task\.speed 0\.08 over 0\.2 m: the set force "
        r"of 90 N, 2 of 3",
    ):
        check_inputs(jobs.clean_barrel(quick=True, speed=0.08))
    with pytest.raises(
        ConfigurationError,
        match=r"longest 100 s: must be longer than the work, which takes at least 2002 s",
    ):
        check_inputs(jobs.clean_barrel(speed=0.0003), longest=100.0)
    with pytest.raises(ConfigurationError, match=r"longest \[s\]"):
        check_inputs(jobs.clean_barrel(), longest=-1.0)


def test_a_slow_job_has_the_time_that_it_needs():
    task = jobs.clean_barrel(speed=0.0005).task
    assert isinstance(task, SurfaceWorkTask)
    assert assemble(jobs.clean_barrel(speed=0.0005)).placed.longest > 1.5 * 0.6 / 0.0005
    assert assemble(jobs.clean_barrel()).placed.longest == 400.0


def test_an_option_that_is_given_wins_over_a_quick_job():
    def site(scenario: Scenario) -> tuple[float, float]:
        of = scenario.site.object
        assert isinstance(of, Barrel | Pile)
        return round(np.degrees(of.arc), 9), of.length

    assert site(jobs.clean_barrel(quick=True, path="transverse", arc=360.0)) == (360.0, 0.2)
    assert site(jobs.clean_barrel(quick=True, length=0.6)) == (60.0, 0.6)
    assert site(jobs.clean_barrel()) == (180.0, 0.6)
    assert site(jobs.clean_pile(quick=True, arc=100.0, length=0.5)) == (100.0, 0.5)
    deep = insert_sampler(quick=True, depth=60.0).task
    assert isinstance(deep, InsertionTask)
    assert deep.depth == pytest.approx(0.06)
    hard = sample_seabed(quick=True, push=50.0).task
    assert isinstance(hard, SeabedSamplingTask)
    assert hard.push == 50.0
