"""A promise at drawn poses of the object is a share, with the worst of those that pass."""

import pytest

from uuv.check.check import check_vehicle
from uuv.check.findings import JobVerdict
from uuv.check.jobs import of_poses
from uuv.cli.vehicles import check_vehicle as command
from uuv.sim.interfaces.errors import ConfigurationError


def verdict(code: str, figure: float) -> JobVerdict:
    said = f"{code} {figure}"
    return JobVerdict(job="pile", promised=code == "ok", code=code, said=said, figure=figure)


def test_most_poses_must_pass_and_the_commonest_reason_is_told() -> None:
    good = [verdict("ok", 0.8), *(verdict("ok", 0.3 + 0.01 * i) for i in range(18))]
    promise = of_poses([*good, verdict("start", 0.06)])
    assert (promise.promised, promise.code, promise.share) == (True, "ok", 0.95)
    assert promise.figure == 0.3
    assert promise.said == ("19 of 20 poses; worst: ok 0.3; 1 refused for start: start 0.06")

    bad = [verdict("reach", 0.2), verdict("start", 0.06), verdict("start", 0.09)]
    refused = of_poses([*good[:17], *bad])
    assert (refused.promised, refused.code, refused.share) == (False, "start", 0.85)
    assert refused.said.endswith("2 refused for start: start 0.06")
    assert of_poses(bad).said == "0 of 3 poses; 2 refused for start: start 0.06"
    assert of_poses(bad[:1]) == bad[0]  # one pose is told as it is


def test_each_seed_draws_another_pose() -> None:
    drawn = check_vehicle("uuv_puma", jobs=("barrel-longitudinal",), poses=2).verdict(
        "barrel-longitudinal"
    )
    assert drawn.share == 1.0
    assert drawn.figure is not None
    assert drawn.said.startswith("2 of 2 poses; worst: margin")


def test_a_number_of_poses_that_is_none_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="--poses: must be at least 1, got 0"):
        command.main("check", ["uuv_puma", "--poses", "0"])
