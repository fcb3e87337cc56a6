"""Pictures of a run that has ended: `uuv picture RUN` renders a still and a clip from its recorded motion."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from uuv.cli.past_runs import TRUST_HELP, run_folder, scenario_of
from uuv.kinds import TRUST

STILL, CLIP = "scene.png", "clip.webp"
_USAGE = f"""usage: uuv picture RUN [{TRUST}]

Renders {STILL}, five seconds after the work began, and {CLIP}, ten seconds of the whole run, into its folder: by
MuJoCo's renderer, or by ray casting where there is no OpenGL.
RUN: folder of a run, or the name of a job for its latest.
{TRUST_HELP}"""


def main(verb: str, args: Sequence[str]) -> int:
    """Renders both; returns the exit code."""
    del verb
    names = [arg for arg in args if arg != TRUST]
    if len(names) != 1 or names[0].startswith("-"):
        print(_USAGE)
        return 0 if {"-h", "--help"} & {*names} else 2
    for file in pictures(run_folder(names[0]), trust=TRUST in args):
        print(file.resolve())
    return 0


def pictures(folder: Path, *, trust: bool = False) -> Iterator[Path]:
    """Still and clip of the run in `folder`, each when it is written; `trust`: also by code that its scenario names.

    Raises:
        ConfigurationError: The run has no series, or its scenario cannot be read or names what there is not.
    """
    from uuv.inputs import check_inputs
    from uuv.sim.reporting.series_tables import SLOW, PastRun

    past, scenario = PastRun.of(folder), scenario_of(folder, trust=trust)
    past.units(SLOW)
    check_inputs(scenario)
    from uuv import first_start

    first_start.build()
    from uuv.cli.run_scene import render

    yield from render(scenario, past, folder / STILL, folder / CLIP)
