"""Where an object that was found differs from its model: growth, silt and dents, as a map and as a list of regions.

Each pixel in the model's picture is compared along its line of sight and counted along the model's normal, growth
positive. Stereo errs in patches, so pixels are averaged until the patches in one mean leave little of their noise; its
size is known in closed form. What deforms an object has also pulled its pose: the pose is fitted anew to the rest.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from perception.clouds.scan import MIN_POINTS, jump, without_flying_pixels
from perception.registration.fine_fit import Evidence, ModelSurface, fine_fit
from perception.registration.identification import Identification
from perception.registration.likelihood import OCCLUDER
from perception.toolpath.path_deviation import POSE_ERROR, SEEN_WELL
from sim.interfaces.errors import ConfigurationError, PerceptionError
from sim.interfaces.spatial import Array, inverse, readonly, transform_points

_NOISE = 0.0015  # [m] that is to be left of the sensor's after averaging,
_WIDTH = (0.006, 0.025)  # [m] within these widths of the Gaussian: a wider one blurs what is to be found
_DOUBT = 4.5  # standard deviations of what is left, beyond which a deviation is beyond doubt: there are many places
_RIM = 2  # [px] of the sensor beside an edge of the model where an error of the pose decides what is seen


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Region:
    """One connected part of the surface that lies off the model, all to one side."""

    p_T: Array  # (3,) [m] the model's point nearest to its middle
    p_S: Array  # (3,) [m] the same in the sensor's frame
    length_m: float  # [m] along its longest axis
    width_m: float  # [m] across that, along the surface
    area_m2: float  # [m^2] of the model's surface
    mean_m: float  # [m] deviation, growth positive
    largest_m: float  # [m] the largest in size, with its sign


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DeformationMap:
    """How far the scanned surface lies off the model, pixel by pixel of the last look."""

    X_sensor_target: Array  # (4, 4) pose of T in S, fitted to what is not deformed
    points_S: Array  # (H, W, 3) [m] the scan
    deviation: Array  # (H, W) [m] along the model's normal, growth positive; NaN where it was not compared
    noise_m: float  # [m] standard deviation of `deviation` that the sensor explains, in the middle of the range
    size_m: float  # [m] beyond which a deviation belongs to a region
    label: np.ndarray  # (H, W) int: k within `regions[k - 1]`, 0 elsewhere
    compared: float  # share of the model's surface that the sensor should see, if nothing hid it, that was compared
    regions: tuple[Region, ...]  # largest area first

    @property
    def cloud_S(self) -> tuple[Array, Array]:
        """Scanned points (N, 3) [m] that were compared, in S, and their deviations (N,) [m]."""
        known = np.isfinite(self.deviation)
        return self.points_S[known], self.deviation[known]


def map_deformation(found: Identification, size: float | None = None) -> DeformationMap:
    """Compare the scan of an accepted `found`, of one look or of several (`looks.on_all_looks`), with its model.

    `size` [m]: deviations beyond it belong to a region; None: twice the error that a pose may have, and twice the
    noise that is left. A region counts if the noise does not explain its largest deviation. Nothing is said of edges,
    of surface seen at more than 60 deg of incidence, of what stands out beyond the model's outline, or where the scan
    lies farther off than OCCLUDER.
    Raises PerceptionError if `found` was not accepted, ConfigurationError for a `size` that is not positive.
    """
    if not found.accepted or found.evidence is None:
        raise PerceptionError(f"no map of deformation of an object that was not found: {found.reason}")
    if size is not None and not (np.isfinite(size) and size > 0.0):
        raise ConfigurationError(f"deformation: size must be positive [m], got {size}")
    evidence, surface = found.evidence, found.surface
    first = _Comparison.of(evidence, surface, found.X_sensor_target)
    X_ST = _refitted(evidence, surface, found.X_sensor_target, first.labelled(0.5 * first.size)[0] > 0)
    last = _Comparison.of(evidence, surface, X_ST)
    size = last.size if size is None else size
    label, count = last.labelled(size)
    regions = sorted(((last.region(label == k), k) for k in range(1, count + 1)), key=lambda item: -item[0].area_m2)
    place = np.zeros(count + 1, dtype=np.int64)
    place[[k for _, k in regions]] = np.arange(1, count + 1)
    return DeformationMap(
        X_sensor_target=readonly(X_ST),
        points_S=evidence.scan.points,
        deviation=readonly(np.where(last.known, last.deviation, np.nan)),
        noise_m=last.noise,
        size_m=size,
        label=place[label],
        compared=float(last.area[last.known].sum() / max(last.area.sum(), 1e-12)),
        regions=tuple(region for region, _ in regions),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Comparison:
    """Scan and model, pixel by pixel, with the model at one pose. All (H, W) but for the poses."""

    X_ST: Array
    points_S: Array  # (H, W, 3) [m] of the model
    known: np.ndarray  # where both were compared
    deviation: Array  # [m] averaged
    sigma: Array  # [m] of it
    area: Array  # [m^2] of the model's surface in a pixel, 0 where nothing of it should come back

    @classmethod
    def of(cls, evidence: Evidence, surface: ModelSurface, X_ST: Array) -> "_Comparison":
        scan, sensor = evidence.scan, evidence.sensor
        model, cosine = surface.seen(X_ST, scan)
        z = model.depth
        covered = np.isfinite(z)
        slant = np.sqrt(1.0 + scan.tangent_x**2 + (scan.tangent_y**2)[:, None])
        normal = cosine * slant  # of a step in depth, the share along the model's normal
        off = (z - scan.depth) * normal
        around = 2 * max(1, round(_RIM / (sensor.focal * scan.pitch))) + 1  # [px] of this grid
        nearest = ndimage.minimum_filter(np.where(covered, z, np.inf), around, mode="nearest")
        farthest = ndimage.maximum_filter(np.where(covered, z, np.inf), around, mode="nearest")
        with np.errstate(invalid="ignore"):  # inf - inf beyond the model
            known = covered & (farthest - nearest < jump(z)) & (np.abs(off) < OCCLUDER)
        known &= (cosine > SEEN_WELL) & without_flying_pixels(scan)
        expected = covered & (cosine > np.cos(sensor.max_incidence))
        area = np.where(expected, (scan.pitch * z) ** 2 / np.where(expected, normal, 1.0), 0.0)
        if not known.any():
            return cls(X_ST, model.points, known, np.zeros_like(z), np.full_like(z, np.inf), area)

        # White noise through a Gaussian of width s, as stereo's is, and then through one of width w, keeps
        # s^2 / (s^2 + w^2) of its variance; where part of the window is unknown, so much more.
        middle = float(np.median(z[known]))
        patch = 0.5 * sensor.noise_length / (sensor.focal * scan.pitch)  # [px] of this grid too
        excess = max(0.0, (float(sensor.sigma(middle)) / _NOISE) ** 2 - 1.0)
        width = np.clip(patch * np.sqrt(excess), *(np.array(_WIDTH) / (scan.pitch * middle)))
        share = np.maximum(ndimage.gaussian_filter(known.astype(float), width, mode="constant"), 1e-3)
        mean = ndimage.gaussian_filter(np.where(known, off, 0.0), width, mode="constant") / share
        left = np.minimum(1.0, patch**2 / ((patch**2 + width**2) * share))
        return cls(X_ST, model.points, known, mean, sensor.sigma(z) * normal * np.sqrt(left), area)

    @property
    def noise(self) -> float:
        return float(np.median(self.sigma[self.known])) if self.known.any() else np.inf

    @property
    def size(self) -> float:
        """[m] that a deviation must exceed to be part of a region, if nothing else is asked."""
        return 2.0 * (POSE_ERROR + self.noise)

    def labelled(self, size: float) -> tuple[np.ndarray, int]:
        """Regions beyond `size` [m] to one side that are somewhere beyond doubt: numbers from 1, and how many."""
        label, count = np.zeros(self.known.shape, dtype=np.int64), 0
        for side in (1.0, -1.0):
            part = ndimage.label(self.known & (side * self.deviation > size))[0]
            certain = self.known & (side * self.deviation > _DOUBT * self.sigma + POSE_ERROR)
            for k in np.unique(part[certain & (part > 0)]):
                count += 1
                label[part == k] = count
        return label, count

    def region(self, inside: np.ndarray) -> Region:
        """What is to be said of the pixels `inside`."""
        points, off, area = self.points_S[inside], self.deviation[inside], self.area[inside]
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


def _refitted(evidence: Evidence, surface: ModelSurface, X_ST: Array, deformed: np.ndarray) -> Array:
    """The pose (4, 4) by the pixels that are not `deformed` (H, W); `X_ST` itself where these do not hold it."""
    rest = evidence.mask & ~deformed
    if not deformed.any() or rest.sum() < MIN_POINTS:
        return X_ST
    fit = fine_fit(Evidence.of(evidence.scan, rest, 0.8 * surface.spacing, evidence.sensor), surface, X_ST)
    return X_ST if len(fit.free) > (surface.target.symmetry.axis is not None) else fit.X_ST
