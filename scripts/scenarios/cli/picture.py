"""Pictures of a run that has ended: `uuv picture RUN` renders a still and a clip from its recorded motion."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from scenarios.cli.past_runs import run_folder

STILL, CLIP = "scene.png", "clip.webp"
_USAGE = f"""usage: uuv picture RUN

Renders {STILL}, five seconds after the work began, and {CLIP}, ten seconds of the whole run, into its folder: by
MuJoCo's renderer, or by ray casting where there is no OpenGL.
RUN: folder of a run, or the name of a job for its latest."""


def main(verb: str, args: Sequence[str]) -> int:
    """Renders both; returns the exit code."""
    del verb
    if len(args) != 1 or args[0].startswith("-"):
        print(_USAGE)
        return 0 if args and args[0] in ("-h", "--help") else 2
    for file in pictures(run_folder(args[0])):
        print(file.resolve())
    return 0


def pictures(folder: Path) -> Iterator[Path]:
    """Still and clip of the run in `folder`, each when it is written.

    Raises:
        ConfigurationError: The run has no series, or its scenario cannot be read or names what there is not.
    """
    from scenarios.inputs import check_inputs
    from scenarios.scenario_file import SCENARIO_FILE, read_scenario
    from sim.reporting.series_tables import SLOW, PastRun

    past, scenario = PastRun.of(folder), read_scenario(folder / SCENARIO_FILE)
    past.units(SLOW)
    check_inputs(scenario)
    from scenarios import first_start

    first_start.build()
    from scenarios.cli.run_scene import render

    yield from render(scenario, past, folder / STILL, folder / CLIP)
