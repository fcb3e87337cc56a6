"""Identification of a known object from one depth frame: a point cloud from a file, or a simulated scene.

The result is the pose, the decision, the clouds and pictures. Where an accepted object differs from its model (growth,
silt, dents) the regions are listed and shown in colour.

The object is one of the library by name, or a mesh file. Coordinates are those of the sensor (x right, y down, z
ahead). Exit code 0: accepted; 1: rescan or refused; 2: invalid file or option.
"""

from scenarios.start import new_folder, parse, run_scenario  # isort: skip

from rich.console import Console

from models.meshes.ply_files import write_ply
from models.objects import targets
from perception.toolpath.deformation import map_deformation
from scenarios.cloud_commands.deformation_report import figures, picture_of_deviations, save_cloud, table
from scenarios.cloud_commands.identification import IdentificationOptions, found_in, picture, report
from sim.interfaces.spatial import transform_points
from sim.runs.saving import write_json

NOT_ACCEPTED = 1  # exit code for the decisions rescan and refuse


def main() -> int:
    """Runs the identification, writes its files and returns the exit code."""
    options, console = parse(IdentificationOptions), Console()
    folder = new_folder("identify_object", options.out, options.seed)
    target = targets.of(options.object, options.mesh_scale)
    found, notes = found_in(options, target)
    decision = found.decision.value
    for note in notes:
        console.print(note, highlight=False)
    console.print(f"{target.name}: {decision}{': ' + found.reason if found.reason else ''}", highlight=False)
    if found.accepted:
        center = ", ".join(f"{value:.4f}" for value in transform_points(found.X_sensor_target, target.center))
        console.print(f"middle at ({center}) m; {found.symmetry.policy}; {found.duration_s:.2f} s", highlight=False)
    said = report(found, target, notes)
    if found.accepted:
        made = map_deformation(found)
        said["deformation"] = figures(made)
        if made.regions:
            console.print(table(made))
            save_cloud(made, folder / "deformation.ply")
            title = f"{target.name}: off its model by more than {1e3 * made.size_m:.1f} mm"
            picture_of_deviations(made, title).savefig(folder / "deformation.png", dpi=120)
        else:
            compared = f"of the {made.compared:.0%} of the surface in view that was compared"
            console.print(f"nothing {compared} lies off its model beyond doubt", highlight=False)
    write_json(folder / "identification.json", said)
    write_ply(folder / "cloud.ply", found.cloud)
    write_ply(folder / "model.ply", found.model_after)
    picture(found, f"{target.name}: {decision}").savefig(folder / "identification.png", dpi=120)
    console.print(f"written to {folder}/", highlight=False)
    return 0 if found.accepted else NOT_ACCEPTED


if __name__ == "__main__":
    run_scenario(main)
