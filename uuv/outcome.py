"""What a run leaves for its assessment: `RunResult`, its pictures, and clouds seen on the way."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from uuv.sim.loop.rollout import Moment

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from uuv.sim.loop.recording import Recorder, Recording

Pictures = Iterable[tuple[str, str, "Figure"]]  # title, caption, figure


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunResult:
    """Recording, last moment and wall time of a run."""

    recording: "Recording"
    last: Moment
    wall_s: float
    # why every tick was taken part by part; empty: compiled ticks where nothing slow was due
    part_by_part: str = ""
    slow_parts: tuple[str, ...] = ()  # in plain Python, called by every compiled tick


@dataclass(frozen=True, slots=True)
class NoFigures:
    """Metrics of a task that adds none to those of every run."""


class CloudRecorder:
    """Observer that adds the clouds of each identification to recording and log."""

    slow_ticks = ()

    def __init__(self, recorder: "Recorder", log: Any) -> None:
        self._recorder, self._log = recorder, log

    def observe(self, moment: Moment) -> None:
        """Adds the clouds, in W, if the moment has an identification."""
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
