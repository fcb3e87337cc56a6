"""Place of work in an environment: path, hull pose and posture, chosen in the same way as for
jobs.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from uuv.controllers.hull.thrust_margin import ThrustMargin
from uuv.controllers.planning.hull_placement import PathStanding, StandingLimits
from uuv.controllers.planning.placement import Placement
from uuv.controllers.tasks.phase import ToolLine
from uuv.models.naming import check_parts
from uuv.models.objects.target_model import ModelPath, TargetModel
from uuv.models.site import scenes
from uuv.own_vehicle import OwnVehicle
from uuv.perception.finding.target_finder import PATH_SPACING
from uuv.perception.toolpath.path_planner import path_on_model
from uuv.sim.interfaces.messages import Target, ToolPath
from uuv.sim.interfaces.spatial import Array
from uuv.sim.runs.provenance import model_digest

# Choices of this process by all that they depend on: an environment that is made again has its
# place at once.
_CHOSEN: dict[Any, tuple[Placement, ToolPath]] = {}
# number of choices that are kept
_MOST_CHOSEN = 32


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WorkPlace:
    """An object at its pose, a tool path on it in W, and the hull pose for the work."""

    target: TargetModel
    X_WT: Array  # (4, 4)
    path: ToolPath
    placement: Placement

    @property
    def depth(self) -> float:
        """Depth [m] of the seabed under the object, below the origin."""
        return -scenes.seabed_height(self.target, self.X_WT)

    def line(self, offset: float) -> ToolLine:
        """Tool line with depths that count from `offset` [m] above the surface."""
        return ToolLine(path=self.path, placement=self.placement, offset=offset)

    def tool_at(self, s: float, depth: float = 0.0) -> Array:
        """Tool pose X_WG (4, 4) at arc length `s` [m], `depth` [m] below the surface."""
        return self.line(0.0).at(s, depth)[0]


def on_path(
    believed: OwnVehicle,
    target: TargetModel,
    path: ModelPath,
    X_WT: Array,
    *,
    force: float,
    standoff: float,
) -> WorkPlace:
    """Place of work on a path of an object.

    Args:
        believed: The vehicle.
        target: The object.
        path: Tool path on it, in T.
        X_WT: (4, 4) pose of the object.
        force: [N] Set force.
        standoff: [m] Distance from which the tool approaches.

    Raises:
        ConfigurationError: The vehicle lacks a part.
        ReachError: The arm reaches the path from no hull pose.
    """
    return standing(
        believed,
        target,
        path_on_model(X_WT, path, spacing=PATH_SPACING),
        X_WT,
        force=force,
        standoff=standoff,
    )


def standing(
    believed: OwnVehicle,
    target: TargetModel,
    path: ToolPath,
    X_WT: Array,
    *,
    force: float,
    standoff: float,
    floor: float | None = None,
) -> WorkPlace:
    """Place of work on a tool path in W; the arguments are those of `on_path`.

    `floor` is the height [m] of the seabed in W, by default under the object's stand.
    """
    check_parts(believed.model, but=("camera", "home", "ready"))
    shapes = (target.vertices, path.s, path.p, path.z, path.x, path.on_scan, X_WT)
    content = b"".join(np.asarray(array).tobytes() for array in shapes)
    height = scenes.seabed_height(target, X_WT) if floor is None else floor
    asked = (model_digest(believed.model), content, path.keeps_x, force, standoff, height)
    if asked in _CHOSEN:
        placement, worked = _CHOSEN[asked]
        return WorkPlace(target=target, X_WT=X_WT, path=worked, placement=placement)

    known = believed.at_work()
    stand = PathStanding(
        vehicle=known.vehicle,
        chain=known.chain,
        model=target,
        hull_box=known.hull_box,
        # the hull does not move along the path
        limits=StandingLimits(force=force, standoff=standoff, roomy=0.0),
        floor=height,
        holding=ThrustMargin.of(believed.model),
    )

    placement, worked, _ = stand(replace(surveyed(X_WT), path=path), path)
    _CHOSEN[asked] = placement, worked
    while len(_CHOSEN) > _MOST_CHOSEN:
        _CHOSEN.pop(next(iter(_CHOSEN)))
    return WorkPlace(target=target, X_WT=X_WT, path=worked, placement=placement)


def surveyed(X_WT: Array) -> Target:
    """An object at a known pose (4, 4), as one that was identified there."""
    return Target(
        time=0.0,
        X_WT=X_WT,
        accepted=True,
        check_m=0.0,
        range_m=float(np.linalg.norm(X_WT[:3, 3])),
        reason="",
        path=None,
    )
