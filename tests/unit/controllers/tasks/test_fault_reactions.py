"""The watch over the work at its bounds: just within each nothing happens, just beyond it breaks off in its time."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from controllers.tasks.fault_reactions import Reaction, choose_reaction
from controllers.tasks.surface_task_config import SurfaceTaskConfig
from sim.interfaces.messages import WorkState

STEP = 0.02  # [s]
JOB = SurfaceTaskConfig(forces=(60.0,))


def broken_off(work_state: WorkState, felt: float, seconds: float) -> tuple[float, str] | None:
    """When [s] and why the work is broken off under a constant felt force [N]; None: not within `seconds`."""
    state: Any = SimpleNamespace(
        state=work_state,
        X_WB=np.eye(4),
        hull_move=None,
        joint_moves=(),
        still_since=0.0,
        hull_waited=0.0,
        force=60.0,
        held_at=0.0,
        contact_at=0.0,
    )
    for tick in range(round(seconds / STEP)):
        estimate: Any = SimpleNamespace(time=tick * STEP, X_WB=np.eye(4))
        verdict = choose_reaction(JOB, state, estimate, felt, ())
        if verdict.reaction is not Reaction.GO_ON:
            return tick * STEP, verdict.reason
    return None


@pytest.mark.parametrize(
    ("work_state", "within", "beyond", "after", "why"),
    [
        (
            WorkState.WORK,
            (1.0 + JOB.excess) * 60.0 + 0.9 * JOB.touch,
            (1.0 + JOB.excess) * 60.0 + 1.1 * JOB.touch,
            JOB.excess_time,
            "cannot be held",
        ),
        (WorkState.WORK, 0.55 * JOB.touch, 0.45 * JOB.touch, JOB.lost_time, "contact lost"),
    ],
)
def test_a_force_beyond_its_bound_ends_the_work_in_its_time(work_state, within, beyond, after, why):
    assert broken_off(work_state, within, 4.0 * after + 1.0) is None
    found = broken_off(work_state, beyond, 4.0 * after + 1.0)
    assert found is not None
    assert after < found[0] < after + 2.5 * STEP
    assert why in found[1]


def test_a_hull_that_does_not_become_quiet_is_waited_for_so_long_and_no_longer():
    found = broken_off(WorkState.SETTLE, 0.0, 2.0 * JOB.settle_limit)
    assert found is not None
    assert JOB.settle_limit < found[0] < JOB.settle_limit + 2.5 * STEP
    assert "quiet" in found[1]
