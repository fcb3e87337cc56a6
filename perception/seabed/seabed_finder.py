"""Target finder for seabed work: terrain and tool path from sonar scans or depth frames."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from uuv.perception.clouds.scan import Scan
from uuv.perception.clouds.sonar_cloud import without_isolated_echoes
from uuv.perception.seabed.relief import ReliefLimits
from uuv.perception.seabed.terrain_path import SeabedPlan, core_path, plan_seabed_work
from uuv.sim.interfaces.errors import ConfigurationError, PerceptionError
from uuv.sim.interfaces.messages import DepthImage, Measurement, SonarScan, StateEstimate, Target
from uuv.sim.interfaces.spatial import Array, checked, pose, readonly, transform_points


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeabedFinderState:
    """State of SeabedFinder: clouds collected for merging, and the last plan for the log."""

    waiting: tuple[Array, ...] = ()  # clouds (n, 3) [m] in W
    cloud_W: Array | None = None  # (n, 3) [m] last merged cloud
    plan: SeabedPlan | None = None  # last plan, in W; None if the work was refused


class SeabedFinder:
    """Target finder for seabed work: terrain of each scan, projected targets, tool path.

    Implements `uuv.sim.interfaces.protocols.TargetFinder`.
    """

    def __init__(
        self,
        B_W: ArrayLike,
        up_W: ArrayLike = (0.0, 0.0, 1.0),
        *,
        core_depth: float = 0.12,
        width: float = 0.1,
        limits: ReliefLimits | None = None,
        cloud_W: ArrayLike | None = None,
        looks: int = 1,
    ) -> None:
        """Prepare the planning for the given points over the seabed.

        Args:
            B_W: (s, 3) [m] points over the seabed in W: one for a core, more for a profile between
                them.
            up_W: (3,) vertical in W; the points are projected downwards along it.
            core_depth: [m] length of a core's path.
            width: [m] width of the tool.
            limits: Limits of the relief; None: `ReliefLimits()`.
            cloud_W: (n, 3) [m] cloud in W that replaces the scanned cloud; None: the scanned cloud
                is used.
            looks: Number of scans or frames that are merged, so that their noise averages out.

        Raises:
            ConfigurationError: The points are malformed, or `looks` is below 1.
        """
        self._B = np.array(B_W, dtype=np.float64)
        if self._B.ndim != 2 or self._B.shape[1:] != (3,) or not len(self._B):
            raise ConfigurationError(
                f"targets B: must be (s, 3) numbers, s > 0, got shape {self._B.shape}"
            )

        if isinstance(looks, bool) or looks < 1:
            raise ConfigurationError(f"looks: must be at least 1, got {looks}")

        self._looks = looks if cloud_W is None else 1
        self._up = np.array(checked(up_W, (3,), "up_W"))
        self._core_depth = core_depth
        self._width = width
        self._limits = limits
        self._cloud_W = None if cloud_W is None else np.asarray(cloud_W, dtype=np.float64)

    def init(self) -> SeabedFinderState:
        """Return the initial state: no clouds, no plan."""
        return SeabedFinderState()

    def step(
        self, state: SeabedFinderState, estimate: StateEstimate, measurement: Measurement
    ) -> tuple[SeabedFinderState, Target | None]:
        """Add one scan of the seabed, and plan the work once there are enough.

        Args:
            state: State from the last call, or from `init`.
            estimate: State of the vehicle at the time of `measurement`; X_WB places the sensor in
                W.
            measurement: A SonarScan or a DepthImage.

        Returns:
            The new state, and the target in W. The target is None while scans are collected. If no
                work is possible, the target is not accepted and contains the reason.

        Raises:
            ConfigurationError: `measurement` is of another type or malformed.
        """
        # Enough clouds are collected first
        points = (
            self._cloud_W
            if self._cloud_W is not None
            else points_in_world(estimate.X_WB, measurement)
        )
        clouds = (*state.waiting, points)
        if len(clouds) < self._looks:
            return replace(state, waiting=clouds), None

        # Plan, or a target that is refused
        cloud_W = np.concatenate(clouds)
        center = self._B.mean(axis=0)
        reach = float(np.linalg.norm(center - estimate.X_WB[:3, 3]))
        try:
            plan = plan_seabed_work(
                cloud_W, self._B, self._up, width=self._width, limits=self._limits
            )
        except PerceptionError as error:
            refused = _refused(measurement.time, center, reach, str(error))
            return SeabedFinderState(cloud_W=readonly(cloud_W)), refused

        # Path of the profile, or that of a core into the ground
        A = plan.targets.A
        away = np.linalg.norm(A - estimate.X_WB[:3, 3], axis=1)
        R = plan.terrain.R_ground
        path = plan.path or core_path(A[0], -R[2], R[0], self._core_depth)

        target = Target(
            time=measurement.time,
            X_WT=readonly(pose(p=A.mean(axis=0))),
            accepted=True,
            check_m=float(plan.targets.sigma.max()),
            range_m=float(away.max()),
            reason="",
            path=path,
            ground=plan.terrain.vertices,
        )
        return SeabedFinderState(cloud_W=readonly(cloud_W), plan=plan), target


def _refused(time: float, center: Array, reach: float, reason: str) -> Target:
    """Target at `center` (3,) [m] on which no work is possible, at a distance of `reach` [m]."""
    return Target(
        time=time,
        X_WT=readonly(pose(p=center)),
        accepted=False,
        check_m=float("inf"),
        range_m=reach,
        reason=reason,
        path=None,
    )


def points_in_world(X_WB: Array, measurement: Measurement) -> Array:
    """Points (n, 3) [m] in W of a sonar scan or depth frame, measured from a hull at `X_WB`."""
    if isinstance(measurement, SonarScan):
        points = without_isolated_echoes(measurement.points)
        X_BS = measurement.X_BS
    elif isinstance(measurement, DepthImage):
        points = Scan.from_depth(measurement).points
        X_BS = measurement.X_BC
    else:
        raise ConfigurationError(
            f"seabed finder: expected a SonarScan or a DepthImage, got {type(measurement).__name__}"
        )

    points = points.reshape(-1, 3)
    return transform_points(X_WB @ X_BS, points[np.isfinite(points).all(axis=1)])
