"""Judgement of an identification: errors modulo geometric symmetry, and what a view could tell at
all.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from experiments.identification.unseen.likeness import DIFFERENT
from experiments.identification.unseen.scenes import UnseenScene
from uuv.clouds.frames import FOCAL, pinhole
from uuv.models.meshes.ray_casting import RayScene
from uuv.perception.clouds.scan import SensorModel
from uuv.sim.interfaces.spatial import Array, inverse, transform_points

# [m] and share of the range that a found position may be off, [deg] of attitude
FOUND = (0.005, 0.003, 3.0)
TELLING = 0.02  # [-] share of the view from which on it can tell a shape from its mirror image
# Expected gain over the best rival pose from which on a view can tell the pose: the gain is normal
# with a variance of twice its mean, so that noise makes the rival more likely in 4 % of the views.
RIVAL_GAIN = 6.0  # [nat]
SIZED = 0.015  # [-] standard deviation of the size from which on a view cannot tell 5 %
SURE = 2.0  # [-] standard deviations of a pose that must lie within FOUND for a view to show it
_STEP = 4  # [px] between the rays of a view
_OUTLIER = 3.0  # [sigma] beyond which a reading counts as an outlier
_BEHIND = 0.02  # [m] least distance of what lies behind an edge of the object's image
_SMOOTH = 2.0  # [px] of the Gaussian for the direction across such an edge
# [1/m2], [1/rad2], [-] information without any view: 1 m, 1 rad, and a factor of e in size
_PRIOR = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseError:
    """Error of an identified pose."""

    position_m: float  # [m] of the object's centroid
    angle_deg: float  # [deg] modulo the geometric symmetry
    found: bool  # within FOUND


def pose_error(scene: UnseenScene, X_CT: Array) -> PoseError:
    """Error of the pose `X_CT` (4, 4) in C, modulo the geometric symmetry of the shape.

    Args:
        scene: The scene with the true pose.
        X_CT: (4, 4) identified pose.
    """
    position, angle = scene.likeness.symmetry.error(X_CT, scene.X_CT)
    degrees = float(np.rad2deg(angle))
    near = position < FOUND[0] + FOUND[1] * scene.range_m and degrees < FOUND[2]
    return PoseError(position_m=position, angle_deg=degrees, found=bool(near))


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewBounds:
    """Cramer-Rao bounds of one view: least standard deviations that any unbiased estimate has."""

    position_m: float  # [m] of the centroid, in its worst direction, the size being known
    angle_deg: float  # [deg] of the attitude about its worst axis, a continuous symmetry left out
    size: float  # [-] of the size, the pose being unknown

    def shows_pose(self, range_m: float) -> bool:
        """Whether SURE standard deviations of the pose lie within FOUND at `range_m` [m]."""
        position = FOUND[0] + FOUND[1] * range_m
        return SURE * self.position_m < position and SURE * self.angle_deg < FOUND[2]


class ViewOfObject:
    """What the view of a scene tells about the object in it, from exact depth."""

    def __init__(self, scene: UnseenScene) -> None:
        self._scene = scene
        self._rays = pinhole(_STEP)
        self._exact = scene.exact[::_STEP, ::_STEP]
        self._seen = scene.seen[::_STEP, ::_STEP]
        self.points_C = self._rays[self._seen] * self._exact[self._seen][:, None]  # (n, 3) [m]

    def rival_nats(self, sensor: SensorModel) -> float:
        """Expected gain [nat] in log likelihood of the true pose over the best rival; inf if there
        is no rival.

        Args:
            sensor: Noise of the depth readings.
        """
        likeness, X_CT = self._scene.likeness, self._scene.X_CT
        seen_T = transform_points(inverse(X_CT), self.points_C)

        gains = [np.inf]
        for rival in likeness.rivals if len(seen_T) else ():
            S = likeness.settled(rival, seen_T)
            if likeness.are_rivals(S, np.eye(4)):
                gains.append(self._gain(X_CT @ inverse(S), sensor))
        return min(gains)

    def _gain(self, X_CT: Array, sensor: SensorModel) -> float:
        """Expected gain [nat] in log likelihood of the true scene over the model at `X_CT`."""
        t, exact = self._model_depth(X_CT), self._exact
        hit = np.isfinite(t)

        # Also where the model would occlude measured points, or is missing.
        off = np.full(t.shape, _OUTLIER)
        both = hit & self._seen
        off[both] = np.minimum(np.abs(t[both] - exact[both]) / sensor.sigma(exact[both]), _OUTLIER)

        # Where the model would hide what lies behind it.
        hides = hit & ~self._seen
        hides[hides] = t[hides] < exact[hides] - _OUTLIER * sensor.sigma(t[hides])

        cost = 0.5 * np.square(off[self._seen | hides])
        return float(sensor.independent(_STEP * sensor.focal / FOCAL) * cost.sum())

    def _model_depth(self, X_CT: Array) -> np.ndarray:
        """Depth (h, w) [m] of the model at `X_CT` (4, 4) alone, inf where it is missed."""
        X_TC, shape = inverse(X_CT), self._scene.shape
        return RayScene(shape.vertices, shape.triangles).distance(
            X_TC[:3, 3], self._rays @ X_TC[:3, :3].T
        )

    def mirror_share(self) -> float:
        """Least share of the view in which the model contradicts the scene, where its mirror image
        stands.
        """
        likeness, X_CT = self._scene.likeness, self._scene.X_CT
        mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
        seen_T = transform_points(mirror @ inverse(X_CT), self.points_C)

        shares = [1.0]
        for reflection in likeness.reflections:
            S = likeness.settled(reflection, seen_T)
            shares.append(self.contradicted(X_CT @ mirror @ inverse(S)))
        return min(shares)

    def contradicted(self, X_CT: Array) -> float:
        """Share of the pixels of object and model, posed at `X_CT` (4, 4), where both lie apart."""
        off = (
            self._scene.likeness.distance(transform_points(inverse(X_CT), self.points_C))
            > DIFFERENT
        )

        # It would occlude points that were measured there.
        hides = (self._model_depth(X_CT) < self._exact - DIFFERENT) & ~self._seen

        total = len(off) + int(hides.sum())
        return float((off.sum() + hides.sum()) / max(1, total))

    def bounds(self, sensor: SensorModel) -> ViewBounds:
        """Cramer-Rao bounds of pose and size, from the surface in view and the outline against what
        lies behind.

        Args:
            sensor: Noise of the depth readings and of the edges.
        """
        axis = self._scene.likeness.symmetry.axis
        turns = np.eye(3) if axis is None else np.linalg.svd(axis[None])[2][1:]

        # Jacobian of the distance along the normal: shift, turns that are no symmetry, size.
        rows = []
        for p, n, sigma in (self._surface(sensor), self._outline(sensor)):
            J = np.column_stack([n, np.cross(p, n) @ turns.T, np.einsum("ni,ni->n", n, p)])
            rows.append(J / sigma[:, None])
        J = np.vstack(rows)

        H = J.T @ J + _PRIOR * np.eye(J.shape[1])
        pose_covariance, covariance = np.linalg.inv(H[:-1, :-1]), np.linalg.inv(H)
        return ViewBounds(
            position_m=float(np.sqrt(np.linalg.eigvalsh(pose_covariance[:3, :3])[-1])),
            angle_deg=float(np.rad2deg(np.sqrt(np.linalg.eigvalsh(pose_covariance[3:, 3:])[-1]))),
            size=float(np.sqrt(covariance[-1, -1])),
        )

    def _surface(self, sensor: SensorModel) -> tuple[Array, Array, Array]:
        """Points (n, 3) [m] in view, normals (n, 3), both in T, and standard deviations (n,) [m]
        along the normals.
        """
        shape = self._scene.there or self._scene.shape
        X_TC = inverse(self._scene.X_CT)
        rays = self._rays[self._seen] @ X_TC[:3, :3].T

        hit = RayScene(shape.vertices, shape.triangles).cast(X_TC[:3, 3], rays)
        n, z = hit["normal"].astype(np.float64), hit["t"].astype(np.float64)
        # cosine of incidence times the length of the ray
        across = np.abs(np.einsum("ni,ni->n", n, rays))
        good = np.isfinite(z) & (
            across > np.cos(sensor.max_incidence) * np.linalg.norm(rays, axis=1)
        )
        n, z, across, rays = n[good], z[good], across[good], rays[good]

        share = sensor.independent(_STEP * sensor.focal / FOCAL)
        return X_TC[:3, 3] + z[:, None] * rays, n, sensor.sigma(z) * across / np.sqrt(share)

    def _outline(self, sensor: SensorModel) -> tuple[Array, Array, Array]:
        """As `_surface`, for the pixels at the object's edge with something farther beside them."""
        visible, depth = self._scene.seen, self._scene.exact
        edge = np.zeros_like(visible)
        for axis in (0, 1):
            for step in (-1, 1):
                beside = np.roll(depth, step, axis=axis)
                edge |= visible & ~np.roll(visible, step, axis=axis) & (beside > depth + _BEHIND)
        edge[[0, -1]] = edge[:, [0, -1]] = False  # the border of the image

        # Normal of the plane of ray and edge, from the slope of the smoothed image.
        smooth = ndimage.gaussian_filter(visible.astype(np.float64), _SMOOTH)
        gy, gx = (slope[edge] for slope in np.gradient(smooth))
        rays = pinhole(1)[edge]
        n = np.cross(rays, np.column_stack([-gy, gx, np.zeros_like(gx)]))
        length = np.linalg.norm(n, axis=1)

        good = length > 0.0
        n, rays, z = n[good] / length[good, None], rays[good], depth[edge][good].astype(np.float64)

        X_TC = inverse(self._scene.X_CT)
        share = min(1.0, sensor.focal / FOCAL / sensor.noise_length)
        sigma = sensor.edge_sigma * z / sensor.focal / np.sqrt(share)
        return transform_points(X_TC, rays * z[:, None]), n @ X_TC[:3, :3].T, sigma
