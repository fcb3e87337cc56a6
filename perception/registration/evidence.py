"""The part of a scan that may show the object, thinned for ICP, and how well a pose agrees with it."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from perception.clouds.nearest_point import NearestPoint
from perception.clouds.scan import Scan, SensorModel, facing_normals, hashed_subset, voxel_means
from perception.registration.model_surface import ModelSurface
from sim.interfaces.spatial import Array, transform_points

_GRAZING = np.deg2rad(88.0)  # [rad] of incidence, up to which the model explains what was scanned
_HASHED = 1e-4  # [m] edge of the cubes by which points are drawn
_MAX_SCAN_POINTS = 4000  # scan points used in ICP, at most about: more add time


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """The part of a scan that takes part in ICP."""

    scan: Scan
    mask: np.ndarray  # (h, w) pixels around the initial poses that may belong to the object
    standing: np.ndarray  # (h, w) all pixels that stand out from the background, wherever the model may be put
    points: Array  # (n, 3) [m] thinned, in S
    normals: Array  # (n, 3) unit, towards the sensor
    sigma: Array  # (n,) [m] standard deviation of depth
    independent: Array  # (n,) [-] share of an independent reading, because errors of neighbours are correlated
    sensor: SensorModel

    @classmethod
    def of(
        cls,
        scan: Scan,
        mask: np.ndarray,
        spacing: float,
        sensor: SensorModel,
        standing: np.ndarray | None = None,
        most: int = _MAX_SCAN_POINTS,
    ) -> "Evidence":
        """Thin the masked pixels to one point per cube and estimate normals.

        Args:
            scan: The scan.
            mask: (h, w) pixels that may belong to the object.
            spacing: [m] edge of the cubes.
            sensor: Accuracy of the sensor.
            standing: (h, w) all pixels that stand out from the background; None: `mask`.
            most: Number of points, at most about.

        Returns:
            The evidence.
        """
        points = voxel_means(scan.points[mask], spacing)
        step = max(1, -(-len(points) // most))
        kept = hashed_subset(step, points, spacing)
        normals, points = facing_normals(points, at=kept), points[kept]
        apart = np.sqrt(step) * spacing / (scan.pitch * points[:, 2])  # [px]
        return cls(
            scan=scan,
            mask=mask,
            standing=mask if standing is None else standing,
            points=points,
            normals=normals,
            sigma=sensor.sigma(points[:, 2]),
            independent=sensor.independent(apart),
            sensor=sensor,
        )

    def thinned(self, step: int, points: int) -> "Evidence":
        """The same evidence on every `step`-th row and column, and about `points` of its points, for a rough fit."""
        every = (slice(None, None, step), slice(None, None, step))
        few = max(1, -(-len(self.points) // points))
        kept = hashed_subset(few, self.points, _HASHED)
        return replace(
            self,
            scan=self.scan.part(every),
            mask=self.mask[every],
            standing=self.standing[every],
            points=self.points[kept],
            normals=self.normals[kept],
            sigma=self.sigma[kept],
            independent=np.minimum(1.0, few * self.independent[kept]),
            sensor=replace(self.sensor, noise_length=max(1.0, self.sensor.noise_length / step)),
        )


def score(evidence: Evidence, surface: ModelSurface, X_ST: Array) -> float:
    """Mutual agreement of scan and model at `X_ST`, from -1 to 2: higher is better.

    The share of the visible model that the scan confirms, less the share that the scan sees through, plus the share of
    the scan that the model explains.

    Args:
        evidence: Scan points of the object.
        surface: Sampled model.
        X_ST: (4, 4) pose of T in S.

    Returns:
        The score [-].
    """
    visible = surface.visible(X_ST, evidence.scan, evidence.sensor.max_incidence)
    if visible.sum() < 10:
        return -1.0
    points = transform_points(X_ST, surface.points[visible])
    row, column, _ = evidence.scan.pixels(points)
    measured = evidence.scan.depth[row, column]
    tolerance = 2.0 * surface.spacing + 3.0 * evidence.sensor.sigma(points[:, 2])
    behind = measured - points[:, 2]
    agree = float(np.mean(np.abs(behind) < tolerance))
    through = float(np.mean(behind > 2.0 * tolerance))
    return agree - through + float(np.mean(explained(evidence, surface, X_ST)))


def explained(evidence: Evidence, surface: ModelSurface, X_ST: Array) -> np.ndarray:
    """Mask (n,) of the scan points that lie on the visible model.

    Args:
        evidence: Scan points of the object.
        surface: Sampled model.
        X_ST: (4, 4) pose of T in S.

    Returns:
        Mask (n,).
    """
    return _explained(evidence, surface, X_ST.tobytes())


@lru_cache(maxsize=4)  # the accepted pose is judged by the check and by its score
def _explained(evidence: Evidence, surface: ModelSurface, pose_bytes: bytes) -> np.ndarray:
    X_ST = np.frombuffer(pose_bytes).reshape(4, 4)
    visible = surface.visible(X_ST, evidence.scan, _GRAZING)  # an echo there is not expected, but may come
    if not visible.any():
        return np.zeros(len(evidence.points), dtype=bool)
    points = transform_points(X_ST, surface.points[visible])
    limit = 2.0 * surface.spacing + 3.0 * evidence.sigma
    mask = NearestPoint.of(points, surface.spacing).query(evidence.points, float(limit.max()))[0] < limit
    mask.setflags(write=False)
    return mask
