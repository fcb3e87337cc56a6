"""Study of the faults that are named while nothing fails: what it draws, what it counts, and the
check switched off.
"""

from dataclasses import asdict, replace

import numpy as np
import pytest

from experiments.faults.false_alarms import CURRENT, GUST, WAVE, WORKERS, draw, false_alarms
from untyped import untyped
from uuv import assemble, jobs
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import FaultKind


def row(run: int, *faults: str, **more):
    """Row of a run of the default vehicle that was done, not repeated without the check."""
    end = {"ended": "done", "why": "", "touched": True, "faults": [*faults], "digest": "a"}
    case = asdict(draw(7, run)) | {"vehicle": "uuv_puma", "job": "tap"}
    return {**case, **end, "unchecked": None, "same": None, **more}


def test_the_draw_takes_every_job_of_every_vehicle_within_its_seas():
    drawn = [draw(7, i) for i in range(25)]
    assert {(case.vehicle, case.job) for case in drawn} == {
        (worker.name, job) for worker in WORKERS for job in worker.jobs
    }

    speeds, waves = (
        [float(np.linalg.norm(v)) for v in vs]
        for vs in zip(*((case.current, case.wave) for case in drawn), strict=True)
    )
    assert 0.5 * CURRENT < max(speeds) <= CURRENT
    assert 0.5 * WAVE < max(waves) <= WAVE
    assert min(waves) == 0.0
    assert max(case.gust for case in drawn) <= GUST
    assert draw(7, 3, paired=True) == replace(drawn[3], paired=True)


def test_the_scenario_of_a_case_has_its_sea():
    case = draw(7, 4)
    site = case.scenario().site
    drawn = (case.current, case.gust, case.wave, case.wave_frequency)
    assert (site.current, site.gust, site.wave, site.wave_frequency) == drawn
    with pytest.raises(ConfigurationError, match=r"job of uuv_puma_side: .*pile.*got 'tap'"):
        replace(draw(7, 1), job="tap")


def test_a_gyro_or_an_attitude_that_is_named_fails_the_study_and_another_fault_is_counted():
    sound = false_alarms.summary([row(0), row(1, "thruster sway", ended="thruster lost")])
    assert sound.accepted
    (table,) = sound.tables
    assert table.rows[-1] == ["all", "2", "1", "0", "1", "0", "0", "1"]

    for kind in (FaultKind.GYRO, FaultKind.ATTITUDE):
        unchecked = {"ended": "done", "digest": "b"}
        paired = row(2, f"{kind.value} x", ended="attitude wrong", unchecked=unchecked, same=False)
        summary = false_alarms.summary([row(0), paired])
        assert not summary.accepted
        assert [line.split(":")[0] for line in summary.lines] == ["run 2, uuv_puma, tap"]
        ((same, left, left_without),) = summary.tables[1].rows
        assert same.startswith("0.0 (")
        assert same.endswith("of 1")
        assert (left, left_without) == ("1", "0")


def test_navigation_does_without_the_check_where_it_is_left_out():
    scenario = jobs.clean_barrel(quick=True, seed=4)
    without = replace(scenario, control=replace(scenario.control, without=("gyro-check",)))
    estimators = [
        untyped(assemble(loop_scenario).parts.estimator) for loop_scenario in (scenario, without)
    ]
    assert [estimator.check_gyro for estimator in estimators] == [True, False]
