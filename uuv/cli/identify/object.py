"""`uuv identify object`: a known object in one depth frame, a point cloud from a file or a simulated scene."""

from collections.abc import Sequence
from dataclasses import dataclass

from uuv.cli.json_output import file_alone
from uuv.clouds.options import IdentificationOptions, check_inputs
from uuv.sim.runs.command_line import as_base
from uuv.sim.runs.saving import write_json
from uuv.start import new_folder, parse

NOT_ACCEPTED = 1  # exit code for the decisions rescan and refuse
_RESULT = "identification.json"


@dataclass(kw_only=True)
class ObjectVerb(IdentificationOptions):
    """Identify a known object in one depth frame: a point cloud from a file, or a simulated scene.

    The result is the pose, the decision, the clouds and pictures. Where an accepted object differs from its model
    (growth, silt, dents) the regions are listed and shown in colour.

    The object is one of the library by name, or a file: a mesh, or a cloud of its surface. With --among the command
    finds out which of several objects it is. Coordinates are those of the sensor (x right, y down, z ahead). Exit code
    0: accepted; 1: rescan or refused; 2: invalid file or option.
    """

    json: bool = False
    """Print identification.json alone."""


def main(verb: str, args: Sequence[str]) -> int:
    """Runs the identification, writes its files; returns the exit code."""
    del verb
    options = parse(ObjectVerb, args)
    plain = as_base(options, IdentificationOptions)
    return file_alone(lambda: identify_object(plain), _RESULT) if options.json else identify_object(plain)


def identify_object(options: IdentificationOptions) -> int:
    """Checks the inputs, identifies, writes the files of the result; returns the exit code.

    Raises:
        UuvError: An option or a file is wrong.
    """
    check_inputs(options)
    from uuv.clouds.deformation_report import figures, picture_of_deviations, save_cloud, table
    from uuv.clouds.identification import candidates_of, found_in, models_among, picture, recognised_in, report
    from uuv.models.meshes.ply_files import write_ply
    from uuv.models.objects import targets
    from uuv.perception.registration.pose_check import Decision
    from uuv.perception.toolpath.deformation import map_deformation
    from uuv.sim.interfaces.spatial import transform_points
    from uuv.sim.runs.terminal import PlainConsole

    console = PlainConsole()
    folder = new_folder("identify_object", options.out, options.seed)

    made = None
    if options.among:
        models = models_among(options)
        made, notes = recognised_in(options, models)
        found, target = made.found, models[made.candidates[0].name]
        decision, reason = made.decision.value, made.reason
    else:
        target = targets.of(options.object, options.mesh_scale)
        found, notes = found_in(options, target)
        decision, reason = found.decision.value, found.reason

    accepted = decision == Decision.ACCEPT.value
    for note in notes:
        console.print(note, highlight=False)
    console.print(f"{target.name}: {decision}{': ' + reason if reason else ''}", highlight=False)
    if made is not None:
        others = ", ".join(f"{each.name} {each.log_likelihood:.0f}" for each in made.candidates)
        ahead = f"{made.margin:.0f} nat ahead of the next; " if len(made.candidates) > 1 else ""
        console.print(f"{ahead}log likelihoods [nat]: {others}", highlight=False)
    if accepted:
        center = ", ".join(f"{value:.4f}" for value in transform_points(found.X_sensor_target, target.center))
        console.print(f"middle at ({center}) m; {found.symmetry.policy}; {found.duration_s:.2f} s", highlight=False)

    said = report(found, target, notes) | {"decision": decision, "reason": reason}
    if made is not None:
        said["candidates"] = candidates_of(made)

    if accepted:
        mapped = map_deformation(found)
        said["deformation"] = figures(mapped)
        if mapped.regions:
            console.print(table(mapped))
            save_cloud(mapped, folder / "deformation.ply")
            title = f"{target.name}: off its model by more than {1e3 * mapped.size_m:.1f} mm"
            picture_of_deviations(mapped, title).savefig(folder / "deformation.png", dpi=120)
        else:
            compared = f"of the {mapped.compared:.0%} of the surface in view that was compared"
            console.print(f"nothing {compared} lies off its model beyond doubt", highlight=False)

    write_json(folder / _RESULT, said)
    write_ply(folder / "cloud.ply", found.cloud)
    write_ply(folder / "model.ply", found.model_after)
    picture(found, f"{target.name}: {decision}").savefig(folder / "identification.png", dpi=120)
    console.print(f"written to {folder}/", highlight=False)
    return 0 if accepted else NOT_ACCEPTED
