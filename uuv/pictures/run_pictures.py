"""Stills and clips of a run: of one in memory, or of one in its folder."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import whole_number
from uuv.sim.reporting.scene.clip import check_file, check_rate, write_clip, write_still
from uuv.sim.reporting.scene.run_scene import PictureStyle, RunScene, Span

if TYPE_CHECKING:
    from uuv.runner import Run
    from uuv.scenario import Scenario
    from uuv.sim.reporting.series_tables import PastRun

FRAMES = 150  # of a clip
MOST_FRAMES = 600  # likewise
RATE = 15.0  # [1/s] frames shown in a second


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureFiles:
    """What is made of a run."""

    still: Path | None = None
    clip: Path | None = None
    at: float | None = None  # [s] time of the still; None: in the middle of the work
    frames: int = FRAMES  # of the clip, at even times
    rate: float = RATE  # [1/s]

    def __post_init__(self) -> None:
        whole_number(self.frames, "frames", least=2, most=MOST_FRAMES)
        check_rate(self.rate)
        if self.still is not None:
            check_file(self.still, "still")
        if self.clip is not None:
            check_file(self.clip, "clip")


def scene_of_run(
    run: "Run", style: PictureStyle | None = None, span: Span = (None, None)
) -> RunScene:
    """Scene of a run in memory, recorded in full.

    Args:
        run: What `uuv.run` returned.
        style: Size and renderer; None: the usual ones.
        span: [s] first and last time to be seen; None: of the run.

    Raises:
        ConfigurationError: The run was not recorded in full.
        MissingLibraryError: What draws is not installed.
    """
    style = (style or PictureStyle()).judged_by(run.assembly.placed.bounds)
    return RunScene(run.assembly.plant.model, run.recording, style, span)


def scene_of_past(
    past: "PastRun",
    scenario: "Scenario",
    style: PictureStyle | None = None,
    span: Span = (None, None),
) -> RunScene:
    """Scene of a run in its folder; the arguments besides its scenario are as of `scene_of_run`.

    Raises:
        ConfigurationError: The folder has no series, or those of another scenario.
        MissingLibraryError: What draws is not installed.
    """
    from uuv import first_start
    from uuv.assembly import assemble

    recorded = past.recorded
    first_start.build()
    assembly = assemble(scenario)
    style = (style or PictureStyle()).judged_by(assembly.placed.bounds)
    try:
        return RunScene(assembly.plant.model, recorded, style, span)
    except ConfigurationError as error:
        raise ConfigurationError(f"{past.folder}: {error}") from error


def write_pictures(scene: RunScene, files: PictureFiles) -> Iterator[Path]:
    """Writes still and clip of a scene; gives each file when it is written.

    Raises:
        ConfigurationError: A time is not within the scene's span, or the clip grows too large.
    """
    if files.still is not None:
        time = scene.telling() if files.at is None else files.at
        write_still(files.still, scene.picture(time))
        yield files.still

    if files.clip is not None:
        frames = list(scene.pictures(scene.times(files.frames)))
        write_clip(files.clip, frames, files.rate)
        yield files.clip
