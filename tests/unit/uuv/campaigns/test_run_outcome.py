"""What came of a run: its class and reason, and the figures that damage is told by."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from short_recording import DT, recording
from uuv.campaigns.run_outcome import (
    CLASSES,
    OVER_SET,
    ending,
    ending_by,
    force_over_set,
    unfolding,
)
from uuv.sim.interfaces.errors import HydrodynamicsError, ReachError
from uuv.sim.interfaces.messages import AbortCode, WorkState

GOOD: dict[str, Any] = {
    "contact.force_error_rms_n": 0.5,
    "contact.force_error_max_n": None,
    "run.collision_s": 0.0,
    OVER_SET: 1.1,
}
DONE = [WorkState.DONE]
OVER = "force above 1.5 times the set force"
WORKED = [
    WorkState.CLOSE_IN,
    WorkState.APPROACH,
    WorkState.PRESS,
    WorkState.WORK,
    WorkState.RETREAT,
]


ABORTED = [*WORKED, WorkState.ABORT]
SCANNED = [WorkState.SCAN, WorkState.ABORT]


@pytest.mark.parametrize(
    ("states", "abort", "figures", "expected"),
    [
        (WORKED + DONE, None, {}, ("done", "")),
        (WORKED + DONE, None, {OVER_SET: 1.5}, ("done", "")),
        (WORKED + DONE, None, {OVER_SET: 1.6}, ("damage", OVER)),
        (WORKED + DONE, None, {OVER_SET: None}, ("done", "")),
        (WORKED + DONE, None, {"run.collision_s": 0.01}, ("damage", "collision of the vehicle")),
        (
            WORKED + DONE,
            None,
            {"contact.force_error_rms_n": np.inf, OVER_SET: 1.6},
            ("diverged", "a figure is not finite"),
        ),
        (ABORTED, AbortCode.CONTACT_LOST, {}, ("broken off", "contact lost")),
        (ABORTED, AbortCode.FORCE_LIMIT, {}, ("broken off", "force limit")),
        (ABORTED, AbortCode.THRUSTER, {OVER_SET: 2.5}, ("damage", OVER)),
        (WORKED, None, {}, ("broken off", "not finished in time")),
        (WORKED, AbortCode.VISION, {}, ("broken off", "vision lost")),
        (
            [WorkState.SETTLE, WorkState.ABORT],
            AbortCode.HULL_NOT_AT_REST,
            {},
            ("refused", "hull not at rest"),
        ),
        (SCANNED, AbortCode.OUT_OF_REACH, {}, ("refused", "out of reach")),
        (SCANNED, AbortCode.NOT_IDENTIFIED, {}, ("refused", "not identified")),
    ],
)
def test_the_end_of_a_run_has_a_class_and_a_reason(states, abort, figures, expected):
    """The reason is the code; words of the sentence beside it tell nothing."""
    note = "contact lost: out of reach, not identified"
    outcome: Any = SimpleNamespace(
        recording=recording(states, note=note, abort=abort),
        assembly=SimpleNamespace(placed=SimpleNamespace(begun=(WorkState.WORK,))),
    )
    outcome_class = ending(outcome, {**GOOD, **figures})
    assert outcome_class == expected
    assert outcome_class[0] in (*CLASSES, "done")


def test_an_error_ends_a_run_by_its_kind():
    assert ending_by(HydrodynamicsError("too fast")) == ("diverged", "unstable motion")
    assert ending_by(ReachError("too far")) == ("refused", "ReachError")
    assert ending_by(ZeroDivisionError()) == ("crashed", "ZeroDivisionError")


def test_force_is_measured_against_what_is_set_then():
    """Before the work against the first set force, however little is asked for yet; at work against
    the present one.
    """
    states = [WorkState.APPROACH, WorkState.PRESS, WorkState.WORK, WorkState.WORK]
    force = np.repeat([0.0, 20.0, 60.0, 30.0], round(1.0 / DT))
    over = force_over_set(
        recording(states, force, np.repeat([30.0, 66.0, 63.0, 45.0], round(1.0 / DT))), 60.0
    )
    assert over == pytest.approx(1.5)
    over = force_over_set(
        recording(states, force, np.repeat([30.0, 96.0, 63.0, 45.0], round(1.0 / DT))), 60.0
    )
    assert over == pytest.approx(1.6)


def test_damage_is_of_the_largest_force_of_a_substep():
    most = np.repeat([30.0, 60.0, 60.0], round(1.0 / DT))
    most[700] = 84.0
    over = force_over_set(
        recording([WorkState.APPROACH, WorkState.PRESS, WorkState.WORK], contact_most=most), 60.0
    )
    assert over == pytest.approx(1.4)


def test_the_hull_is_off_its_place_where_that_stands_still():
    """It travels for a second, 0.2 m behind; then it is 5 cm off while the arm unfolds, 0.3 m
    before and after.
    """
    ticks = round(1.0 / DT)
    reference = np.zeros((4 * ticks, 3))
    reference[: ticks + 1] = np.linspace([-1.0, 2.0, 0.0], [0.0, 0.0, 0.0], ticks + 1)
    off = np.repeat(
        [[0.0, 0.12, 0.16], [0.03, 0.0, -0.04], [0.0, 0.03, 0.04], [0.3, 0.0, 0.0]], ticks, axis=0
    )
    states = [WorkState.CLOSE_IN, WorkState.CLOSE_IN, WorkState.TARE, WorkState.WORK]
    run = recording(states, p_WB_reference=reference, p_WB=reference + off)
    assert unfolding(run) == pytest.approx(0.05)
