"""Loads on the joints of an arm: link weights, buoyancy in water, and the payload in the tool.

A joint with compliance c [rad/(N m)] is at q + c tau [Yukhimets 2020]. Touches of one point under
different moments make c observable, except at joints whose moment does not change.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from uuv.calib import kernels
from uuv.models.arms.kinematics import A, D, frames
from uuv.models.arms.serial_arm import SerialArm
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import GRAVITY, Array, checked

# [kg/m] assumed if no mass is stated; only ratios of moments matter, since c absorbs the factor
_EVEN = 10.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Loads:
    """Weights and buoyancy on an arm. Frame k moves with joint k (standard DH).

    Without `link_masses` the arm is assumed to have 10 kg/m along its links. Compliances are then
    relative to that assumption, and still compensate the sag.
    """

    link_masses: ArrayLike | None = None  # (n,) [kg]
    # (n, 3) [m] centre of mass of link k in frame k; default: the middle of the link
    link_centers: ArrayLike | None = None
    link_volumes: ArrayLike = 0.0  # (n,) or one number [m^3] displaced
    # (n, 3) [m] centre of buoyancy in frame k; default: the centre of mass
    link_buoyancy_centers: ArrayLike | None = None
    # [kg] one number for all touches, one per series, or (m_i,) per touch
    payload_mass: ArrayLike | Sequence[ArrayLike] = 0.0
    payload_center: ArrayLike = (0.0, 0.0, 0.0)  # (3,) [m] centre of mass in the flange frame
    payload_volume: float = 0.0  # [m^3] displaced by the payload, if there is one
    water_density: float = 0.0  # [kg/m^3] density of the water; 0 in air
    gravity: ArrayLike = (0.0, 0.0, -GRAVITY)  # (3,) [m/s^2] in the arm's base frame

    def bind(self, arm: SerialArm, counts: Sequence[int]) -> "BoundLoads":
        """Evaluate the loads for `arm` over series of `counts` touches.

        Raises:
            ConfigurationError: wrong shapes or signs.
        """
        n = arm.n
        gravity = checked(self.gravity, (3,), "loads.gravity")
        middles, lengths = _middles(arm)

        link_masses = self.link_masses
        masses = (
            _EVEN * lengths
            if link_masses is None
            else checked(link_masses, (n,), "loads.link_masses")
        )
        centers = (
            middles
            if self.link_centers is None
            else checked(self.link_centers, (n, 3), "loads.link_centers")
        )

        volumes = np.broadcast_to(np.asarray(self.link_volumes, dtype=np.float64), (n,))
        buoyant = self.link_buoyancy_centers
        cob = (
            centers if buoyant is None else checked(buoyant, (n, 3), "loads.link_buoyancy_centers")
        )

        if not (np.all(masses >= 0.0) and np.all(volumes >= 0.0) and self.water_density >= 0.0):
            raise ConfigurationError(
                "loads: masses, volumes and the water's density must not be negative"
            )

        forces = np.stack(
            [masses[:, None] * gravity, -self.water_density * volumes[:, None] * gravity], axis=1
        )

        return BoundLoads(
            arm=arm,
            forces=np.ascontiguousarray(forces),
            points=np.ascontiguousarray(np.stack([centers, cob], axis=1)),
            payload=self._payload(counts),
            center=checked(self.payload_center, (3,), "loads.payload_center"),
            displaced=self.water_density * self.payload_volume,
            gravity=gravity,
        )

    def _payload(self, counts: Sequence[int]) -> Array:
        """Payload mass (M,) [kg] of every touch."""
        total = int(np.sum(counts))
        payload = self.payload_mass
        if isinstance(payload, (int, float)):
            masses = np.full(total, float(payload))
        else:
            series_masses = list(payload)  # pyright: ignore[reportArgumentType]
            if len(series_masses) != len(counts):
                raise ConfigurationError(
                    f"loads.payload_mass: must have one mass for each of the {len(counts)} series, "
                    f"got {len(series_masses)}"
                )

            parts = []

            for i, (series_mass, count) in enumerate(zip(series_masses, counts, strict=True)):
                part = np.asarray(series_mass, dtype=np.float64)
                if part.shape not in {(), (count,)}:
                    raise ConfigurationError(
                        f"loads.payload_mass of series {i + 1}: must be one mass or an array "
                        f"({count},), got shape {part.shape}"
                    )
                parts.append(np.broadcast_to(part, (count,)))
            masses = np.concatenate(parts)

        if not np.all(np.isfinite(masses) & (masses >= 0.0)):
            raise ConfigurationError(
                "loads.payload_mass: every mass must be finite and not negative"
            )

        return masses


@dataclass(frozen=True, kw_only=True, eq=False)
class BoundLoads:
    """Loads of one arm at given touches, ready for the joint-load kernel."""

    arm: SerialArm
    forces: Array  # (n, 2, 3) [N] weight and buoyancy of each link
    points: Array  # (n, 2, 3) [m] where they act, in the link's frame
    payload: Array  # (M,) [kg]
    center: Array  # (3,) [m] centre of mass of the payload in the flange frame
    displaced: float  # [kg] of water displaced by the payload
    gravity: Array  # (3,) [m/s^2]

    def with_payload(self, mass: float, count: int) -> "BoundLoads":
        """Copy for the same arm with a payload of `mass` [kg] in each of `count` poses."""
        return replace(self, payload=np.full(count, float(mass)))

    def at(self, q: Array, places: np.ndarray | slice = slice(None)) -> Callable[[Array], Array]:
        """Function that maps the table (n, 5) to the joint loads (M, n) [N m] at the touches `q`
        (M, n).

        Args:
            q: (M, n) joint values at which the loads act.
            places: indices of these touches among all that were bound.

        Returns:
            Function of the table, for the estimation.
        """
        payload = self.payload[places]
        net = np.where(payload > 0.0, payload - self.displaced, 0.0)

        extra = np.ascontiguousarray(net[:, None, None] * self.gravity)
        X = self.arm.X_n_flange
        point = np.ascontiguousarray(
            np.broadcast_to(X[:3, :3] @ self.center + X[:3, 3], (len(q), 1, 3))
        )

        slides = self.arm.slides
        X_base_0 = self.arm.X_base_0

        def load(table: Array) -> Array:
            X = frames(table, slides, X_base_0, q)
            return kernels.joint_loads(X, slides, self.forces, self.points, extra, point)

        return load


def _middles(arm: SerialArm) -> tuple[Array, Array]:
    """Middle of each link in its own frame (n, 3) [m], and distance of its frames (n,) [m]."""
    middles = np.empty((arm.n, 3))
    X = frames(arm.table, arm.slides, arm.X_base_0, np.zeros((1, arm.n)))[0]

    for k in range(arm.n):
        start, end = X[k, :3, 3], X[k + 1, :3, 3]
        middles[k] = 0.5 * X[k + 1, :3, :3].T @ (start - end)

    return middles, np.hypot(arm.table[:, A], arm.table[:, D])
