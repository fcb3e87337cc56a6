"""Slant ranges of a Doppler velocity log to the ground along each beam, simulated by ray
casting.
"""

from collections.abc import Collection
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import DvlRangesMeasurement
from uuv.sim.interfaces.spatial import Array, checked, pose, readonly
from uuv.sim.sensors.visible_world import BodyPoses, Rays, VisibleWorld, body_id

NEAR = 0.02  # [m] closest distance at which a ray can hit


@dataclass(frozen=True, slots=True, kw_only=True)
class DvlBeams:
    """Janus array: beams evenly spaced around the vertical, the first ahead to port, and their
    errors.
    """

    count: int = 4
    # [rad] of each beam from the vertical; 20 to 30 deg for most arrays
    slant: float = float(np.radians(30.0))
    noise: float = 0.01  # white, share of the range: an order of magnitude
    dropouts: float = 0.02  # share of the pings without an echo, for each beam
    limits: tuple[float, float] = (0.3, 50.0)  # [m]
    dead: tuple[int, ...] = ()  # failed beams, counted from 1

    def __post_init__(self) -> None:
        if not (self.count >= 1 and 0.0 <= self.slant < 0.5 * np.pi):
            raise ConfigurationError(
                f"Doppler log: count must be >= 1 and slant in [0, pi/2) rad, got {self.count}, "
                f"{self.slant}"
            )
        if not (0.0 <= self.noise < 1.0 and 0.0 <= self.dropouts <= 1.0):
            raise ConfigurationError(
                f"Doppler log: noise must be in [0, 1) and dropouts in [0, 1], got {self.noise} "
                f"and {self.dropouts}"
            )
        if not 0.0 < self.limits[0] < self.limits[1] < np.inf:
            raise ConfigurationError(
                f"Doppler log: limits must be 0 < near < far [m], got {self.limits}"
            )
        if not all(1 <= beam <= self.count for beam in self.dead):
            raise ConfigurationError(
                f"Doppler log: numbers of dead beams must be 1 to {self.count}, got {self.dead}"
            )

    def axes(self) -> Array:
        """Unit axes (count, 3) of the beams in hull axes, downwards."""
        around = (np.arange(self.count) + 0.5) * (2.0 * np.pi / self.count)
        level = np.sin(self.slant)
        down = np.full(self.count, -np.cos(self.slant))
        return np.column_stack([level * np.cos(around), level * np.sin(around), down])


@dataclass(frozen=True, slots=True)
class DvlRanges:
    """Sensor of the slant ranges; `uuv.sim.sensors.proprioception.Dvl` is the sensor of the
    velocity.
    """

    world: VisibleWorld
    body: int
    p_BD: Array  # (3,) [m] position of the array in the hull
    beams: DvlBeams
    period: float = 0.1  # [s]
    delay: float = 0.0  # [s]

    @classmethod
    def on(
        cls,
        model: mujoco.MjModel,
        body: str,
        p_BD: ArrayLike,
        beams: DvlBeams | None = None,
        exclude: Collection[str] = (),
    ) -> "DvlRanges":
        """Mount the array on a body.

        Args:
            model: Compiled model.
            body: Name of the body.
            p_BD: Position of the array in the body (3,) [m].
            beams: Array and errors; default: `DvlBeams()`.
            exclude: Names of bodies that are invisible to it.

        Returns:
            The sensor.

        Raises:
            ConfigurationError: A body is unknown.
        """
        world = VisibleWorld(
            model, exclude={body_id(model, name, "Doppler log") for name in exclude}
        )
        return cls(
            world,
            body_id(model, body, "Doppler log"),
            checked(p_BD, (3,), "p_BD"),
            beams or DvlBeams(),
        )

    def init(self, rng: np.random.Generator) -> np.random.Generator:
        """Initial state, which is the random stream."""
        return rng

    def step(
        self, state: np.random.Generator, truth: BodyPoses
    ) -> tuple[np.random.Generator, DvlRangesMeasurement]:
        """Measure the slant ranges."""
        beams = self.beams
        axes = self.beams.axes()
        xpos = np.asarray(truth.xpos)
        R_W = np.asarray(truth.xmat).reshape(-1, 3, 3)
        X_WD = pose(R_W[self.body], xpos[self.body]) @ pose(p=self.p_BD)
        hit, _ = self.world.cast(
            X_WD, Rays.of(axes[None, :, None].astype(np.float32), NEAR), xpos, R_W
        )

        ranges = hit.reshape(-1).astype(np.float64) * (
            1.0 + beams.noise * state.standard_normal(beams.count)
        )

        # Beams without an echo, failed ones, and echoes out of range.
        silent = state.random(beams.count) < beams.dropouts
        silent[[beam - 1 for beam in beams.dead]] = True
        silent |= ~((ranges >= beams.limits[0]) & (ranges <= beams.limits[1]))
        ranges[silent] = np.nan

        return state, DvlRangesMeasurement(
            time=float(truth.time),
            ranges=readonly(ranges),
            axes_B=readonly(axes),
            p_BD=readonly(self.p_BD),
        )
