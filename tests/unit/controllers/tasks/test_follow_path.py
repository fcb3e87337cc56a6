"""The tool on its path: a pause costs its own time, no way, and the force falls meanwhile."""

import numpy as np
import pytest

from at_rest import at_rest
from uuv.controllers.planning.placement import Placement
from uuv.controllers.tasks.contact_phases import FollowPath
from uuv.controllers.tasks.follow_limits import FollowLimits
from uuv.controllers.tasks.phase import Context, Held, PhaseEvent, ToolLine
from uuv.sim.interfaces.messages import ToolPath
from uuv.sim.interfaces.spatial import exp_so3, pose

PERIOD = 0.01  # [s]
LENGTH, SPEED, FORCE = 0.12, 0.02, 60.0  # [m], [m/s], [N]
LIMITS = FollowLimits(speed=SPEED, ramp=1.0, linger=0.5, paused_force=0.5, pace_time=0.5)
X_WT = pose(exp_so3([0.3, -0.2, 1.1]), [1.0, 2.0, -3.0])


def held() -> Held:
    """Before a straight path, askew in W; the hull travels 0.3 m along y."""
    s = np.linspace(0.0, LENGTH, 25)
    ones = np.ones((25, 1))
    R = X_WT[:3, :3]
    path = ToolPath(
        s=s,
        p=X_WT[:3, 3] + s[:, None] * R[:, 0],
        z=-ones * R[:, 2],
        x=ones * R[:, 0],
        on_scan=np.ones(25, dtype=bool),
    )
    travel = np.array([0.0, 0.3, 0.0])
    placement = Placement(
        X_WB=X_WT, travel_W=travel, roll=0.2, q_start=np.zeros(6), margin=1.0, reached=1.0
    )
    line = ToolLine(path=path, placement=placement, offset=0.0)
    return Held(X_WB=X_WT, X_WB_scan=X_WT, q=np.zeros(6), line=line, set_force=FORCE)


def followed(*pauses: tuple[float, float]) -> np.ndarray:
    """Rows (N, 4) of time [s], place [m], commanded speed [m/s] and force [N]; paused from and to
    each pair [s].
    """
    here = held()
    phase = FollowPath(LIMITS, (FORCE,), rate=200.0)
    rows = []
    state = phase.enter(here, Context(0.0, PERIOD, at_rest(), None, None))
    for tick in range(4000):
        time = tick * PERIOD
        paused = any(begin <= time < end for begin, end in pauses)
        context_of = Context(time, PERIOD, at_rest(time=time), None, None, paused=paused)
        if phase.step(state, here, context_of) is PhaseEvent.DONE:
            return np.array(rows)
        speed = np.linalg.norm(phase.setpoint(state, here, context_of).v_WG_W)
        rows.append((time, here.s, speed, here.set_force))
    raise AssertionError("the path has no end")


def test_a_pause_delays_the_end_by_its_own_time():
    """With ramps of 1 s to 0.02 m/s the path takes 7 s, and lingers 0.5 s; stop and go of the
    pauses cancel.

    In 0.2 s the pace falls by 0.4 only, and takes as long to come back: 0.08 s are lost.
    """
    whole = followed()
    assert whole[-1, 0] == pytest.approx(7.5, abs=1.5 * PERIOD)
    for pauses, lost in (
        ([(2.0, 5.0)], 3.0),
        ([(2.0, 3.0), (4.0, 6.5)], 3.5),
        ([(2.0, 2.2)], 0.08),
    ):
        assert followed(*pauses)[-1, 0] - whole[-1, 0] == pytest.approx(lost, abs=1.5 * PERIOD)


def test_the_tool_stands_through_a_pause_at_less_force_and_its_speed_is_that_of_its_place():
    time, position, speed, force = followed((2.0, 5.0)).T
    still = (time >= 2.0 + LIMITS.pace_time + PERIOD) & (time < 5.0)
    assert np.ptp(position[still]) == pytest.approx(0.0, abs=1e-12)
    assert speed[still].max() == 0.0
    assert np.all(force[still] == 0.5 * FORCE)
    assert force[0] == force[-1] == FORCE
    assert position[-1] == pytest.approx(LENGTH)
    # a period of the ramps
    assert np.gradient(position, time)[1:-1] == pytest.approx(speed[1:-1], abs=1e-3)
