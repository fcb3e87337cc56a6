"""`uuv identify object`: a known object in one depth frame, from a file or simulated."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uuv.cli.json_output import file_alone
from uuv.clouds.options import IdentificationOptions, check_inputs
from uuv.sim.runs.command_line import as_base
from uuv.sim.runs.saving import write_json
from uuv.start import new_folder, parse

if TYPE_CHECKING:  # not needed for a help text
    from rich.console import Console

    from uuv.models.objects.target_model import TargetModel
    from uuv.perception.registration.identification import Identification
    from uuv.perception.registration.recognition import Recognition

NOT_ACCEPTED = 1  # exit code for the decisions rescan and refuse
_RESULT = "identification.json"


@dataclass(kw_only=True)
class ObjectVerb(IdentificationOptions):
    """Identify a known object in one depth frame: a point cloud from a file, or a simulated scene.

    The result is the pose, the decision, the clouds and pictures. Where an accepted object differs
    from its model (growth, silt, dents) the regions are listed and shown in colour.

    The object is a name of the library, or a file: a mesh, or a cloud of its surface. With --among
    the command decides which of several objects is in the frame. Coordinates are those of the
    sensor (x right, y down, z ahead). Exit code 0: accepted; 1: rescan or refused; 2: invalid file
    or option.
    """

    json: bool = False
    """Print identification.json alone."""


def main(verb: str, args: Sequence[str]) -> int:
    """Runs the identification, writes its files; returns the exit code."""
    del verb
    options = parse(ObjectVerb, args)
    plain = as_base(options, IdentificationOptions)
    work = partial(identify_object, plain)
    return file_alone(work, _RESULT) if options.json else work()


def identify_object(options: IdentificationOptions) -> int:
    """Checks the inputs, identifies, writes the files of the result; returns the exit code.

    Raises:
        UuvError: An option or a file is wrong.
    """
    check_inputs(options)
    from uuv.clouds import identification
    from uuv.models.meshes.ply_files import write_ply
    from uuv.models.objects import targets
    from uuv.perception.registration.pose_check import Decision
    from uuv.sim.runs.terminal import PlainConsole

    console = PlainConsole()
    folder = new_folder("identify_object", options.out, options.seed)

    # A single known object; or the choice among several, which then gives the decision.
    several = None
    if options.among:
        models = identification.models_among(options)
        several, notes = identification.recognised_in(options, models)
        pose = several.found
        target = models[several.candidates[0].name]
    else:
        target = targets.of(options.object, options.mesh_scale)
        pose, notes = identification.found_in(options, target)
    judge = pose if several is None else several
    decision = judge.decision.value
    accepted = judge.decision is Decision.ACCEPT

    for note in notes:
        console.print(note, highlight=False)
    reason = f": {judge.reason}" if judge.reason else ""
    console.print(f"{target.name}: {decision}{reason}", highlight=False)

    content = identification.report(pose, target, notes)
    content |= {"decision": decision, "reason": judge.reason}
    if several is not None:
        content["candidates"] = identification.candidates_of(several)
        print_candidates(several, console)
    if accepted:
        print_pose(pose, target, console)
        content["deformation"] = deformation(pose, target.name, folder, console)

    write_json(folder / _RESULT, content)
    write_ply(folder / "cloud.ply", pose.cloud)
    write_ply(folder / "model.ply", pose.model_after)
    figure = identification.picture(pose, f"{target.name}: {decision}")
    figure.savefig(folder / "identification.png", dpi=120)
    console.print(f"written to {folder}/", highlight=False)
    return 0 if accepted else NOT_ACCEPTED


def print_candidates(several: "Recognition", console: "Console") -> None:
    """Prints how likely each of several objects is."""
    candidates = several.candidates
    likely = ", ".join(f"{rival.name} {rival.log_likelihood:.0f}" for rival in candidates)
    ahead = f"{several.margin:.0f} nat above the next; " if len(candidates) > 1 else ""
    console.print(f"{ahead}log likelihoods [nat]: {likely}", highlight=False)


def print_pose(pose: "Identification", target: "TargetModel", console: "Console") -> None:
    """Prints middle and attitude of the object with their standard deviations, the choice among
    symmetric poses, and the time taken.
    """
    import numpy as np

    from uuv.sim.interfaces.spatial import log_so3, transform_points

    p_C = transform_points(pose.X_sensor_target, target.center)
    turn = np.degrees(log_so3(pose.X_sensor_target[:3, :3]))
    position = angle = ""
    if pose.covariance is not None:
        sigma_p, sigma_R = pose.covariance.held_sigmas
        position = f", standard deviation {1e3 * sigma_p:.1f} mm"
        angle = f", standard deviation {np.degrees(sigma_R):.1f} deg"

    lines = [
        f"middle at ({', '.join(f'{value:.4f}' for value in p_C)}) m{position}",
        f"rotation vector ({', '.join(f'{value:.1f}' for value in turn)}) deg{angle}",
    ]
    if pose.symmetry.axis is not None or pose.symmetry.turns > 1:
        lines.append(f"symmetric object: {pose.symmetry.policy}")
    for line in (*lines, f"found in {pose.duration_s:.2f} s"):
        console.print(line, highlight=False)


def deformation(
    pose: "Identification", name: str, folder: Path, console: "Console"
) -> dict[str, Any]:
    """Figures of an object's deviations from its model; also prints, writes and draws them."""
    from uuv.clouds import deformation_report
    from uuv.perception.toolpath.deformation import map_deformation

    mapped = map_deformation(pose)
    if mapped.regions:
        console.print(deformation_report.table(mapped))
        deformation_report.save_cloud(mapped, folder / "deformation.ply")
        title = f"{name}: deviation from its model above {1e3 * mapped.size_m:.1f} mm"
        figure = deformation_report.picture_of_deviations(mapped, title)
        figure.savefig(folder / "deformation.png", dpi=120)
    else:
        line = (
            f"no deviation from the model above {1e3 * mapped.size_m:.1f} mm on the "
            f"{mapped.compared:.0%} of the surface in view that was compared"
        )
        console.print(line, highlight=False)
    return deformation_report.figures(mapped)
