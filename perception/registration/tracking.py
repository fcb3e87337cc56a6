"""Tracking of an identified object by ICP from the last pose, on the pixels around it."""

from dataclasses import dataclass, replace

import numpy as np

from uuv.perception.clouds.scan import (
    MIN_POINTS,
    Scan,
    SensorModel,
    near_any,
    without_flying_pixels,
)
from uuv.perception.registration.evidence import Evidence
from uuv.perception.registration.fine_fit import GATES, fine_fit, icp_rows
from uuv.perception.registration.model_surface import ModelSurface
from uuv.perception.registration.pose_covariance import PoseCovariance, pose_covariance
from uuv.sim.interfaces.spatial import Array, transform_points

_PIXELS = 10_000  # approximate number of pixels of the window around the object
_POINTS = 1500  # approximate number of these that ICP compares
_MODEL = 8000  # approximate number of points of the model with which it compares them
_AROUND = 1.1  # [radii] around its centre, within which scan points are used


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameFit:
    """Pose of a followed object in one frame."""

    X_ST: Array  # (4, 4) pose of T in S
    covariance: PoseCovariance | None  # None if too little of the object is in view
    # [m] robust rms distance of the scan from the model; inf if nothing was compared
    residual: float


def follow(scan: Scan, surface: ModelSurface, X_ST: Array, sensor: SensorModel) -> FrameFit | None:
    """Fit an object in a frame, near its expected pose.

    There is no search and no verification. If the object has moved further than ICP can follow,
    about a twelfth of its radius, it is lost and must be identified again.

    Args:
        scan: The frame.
        surface: Sampled model.
        X_ST: (4, 4) expected pose of T in S.
        sensor: Accuracy of the sensor.

    Returns:
        The fit; None if fewer than MIN_POINTS of the frame are where the object is expected.
    """
    surface = surface.thinned(_MODEL)
    window = scan.window(transform_points(X_ST, surface.hull), 0.1, _PIXELS)
    part = scan.part(window)
    if min(part.depth.shape) < 3:
        return None

    # [px] of the thinned window
    sensor = replace(sensor, noise_length=max(1.0, sensor.noise_length / window[0].step))

    center = transform_points(X_ST, surface.center)
    mask = near_any(part.points, center[None], _AROUND * surface.radius) & without_flying_pixels(
        part
    )
    if mask.sum() < MIN_POINTS:
        return None

    evidence = Evidence.of(part, mask, 0.8 * surface.spacing, sensor, most=_POINTS)
    if len(evidence.points) < MIN_POINTS:
        return None

    fit = fine_fit(evidence, surface, X_ST, GATES[:1])
    if not np.isfinite(fit.residual):
        return None
    doubt = pose_covariance(evidence, surface, fit.X_ST, fit.free, icp_rows(evidence, surface, fit))
    return FrameFit(X_ST=fit.X_ST, covariance=doubt, residual=fit.residual)
