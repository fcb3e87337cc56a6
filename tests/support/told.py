"""What a planner said, for tests that drive one through a script of their own."""

from dataclasses import dataclass, field
from itertools import groupby

from uuv.sim.interfaces.messages import Reference, WorkState


@dataclass
class Told:
    """Every reference that a planner gave, in order."""

    references: list[Reference] = field(default_factory=list, init=False)

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
