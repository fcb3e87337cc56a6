"""Map of the deformation of an object relative to its model: growth, silt and dents, by pixel and
region.

Each pixel that the model covers is compared along its line of sight; the deviation is along the
model's normal, growth positive. Errors of stereo are correlated over patches, so pixels are
averaged until little of this noise remains; the remaining noise is known in closed form. A
deformation also shifts the fitted pose, so the pose is fitted again to the undeformed rest.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from uuv.perception.clouds.scan import MIN_POINTS, jump, without_flying_pixels
from uuv.perception.registration.evidence import Evidence
from uuv.perception.registration.fine_fit import fine_fit
from uuv.perception.registration.identification import Identification
from uuv.perception.registration.likelihood import OCCLUDER
from uuv.perception.registration.model_surface import ModelSurface
from uuv.perception.toolpath.path_deviation import POSE_ERROR, SEEN_WELL
from uuv.sim.interfaces.errors import ConfigurationError, PerceptionError
from uuv.sim.interfaces.spatial import Array, inverse, readonly, transform_points

_NOISE = 0.0015  # [m] of the sensor's noise that may remain after averaging
# [m] limits of the Gaussian's width, since a wider one blurs the deviations
_WIDTH = (0.006, 0.025)
# standard deviations of the remaining noise that are significant, considering the many positions
_DOUBT = 4.5
_RIM = 2  # [px] of the sensor next to an edge of the model, where an error of the pose dominates


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Region:
    """One connected part of the surface that deviates from the model to one side."""

    p_T: Array  # (3,) [m] model point nearest to the region's middle, in T
    p_S: Array  # (3,) [m] the same point in S
    length_m: float  # [m] length along its longest axis
    width_m: float  # [m] width perpendicular to that axis, along the surface
    area_m2: float  # [m^2] area of the model's surface in the region
    mean_m: float  # [m] mean deviation, growth positive
    largest_m: float  # [m] deviation of the largest magnitude, with its sign


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DeformationMap:
    """Deviation of the scanned surface from the model, pixel by pixel of the last frame."""

    X_sensor_target: Array  # (4, 4) pose of T in S, fitted to the undeformed part
    points_S: Array  # (h, w, 3) [m] the scan
    # (h, w) [m] along the model's normal, growth positive; NaN where it was not compared
    deviation: Array
    # [m] standard deviation of `deviation` from the sensor: median over the compared pixels
    noise_m: float
    size_m: float  # [m] deviation, beyond which a pixel belongs to a region
    label: np.ndarray  # (h, w) int: pixels of `regions[k - 1]` have the value k, all others 0
    # [-] share of the model's surface visible to an unobstructed sensor that was compared
    compared: float
    regions: tuple[Region, ...]  # largest area first

    @property
    def cloud_S(self) -> tuple[Array, Array]:
        """Scanned points (n, 3) [m] that were compared, in S, and their deviations (n,) [m]."""
        known = np.isfinite(self.deviation)
        return self.points_S[known], self.deviation[known]


def map_deformation(found: Identification, size: float | None = None) -> DeformationMap:
    """Compare the scan of an accepted identification with its model.

    The scan may be fused from several frames (`target_finder.with_fused_frames`). A region is
    reported if noise does not explain its largest deviation. Excluded are edges, surface at more
    than 60 deg of incidence, growth beyond the model's outline, and deviations of OCCLUDER or more.

    Args:
        found: Accepted identification.
        size: [m] deviation beyond which a pixel belongs to a region. None: twice the sum of the
            pose error and the remaining noise.

    Raises:
        PerceptionError: `found` was not accepted.
        ConfigurationError: `size` is not positive.
    """
    if not found.accepted or found.evidence is None:
        raise PerceptionError(f"deformation: the object was not identified: {found.reason}")
    if size is not None and not (np.isfinite(size) and size > 0.0):
        raise ConfigurationError(f"deformation: size must be positive [m], got {size}")

    evidence = found.evidence
    surface = found.surface

    # The pose is fitted again to the undeformed rest, with the regions of a first comparison
    first = _Comparison.of(evidence, surface, found.X_sensor_target)
    X_ST = _refitted(
        evidence, surface, found.X_sensor_target, first.labelled(0.5 * first.size)[0] > 0
    )
    last = _Comparison.of(evidence, surface, X_ST)

    size = last.size if size is None else size
    label, count = last.labelled(size)

    # Regions of the second comparison, the largest first
    regions = sorted(
        ((last.region(label == k), k) for k in range(1, count + 1)),
        key=lambda item: -item[0].area_m2,
    )
    rank = np.zeros(count + 1, dtype=np.int64)
    rank[[k for _, k in regions]] = np.arange(1, count + 1)

    return DeformationMap(
        X_sensor_target=readonly(X_ST),
        points_S=evidence.scan.points,
        deviation=readonly(np.where(last.known, last.deviation, np.nan)),
        noise_m=last.noise,
        size_m=size,
        label=rank[label],
        compared=float(last.area[last.known].sum() / max(last.area.sum(), 1e-12)),
        regions=tuple(region for region, _ in regions),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Comparison:
    """Scan and model, pixel by pixel, with the model at one pose. All (h, w) except the poses."""

    X_ST: Array
    points_S: Array  # (h, w, 3) [m] of the model
    known: np.ndarray  # pixels where both were compared
    deviation: Array  # [m] averaged deviation
    sigma: Array  # [m] standard deviation of the averaged deviation
    area: Array  # [m^2] area of the model's surface in a pixel, 0 where no echo is expected

    @classmethod
    def of(cls, evidence: Evidence, surface: ModelSurface, X_ST: Array) -> "_Comparison":
        """Compare with the model at `X_ST` (4, 4)."""
        scan = evidence.scan
        sensor = evidence.sensor

        model, cosine = surface.seen(X_ST, scan)
        z = model.depth
        covered = np.isfinite(z)
        slant = np.sqrt(1.0 + scan.tangent_x**2 + (scan.tangent_y**2)[:, None])

        # Deviation along the model's normal, from that along the line of sight
        normal = cosine * slant  # [-] component of a depth step along the model's normal
        off = (z - scan.depth) * normal

        around = 2 * max(1, round(_RIM / (sensor.focal * scan.pitch))) + 1  # [px] of this grid
        nearest = ndimage.minimum_filter(np.where(covered, z, np.inf), around, mode="nearest")
        farthest = ndimage.maximum_filter(np.where(covered, z, np.inf), around, mode="nearest")

        # Pixels that are compared: away from edges, at moderate incidence, of the object and not of
        # an occluder
        with np.errstate(invalid="ignore"):  # inf - inf beyond the model
            known = covered & (farthest - nearest < jump(z)) & (np.abs(off) < OCCLUDER)
        known &= (cosine > SEEN_WELL) & without_flying_pixels(scan)
        expected = covered & (cosine > np.cos(sensor.max_incidence))

        area = np.where(expected, (scan.pitch * z) ** 2 / np.where(expected, normal, 1.0), 0.0)
        if not known.any():
            return cls(X_ST, model.points, known, np.zeros_like(z), np.full_like(z, np.inf), area)

        # White noise that is filtered by a Gaussian of width s, as in stereo, and then by one of
        # width w, keeps s^2 / (s^2 + w^2) of its variance. If part of the window is unknown, the
        # variance grows by that share.
        middle = float(np.median(z[known]))
        patch = 0.5 * sensor.noise_length / (sensor.focal * scan.pitch)  # [px] of this grid too
        excess = max(0.0, (float(sensor.sigma(middle)) / _NOISE) ** 2 - 1.0)
        width = np.clip(patch * np.sqrt(excess), *(np.array(_WIDTH) / (scan.pitch * middle)))
        share = np.maximum(
            ndimage.gaussian_filter(known.astype(float), width, mode="constant"), 1e-3
        )
        mean = ndimage.gaussian_filter(np.where(known, off, 0.0), width, mode="constant") / share
        left = np.minimum(1.0, patch**2 / ((patch**2 + width**2) * share))
        return cls(X_ST, model.points, known, mean, sensor.sigma(z) * normal * np.sqrt(left), area)

    @property
    def noise(self) -> float:
        """Median standard deviation [m] of the averaged deviation; inf without compared pixels."""
        return float(np.median(self.sigma[self.known])) if self.known.any() else np.inf

    @property
    def size(self) -> float:
        """Default threshold [m] for a region."""
        return 2.0 * (POSE_ERROR + self.noise)

    def labelled(self, size: float) -> tuple[np.ndarray, int]:
        """Labels, from 1, of significant regions beyond `size` [m] to one side; their number."""
        label = np.zeros(self.known.shape, dtype=np.int64)
        count = 0

        for side in (1.0, -1.0):
            part = ndimage.label(self.known & (side * self.deviation > size))[0]
            certain = self.known & (side * self.deviation > _DOUBT * self.sigma + POSE_ERROR)
            for k in np.unique(part[certain & (part > 0)]):
                count += 1
                label[part == k] = count
        return label, count

    def region(self, inside: np.ndarray) -> Region:
        """Properties of the region of the pixels `inside`."""
        points = self.points_S[inside]
        off = self.deviation[inside]
        area = self.area[inside]
        offset = points - np.average(points, axis=0, weights=area)
        p_S = points[int(np.linalg.norm(offset, axis=1).argmin())]
        axes = np.linalg.eigh((area[:, None] * offset).T @ offset)[1]
        width, length = np.ptp(offset @ axes[:, 1:], axis=0)

        return Region(
            p_T=readonly(transform_points(inverse(self.X_ST), p_S)),
            p_S=readonly(p_S),
            length_m=float(length),
            width_m=float(width),
            area_m2=float(area.sum()),
            mean_m=float(np.average(off, weights=area)),
            largest_m=float(off[np.abs(off).argmax()]),
        )


def _refitted(
    evidence: Evidence, surface: ModelSurface, X_ST: Array, deformed: np.ndarray
) -> Array:
    """Pose (4, 4) fitted to pixels that are not `deformed` (h, w); `X_ST` if there are too few of
    them.
    """
    rest = evidence.mask & ~deformed
    if not deformed.any() or rest.sum() < MIN_POINTS:
        return X_ST

    fit = fine_fit(
        Evidence.of(evidence.scan, rest, 0.8 * surface.spacing, evidence.sensor), surface, X_ST
    )
    return X_ST if len(fit.free) > (surface.symmetry.axis is not None) else fit.X_ST
