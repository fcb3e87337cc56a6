"""The leash of a hull that is carried away: what is asked for stays near it, but for the return to
its depth.
"""

import numpy as np
import pytest

from at_rest import at_rest
from uuv.controllers.tasks.hull_phases import Leash, heading
from uuv.sim.interfaces.spatial import exp_so3, pose

LEASH = Leash()
STILL = np.zeros(3)


def turned(angle: float, p: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    return pose(exp_so3([0.0, 0.0, angle]), p)


def test_a_reference_near_a_hull_at_rest_is_left_alone():
    X_WB = turned(0.1, (0.02, -0.03, -0.04))
    X, v, w = LEASH.pull(X_WB, np.array([0.01, 0.0, 0.02]), at_rest())
    assert pytest.approx(X_WB) == X
    assert v == pytest.approx([0.01, 0.0, 0.02])
    assert w == pytest.approx(STILL)


def test_a_far_reference_is_pulled_to_the_hull_in_its_direction():
    X, _, _ = LEASH.pull(turned(0.0, (3.0, 4.0, -2.0)), STILL, at_rest())
    assert X[:3, 3] == pytest.approx([0.6 * LEASH.place, 0.8 * LEASH.place, -LEASH.place])


def test_a_hull_that_sinks_is_asked_to_return_from_any_depth():
    X, v, _ = LEASH.pull(
        turned(0.0, (0.0, 0.0, 2.0)), STILL, at_rest(v_WB_B=np.array([0.0, 0.0, -1.0]))
    )
    assert X[:3, 3] == pytest.approx([0.0, 0.0, 2.0])
    assert v == pytest.approx(STILL)


def test_the_velocity_of_a_hull_that_is_carried_away_is_nearly_granted():
    """In hull axes that are turned by a quarter, 1 m/s ahead is 1 m/s along y of the world."""
    estimate = at_rest(
        X_WB=turned(np.pi / 2), v_WB_B=np.array([1.0, 0.0, 0.7]), w_WB_B=np.array([0.0, 0.0, -2.0])
    )
    _, v, w = LEASH.pull(turned(np.pi / 2), STILL, estimate)
    assert v == pytest.approx([0.0, 1.0 - LEASH.speed, 0.7 - LEASH.speed])
    assert w == pytest.approx([0.0, 0.0, -2.0 + LEASH.turn])


@pytest.mark.parametrize("off", [0.5, -0.5, 3.0, -3.0])
@pytest.mark.parametrize("of_hull", [0.0, 3.0, -2.5])
def test_the_heading_follows_a_hull_that_spins_and_stays_level(off, of_hull):
    X, _, _ = LEASH.pull(turned(of_hull + off), STILL, at_rest(X_WB=turned(of_hull)))
    assert heading(turned(-of_hull)[:3, :3] @ X[:3, :3]) == pytest.approx(
        np.copysign(LEASH.heading, off)
    )
    assert X[2, 2] == pytest.approx(1.0)
