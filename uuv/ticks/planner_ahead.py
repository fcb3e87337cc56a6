"""The planner's next periods as a table of set points, for one stretch of compiled ticks."""

from collections.abc import Sequence

from uuv.sim.interfaces.kernels.foresight import ROWS, Foresight, ReferenceTable, foresees
from uuv.sim.interfaces.messages import Reference
from uuv.sim.loop.rollout import Rollout
from uuv.sim.plant.plant import Plant

# number of calls of `look` that return no rows, after a table of which no row was taken
_REST = 8


class PlannerAhead:
    """Gets the next periods from the planner of a run, and advances its state to the rows taken."""

    def __init__(self, run: Rollout, plant: Plant) -> None:
        """Take the run, and its plant without wrappers."""
        self._run = run
        self._step = float(plant.model.opt.timestep)
        self._substeps = round(plant.timestep / self._step)
        self._foresight: Foresight | None = None
        self._rest = 0  # remaining number of calls of `look` that return no rows
        planner = run.parts.planner
        self._planner = planner if foresees(planner) else None
        self.table = ReferenceTable(len(plant.truth.q))

    def look(self, tick: int, first: int, end: int) -> int:
        """Fill the table for the planner's ticks from `first` on, before `end`; return the number
        of rows.

        Args:
            tick: Present tick, of the estimate or the one after it.
            first: First tick of the planner that is not planned yet.
            end: Number after the last tick that may be run.
        """
        run = self._run
        if self._planner is None:
            return 0
        if self._rest:
            self._rest -= 1
            return 0

        known = tick if run.stage else tick - 1
        times = self._times(first - known, (end - first - 1) // run.planner_ticks + 1)
        self._foresight = self._planner.ahead(run.planner_state, run.estimate, run.target, times)
        if self._foresight is None:
            return 0
        self.table.fill(self._foresight)
        return len(self._foresight.times)

    def _times(self, ticks: int, periods: int) -> Sequence[float]:
        """Times [s] of estimates: in `ticks` ticks, and then in each of the `periods`; summed as in
        MuJoCo.
        """
        time = self._run.estimate.time
        times: list[float] = []

        for _ in range(min(periods, ROWS)):
            for _ in range(ticks * self._substeps):
                time += self._step
            times.append(time)
            ticks = self._run.planner_ticks
        return times

    def close(self) -> Sequence[Reference]:
        """Advance the planner to the rows that were taken, and return its set points."""
        foresight = self._foresight
        if foresight is None or self._planner is None:
            return ()
        run = self._run
        taken = self.table.taken
        self.table.clear()
        self._foresight = None
        if not taken:
            self._rest = _REST
            return ()

        run.planner_state = self._planner.followed(run.planner_state, foresight, taken)
        return foresight.references[:taken]
