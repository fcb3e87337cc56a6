"""Parts of a site that several tasks need: its object, and the pose to look from."""

from typing import Any

import numpy as np

from uuv.scenario import Scenario
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, exp_so3, finite_number, pose

_FARTHEST = 1e3  # [m] largest scan range, far beyond any sensor here


def object_of(scenario: Scenario, kind: type[Any]) -> Any:
    """The site's object, which must be of the kind `kind`.

    Raises:
        ConfigurationError: It is of another kind.
    """
    place_object = scenario.site.object
    if not isinstance(place_object, kind):
        raise ConfigurationError(
            f"task {type(scenario.task).__name__}: needs a {kind.__name__} at the site, got "
            f"{type(place_object).__name__}"
        )
    return place_object


def scan_pose(X_BC: Array, approach_W: Array, scan_range: float) -> Array:
    """Level hull pose (4, 4) in W with the camera at scan range from the coarse position.

    The camera looks towards +x of W, or down, or up.

    Args:
        X_BC: (4, 4) pose of the camera on the hull.
        approach_W: (3,) [m] coarse position of the object.
        scan_range: [m] distance along the camera's axis.

    Raises:
        ConfigurationError: The scan range is out of range.
    """
    finite_number(scan_range, "task.range [m]", above=0.0, most=_FARTHEST)
    R_WB = exp_so3([0.0, 0.0, -np.arctan2(X_BC[1, 2], X_BC[0, 2])])
    return pose(R_WB, approach_W - R_WB @ (X_BC[:3, 3] + scan_range * X_BC[:3, 2]))
