"""Results of a run for its assessment: `RunResult`, pictures, and point clouds seen during the
run.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from uuv.sim.loop.rollout import Moment

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from uuv.sim.loop.recording import Recorder, Recording

Pictures = Iterable[tuple[str, str, "Figure"]]  # title, caption and figure of a picture


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunResult:
    """Recording, last moment and wall time of a run."""

    recording: "Recording"
    last: Moment
    wall_s: float
    # why every tick ran in Python; empty if ticks without slow components ran compiled
    part_by_part: str = ""
    slow_parts: tuple[str, ...] = ()  # components in plain Python that every compiled tick calls


@dataclass(frozen=True, slots=True)
class NoFigures:
    """Metrics of a task that adds no metrics to those of every run."""


class CloudRecorder:
    """Observer that adds the clouds of each identification to recording and log."""

    slow_ticks = ()

    def __init__(self, recorder: "Recorder", log: Any) -> None:
        self._recorder, self._log = recorder, log

    def observe(self, moment: Moment) -> None:
        """Add the clouds, in W, if the moment has an identification."""
        if moment.frame is None:
            return
        from uuv.perception.finding.target_finder import FinderState

        if not isinstance(moment.found, FinderState) or moment.found.last is None:
            return

        for name in ("cloud", "model_before", "model_after"):
            points_W = moment.found.in_world(getattr(moment.found.last, name))
            self._recorder.add_cloud(name, points_W)
            if self._log is not None:
                self._log.log_cloud(name, points_W, moment.truth.time)
