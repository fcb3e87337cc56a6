"""A tool that stops on its path: it stands still while it says so, and what it says reaches
navigation.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from uuv.assembly import assemble
from uuv.controllers.planning.promise import StopLimits
from uuv.jobs import clean_barrel
from uuv.perception.navigation.strapdown_filter import Navigation, NavigationState
from uuv.runner import run
from uuv.scenario import Sensing
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import FaultKind, Measurement, StateEstimate, ToolAtRest, WorkState


@dataclass(frozen=True, kw_only=True)
class Listening(Navigation):
    """Navigation that keeps what the planner says."""

    told: list[ToolAtRest] = field(default_factory=list)

    def step(
        self, state: NavigationState, measurements: Sequence[Measurement]
    ) -> tuple[NavigationState, StateEstimate]:
        """As that of navigation."""
        self.told.extend(m for m in measurements if isinstance(m, ToolAtRest))
        return Navigation.step(self, state, measurements)


@pytest.mark.long(
    guarded_by="tests/unit/controllers/tasks/test_stops.py::test_each_stop_says_when_it_began_and_that_nothing_has_moved_since"
)
def test_a_stopped_tool_does_not_creep_and_the_path_goes_on():
    poor = Sensing(sensor="survey", vision_noise=5e-3, vision_period=0.2, vision_delay=0.2)
    assembly = assemble(replace(clean_barrel(seed=2, quick=True, stop_every=2.0), sensing=poor))
    estimator = assembly.parts.estimator
    assert isinstance(estimator, Navigation)
    listening = Listening(standing=estimator.standing)
    messages = listening.told
    parts = replace(assembly.parts, estimator=listening)
    outcome = run(replace(assembly, loop=replace(assembly.loop, parts=parts)))
    recording = outcome.recording
    assert len(messages) >= 6  # two messages a stop reach the estimator, each once
    assert len({m.time for m in messages}) == len(messages)
    work = recording.within(WorkState.WORK)
    path_s = recording["path_s"]
    pad = recording["p_pad"]
    s, time = path_s.scalar, path_s.time
    still = np.flatnonzero(
        work[1:] & (np.diff(s) < 1e-9) & (s[1:] > 1e-3) & (s[1:] < s.max() - 1e-3)
    )
    stops = [
        time[rows[[0, -1]]] for rows in np.split(still, np.flatnonzero(np.diff(still) > 1) + 1)
    ]
    settle, lasting = StopLimits().settle, StopLimits().lasting
    stops = [(begin, end) for begin, end in stops if end - begin > settle + 0.9 * lasting]
    assert len(stops) >= 3
    crept = []
    for begin, end in stops:
        p_stopped = pad.value[(pad.time > begin + settle) & (pad.time < end)]
        crept.append(float(np.linalg.norm(p_stopped - p_stopped[0], axis=1).max()))
    assert max(crept) < 1.5e-4  # [m]; measured 0.01 to 0.03 mm
    assert outcome.assessment.metrics["contact"]["lost_s"] == 0.0
    assert s.max() == pytest.approx(0.2, abs=1e-3)


@dataclass(frozen=True, kw_only=True)
class Failing(Listening):
    """Navigation in which an encoder is frozen from the moment a tool stands still."""

    def step(
        self, state: NavigationState, measurements: Sequence[Measurement]
    ) -> tuple[NavigationState, StateEstimate]:
        """As that of navigation until the first message of a stop."""
        state, estimate = Listening.step(self, state, measurements)
        if not self.told:
            return state, estimate
        q, qd = estimate.q.copy(), estimate.qd.copy()
        q[1] = self.told[0].q[1]
        qd[1] = 0.0
        return state, replace(estimate, q=q, qd=qd)


@pytest.mark.long
def test_a_fault_while_the_tool_stands_ends_the_work_without_harm():
    poor = Sensing(vision_noise=5e-3, vision_period=0.2, vision_delay=0.2)
    assembly = assemble(replace(clean_barrel(seed=2, quick=True, stop_every=1.0), sensing=poor))
    estimator = assembly.parts.estimator
    assert isinstance(estimator, Navigation)
    failing = Failing(standing=estimator.standing)
    parts = replace(assembly.parts, estimator=failing)
    outcome = run(replace(assembly, loop=replace(assembly.loop, parts=parts)))
    (stop,) = failing.told[:1]
    recording = outcome.recording
    force = recording["contact_most"]
    begun = recording.within(WorkState.WORK)
    assert outcome.result.last.reference.state is WorkState.ABORT
    assert (FaultKind.ENCODER, 1) in [
        (fault.kind, fault.index) for fault in outcome.result.last.command.faults
    ]
    assert force.time[begun].max() < stop.time + 0.5
    assert force.scalar[force.time > stop.time].max() < 1.1 * 60.0
    assert force.scalar[force.time > stop.time + 1.0].max() == 0.0


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"arm_camera": True}, "sensing.arm_camera"),
        ({"contactless": 0.03}, "task.contactless"),
        ({"without": ("fusion",)}, "control.without fusion"),
    ],
)
def test_stops_that_would_tell_nothing_are_refused(options, why):
    with pytest.raises(ConfigurationError, match=f"task.promise.stops .*{why}"):
        assemble(clean_barrel(stop_every=2.0, **options))
