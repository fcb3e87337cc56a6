"""Scene builder: a vehicle, an object to work on, and the seabed in one MjSpec."""

from pathlib import Path

import mujoco

from uuv import models
from uuv.models import hydrodynamics
from uuv.models.completing import mapping, urdf_vehicle
from uuv.models.completing.complete import complete, forget, note
from uuv.models.files import sidecar
from uuv.models.files.mjcf_files import compiled, read_mjcf
from uuv.models.files.parts_file import PartsMap, beside, read_parts
from uuv.models.files.urdf import is_urdf
from uuv.models.naming import TOOL_GEOM
from uuv.models.objects.targets import TargetModel
from uuv.models.site.seabed import Seabed
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.interfaces.files import existing_file
from uuv.sim.interfaces.spatial import Array, shown, transform_points

SEABED_DEPTH = 0.75  # [m] of the flat seabed below the object's origin


def vehicle_spec(
    vehicle: str | Path, water: str | Path | None = None, parts: str | Path | None = None
) -> mujoco.MjSpec:
    """Vehicle by its name in `uuv.models.available()`, or from a file; the parts that can be computed are complete.

    An MJCF's coefficients are in its user data, in custom elements, or in a sidecar (`uuv.models.files.sidecar`); a
    URDF's in a sidecar.

    Args:
        vehicle: a name, MODULE:FUNCTION, or a file, MJCF or URDF.
        water: sidecar of the file; None: `NAME.water.yaml` beside it, if there is one.
        parts: file that maps the model's names to those of the contract (`uuv.models.files.parts_file`); None:
            `NAME.parts.yaml` beside the vehicle's file, if there is one.

    Returns:
        Its spec with its water; `uuv.models.completing.complete.computed` tells what was added.

    Raises:
        ConfigurationError: neither a name nor a file, a file that cannot be read or compiled, or a part of the mapping
            that the model has not.
    """
    spec, mapped = given_vehicle(vehicle, water, parts)
    complete(spec)
    if mapped is not None and mapped.trim is not None:
        note(spec, [mapping.ballast(spec, mapped.trim, f"vehicle {shown(str(vehicle))}")])
    return spec


def given_vehicle(
    vehicle: str | Path, water: str | Path | None = None, parts: str | Path | None = None
) -> tuple[mujoco.MjSpec, PartsMap | None]:
    """The spec of a vehicle under the contract's names, and the mapping that gave them; nothing is computed.

    Args and errors are those of `vehicle_spec`.
    """
    if not isinstance(vehicle, str | Path):
        raise ConfigurationError(f"vehicle: expected a name or a file, got {shown(vehicle)}")
    vehicle = str(vehicle)
    mapped, name = None if parts is None else read_parts(parts), f"parts {shown(str(parts))}"
    if ":" in vehicle or vehicle in models.available():
        if water is not None:
            raise ConfigurationError(f"vehicle {shown(vehicle)}: has its own water, so a water file is refused")
        spec = models.load(vehicle)
        if mapped is not None:
            mapping.apply(spec, mapped, name)
            compiled(spec, name)
        return spec, mapped
    if not Path(vehicle).suffix:
        raise ConfigurationError(
            f"unknown vehicle {shown(vehicle)}; there are {', '.join(models.available())}, or a file, MJCF or URDF"
            f"{did_you_mean(vehicle, models.available())}"
        )
    existing_file(vehicle, "vehicle")
    if mapped is None and (there := beside(vehicle)) is not None:
        mapped, name = read_parts(there), f"parts {shown(str(there))}"
    if is_urdf(vehicle, "vehicle"):
        spec, notes = urdf_vehicle.spec_of_urdf(vehicle)
        mapped = mapped or PartsMap()
        sidecar.attach_beside(spec, vehicle, water)  # by the names of the file
        mapping.apply(spec, mapped, name if parts or beside(vehicle) else f"vehicle {shown(vehicle)}")
        urdf_vehicle.add_motors(spec, mapping.joints_between(spec), f"vehicle {shown(vehicle)}")
        note(spec, notes)
    else:
        spec, _ = read_mjcf(vehicle, "vehicle")
        forget(spec)  # lines about computed parts of an earlier state, saved with it
        sidecar.attach_beside(spec, vehicle, water)
        if mapped is not None:
            mapping.apply(spec, mapped, name)
        elif line := mapping.name_hull(spec):
            note(spec, [line])
    compiled(spec, f"vehicle {shown(vehicle)}")
    if hydrodynamics.attached(spec):
        hydrodynamics.attach(spec, {})  # MJCF keeps user data of bodies but not of the world
    return spec, mapped


def work_site(vehicle: mujoco.MjSpec, target: TargetModel, X_WT: Array) -> mujoco.MjSpec:
    """Add `target` on its stand, and flat seabed under it, to the spec of a vehicle at the origin.

    A target that extends deeper than SEABED_DEPTH below its own origin stands on the seabed.

    Args:
        vehicle: spec, changed in place.
        target: object to work on.
        X_WT: (4, 4) pose of the target.

    Returns:
        The same spec.
    """
    spec = vehicle
    target.add_to(spec, X_WT)
    seabed = spec.worldbody.add_geom()
    seabed.name = "seabed"
    seabed.type = mujoco.mjtGeom.mjGEOM_PLANE
    seabed.size = [8.0, 8.0, 0.1]
    seabed.pos = [X_WT[0, 3], X_WT[1, 3], seabed_height(target, X_WT)]
    seabed.rgba = [0.55, 0.5, 0.4, 1.0]
    return spec


def dig_site(vehicle: mujoco.MjSpec, ground: Seabed) -> mujoco.MjSpec:
    """Add `ground` to the spec of a vehicle whose tool, the geom "pad", penetrates it without collision.

    The soil acts as a force on the tool (`uuv.models.site.soil`).

    Raises:
        ConfigurationError: the vehicle has no such tool.
    """
    tool = next((geom for geom in vehicle.geoms if geom.name == TOOL_GEOM), None)
    if tool is None:
        raise ConfigurationError(f"to dig the vehicle needs a tool, a geom named {TOOL_GEOM!r}")
    tool.contype = tool.conaffinity = 0
    ground.add_to(vehicle)
    return vehicle


def seabed_height(target: TargetModel, X_WT: Array) -> float:
    """Height [m] in W of the seabed under `target` at `X_WT` (4, 4)."""
    return min(float(X_WT[2, 3]) - SEABED_DEPTH, float(transform_points(X_WT, target.vertices)[:, 2].min()))
