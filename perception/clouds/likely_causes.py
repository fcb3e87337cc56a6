"""Likely causes of a refusal of a cloud: other axes than those of a sensor, another unit."""

import numpy as np

from uuv.sim.interfaces.spatial import Array

# conventions of a camera's frame, by the axis that points ahead in them
_OTHER_AXES = {"+x": "ROS camera_link", "-z": "OpenGL or Blender"}
# ratio of the distances of approach and farthest point, above which the approach is in another unit
_OTHER_UNIT = 20.0


def other_axes(points: Array) -> str:
    """Sign of a cloud in other axes than those of a sensor, x right, y down, z ahead.

    Args:
        points: (n, 3) [m], finite.

    Returns:
        Message with the axis along which the points lie; empty if that is +z.
    """
    if not len(points):
        return ""

    middle = np.median(points, axis=0)
    axis = int(np.abs(middle).argmax())
    if axis == 2 and middle[2] > 0.0:
        return ""

    along = f"{'-' if middle[axis] < 0.0 else '+'}{'xyz'[axis]}"
    convention = f" (the axes of {_OTHER_AXES[along]}?)" if along in _OTHER_AXES else ""
    return (
        "the cloud has to be in the frame of the sensor, z ahead, but most of its points lie along "
        f"{along}{convention}"
    )


def far_approach(points: Array, approach: Array, reach: float) -> str:
    """Why no point may lie within `reach` [m] of the coarse position: points (n, 3) [m] in S.

    Empty if a point is near enough.
    """
    nearest = float(np.linalg.norm(points - approach, axis=1).min(initial=np.inf))
    if nearest <= reach:
        return ""

    ranges = np.linalg.norm(points, axis=1)
    away = float(np.linalg.norm(approach))
    units = " (in millimetres?)" if away > _OTHER_UNIT * ranges.max() else ""
    return (
        f"the approach is {away:.2f} m from the sensor{units}, the points {ranges.min():.2f} to "
        f"{ranges.max():.2f} m, the nearest of them {nearest:.2f} m from the approach"
    )


def with_cause(reason: str, cause: str) -> str:
    """Reason of a refusal with its likely cause; empty without a reason."""
    return f"{reason}; {cause}" if reason and cause else reason
