"""Tool path on the real surface from a path on the model [Konoplin 2022, eq. 3 and after].

The path is transformed by the identified pose. Where the object is seen well and deviates from its model by more than
the sensor's noise (fouled, silted, dented), points are moved along +-o onto the scanned triangulation. Elsewhere the
model is the better measurement and is kept. A cubic B-spline smooths the whole path.
"""

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline, make_lsq_spline

from models.objects.targets import ModelPath
from perception.registration.identification import Identification
from perception.toolpath.path_deviation import deviate, tilted_axis
from perception.toolpath.tool_contact_path import rolled
from sim.interfaces.errors import ConfigurationError, PerceptionError
from sim.interfaces.messages import ToolPath
from sim.interfaces.spatial import Array, readonly, transform_points

_DENSE = 0.003  # [m] between the points that are projected
_KNOTS = 0.015  # [m] between the knots of the smoothing spline


def plan_path(
    found: Identification,
    path: ModelPath,
    *,
    spacing: float = 0.0015,
    max_deviation: float = 0.05,
    bridge: float = 0.06,
    tool_radius: float = 0.0,
) -> ToolPath:
    """Plan the tool path on the real surface, in the sensor frame S.

    Args:
        found: Accepted identification of the object.
        path: Path on the model, in T.
        spacing: [m] of the samples along the arc length.
        max_deviation: [m] along the line of sight; larger deviations are taken for another object.
        bridge: [m] longest hole in the scan, along the path, over which both sides are joined.
        tool_radius: [m] of the ball at the end of the tool, whose reachable surface the path follows where it deviates;
            0: a point.

    Returns:
        The tool path in S.

    Raises:
        PerceptionError: If `found` was not accepted, or the scan has a longer hole on the path.
        ConfigurationError: For a path with coinciding points, or parameters out of bounds.
    """
    if not found.accepted or found.evidence is None:
        raise PerceptionError(f"no tool path on an object that was not found: {found.reason}")
    if not (spacing > 0.0 and max_deviation > 0.0 and bridge >= 0.0 and tool_radius >= 0.0):
        raise ConfigurationError(
            "spacing and max_deviation must be positive, bridge and tool_radius not negative [m], got "
            f"{spacing}, {max_deviation}, {bridge} and {tool_radius}"
        )
    dense = carry(found.X_sensor_target, densified(path))
    deviation = deviate(found.evidence, found.surface, found.X_sensor_target, dense, max_deviation, bridge)
    p, z = dense.p + deviation.along_o[:, None] * deviation.o, tilted_axis(dense, deviation)
    if tool_radius > 0.0 and deviation.on_scan.any():
        p, z = rolled(dense, deviation, tool_radius)
    return _smoothed(p, z, deviation.on_scan, spacing)


def carry(X_ST: Array, path: ModelPath) -> ModelPath:
    """Transform a path from T to S, points and axes [Konoplin 2022, eq. 3], with the whole pose in one matrix.

    The equation has two rotations and centroids; `X_ST` (4, 4) combines them.
    """
    R = X_ST[:3, :3]
    return ModelPath(p=transform_points(X_ST, path.p), a=path.a @ R.T, b=path.b @ R.T)


def densified(path: ModelPath) -> ModelPath:
    """Resample the path at a spacing of _DENSE, through all its points.

    Raises:
        ConfigurationError: If two neighbours coincide.
    """
    chord = np.linalg.norm(np.diff(path.p, axis=0), axis=1)
    if chord.min() < 1e-9:
        raise ConfigurationError(f"tool path: points {int(chord.argmin())} and {int(chord.argmin()) + 1} coincide")
    u = np.concatenate([[0.0], np.cumsum(chord)])
    fine = np.linspace(0.0, u[-1], max(8, 1 + round(u[-1] / _DENSE)))
    p, a, b = (make_interp_spline(u, values, k=3)(fine) for values in (path.p, path.a, path.b))
    a /= np.linalg.norm(a, axis=1, keepdims=True)
    return ModelPath(p=p, a=a, b=b / np.linalg.norm(b, axis=1, keepdims=True))


def _smoothed(p: Array, z: Array, on_scan: np.ndarray, spacing: float) -> ToolPath:
    """Least-squares cubic B-splines through points and axes, sampled evenly over arc length."""
    u = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
    curve, axis = _spline(u, p), _spline(u, z)
    fine = np.linspace(0.0, u[-1], max(16, 4 * round(u[-1] / spacing)))
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve(fine), axis=0), axis=1))])
    s = np.linspace(0.0, length[-1], max(2, 1 + round(length[-1] / spacing)))
    at = np.interp(s, length, fine)
    points, tool = curve(at), axis(at)
    tool /= np.linalg.norm(tool, axis=1, keepdims=True)
    x = curve.derivative()(at)
    x -= np.einsum("ij,ij->i", x, tool)[:, None] * tool
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    nearest = np.clip(np.searchsorted(u, at), 0, len(u) - 1)
    flags = on_scan[nearest].copy()
    flags.setflags(write=False)
    return ToolPath(s=readonly(s), p=readonly(points), z=readonly(tool), x=readonly(x), on_scan=flags)


def _spline(u: Array, values: Array) -> BSpline:
    intervals = max(1, min(int(u[-1] / _KNOTS), (len(u) - 4) // 2))
    inner = np.linspace(u[0], u[-1], intervals + 1)[1:-1]
    return make_lsq_spline(u, values, np.concatenate([[u[0]] * 4, inner, [u[-1]] * 4]), k=3)
