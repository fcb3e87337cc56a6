"""A planner alone, in a world that a test scripts: where the hull goes, what a look finds, what the
tool feels.
"""

from dataclasses import dataclass, field
from itertools import groupby
from typing import Self

import numpy as np

from at_rest import at_rest
from uuv.controllers.tasks.task import TaskPlanner, TaskState
from uuv.sim.interfaces.messages import (
    Command,
    ContactEstimate,
    Fault,
    Reference,
    StateEstimate,
    Target,
    WorkState,
)
from uuv.sim.interfaces.spatial import Array

ENDS = (WorkState.DONE, WorkState.ABORT)
UNTOUCHED = ContactEstimate(force_W=np.zeros(3), normal=0.0)


@dataclass
class ScriptedWorld:
    """Every reference that a planner gave, in order.

    Unless a test overrides it, the hull is where it should be, the joints are at `q`, a look finds
    nothing, and the tool feels nothing.
    """

    references: list[Reference] = field(default_factory=list, init=False)
    state: TaskState = field(init=False)  # of the planner, after its last step

    def drive(
        self, planner: TaskPlanner, X_WB: Array, seconds: float, q: Array | None = None
    ) -> Self:
        """Let the planner work from a hull at `X_WB`, for `seconds` [s] or until it ends."""
        joints = np.zeros(6) if q is None else q
        command = seen = reference = None

        for tick in range(round(seconds / planner.period)):
            time = tick * planner.period
            estimate = self.estimated(at_rest(time=time, X_WB=X_WB, q=joints), reference)
            scanning = reference is not None and reference.scan
            if reference is None:
                self.state = planner.init(estimate)
            self.state, reference = planner.step(self.state, estimate, seen, command)
            self.references.append(reference)

            X_WB = self.hull_at(X_WB, reference)
            if reference.scan and not scanning:
                seen = self.look(time) or seen
            command = Command(
                time=time,
                joint_torque=np.zeros(6),
                thrusters=np.zeros(6),
                scan=reference.scan,
                contact=self.feel(reference, time),
                faults=self.faults(reference, time),
            )
            if self.over(reference):
                break
        return self

    # --- The script ---

    def estimated(self, estimate: StateEstimate, reference: Reference | None) -> StateEstimate:
        """The estimate that the planner gets, after its last `reference`."""
        del reference
        return estimate

    def hull_at(self, X_WB: Array, reference: Reference) -> Array:
        """Pose of the hull after `reference`, from the one before."""
        del X_WB
        return reference.X_WB

    def look(self, time: float) -> Target | None:
        """What a look finds that begins at `time` [s]; None: what the last one found."""
        del time
        return None

    def feel(self, reference: Reference, time: float) -> ContactEstimate:
        """What the tool feels."""
        del reference, time
        return UNTOUCHED

    def faults(self, reference: Reference, time: float) -> tuple[Fault, ...]:
        """Faults that are known."""
        del reference, time
        return ()

    def over(self, reference: Reference) -> bool:
        """Whether the run ends after `reference`."""
        return reference.state in ENDS

    # --- What the planner gave ---

    @property
    def states(self) -> list[WorkState]:
        """One after another, each once for as long as it lasted."""
        return [state for state, _ in groupby(r.state for r in self.references)]

    @property
    def end(self) -> Reference:
        """The last one; it has a code and a sentence for an abort, and no code without one."""
        last = self.references[-1]
        assert (last.abort is not None and last.note != "") is (last.state is WorkState.ABORT), (
            last.note
        )
        return last

    def of(self, *states: WorkState) -> list[Reference]:
        """Those given in `states`."""
        return [r for r in self.references if r.state in states]
