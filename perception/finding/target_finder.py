"""Target finder: identifies a known object in depth frames or sonar scans, and plans its path."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from uuv.models.meshes import ray_casting
from uuv.models.objects.targets import ModelPath, TargetModel
from uuv.perception.clouds.scan import Scan, SensorModel
from uuv.perception.clouds.sonar_cloud import without_isolated_echoes
from uuv.perception.finding.next_view import ranked_views, views_around
from uuv.perception.registration.identification import Identification, Method, attempted
from uuv.perception.registration.model_surface import ModelSurface
from uuv.perception.toolpath.path_planner import plan_path
from uuv.sim.interfaces.errors import ConfigurationError, PerceptionError
from uuv.sim.interfaces.messages import (
    DepthImage,
    Measurement,
    SonarScan,
    StateEstimate,
    Target,
    ToolPath,
)
from uuv.sim.interfaces.pose_covariance import PoseCovariance
from uuv.sim.interfaces.spatial import (
    Array,
    checked,
    finite_number,
    inverse,
    readonly,
    transform_points,
)

PATH_SPACING = 0.0015  # [m] spacing of the samples of the tool path
# [rad] attitude error of the hull: bias of an inertial unit with fibre-optic gyros
ATTITUDE_SIGMA = 3e-4
LOOSE = 0.005  # [m] accepted error of an identification (`uuv.sim.evaluation.bounds.Bounds`)
_ASIDE = 0.15  # [m] distance of hull positions, below which they give the same view
_SEEN = 0.4  # [-] share of the frames in which a pixel must have depth
# [-] ratio of the standard deviation of a median of normal errors to that of their mean
_MEDIAN = 1.25
_FEW = 3  # number of frames from which on they are fused, since a median of fewer removes nothing


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frame:
    """A scan with the pose of the sensor."""

    scan: Scan
    X_WS: Array  # (4, 4) pose of the sensor, in a frame W common to all frames


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FinderState:
    """State of KnownObjectFinder: frames collected for fusion, and the last identification."""

    frames: int = 0  # number of measurements processed
    # frames or pings collected so far, until the number to fuse is reached
    looks: tuple[Frame, ...] = ()
    last: Identification | None = None
    X_WC: Array | None = None  # (4, 4) estimated pose of the camera for `last`
    places: tuple[Array, ...] = ()  # (3,) [m] hull positions in W of the views so far

    def in_world(self, points_C: Array) -> Array:
        """Transform points of the last identification from the camera frame into W.

        Args:
            points_C: (n, 3) [m] cloud, model_before or model_after of `last`, in C.

        Returns:
            The same points (n, 3) [m] in W. Empty (0, 3) before the first identification.
        """
        return np.zeros((0, 3)) if self.X_WC is None else transform_points(self.X_WC, points_C)


class KnownObjectFinder:
    """Target finder for one known object near its coarse detection.

    The finder also plans the tool path on the scanned surface. Implements
    `uuv.sim.interfaces.protocols.TargetFinder`.
    """

    method: ClassVar[Method] = "planes"

    def __init__(
        self,
        target: TargetModel,
        path: str | ModelPath | None,
        approach_W: ArrayLike,
        orientation_W: ArrayLike | None = None,
        *,
        sensor: SensorModel | None = None,
        tool_radius: float = 0.0,
        looks: int = 1,
        seed: int = 0,
        attitude_sigma: float = ATTITUDE_SIGMA,
        loose: float = LOOSE,
    ) -> None:
        """Prepare the search for `target` around its coarse position.

        Args:
            target: Model of the object.
            path: Name of one of the target's paths, a path in T, or None to plan no path.
            approach_W: (3,) [m] coarse position of the target's centre in W, at most
                `APPROACH_ERROR` off.
            orientation_W: (3, 3) coarse rotation of T in W, with an error of up to about 30 deg;
                None: unknown.
            sensor: Accuracy of the depth sensor; None: `SensorModel()`.
            tool_radius: [m] radius of the ball at the end of the tool; 0: a point.
            looks: Number of consecutive frames or pings, on whose median depth the path is planned.
            seed: Seed of all random samples.
            attitude_sigma: [rad] standard deviation of the hull's attitude about any axis, used if
                the estimate states none.
            loose: [m] standard deviation, of the centre or of the surface under the path, above
                which an accepted identification asks for another view.

        Raises:
            ConfigurationError: The path is unknown, or a prior is malformed.
            MissingLibraryError: There is no ray caster.
        """
        self._path = target.path(path) if isinstance(path, str) else path
        self._approach_W = checked(approach_W, (3,), "approach_W")
        self._R_WT = (
            None if orientation_W is None else checked(orientation_W, (3, 3), "orientation_W")
        )

        if isinstance(looks, bool) or looks < 1:
            raise ConfigurationError(f"looks: must be at least 1, got {looks}")
        if not 0.0 <= tool_radius < np.inf:
            raise ConfigurationError(f"tool_radius: must be >= 0 m, got {tool_radius}")

        self._sensor = sensor or SensorModel()
        self._tool_radius = tool_radius
        self._count = looks
        self._seed = seed
        self._attitude_sigma = finite_number(attitude_sigma, "attitude_sigma [rad]", least=0.0)
        self._loose = finite_number(loose, "loose [m]", above=0.0)
        self._target = target
        ray_casting.installed()  # or the error, raised now

    @cached_property
    def _surface(self) -> ModelSurface:
        """Surface of the target, sampled at the first frame."""
        return ModelSurface.of(self._target, self._seed)

    def init(self) -> FinderState:
        """Return the initial state: no frames, no identification."""
        return FinderState()

    def step(
        self, state: FinderState, estimate: StateEstimate, measurement: Measurement
    ) -> tuple[FinderState, Target | None]:
        """Search one depth frame or sonar scan for the target and plan the tool path.

        Args:
            state: State from the last call, or from `init`.
            estimate: State of the vehicle at the time of `measurement`; X_WB places the sensor in
                W.
            measurement: A DepthImage or a SonarScan.

        Returns:
            The new state, and the target in W. The target is None while frames are collected. If
                the object was not identified, or the path has no scanned surface, the target is not
                accepted and contains the reason.

        Raises:
            ConfigurationError: `measurement` is of another type or malformed.
        """
        scan, X_BC, sensor = self._measured(measurement)
        X_WC = estimate.X_WB @ X_BC

        # Frames are collected until there are enough to fuse
        looks = state.looks
        if isinstance(scan, Scan):
            looks = (*looks, Frame(scan=scan, X_WS=X_WC))
            if len(looks) < self._count:
                return replace(state, frames=state.frames + 1, looks=looks), None

        identified = self._identified(scan, sensor, X_WC, state)
        path, reason = self._planned(identified, looks, X_WC)

        # Pose in the world, with its uncertainty
        doubt, of_hull = self._doubt(identified, estimate, X_WC)
        target = Target(
            time=measurement.time,
            X_WT=readonly(X_WC @ identified.X_sensor_target),
            accepted=identified.accepted if self._path is None else path is not None,
            check_m=identified.check.figure_m if identified.check is not None else float("inf"),
            range_m=float(
                np.linalg.norm(transform_points(identified.X_sensor_target, self._surface.center))
            ),
            reason=reason,
            path=path,
            covariance=doubt,
            hull_covariance=of_hull,
        )

        # Next view, from a position where none was taken yet
        p_WB = estimate.X_WB[:3, 3]
        positions = state.places
        if all(np.linalg.norm(p_WB - position) > _ASIDE for position in positions):
            positions = (*positions, readonly(p_WB))
        target = replace(
            target, next_X_WB=self._next_view(identified, target, estimate.X_WB, X_WC, positions)
        )

        return FinderState(
            frames=state.frames + 1, last=identified, X_WC=readonly(X_WC), places=positions
        ), target

    def _measured(self, measurement: Measurement) -> tuple[Scan | Array, Array, SensorModel]:
        """Scan in the sensor's frame, the sensor's pose (4, 4) on the hull, and its accuracy.

        Echoes of a sonar that form no scan are returned unchanged, see `_scan_of`.
        """
        if isinstance(measurement, DepthImage):
            sensor = replace(self._sensor, focal=float(measurement.K[0, 0]))
            return Scan.from_depth(measurement), measurement.X_BC, sensor

        if isinstance(measurement, SonarScan):
            scan = _scan_of(without_isolated_echoes(measurement.points))
            return scan, measurement.X_BS, self._sensor

        raise ConfigurationError(
            f"target finder: expected a DepthImage or a SonarScan, got {type(measurement).__name__}"
        )

    def _identified(
        self, scan: Scan | Array, sensor: SensorModel, X_WC: Array, state: FinderState
    ) -> Identification:
        """Identification near the coarse detection.

        Without a coarse orientation the result is, among all poses equivalent by symmetry, the one
        nearest to the last estimate.
        """
        X_CW = inverse(X_WC)
        attempt = attempted(
            scan,
            self._surface,
            transform_points(X_CW, self._approach_W),
            None if self._R_WT is None else X_CW[:3, :3] @ self._R_WT,
            sensor=sensor,
            seed=self._seed,
            method=self.method,
        )
        identified = attempt.widened().concluded(state.last)
        if self._R_WT is not None or state.last is None or state.X_WC is None:
            return identified
        if not state.last.accepted:
            return identified

        R_CT = X_CW[:3, :3] @ state.X_WC[:3, :3] @ state.last.X_sensor_target[:3, :3]
        alike = self._surface.symmetry.nearest_pose(identified.X_sensor_target, R_CT)
        return replace(identified, X_sensor_target=readonly(alike))

    def _planned(
        self, identified: Identification, looks: Sequence[Frame], X_WC: Array
    ) -> tuple[ToolPath | None, str]:
        """Tool path in W on the scanned surface, or None with the reason."""
        if not identified.accepted or self._path is None:
            return None, identified.reason

        try:
            whole = with_fused_frames(identified, looks)
            path = plan_path(whole, self._path, spacing=PATH_SPACING, tool_radius=self._tool_radius)
        # the pose is accepted, but the scan lacks the surface on the path
        except PerceptionError as error:
            return None, str(error)
        return _in_world(X_WC, path), identified.reason

    def _next_view(
        self,
        found: Identification,
        target: Target,
        X_WB: Array,
        X_WC: Array,
        places: Sequence[Array],
    ) -> Array | None:
        """Hull pose (4, 4) of the next view, away from the previous ones; None if no further view
        is needed.
        """
        if self.method != "planes" or (target.accepted and not self._is_loose(target)):
            return None

        center = transform_points(target.X_WT, self._surface.center)
        motions = [
            motion
            for motion in views_around(center, np.array([0.0, 0.0, 1.0]))
            if all(
                np.linalg.norm((motion @ X_WB)[:3, 3] - position) > _ASIDE for position in places
            )
        ]

        X_CW = inverse(X_WC)
        ranked = ranked_views(found, [X_CW @ motion @ X_WC for motion in motions])
        return readonly(motions[ranked[0]] @ X_WB) if ranked else None

    def _is_loose(self, target: Target) -> bool:
        """True if an accepted pose is less certain than the work requires."""
        if target.covariance is None:
            return False

        sigma = target.path_sigma
        worst = target.covariance.position_sigma if sigma is None else float(sigma.max())
        return worst > self._loose

    def _doubt(
        self, found: Identification, estimate: StateEstimate, X_WC: Array
    ) -> tuple[PoseCovariance | None, Array]:
        """Covariance of an estimated pose in W, and the part (6, 6) [m^2] of it that comes from the
        hull pose.
        """
        if found.covariance is None:
            return None, readonly(np.zeros((6, 6)))

        doubt = found.covariance.in_frame(X_WC)
        position = np.nan_to_num(estimate.position_sigma, nan=0.0)
        attitude = (
            self._attitude_sigma if np.isnan(estimate.attitude_sigma) else estimate.attitude_sigma
        )

        of_hull = doubt.of_carrier(estimate.X_WB[:3, 3], position, attitude)
        both = doubt.plus(of_hull)
        return both, readonly(both.matrix - doubt.matrix)


class PublishedFinder(KnownObjectFinder):
    """Target finder with the published ICP and the published threshold on Q [Konoplin 2022]."""

    method: ClassVar[Method] = "paper-q"


def _scan_of(echoes: Array) -> Scan | Array:
    """Scan of echoes (h, w, 3) [m]; or, if they form no scan, the echoes, for which `identify`
    states the reason.
    """
    try:
        return Scan.from_cloud(echoes)
    except PerceptionError:
        return echoes


def _in_world(X_WC: Array, path: ToolPath) -> ToolPath:
    R_WC = X_WC[:3, :3]
    return replace(
        path,
        p=readonly(transform_points(X_WC, path.p)),
        z=readonly(path.z @ R_WC.T),
        x=readonly(path.x @ R_WC.T),
    )


def fused(looks: Sequence[Frame]) -> Scan:
    """Median depth of several frames in the grid of the last one; NaN where too few have depth.

    Errors of a stereo matcher are correlated over patches, and differ from frame to frame. A mean
    over neighbours in one frame keeps such errors. A median over frames removes them, and also
    anything that only one frame shows, such as flying pixels or a fish. The frames may be taken
    from different positions. Where one frame has no depth, or shows another surface, the other
    frames determine the median.

    Args:
        looks: Frames, in order of time.

    Raises:
        ConfigurationError: There is no frame.
    """
    if not looks:
        raise ConfigurationError("fused: looks must have at least one frame")

    # Depth of every frame, in the pixels of the last
    last = looks[-1]
    X_SW = inverse(last.X_WS)
    depths = np.stack(
        [
            *(_seen_from(last.scan, look.scan, X_SW @ look.X_WS) for look in looks[:-1]),
            last.scan.depth,
        ]
    )

    # Median if enough frames have depth
    enough = np.isfinite(depths).sum(axis=0) >= max(1, _SEEN * len(looks))
    depth = np.full(last.scan.depth.shape, np.nan)
    depth[enough] = np.nanmedian(depths[:, enough], axis=0)

    x, y = np.meshgrid(last.scan.tangent_x, last.scan.tangent_y)
    return replace(last.scan, points=readonly(np.stack([depth * x, depth * y, depth], axis=-1)))


def with_fused_frames(found: Identification, looks: Sequence[Frame]) -> Identification:
    """Identification whose scan is replaced by the median of several frames, on which a path is
    planned.

    The pose and its PoseCheck remain those of the single frame, because their limits were set for
    the noise of a single frame. With fewer than three frames `found` is returned unchanged.

    Args:
        found: Identification in the last of `looks`.
        looks: Frames, in order of time.
    """
    if found.evidence is None or len(looks) < _FEW:
        return found

    evidence = found.evidence
    scan = fused(looks)
    of_median = evidence.sensor.disparity_sigma * _MEDIAN / float(np.sqrt(len(looks)))
    return replace(
        found,
        evidence=replace(
            evidence,
            scan=scan,
            mask=evidence.mask & np.isfinite(scan.depth),
            sensor=replace(evidence.sensor, disparity_sigma=of_median),
        ),
    )


def _seen_from(grid: Scan, scan: Scan, X_GS: Array) -> Array:
    """Depth (h, w) [m] of the nearest point of `scan` in each pixel of `grid`; NaN if there is
    none.

    `X_GS` (4, 4) is the pose of the scan's sensor in the frame of the grid's sensor.
    """
    points = scan.points.reshape(-1, 3)
    points = transform_points(X_GS, points[np.isfinite(points[:, 2])])
    row, column, inside = grid.pixels(points)

    # The nearest point in each pixel
    depth = np.full(grid.depth.shape, np.inf)
    np.minimum.at(depth, (row[inside], column[inside]), points[inside, 2])
    depth[np.isinf(depth)] = np.nan
    return depth
