"""Scene builder: a vehicle, an object to work on, and the seabed in one MjSpec."""

from pathlib import Path

import mujoco

import models
from models import hydrodynamics, sidecar
from models.mjcf_files import read_mjcf
from models.naming import TOOL_GEOM
from models.objects.targets import TargetModel
from models.site.seabed import Seabed
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array, shown, transform_points

SEABED_DEPTH = 0.75  # [m] of the flat seabed below the object's origin


def vehicle_spec(vehicle: str | Path, water: str | Path | None = None) -> mujoco.MjSpec:
    """Vehicle by its name in `models.available()`, or from an MJCF file.

    The file's coefficients are in its user data, in custom elements, or in a sidecar (`models.sidecar`).

    Args:
        vehicle: name, or MJCF file.
        water: sidecar of the MJCF file; by default `NAME.water.yaml` beside it, if there is one.

    Returns:
        Spec with its water.

    Raises:
        ConfigurationError: neither a name nor a file, or a file that cannot be read or compiled.
    """
    if not isinstance(vehicle, str | Path):
        raise ConfigurationError(f"vehicle: expected a name or an MJCF file, got {shown(vehicle)}")
    vehicle = str(vehicle)
    if ":" in vehicle or vehicle in models.available():
        if water is not None:
            raise ConfigurationError(f"vehicle {shown(vehicle)}: has its own water, so a water file is refused")
        return models.load(vehicle)
    if not Path(vehicle).suffix:
        raise ConfigurationError(
            f"unknown vehicle {shown(vehicle)}; there are {', '.join(models.available())}, or an MJCF file"
        )
    spec, _ = read_mjcf(vehicle, "vehicle")
    sidecar.attach_beside(spec, vehicle, water)
    if hydrodynamics.attached(spec):
        hydrodynamics.attach(spec, {})  # MJCF keeps user data of bodies but not of the world
    return spec


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

    The soil acts as a force on the tool (`models.site.soil`).

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
