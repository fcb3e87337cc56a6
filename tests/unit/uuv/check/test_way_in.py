"""Contact on the way to the work, by the shapes of the site, and the verdict on it."""

import re

import numpy as np
import pytest

from uuv.check.check import check_vehicle
from uuv.check.conditions import Conditions
from uuv.check.way_in import met_on_the_way
from uuv.controllers.planning.placement import Placement
from uuv.models import load
from uuv.models.objects.targets import pile
from uuv.models.site import scenes
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.spatial import Array, pose

BEFORE, BEHIND = pose(p=[-3.0, 0.0, 0.0]), pose(p=[3.0, 0.0, 0.0])


def placed(X_WB: Array, q: Array) -> Placement:
    """A placement at a hull pose and a posture."""
    return Placement(X_WB=X_WB, travel_W=np.zeros(3), roll=0.0, q_start=q, margin=1.0, reached=1.0)


@pytest.mark.parametrize(
    ("way", "work", "words"),
    [
        ([BEFORE, BEFORE], BEFORE, None),
        ([BEFORE, BEHIND], BEHIND, "on its way to the work the vehicle is .* of 'target'"),
        ([BEFORE, BEFORE], BEHIND, "as it comes near the vehicle is .* of 'target'"),
    ],
)
def test_the_first_contact_is_told_with_its_motion(way, work, words) -> None:
    model = scenes.work_site(load("uuv_puma"), pile(), pose(p=[0.0, 0.0, 0.0])).compile()
    vehicle = Vehicle.of(model)
    met = met_on_the_way(model, vehicle, way, placed(work, np.array(vehicle.q_ready)))
    if words is None:
        assert met is None
        return
    assert met is not None
    said, distance = met
    assert distance < 0.02
    assert re.match(words, said)


@pytest.mark.long
def test_an_arm_that_would_strike_the_pile_is_refused_for_its_way() -> None:
    check = check_vehicle("rexrov_oberon7", jobs=("pile",), conditions=Conditions(poses=1))
    verdict = check.verdict("pile")
    assert (verdict.promised, verdict.code) == (False, "way")
    assert "'end_effector'" in verdict.said
