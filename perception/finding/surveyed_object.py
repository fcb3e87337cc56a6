"""Target finder for an object whose pose a survey states. The tool path is that of the model."""

import numpy as np

from uuv.models.objects.targets import ModelPath, TargetModel
from uuv.perception.finding.target_finder import ATTITUDE_SIGMA, PATH_SPACING, FinderState
from uuv.perception.toolpath.path_planner import path_on_model
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import Measurement, StateEstimate, SurveyedPose, Target
from uuv.sim.interfaces.pose_covariance import PoseCovariance
from uuv.sim.interfaces.spatial import finite_number, inverse, readonly, transform_points

SURVEY_SIGMA = 1e-4  # [m] standard deviation for a survey that the simulation treats as exact


class SurveyedObjectFinder:
    """Uses a `SurveyedPose` as the pose of the object, without a search.

    Implements `uuv.sim.interfaces.protocols.TargetFinder`.
    """

    def __init__(
        self, target: TargetModel, path: str | ModelPath, *, attitude_sigma: float = ATTITUDE_SIGMA
    ) -> None:
        """Set the object and the path to work on.

        Args:
            target: Model of the object.
            path: Name of one of the object's paths, or a path in T.
            attitude_sigma: [rad] standard deviation of the hull's attitude, used if the estimate
                states none.

        Raises:
            ConfigurationError: The path is unknown.
        """
        self._target = target
        self._path = target.path(path) if isinstance(path, str) else path
        self._attitude_sigma = finite_number(attitude_sigma, "attitude_sigma [rad]", least=0.0)

        low, high = target.vertices.min(axis=0), target.vertices.max(axis=0)
        self._center = 0.5 * (low + high)
        self._radius = 0.5 * float(np.linalg.norm(high - low))

    def init(self) -> FinderState:
        """Initial state."""
        return FinderState()

    def step(
        self, state: FinderState, estimate: StateEstimate, measurement: Measurement
    ) -> tuple[FinderState, Target | None]:
        """Target at the surveyed pose.

        The target's covariance includes that of the hull's estimated pose, since the tool is led to
        a position in W.

        Raises:
            ConfigurationError: `measurement` is no SurveyedPose.
        """
        if not isinstance(measurement, SurveyedPose):
            raise ConfigurationError(
                "surveyed object: the measurement must be a SurveyedPose, got "
                f"{type(measurement).__name__}; choose a survey as the sensor"
            )

        # Covariance of the survey, and that of the hull's pose
        X_WT = measurement.X_WT
        center = transform_points(X_WT, self._center)
        known = PoseCovariance(
            matrix=readonly(SURVEY_SIGMA**2 * np.eye(6)),
            free=readonly(np.zeros((0, 6))),
            center=readonly(center),
            radius=self._radius,
            size_sigma=0.0,
        )
        attitude = (
            self._attitude_sigma if np.isnan(estimate.attitude_sigma) else estimate.attitude_sigma
        )
        position = np.nan_to_num(estimate.position_sigma, nan=0.0)
        of_hull = known.of_carrier(estimate.X_WB[:3, 3], position, attitude)

        target = Target(
            time=measurement.time,
            X_WT=X_WT,
            accepted=True,
            check_m=0.0,
            range_m=float(np.linalg.norm(transform_points(inverse(estimate.X_WB), center))),
            reason="",
            path=path_on_model(X_WT, self._path, spacing=PATH_SPACING),
            covariance=known.plus(of_hull),
            hull_covariance=readonly(of_hull),
        )
        return FinderState(frames=state.frames + 1), target
