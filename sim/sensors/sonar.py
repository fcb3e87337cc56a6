"""Multibeam 3D sonar, simulated by ray casting, with finite beam width and echo errors.

The sonar can be mounted on any body of any compiled model, and sees primitives, meshes, height
fields and visual-only geoms:

    sonar = Sonar(model, "world", X_WS)  # S has OpenCV axes: x right, y down, z ahead
    points_S = sonar.ping(data, np.random.default_rng(0))  # (H, W, 3) [m], NaN without an echo
    points_S = sonar.ping(data, rng, X_WS=elsewhere)  # the same sonar at another pose

It is also a `uuv.sim.interfaces.protocols.Sensor` for the step loop, with messages `SonarScan`.
"""

from dataclasses import dataclass
from typing import Any, Literal

import mujoco
import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.messages import SonarScan
from uuv.sim.interfaces.spatial import Array, checked_pose, pose, readonly
from uuv.sim.sensors.visible_world import ALL, BodyPoses, Rays, Visible, body_id, site_on_body

NEAR = 0.02  # [m] surfaces closer than this to the sonar are not seen

# Within a beam, rays are cast along its axis and on a ring around it.
_RING = 0.8  # radius of the ring, as a share of the beam's half width
_ON_RING = 6  # number of rays on the ring


@dataclass(frozen=True, slots=True, kw_only=True)
class SonarBeams:
    """Grid of beams, evenly spaced in azimuth (columns, about y) and elevation (rows), and the kind
    of echo.

    The range of the "first" echo is the range of the nearest surface in the beam. The range of the
    "strongest" echo is that of the largest area across the beam within one range cell.
    """

    rows: int = 72
    columns: int = 96
    elevation: float = np.deg2rad(45.0)  # [rad] between the first and the last row
    azimuth: float = np.deg2rad(60.0)  # [rad] between the first and the last column
    # [rad] width of a beam at half power; its footprint is 21 mm at 1 m
    width: float = np.deg2rad(1.2)
    echo: Literal["first", "strongest"] = "strongest"

    def __post_init__(self) -> None:
        if not all(
            isinstance(count, int | np.integer) and count >= 1
            for count in (self.rows, self.columns)
        ):
            raise ConfigurationError(
                f"sonar: rows and columns of beams must be whole numbers >= 1, got {self.rows} x "
                f"{self.columns}"
            )

        for name in ("elevation", "azimuth"):
            if not 0.0 <= getattr(self, name) < np.deg2rad(175.0):
                raise ConfigurationError(
                    f"sonar: {name} must lie in [0, 175) deg, got {getattr(self, name)} rad"
                )
        if not 0.0 <= self.width <= np.deg2rad(30.0):
            raise ConfigurationError(
                f"sonar: beam width must lie in [0, 30] deg, got {self.width} rad"
            )
        if self.echo not in ("first", "strongest"):
            raise ConfigurationError(
                f"sonar: echo must be 'first' or 'strongest', got {self.echo!r}"
            )

    @property
    def pitch(self) -> float:
        """Angle [rad] between neighbouring columns."""
        return self.azimuth / max(1, self.columns - 1)

    def axes(self) -> Array:
        """Unit axes (rows, columns, 3) of the beams in S."""
        down = np.linspace(-0.5, 0.5, self.rows) * self.elevation if self.rows > 1 else np.zeros(1)
        right = (
            np.linspace(-0.5, 0.5, self.columns) * self.azimuth if self.columns > 1 else np.zeros(1)
        )

        elevation, azimuth = np.meshgrid(down, right, indexing="ij")
        return np.stack(
            [
                np.cos(elevation) * np.sin(azimuth),
                np.sin(elevation),
                np.cos(elevation) * np.cos(azimuth),
            ],
            axis=-1,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class SonarNoise:
    """Error model of the echoes. The values are orders of magnitude from range cell and beam width,
    since no manufacturer publishes them.
    """

    range_share: float = 0.003  # standard deviation of the range, as a share of it
    range_cell: float = 0.01  # [m] to which ranges are rounded; 0: no rounding
    # standard deviation of a beam's direction about each axis, as a share of its width
    pointing: float = 0.25
    outliers: float = 0.03  # share of the beams that report a random range within the limits
    max_incidence: float = np.deg2rad(75.0)  # [rad] from the surface normal; no echo beyond it

    def __post_init__(self) -> None:
        for name in ("range_share", "range_cell", "pointing"):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise ConfigurationError(
                    f"sonar noise: {name} must not be negative, got {getattr(self, name)}"
                )
        if not 0.0 <= self.outliers <= 1.0:
            raise ConfigurationError(
                f"sonar noise: outliers must lie in [0, 1], got {self.outliers}"
            )
        if not 0.0 < self.max_incidence <= 0.5 * np.pi:
            raise ConfigurationError(
                f"sonar noise: max_incidence must lie in (0, pi/2], got {self.max_incidence}"
            )


BEAMS = SonarBeams()
NOISE = SonarNoise()


@dataclass(frozen=True, slots=True, kw_only=True)
class SonarState:
    """State of the noise. A ping depends only on this state and the truth, so a run can be
    repeated.
    """

    seed: int
    ping: int


class Sonar:
    """3D sonar fixed to a body of a compiled model. It sends one ping for each request (`period`
    0).

    An echo is placed on the axis of its beam.
    """

    period = 0.0  # [s], on request

    def __init__(
        self,
        model: mujoco.MjModel,
        body: str,
        X_BS: Array,
        *,
        beams: SonarBeams = BEAMS,
        noise: SonarNoise | None = NOISE,
        range_limits: tuple[float, float] = (0.3, 10.0),
        delay: float = 0.0,
        visible: Visible = ALL,
    ) -> None:
        """Mount the sonar on a body.

        Height fields are read once, by this call.

        Args:
            model: Compiled model.
            body: Name of the body; "world": fixed in W.
            X_BS: Pose of the sonar in the body (4, 4), OpenCV axes.
            beams: Grid of beams, and which echo of a beam counts.
            noise: Error model; None: only the effect of the beam width.
            range_limits: Closest and farthest range [m].
            delay: [s]
            visible: Surfaces that the sonar sees.

        Raises:
            ConfigurationError: A body is unknown, or a number is invalid.
            MissingLibraryError: No ray caster is installed.
        """
        if not (len(range_limits) == 2 and 0.0 < range_limits[0] < range_limits[1] < np.inf):
            raise ConfigurationError(
                f"sonar: range_limits must be 0 < near < far, got {range_limits}"
            )
        if not delay >= 0.0:
            raise ConfigurationError(f"sonar: delay must not be negative, got {delay}")

        self.delay = delay
        self._body = body_id(model, body, "sonar")
        self._X_BS = checked_pose(X_BS, "X_BS")
        self._beams = beams
        self._noise = noise
        self._range = range_limits
        self._world = visible.world(model, "sonar")
        self._axes = beams.axes()

        # Two axes across each beam, for the directions of the rays on the ring.
        right = np.stack(
            [self._axes[..., 2], np.zeros(self._axes.shape[:2]), -self._axes[..., 0]], axis=-1
        )
        self._right = right / np.linalg.norm(right, axis=-1, keepdims=True)
        self._down = np.cross(self._axes, self._right)

        # Two-way share of the beam's power, for its axis and for each ray of the ring.
        ring = 0.5 ** (2.0 * _RING**2)
        self._weight = np.array([1.0] + [ring] * _ON_RING) / (1.0 + _ON_RING * ring)

    @classmethod
    def at_site(cls, model: mujoco.MjModel, site: str, **options: Any) -> "Sonar":
        """Sonar at a site, looking along its z axis with x to the right.

        Args:
            model: Compiled model.
            site: Name of the site.
            **options: As in the constructor.

        Returns:
            The sonar.
        """
        body, X_BS = site_on_body(model, site, "sonar")
        return cls(model, body, X_BS, **options)

    @property
    def axes(self) -> Array:
        """Unit axes (H, W, 3) of the beams in S."""
        return readonly(self._axes)

    def init(self, rng: np.random.Generator) -> SonarState:
        """Draw the seed of this sonar's noise from `rng`."""
        return SonarState(seed=int(rng.integers(2**63)), ping=0)

    def step(self, state: SonarState, truth: BodyPoses) -> tuple[SonarState, SonarScan]:
        """One ping of the world at `truth`; the same state and truth give the same echoes."""
        points = self.ping(truth, np.random.default_rng([state.seed, state.ping]))
        scan = SonarScan(time=float(truth.time), points=points, X_BS=self._X_BS)
        return SonarState(seed=state.seed, ping=state.ping + 1), scan

    def ping(self, truth: BodyPoses, rng: np.random.Generator, X_WS: Array | None = None) -> Array:
        """Echoes of one ping.

        Args:
            truth: Object with `xpos` and `xmat`, such as an MjData after `mj_kinematics`.
            rng: Source of the errors.
            X_WS: Pose of the sonar (4, 4); default: the pose of its mount.

        Returns:
            Points (H, W, 3) [m] in S, NaN without an echo.

        Raises:
            ConfigurationError: The bodies have no poses yet, or `X_WS` is not a pose.
        """
        xpos = np.asarray(truth.xpos)
        R_W = np.asarray(truth.xmat).reshape(-1, 3, 3)
        if not R_W[0].any():
            raise ConfigurationError(
                "sonar: the bodies have no poses yet; call mujoco.mj_kinematics(model, data) first"
            )

        mounted = pose(R_W[self._body], xpos[self._body]) @ self._X_BS
        X = mounted if X_WS is None else checked_pose(X_WS, "X_WS")
        distance, cosine = self._world.cast(X, Rays.of(self._directions(rng), NEAR), xpos, R_W)

        # There is no echo at grazing incidence. Of each beam the nearest or the strongest echo is
        # taken.
        least = np.cos(self._noise.max_incidence) if self._noise is not None else 0.0
        distance[cosine < least] = np.inf
        cell = self._noise.range_cell if self._noise is not None else 0.0
        if self._beams.echo == "first" or distance.shape[2] == 1:
            r = distance.min(axis=2).astype(np.float64)
        else:
            r = _strongest(distance, cosine, self._weight, max(cell, 1e-3))

        if self._noise is not None:
            r = self._with_errors(r, self._noise, rng)
        r[~((r >= self._range[0]) & (r <= self._range[1]))] = np.nan
        return readonly(self._axes * r[..., None])

    def _directions(self, rng: np.random.Generator) -> np.ndarray:
        """Unit directions (H, W, K, 3) of the rays: for each beam its axis first, then the ring."""
        width = self._beams.width
        shape = self._axes.shape[:2]
        off = np.zeros((*shape, 2))
        if self._noise is not None and self._noise.pointing > 0.0:
            off = self._noise.pointing * width * rng.standard_normal((*shape, 2))

        if width == 0.0:
            return self._axes[:, :, None].astype(np.float32)

        angle = np.arange(_ON_RING) * (2.0 * np.pi / _ON_RING)
        within = 0.5 * width * _RING * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        offsets = off[:, :, None] + np.concatenate([np.zeros((1, 2)), within])

        rays = (
            self._axes[:, :, None]
            + np.tan(offsets[..., :1]) * self._right[:, :, None]
            + np.tan(offsets[..., 1:]) * self._down[:, :, None]
        )
        return (rays / np.linalg.norm(rays, axis=-1, keepdims=True)).astype(np.float32)

    def _with_errors(self, r: Array, noise: SonarNoise, rng: np.random.Generator) -> Array:
        r = r * (1.0 + noise.range_share * rng.standard_normal(r.shape))
        is_outlier = rng.random(r.shape) < noise.outliers
        r[is_outlier] = rng.uniform(*self._range, int(is_outlier.sum()))
        if noise.range_cell > 0.0:
            r = np.rint(r / noise.range_cell) * noise.range_cell
        return r


@kernel
def _strongest(
    distance: np.ndarray, cosine: np.ndarray, weight: np.ndarray, cell: float
) -> np.ndarray:
    """Range (H, W) [m] of the strongest echo. The powers of rays that return within one range cell
    add up.

    A ray's power is its share of the beam times the cosine of incidence. By Lambert's law the power
    that an area scatters back is proportional to the square of the cosine, and the area in the beam
    to its inverse. The range is the mean over the echo's rays.
    """
    rows, columns, rays = distance.shape
    ranges = np.full((rows, columns), np.inf)

    for i in range(rows):
        for j in range(columns):
            best = 0.0
            for k in range(rays):
                power = 0.0
                moment = 0.0
                for m in range(rays):
                    gap = distance[i, j, m] - distance[i, j, k]
                    if gap >= 0.0 and gap < cell:
                        ray_power = weight[m] * cosine[i, j, m]
                        power += ray_power
                        moment += ray_power * distance[i, j, m]
                if power > best:
                    best = power
                    ranges[i, j] = moment / power

    return ranges
