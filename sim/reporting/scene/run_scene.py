"""Pictures of a run at any of its times, as stills and as a clip."""

import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Literal, Self

import mujoco
import numpy as np

from uuv.sim.evaluation.bounds import Bounds
from uuv.sim.interfaces.errors import ConfigurationError, MissingLibraryError
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.spatial import finite_number, one_of, whole_number
from uuv.sim.loop.recording import RecordedSeries
from uuv.sim.reporting.scene.captions import Captions
from uuv.sim.reporting.scene.gl_picture import GlPicture
from uuv.sim.reporting.scene.poses import Poses
from uuv.sim.reporting.scene.ray_picture import RayPicture
from uuv.sim.reporting.scene.sea import SeaLook
from uuv.sim.reporting.scene.shots import Shots, shots
from uuv.sim.reporting.scene.view import CameraView
from uuv.sim.reporting.scene.work import Work

Gl = Literal["auto", "on", "off"]
Span = tuple[float | None, float | None]  # [s]
LEAST_SIZE = 64  # [px] of a picture, either way
MOST_SIZE = 4096  # [px] of a picture, either way
_ROOM = 3.2  # distance of the view of the tool over half the extent of the path in it
_NEAR = 0.15  # distance of the view of the tool, over the largest one
_STEEPER = 20.0  # [deg] by which it looks down more
_INTO_WORK = 0.5  # share of the work at which a still is taken


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureStyle:
    """Style of the pictures of a run."""

    width: int = 1280  # [px]
    height: int = 720  # [px]
    gl: Gl = "auto"  # "off": by ray casting; "auto": likewise where there is no OpenGL
    title: str = ""
    # [N] error of the force drawn in the last colour; None: the run's bound, else the usual one
    error_scale: float | None = None

    def __post_init__(self) -> None:
        for name, pixels in (("width", self.width), ("height", self.height)):
            whole_number(pixels, f"{name} of a picture [px]", least=LEAST_SIZE, most=MOST_SIZE)
        one_of(self.gl, ("auto", "on", "off"), "gl")
        if self.error_scale is not None:
            finite_number(self.error_scale, "error_scale [N]", above=0.0)

    def judged_by(self, bounds: Bounds | None) -> "PictureStyle":
        """The style with the scale of a run's bounds, where it has none."""
        if self.error_scale is not None or bounds is None:
            return self
        return replace(self, error_scale=bounds.force_error_rms)


class RunScene:
    """Scene of a run in its recorded poses, drawn with path and forces of the tool."""

    def __init__(
        self,
        model: mujoco.MjModel,
        recorded: RecordedSeries,
        style: PictureStyle | None = None,
        span: Span = (None, None),
    ) -> None:
        """Prepare the pictures of a run.

        Args:
            model: The plant's.
            recorded: The run, in full: from memory, or `PastRun.recorded`.
            style: Size and renderer; None: the usual ones.
            span: [s] first and last time of a clip; None: of the run.

        Raises:
            ConfigurationError: The run has no poses of this model, or `span` is not within it.
            MissingLibraryError: There is neither OpenGL nor the ray caster, or what draws text is
                missing.
        """
        self.style = style = style or PictureStyle()
        self.error_scale = style.judged_by(Bounds()).error_scale or 0.0
        self.work = Work.of(recorded)
        self.events = recorded.events
        self._poses = Poses(model, recorded)
        self._whole = float(self._poses.time[0]), float(self._poses.time[-1])  # [s] with poses
        self._duration = max(recorded.duration, self._whole[1])
        self.span = self._checked(span)

        self._captions = Captions(
            style.height,
            style.width,
            style.title,
            most_force=self.work.most_force,
            error_scale=self.error_scale if self.work.judged else None,
        )

        # What draws, and from where.
        self._drawer = _drawer(model, style)
        changes = [event.time for event in recorded.events]
        aspect = style.width / style.height
        self._shots: Shots = shots(model, self._poses, self.work, changes, self.span, aspect)
        self._sea = SeaLook(model, self._shots.reach)

    @property
    def renderer(self) -> str:
        """Name of the renderer: "OpenGL" or "rays"."""
        return "rays" if isinstance(self._drawer, RayPicture) else "OpenGL"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Frees the renderer."""
        self._drawer.close()

    def picture(self, time: float) -> np.ndarray:
        """Picture (h, w, 3), 0 to 255, at a time of the run.

        Args:
            time: [s]

        Raises:
            ConfigurationError: It is not within the run.
        """
        first, last = self._whole
        finite_number(time, "time of a picture [s]", least=first, most=self._duration)
        time = min(time, last)

        view = self.view(time)
        self._poses.put(self._poses.row(time))
        data = self._poses.data
        work = self.work

        # The scene with its marks.
        path = work.path(time, self.error_scale)
        marks = [*path, *work.forces(time, view), *work.current(time, view)]
        drawn = self._drawer.render(data, view, self._sea, marks)

        # The tool from near, beside it.
        readout = work.readout(time)
        near = None
        if readout.touching:
            middle_W, half = work.near(time)
            distance = max(_NEAR * self._shots.reach, _ROOM * half)
            close = CameraView(middle_W, distance, view.azimuth, view.elevation - _STEEPER)
            size = self._captions.near_size
            near = self._drawer.render(
                data, close, self._sea, [*path, *work.forces(time, close)], size=size
            )
        return self._captions.on(drawn, readout, near)

    def view(self, time: float) -> CameraView:
        """The camera's view at a time [s]."""
        return self._shots.at(time)

    def phase(self, time: float) -> str:
        """Phase of the work at a time [s]."""
        return self.work.readout(time).phase

    def pictures(self, times: Iterable[float]) -> Iterator[np.ndarray]:
        """Pictures at several times [s]."""
        return (self.picture(float(time)) for time in times)

    def times(self, count: int) -> np.ndarray:
        """Evenly spaced times (count,) [s] of the span."""
        return np.linspace(*self.span, count)

    def telling(self) -> float:
        """Time [s] in the middle of the work or, without work, of the run."""
        time = self.work.time
        at = float(time[int(_INTO_WORK * (len(time) - 1))]) if len(time) else sum(self._whole) / 2.0
        return float(np.clip(at, *self._whole))

    def moments(self) -> list[float]:
        """Four times [s] of a run: during scan, approach and work, and at the end."""
        begin, end = self.span
        first = {event.state: event.time for event in reversed(self.events)}

        # Where a phase is missing, even times.
        closing = first.get(WorkState.CLOSE_IN, begin + 0.25 * (end - begin))
        touching = first.get(WorkState.APPROACH, begin + 0.5 * (end - begin))
        wanted_times = [closing - 0.1, 0.5 * (closing + touching), self.telling(), end]
        return sorted(float(np.clip(time, begin, end)) for time in wanted_times)

    def _checked(self, span: Span) -> tuple[float, float]:
        """The span, within the recorded times."""
        first, last = self._whole
        begin = first if span[0] is None else span[0]
        end = last if span[1] is None else span[1]
        finite_number(begin, "begin [s]", least=first, most=last)
        finite_number(end, "end [s]", least=first, most=self._duration)
        end = min(end, last)  # the last poses are recorded before the last step
        if begin > end:
            raise ConfigurationError(f"begin [s] is after end: {begin:g} and {end:g}")
        return begin, end


def _drawer(model: mujoco.MjModel, style: PictureStyle) -> GlPicture | RayPicture:
    """MuJoCo's renderer, or ray casting if that is chosen or OpenGL is missing."""
    if style.gl == "off":
        return RayPicture(model, style.height, style.width)
    try:
        return GlPicture(model, style.height, style.width)
    except MissingLibraryError as error:
        if style.gl == "on":
            raise
        print(f"{error}: pictures by ray casting", file=sys.stderr)
        return RayPicture(model, style.height, style.width)
