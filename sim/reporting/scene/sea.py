"""Appearance of the sea: colour and haze of the water over a distance, and sand on the ground."""

from functools import cache

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

Floats = NDArray[np.floating]  # of pixels: in single precision

SUN_W = np.array([0.3, -0.38, 0.87])
SUN_W /= np.linalg.norm(SUN_W)  # direction to the light, refracted at the surface

# Colours, red, green and blue in [0, 1]: water looked at from above, level and from below.
_DOWN = np.array([0.04, 0.22, 0.30], dtype=np.float32)
_LEVEL = np.array([0.10, 0.42, 0.52], dtype=np.float32)
_UP = np.array([0.45, 0.80, 0.86], dtype=np.float32)

# Share of light lost over the distance of the work: red first.
_LOST = np.array([0.07, 0.01, 0.03], dtype=np.float32)
_HAZE = 0.14  # share of the water's own light in a pixel at the distance of the work

_TILE = 6.0  # [m] after which the sand repeats
_CELLS = 512  # of the tile, a side
_RELIEF = 0.17  # share by which the sand's brightness varies
_NEAR_GROUND = 0.012  # [m] height over the ground at which a point is taken for it
_FAR = 60.0  # [m] half the side of a flat seabed as it is drawn


class SeaLook:
    """Water of a scene, with a clarity that grows with the pictures' extent, and the ground."""

    def __init__(self, model: mujoco.MjModel, reach: float) -> None:
        """Takes the ground of a compiled model.

        Args:
            model: Its first plane or height field of the world is the ground.
            reach: [m] distance of the work from the camera.
        """
        self.reach = reach
        self._model = model
        kinds = (int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD))
        self._grounds = [
            geom
            for geom in range(model.ngeom)
            if model.geom_type[geom] in kinds and model.geom_bodyid[geom] == 0
        ]

    def seen(self, colours: Floats, ways_W: Floats, distance: Floats) -> Floats:
        """Colours (N, 3) in [0, 1] as seen through the water.

        Args:
            colours: (N, 3) of what is there, lit.
            ways_W: (N, 3) unit vectors of the view.
            distance: (N,) [m]; infinite: nothing is there.
        """
        far = np.minimum(distance / self.reach, 50.0).astype(np.float32)[:, None]
        clear = np.exp(-_HAZE * far)
        veiled = self.water(ways_W)
        veiled *= 1.0 - clear
        return colours * clear * np.exp(-_LOST * far) + veiled

    def water(self, ways_W: Floats) -> Floats:
        """Colour (N, 3) of endless water along unit vectors (N, 3)."""
        steep = ways_W[:, 2].astype(np.float32)[:, None]
        upwards = np.clip(1.8 * steep, 0.0, 1.0)
        downwards = np.clip(-1.8 * steep, 0.0, 1.0)
        return _LEVEL + upwards * (_UP - _LEVEL) + downwards * (_DOWN - _LEVEL)

    def sand(self, points_W: Floats) -> Floats:
        """Brightness (N,) of the sand at points (N, 3) [m] on the ground; 1 anywhere else."""
        bright = np.ones(len(points_W), dtype=np.float32)
        on_ground = np.zeros(len(points_W), dtype=bool)
        for geom in self._grounds:
            on_ground |= abs(points_W[:, 2] - self._height(geom, points_W)) < _NEAR_GROUND

        cells = points_W[on_ground, :2] * (_CELLS / _TILE)
        bright[on_ground] = map_coordinates(_tile(), cells.T, order=1, mode="grid-wrap")
        return bright

    def _height(self, geom: int, points_W: Floats) -> Floats:
        """Height (N,) [m] in W of a ground below or above points (N, 3); NaN outside the ground."""
        model = self._model
        place = model.geom_pos[geom]
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
            return np.full(len(points_W), place[2])

        # Between the points of the field, whose axes are those of W.
        field = model.geom_dataid[geom]
        rows = int(model.hfield_nrow[field])
        columns = int(model.hfield_ncol[field])
        half_x, half_y, top, _ = model.hfield_size[field]
        first = model.hfield_adr[field]
        heights = top * model.hfield_data[first : first + rows * columns].reshape(rows, columns)

        x, y = (points_W[:, :2] - place[:2]).T
        at = [(y / half_y + 1.0) * 0.5 * (rows - 1), (x / half_x + 1.0) * 0.5 * (columns - 1)]
        return place[2] + map_coordinates(heights, at, order=1, cval=np.nan)


def drawn_model(model: mujoco.MjModel) -> mujoco.MjModel:
    """Copy of a model for drawing, whose flat seabeds extend to the limit of view."""
    import copy

    drawn = copy.deepcopy(model)
    planes = drawn.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
    drawn.geom_size[planes, :2] = _FAR
    return drawn


@cache
def _tile() -> Floats:
    """Periodic brightness (_CELLS, _CELLS) of sand with ripples, and patches of all sizes."""
    rng = np.random.default_rng(5)
    waves = np.fft.fftfreq(_CELLS, 1.0 / _CELLS)
    ky, kx = np.meshgrid(waves, waves, indexing="ij")
    k = np.hypot(kx, ky)

    patches = _noise(rng, np.where(k > 0.0, np.maximum(k, 2.0) ** -1.8, 0.0) * (k < 120.0))
    # Ripples: wave crests some 18 cm apart, nearly parallel. No grain: a clip has no room for it.
    crests = np.exp(-(((abs(kx) - 34.0) / 8.0) ** 2) - (ky / 9.0) ** 2)
    relief = 0.55 * patches + 0.4 * _noise(rng, crests)
    return (1.0 + _RELIEF * np.clip(relief, -2.0, 2.0)).astype(np.float32)


def _noise(rng: np.random.Generator, spectrum: Floats) -> Floats:
    """Periodic noise of a spectrum (n, n), of variance 1."""
    white = np.fft.fft2(rng.standard_normal(spectrum.shape))
    noise = np.fft.ifft2(white * spectrum).real
    return noise / noise.std()
