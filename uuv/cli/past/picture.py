"""`uuv picture RUN`: a still and a clip from the recorded motion of a run."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import arg

from uuv.cli.past.past_runs import Run, Trust, run_folder, scenario_of
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import finite_number, shown
from uuv.sim.runs.command_line import parse

STILL, CLIP = "scene.png", "clip.webp"
_SIZE = re.compile(r"(\d{1,6})x(\d{1,6})")


@dataclass(kw_only=True)
class PictureOptions:
    """Draw a still, in the middle of the work, and a clip of the whole run.

    Both go into its folder, as scene.png and clip.webp, unless a file is named.
    """

    run: Run
    size: Annotated[str, arg(metavar="WIDTHxHEIGHT")] = "1280x720"
    """Size of the pictures [px]."""
    still: Annotated[Path | None, arg(metavar="FILE")] = None
    """Write this still, *.png, *.webp or *.jpg, and no clip unless one is named."""
    clip: Annotated[Path | None, arg(metavar="FILE.webp")] = None
    """Write this clip, at most 1.5 MB, and no still unless one is named."""
    at: float | None = None
    """Time of the still [s]."""
    begin: float | None = None
    """First time of the clip [s]; default: of the run."""
    end: float | None = None
    """Last time of the clip [s]; default: of the run."""
    frames: int | None = None
    """Frames of the clip, at even times of the run, 15 a second; default: 150."""
    gl: Literal["auto", "on", "off"] = "auto"
    """Draw by OpenGL (on), by ray casting (off), or by rays where there is no OpenGL (auto)."""
    trust: Trust = False


def main(verb: str, args: Sequence[str]) -> int:
    """Draws both; returns the exit code."""
    del verb
    options = parse(PictureOptions, args)
    folder = run_folder(options.run)
    width, height = size_of(options.size)

    from uuv.inputs import check_inputs
    from uuv.pictures.run_pictures import FRAMES, PictureFiles, scene_of_past, write_pictures
    from uuv.sim.reporting.scene.run_scene import PictureStyle
    from uuv.sim.reporting.series_tables import SLOW, PastRun

    # All that can be refused, before anything is compiled.
    past = PastRun.of(folder)
    scenario = scenario_of(folder, trust=options.trust)
    past.units(SLOW)
    chosen = options.still is not None or options.clip is not None
    _refuse_idle(options, chosen=chosen)
    files = PictureFiles(
        still=options.still if chosen else folder / STILL,
        clip=options.clip if chosen else folder / CLIP,
        at=options.at,
        frames=FRAMES if options.frames is None else options.frames,
    )
    title = f"{scenario.name.replace('_', '-')}, {scenario.vehicle.vehicle}"
    style = PictureStyle(width=width, height=height, gl=options.gl, title=title)
    check_inputs(scenario)
    for name in ("at", "begin", "end"):
        if (time := getattr(options, name)) is not None:
            finite_number(time, f"{name} [s]", least=0.0, most=past.simulated_s)
    begin = options.begin
    end = options.end
    if begin is not None and end is not None and begin > end:
        raise ConfigurationError(f"begin [s] is after end: {begin:g} and {end:g}")

    with scene_of_past(past, scenario, style, (begin, end)) as scene:
        for file in write_pictures(scene, files):
            print(file.resolve())
    return 0


def _refuse_idle(options: PictureOptions, *, chosen: bool) -> None:
    """Refuse options of a still or a clip that is not written."""
    if chosen and options.still is None and options.at is not None:
        raise ConfigurationError("at: is the time of a still; --clip alone writes none")
    for name in ("begin", "end", "frames"):
        if chosen and options.clip is None and getattr(options, name) is not None:
            raise ConfigurationError(f"{name}: is of a clip; --still alone writes none")


def size_of(text: str) -> tuple[int, int]:
    """Width and height [px] in WIDTHxHEIGHT.

    Raises:
        ConfigurationError: It is another text.
    """
    match = _SIZE.fullmatch(text)
    if match is None:
        raise ConfigurationError(f"size: WIDTHxHEIGHT in pixels, like 1280x720, got {shown(text)}")
    return int(match[1]), int(match[2])
