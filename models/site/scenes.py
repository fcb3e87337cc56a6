"""Scene builder: a vehicle, an object to work on, and the seabed in one MjSpec."""

from typing import TYPE_CHECKING

from uuv.models.naming import TOOL_GEOM
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, transform_points

if TYPE_CHECKING:
    import mujoco

    from uuv.models.objects.targets import TargetModel
    from uuv.models.site.seabed import Seabed

SEABED_DEPTH = 0.75  # [m] depth of the flat seabed below the object's origin


def work_site(vehicle: "mujoco.MjSpec", target: "TargetModel", X_WT: Array) -> "mujoco.MjSpec":
    """Add `target` on its stand, and a flat seabed under it, to the spec of a vehicle at the
    origin.

    A target that extends deeper than SEABED_DEPTH below its own origin stands on the seabed.

    Args:
        vehicle: spec, changed in place.
        target: object to work on.
        X_WT: (4, 4) pose of the target.

    Returns:
        The same spec.
    """
    import mujoco

    spec = vehicle
    target.add_to(spec, X_WT)

    seabed = spec.worldbody.add_geom()
    seabed.name = "seabed"
    seabed.type = mujoco.mjtGeom.mjGEOM_PLANE
    seabed.size = [8.0, 8.0, 0.1]
    seabed.pos = [X_WT[0, 3], X_WT[1, 3], seabed_height(target, X_WT)]
    seabed.rgba = [0.55, 0.5, 0.4, 1.0]
    return spec


def dig_site(vehicle: "mujoco.MjSpec", ground: "Seabed") -> "mujoco.MjSpec":
    """Add `ground` to the spec of a vehicle; its tool, geom "pad", enters the ground without
    collision.

    The soil acts as a force on the tool (`uuv.models.site.soil`).

    Raises:
        ConfigurationError: the vehicle has no geom "pad".
    """
    tool = next((geom for geom in vehicle.geoms if geom.name == TOOL_GEOM), None)
    if tool is None:
        raise ConfigurationError(
            f"dig_site: the vehicle must have a tool, a geom named {TOOL_GEOM!r}"
        )

    tool.contype = tool.conaffinity = 0
    ground.add_to(vehicle)
    return vehicle


def seabed_height(target: "TargetModel", X_WT: Array) -> float:
    """Height [m] in W of the seabed under `target` at `X_WT` (4, 4)."""
    return min(
        float(X_WT[2, 3]) - SEABED_DEPTH, float(transform_points(X_WT, target.vertices)[:, 2].min())
    )
