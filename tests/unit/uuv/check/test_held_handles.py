"""The check of jobs that hold a handle: promised with the load that can be given, or refused with
the figure.
"""

import re
from dataclasses import replace

import pytest

from uuv.check.check import check_vehicle
from uuv.check.conditions import Conditions
from uuv.check.jobs import ArmJobs
from uuv.check.remedies import changes_for
from uuv.own_vehicle import vehicle_spec

ONE = Conditions(poses=1)
long = pytest.mark.long(
    guarded_by="tests/unit/uuv/check/test_held_handles.py::"
    "test_a_weaker_arm_is_refused_with_the_moment_that_it_can_give_and_with_one_that_passes"
)


def test_a_weaker_arm_is_refused_with_the_moment_that_it_can_give_and_with_one_that_passes() -> (
    None
):
    spec = vehicle_spec("uuv_puma", None, None, "handle_socket")
    for joint in range(1, 7):
        motor = spec.actuator(f"joint{joint}")
        motor.ctrlrange = 0.6 * motor.ctrlrange
    verdict = ArmJobs("uuv_puma", override=spec, conditions=ONE).verdict("turn-valve", 0.0)

    # About 0.6 of the 31 N m of the whole arm, less the share of its own weight.
    assert not verdict.promised
    assert verdict.code == "moment"
    assert verdict.figure is not None
    assert 10.0 < verdict.figure < 0.6 * 31.5
    asked = re.search(r"--moment (\d+)", verdict.remedy)
    assert asked is not None
    assert float(asked[1]) <= verdict.figure


@long
@pytest.mark.parametrize("job", ["turn-valve", "turn-valve-bar", "move-plug"])
def test_the_generic_vehicle_is_promised_with_what_it_can_give(job: str) -> None:
    verdict = check_vehicle("uuv_puma", jobs=(job,), conditions=replace(ONE, poses=3)).verdict(job)
    assert verdict.promised, verdict.said
    assert "it can " in verdict.said


@pytest.mark.parametrize("job", ["turn-valve", "turn-valve-bar", "move-plug"])
def test_an_arm_of_four_joints_is_refused_with_their_number(job: str) -> None:
    verdict = ArmJobs("bluerov2_heavy_alpha5", conditions=ONE).verdict(job, 0.0)
    assert (verdict.promised, verdict.code, verdict.figure) == (False, "joints", 4.0)
    assert "at least 6 are needed" in verdict.said


def test_the_speed_of_a_path_is_not_that_of_a_handle() -> None:
    jobs = ArmJobs("uuv_puma", conditions=replace(ONE, speed=0.03))
    assert jobs.scenario("turn-valve").task == ArmJobs("uuv_puma").scenario("turn-valve").task


def test_a_pull_that_is_too_much_is_tried_with_less() -> None:
    scenario = ArmJobs("uuv_puma").scenario("move-plug")
    tried = [change.typed for change in next(changes_for("pull", "move-plug", scenario))]
    assert tried == ["--pull 32", "--pull 24", "--pull 16", "--pull 8"]
