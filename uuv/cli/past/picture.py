"""`uuv picture RUN`: a still and a clip from the recorded motion of a run."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from uuv.cli.past.past_runs import Run, Trust, run_folder, scenario_of
from uuv.sim.runs.command_line import parse

STILL, CLIP = "scene.png", "clip.webp"


@dataclass(kw_only=True)
class PictureOptions:
    """Render a still, 5 s after the work began, and a clip of the whole run into its folder.

    MuJoCo renders them, or ray casting if there is no OpenGL.
    """

    run: Run
    trust: Trust = False


def main(verb: str, args: Sequence[str]) -> int:
    """Renders both; returns the exit code."""
    del verb
    options = parse(PictureOptions, args)
    for file in pictures(run_folder(options.run), trust=options.trust):
        print(file.resolve())
    return 0


def pictures(folder: Path, *, trust: bool = False) -> Iterator[Path]:
    """Still and clip of a run, each when it is written; `trust`: run its scenario's code too.

    Raises:
        ConfigurationError: The run has no series, or its scenario cannot be read or has an unknown
            name.
    """
    from uuv.inputs import check_inputs
    from uuv.sim.reporting.series_tables import SLOW, PastRun

    past = PastRun.of(folder)
    scenario = scenario_of(folder, trust=trust)
    past.units(SLOW)
    check_inputs(scenario)
    from uuv import first_start

    first_start.build()
    from uuv.cli.past.run_scene import render

    yield from render(scenario, past, folder / STILL, folder / CLIP)
