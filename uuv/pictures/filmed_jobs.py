"""Jobs that the gallery films: command, figures beside the clip, and from when it goes."""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from uuv.sim.interfaces.messages import WorkState


@dataclass(frozen=True, slots=True, kw_only=True)
class FilmedJob:
    """A job as a clip."""

    name: str  # of the file
    about: str
    command: str  # words after `uuv run`
    figures: Sequence[str]  # names of its checks
    begin: WorkState = WorkState.CLOSE_IN  # phase in which the clip begins
    size: tuple[int, int] = (640, 360)  # [px] width and height
    frames: int = 60

    def film(self, file: Path) -> list[tuple[str, str]]:
        """Runs the job, and films it into `file`; names of figures, and values with units."""
        from uuv import jobs, run
        from uuv.assembly import assemble
        from uuv.jobs.command_line import parsed
        from uuv.pictures.run_pictures import PictureFiles, scene_of_run, write_pictures
        from uuv.sim.reporting.results_table import figures_of
        from uuv.sim.reporting.scene.run_scene import PictureStyle

        # The run that the command describes.
        name, *options = shlex.split(self.command)
        job = jobs.named(name)
        values, _ = parsed(job, options)
        assembly = assemble(job.scenario(values), full=True)
        ended = run(assembly)

        # Its clip, by rays, which are the same anywhere.
        width, height = self.size
        style = PictureStyle(width=width, height=height, gl="off", title=f"uuv run {name}")
        begun = [e.time for e in ended.recording.events if e.state is self.begin]
        with scene_of_run(ended, style, (begun[0] if begun else None, None)) as scene:
            list(write_pictures(scene, PictureFiles(clip=file, frames=self.frames)))

        checks = {check.name: check for check in ended.assessment.checks}
        verdict = "accepted" if ended.assessment.accepted else "not accepted"
        values_of = [f"{figures_of(checks[word])[0]} {checks[word].unit}" for word in self.figures]
        return [("verdict", verdict), *zip(self.figures, values_of, strict=True)]


_PRESSED = ("force error, RMS", "force error, peak", "path deviation, peak", "hull excursion, peak")

FILMED = (
    FilmedJob(
        name="clean_barrel",
        about="60 and 90 N along the top of a barrel",
        command="clean-barrel",
        figures=_PRESSED,
        size=(960, 540),
        frames=100,
    ),
    FilmedJob(
        name="clean_pile",
        about="up a pile, by an arm at the vehicle's side",
        command="clean-pile --quick",
        figures=_PRESSED,
    ),
    # Other shapes, holes and ground.
    FilmedJob(
        name="clean_object",
        about="along an arm of a starfish",
        command="clean-object --object starfish --quick",
        figures=_PRESSED,
    ),
    FilmedJob(
        name="insert_sampler",
        about="a tube into a hole with 2 mm of play",
        command="insert-sampler --quick",
        figures=("hole position error", "depth reached", "side force, peak"),
    ),
    FilmedJob(
        name="sample_seabed",
        about="a core of sand",
        command="sample-seabed --quick",
        figures=("target height error", "push, peak", "depth of the core", "hull, excursion"),
        begin=WorkState.SCAN,
    ),
    FilmedJob(
        name="collect",
        about="a stone off the seabed, into a basket",
        command="collect --quick",
        figures=(
            "put, distance from the middle",
            "grip force, peak",
            "object slips in the jaws",
            "hull excursion after the lift",
        ),
    ),
    FilmedJob(
        name="turn_valve",
        about="a valve by its lever, a quarter turn",
        command="turn-valve --quick",
        figures=("handle angle, error", "moment, mean", "moment, RMS error", "hull excursion"),
        begin=WorkState.APPROACH,
    ),
    FilmedJob(
        name="move_plug",
        about="a plug out of one receptacle, into the other",
        command="move-plug --quick",
        figures=("collar above its seat", "side force, peak", "pull, peak", "hull excursion"),
        begin=WorkState.APPROACH,
    ),
    # Without contact.
    FilmedJob(
        name="inspect_object",
        about="an orbit around a barrel, without contact",
        command="inspect-object --quick",
        figures=("distance, RMS error", "pointing error, peak", "surface seen"),
        begin=WorkState.SETTLE,
    ),
    FilmedJob(
        name="identify_friction",
        about="joints swung, to identify the friction of their gears",
        command="identify-friction --quick",
        figures=(),
        begin=WorkState.SETTLE,
    ),
    FilmedJob(
        name="open_water",
        about="keeping station in a current",
        command="open-water --quick --current 0.2 0.1 0",
        figures=(),
        begin=WorkState.SETTLE,
        frames=45,
    ),
)
