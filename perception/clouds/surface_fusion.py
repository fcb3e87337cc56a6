"""Mesh of a surface from depth frames of many views, by a signed distance field [Curless 1996].

The field is truncated. Open3D integrates the frames.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from uuv.models.meshes import open3d_loader
from uuv.models.meshes.nearest_surface import NearestSurface
from uuv.perception.clouds.scan import Scan, SensorModel, without_flying_pixels
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import DepthImage
from uuv.sim.interfaces.spatial import (
    Array,
    checked,
    checked_pose,
    finite_number,
    inverse,
    readonly,
)

VOXEL = 0.006  # [m] voxel of the field; 8 mm is less accurate at edges, 4 mm no better
# [m] truncation, two deviations of a stereo frame at 1.4 m; 30 mm rounds edges off (95 %: 5.6
# instead of 3.0 mm)
_TRUNCATION = 0.02
# [-] largest standard deviation of a depth, as a share of the truncation; less accurate pixels
# hollow out the surface measured by others
_SURE = 0.55
# [px] width of the margin next to a jump of the depth that is left out, since a stereo matcher
# smears it
_EDGE = 3
# ratio of the vertices of a connected part to those of the largest, below which the part belongs to
# another object
_ISLAND = 0.05
_MOST_VOXELS = 400  # largest number of voxels along each side, 2 GB


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SurfaceMesh:
    """Measured surface and its signed distance from a model."""

    vertices: Array  # (V, 3) [m] in the object's frame T
    triangles: np.ndarray  # (F, 3)
    deviation: Array  # (V,) [m] distance from the model, positive outside


class SurfaceFusion:
    """Distance field in a cube around an object, to which depth frames are added one by one."""

    def __init__(
        self, box_T: ArrayLike, voxel: float = VOXEL, sensor: SensorModel | None = None
    ) -> None:
        """Set up an empty field.

        Args:
            box_T: (2, 3) [m] lowest and highest corner of the field, in the object's frame T.
            voxel: [m] resolution.
            sensor: Accuracy of the depth camera; None: `SensorModel()`. Pixels that are too
                inaccurate for the field are left out; with a stereo camera these are pixels farther
                than about 1.7 m.

        Raises:
            MissingLibraryError: Open3D is not installed.
            ConfigurationError: The box is empty, or has too many voxels.
        """
        self._integration = open3d_loader.load().pipelines.integration
        self._box = checked(box_T, (2, 3), "box_T")

        voxel = finite_number(voxel, "voxel [m]", above=0.0)
        side = float((self._box[1] - self._box[0]).max())
        count = math.ceil(side / voxel)

        if not (np.all(self._box[0] < self._box[1]) and count <= _MOST_VOXELS):
            raise ConfigurationError(
                f"surface fusion: a side must have 1 to {_MOST_VOXELS} voxels, but a box of "
                f"{side:g} m with voxels of {voxel:g} m has {count}"
            )

        origin = self._box.mean(axis=0) - 0.5 * count * voxel
        # The scalable volume of Open3D 0.20 returns no surface from depth alone.
        self._volume = self._integration.UniformTSDFVolume(
            count * voxel, count, _TRUNCATION, self._integration.TSDFVolumeColorType.NoColor, origin
        )

        self._sensor = sensor or SensorModel()
        self.frames = 0

    def add(self, image: DepthImage, X_TC: Array) -> None:
        """Add the part inside the box of a frame that was taken with the camera at `X_TC` (4,
        4).
        """
        o3d = open3d_loader.load()
        X_TC = checked_pose(X_TC, "X_TC")
        K = image.K
        height, width = image.depth.shape

        # Reliable depths: not next to an edge, accurate enough, inside the box
        scan = Scan.from_depth(image)
        edge = ndimage.binary_dilation(~without_flying_pixels(scan), iterations=_EDGE)
        depth = np.where(edge, 0.0, np.nan_to_num(image.depth))
        sigma = replace(self._sensor, focal=float(image.K[0, 0])).sigma(depth)
        depth[sigma > _SURE * _TRUNCATION] = 0.0
        points_T = scan.points @ X_TC[:3, :3].T + X_TC[:3, 3]
        depth[~np.all((points_T > self._box[0]) & (points_T < self._box[1]), axis=-1)] = 0.0

        # Frame in the types of Open3D
        frame = o3d.geometry.RGBDImage.create_from_color_and_depth(
            o3d.geometry.Image(np.zeros((height, width, 3), dtype=np.uint8)),
            o3d.geometry.Image(depth.astype(np.float32)),
            depth_scale=1.0,
            depth_trunc=float(depth.max()) + 1.0,
            convert_rgb_to_intensity=False,
        )
        pinhole = o3d.camera.PinholeCameraIntrinsic(
            width, height, K[0, 0], K[1, 1], K[0, 2], K[1, 2]
        )
        self._volume.integrate(frame, pinhole, inverse(X_TC))
        self.frames += 1

    def mesh(self, model: NearestSurface, normals: Array, reach: float) -> SurfaceMesh:
        """Surface from the frames added so far, restricted to the neighbourhood of a model.

        Args:
            model: Surface of the model, in T.
            normals: (T, 3) outward unit normals of its triangles.
            reach: [m] largest distance from the model; surface farther away and small unconnected
                parts belong to something else, such as a stand, the seabed or stray pixels.

        Returns:
            The mesh; it is empty if no frame showed the object.
        """
        extracted = self._volume.extract_triangle_mesh()
        vertices, triangles = np.asarray(extracted.vertices), np.asarray(extracted.triangles)

        if not len(vertices):
            return SurfaceMesh(
                vertices=np.empty((0, 3)), triangles=triangles.reshape(0, 3), deviation=np.empty(0)
            )

        # Signed distance from the model
        near = model.query(vertices)
        outside = np.einsum("nk,nk->n", vertices - near.point, normals[near.triangle])
        belongs = near.distance <= reach

        # Surface near the model, without islands
        faces = without_islands(triangles[belongs[triangles].all(axis=1)])
        used, index = np.unique(faces, return_inverse=True)
        return SurfaceMesh(
            vertices=readonly(vertices[used]),
            triangles=index.reshape(-1, 3),
            deviation=readonly(np.copysign(near.distance, outside)[used]),
        )


def without_islands(triangles: np.ndarray) -> np.ndarray:
    """Triangles (F, 3) of the largest connected part, and of all parts that are not much
    smaller.
    """
    if not len(triangles):
        return triangles

    edges = np.concatenate([triangles[:, :2], triangles[:, 1:]])
    size = int(triangles.max()) + 1
    part = connected_components(
        coo_array((np.ones(len(edges)), edges.T), shape=(size, size)), directed=False
    )[1]

    used = np.bincount(part[np.unique(triangles)])
    return triangles[used[part[triangles[:, 0]]] >= _ISLAND * used.max()]
