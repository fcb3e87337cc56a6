"""Judgement of an identification: errors modulo geometric symmetry, and what a view could tell at all."""

from dataclasses import dataclass

import numpy as np

from models.meshes.ray_casting import RayScene
from perception.clouds.scan import SensorModel
from scenarios.unseen.likeness import DIFFERENT, Likeness
from scenarios.unseen.scenes import UnseenScene, pinhole
from sim.interfaces.spatial import Array, inverse, transform_points

FOUND = (0.005, 0.003, 3.0)  # [m] and share of the range that a found position may be off, [deg] of attitude
TELLING = 0.02  # [-] share of the surface in view from which on a view can tell two poses, or hands, apart
SIZED = 0.015  # [-] standard deviation of the size from which on a view cannot tell 5 %
_STEP = 4  # [px] between the rays of a view
_TURNED = np.deg2rad(3.0)  # [rad] least turn of a rival pose
_FREE = 1e-9  # [-] eigenvalues below this share of the largest are symmetries


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


class ViewOfObject:
    """What the view of a scene tells about the object in it, from exact depth."""

    def __init__(self, scene: UnseenScene) -> None:
        self._scene = scene
        self._rays = pinhole(_STEP)
        self._exact = scene.exact[::_STEP, ::_STEP]
        self._seen = scene.seen[::_STEP, ::_STEP]
        self.points_C = self._rays[self._seen] * self._exact[self._seen][:, None]  # (n, 3) [m]

    def rival_share(self) -> float:
        """Least share of the view in which another attitude of the model contradicts the scene; 1 if none is alike."""
        likeness, X_CT = self._scene.likeness, self._scene.X_CT
        seen_T = transform_points(inverse(X_CT), self.points_C)
        shares = [1.0]
        for rival in likeness.rivals:
            S = likeness.settled(rival, seen_T) if len(seen_T) else rival
            if likeness.symmetry.error(S, np.eye(4))[1] > _TURNED:
                shares.append(self._contradicted(X_CT @ inverse(S), likeness))
        return min(shares)

    def mirror_share(self) -> float:
        """Least share of the view in which the model contradicts the scene, where its mirror image stands."""
        likeness, X_CT = self._scene.likeness, self._scene.X_CT
        mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
        seen_T = transform_points(mirror @ inverse(X_CT), self.points_C)
        shares = [1.0]
        for reflection in likeness.reflections:
            S = likeness.settled(reflection, seen_T)
            shares.append(self._contradicted(X_CT @ mirror @ inverse(S), likeness))
        return min(shares)

    def _contradicted(self, X: Array, likeness: Likeness) -> float:
        """Share of the pixels with the object, or with the model at `X` (4, 4), in which both lie apart."""
        X_TC = inverse(X)
        off = likeness.distance(transform_points(X_TC, self.points_C)) > DIFFERENT
        shape = self._scene.shape
        t = RayScene(shape.vertices, shape.triangles).distance(X_TC[:3, 3], self._rays @ X_TC[:3, :3].T)
        shown = t < self._exact - DIFFERENT  # the model would hide what is seen there
        total = len(off) + int((shown & ~self._seen).sum())
        return float((off.sum() + (shown & ~self._seen).sum()) / max(1, total))

    def size_sigma(self, sensor: SensorModel) -> float:
        """Cramer-Rao bound [-] of the standard deviation of the object's size, from the surface in view.

        The pose is unknown as well. Edges of the image are left out; they can only make the size better known.

        Args:
            sensor: Noise of the depth readings.
        """
        scene = self._scene
        shape = scene.there or scene.shape
        X_TC = inverse(scene.X_CT)
        rays = self._rays[self._seen]
        if len(rays) < 8:
            return np.inf
        rays_T = rays @ X_TC[:3, :3].T
        hit = RayScene(shape.vertices, shape.triangles).cast(X_TC[:3, 3], rays_T)
        n = hit["normal"].astype(np.float64)
        p = X_TC[:3, 3] + hit["t"][:, None] * rays_T
        across = np.abs(np.einsum("ni,ni->n", n, rays_T))  # cosine of incidence times the length of the ray
        good = np.isfinite(hit["t"]) & (across > np.cos(sensor.max_incidence) * np.linalg.norm(rays_T, axis=1))
        n, p, across, z = n[good], p[good], across[good], hit["t"][good]
        weight = np.sqrt(sensor.independent(_STEP)) / (sensor.sigma(z) * across)
        J = weight[:, None] * np.column_stack([n, np.cross(p, n) / shape.radius, np.einsum("ni,ni->n", n, p)])
        H = J.T @ J
        values, axes = np.linalg.eigh(H[:6, :6])
        inverse_pose = axes @ np.diag(np.where(values > _FREE * values[-1], 1.0 / values, 0.0)) @ axes.T
        known = float(H[6, 6] - H[6, :6] @ inverse_pose @ H[:6, 6])
        return float(1.0 / np.sqrt(known)) if known > 0.0 else np.inf
