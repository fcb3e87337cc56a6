"""Tasks without contact: hold station, go to a waypoint, reach a pose with the tool."""

from collections.abc import Mapping
from typing import ClassVar, NamedTuple

import numpy as np
from dm_control.utils import rewards

from uuv.controllers.mkps import Chain
from uuv.environments.actions import Actions
from uuv.environments.entities import Sea, VehicleEntity
from uuv.environments.judges import KeptFor
from uuv.environments.sensing import FARTHEST
from uuv.environments.vehicle_task import SITE_DEPTH, Random, VehicleTask, near
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, cross, exp_so3, inverse, log_so3, pose, readonly
from uuv.sim.plant.truth import Truth


class Closeness(NamedTuple):
    """Reward of an error, and the largest error at which the goal is met."""

    met: float  # largest error with the full reward
    margin: float  # further error at which the reward is a tenth

    def reward(self, error: float) -> float:
        """Reward: 1 if the goal is met, less for larger errors."""
        return rewards.tolerance(
            error, bounds=(0.0, self.met), margin=self.margin, value_at_margin=0.1
        )


START_OFFSET = 0.5  # [m] largest per axis, from the pose to hold
START_TURN = 0.3  # [rad] largest, about the vertical
CLOSE = Closeness(0.05, 0.5)  # [m] of the hull's position
ALIGNED = Closeness(0.05, 0.5)  # [rad] of its attitude
STATION_TIME = 5.0  # [s] for which a pose must be held
ARRIVED_TIME = 2.0  # [s] for which a waypoint must be kept
REACHED_TIME = 1.0  # [s] for which the tool must stay at its goal
FARTHEST_WAYPOINT = 2.0  # [m] per horizontal axis from the start; half as much up and down
WAYPOINT_TURN = 0.8  # [rad] largest, about the vertical
REACHED = Closeness(0.02, 0.3)  # [m] of the tip
POINTED = Closeness(0.1, 1.0)  # [rad] of the tool's axis
# (4, 4) pose of the hull in the middle of the site
MIDDLE = readonly(pose(p=[0.0, 0.0, -SITE_DEPTH]))
SPREAD = 0.35  # [rad] of each joint about the ready posture, in which goals to reach are drawn
NEAR_MIDDLE = (0.1, 0.2)  # [m] per axis and [rad] about the vertical, of a hull that is to reach


class HoldStation(VehicleTask):
    """Hold a hull pose in a current, from a random start nearby.

    The work is done once the hull has been within CLOSE and ALIGNED for STATION_TIME. The goal
    consists of the position (3,) [m] and the rotation vector (3,) [rad] of the pose to hold, in
    hull axes.
    """

    seconds: ClassVar[float] = STATION_TIME  # for which the goal must be met

    def __init__(
        self, sea: Sea, vehicle: VehicleEntity, actions: Actions, *, sparse: bool = False
    ) -> None:
        """Same as `VehicleTask`."""
        super().__init__(sea, vehicle, actions, sparse=sparse)
        self.X_WH = np.eye(4)  # pose to hold
        self._judge = KeptFor(self._at_goal, self.seconds)
        self.add_goals(FARTHEST, goal_position=3, goal_attitude=3)

    @property
    def judge(self) -> KeptFor:
        """Judge: the pose was kept for some time."""
        return self._judge

    def begin(self, random_state: Random) -> tuple[Array, None]:
        """Draw the start, near the pose to hold."""
        self.X_WH = MIDDLE
        return near(self.X_WH, random_state, offset=START_OFFSET, turn=START_TURN), None

    def X_BH(self, truth: Truth) -> Array:
        """The pose (4, 4) to hold, in hull axes."""
        return inverse(pose(truth.R_WB, truth.p_WB)) @ self.X_WH

    def _errors(self, truth: Truth) -> tuple[float, float]:
        """Distance [m] and angle [rad] from the goal."""
        X_BH = self.X_BH(truth)
        return float(np.linalg.norm(X_BH[:3, 3])), float(np.linalg.norm(log_so3(X_BH[:3, :3])))

    def _at_goal(self, truth: Truth) -> bool:
        distance, angle = self._errors(truth)
        return distance <= CLOSE.met and angle <= ALIGNED.met

    def goal(self, truth: Truth) -> Mapping[str, Array]:
        """The pose to hold, as numbers."""
        X_BH = self.X_BH(truth)
        return {"goal_position": X_BH[:3, 3], "goal_attitude": log_so3(X_BH[:3, :3])}

    def shaped(self, truth: Truth) -> float:
        """Reward 1 at the pose, decreasing with distance and angle."""
        distance, angle = self._errors(truth)
        return CLOSE.reward(distance) * ALIGNED.reward(angle)


class GoToWaypoint(HoldStation):
    """Go to a hull pose some metres away, and stay there for ARRIVED_TIME."""

    seconds = ARRIVED_TIME

    def begin(self, random_state: Random) -> tuple[Array, None]:
        """Draw the waypoint; the start is at the centre of the site."""
        most = np.array([FARTHEST_WAYPOINT, FARTHEST_WAYPOINT, 0.5 * FARTHEST_WAYPOINT])
        turn = exp_so3([0.0, 0.0, random_state.uniform(-WAYPOINT_TURN, WAYPOINT_TURN)])
        self.X_WH = MIDDLE @ pose(turn, random_state.uniform(-most, most))
        return MIDDLE, None

    def shaped(self, truth: Truth) -> float:
        """Reward 1 at the pose, and a tenth at the largest distance of a waypoint."""
        distance, angle = self._errors(truth)
        close = CLOSE._replace(margin=1.5 * FARTHEST_WAYPOINT)  # the diagonal of the waypoints' box
        return close.reward(distance) * ALIGNED._replace(margin=WAYPOINT_TURN).reward(angle)


class ReachPose(VehicleTask):
    """Move the tool's tip to a point, and its axis to a direction, from a hovering hull.

    The point is fixed to the world, and within reach of the arm from the ready posture. The work is
    done once the tip has been within REACHED and the axis within POINTED for REACHED_TIME. The goal
    consists of the position (3,) [m] of the point, and of the rotation vector (3,) [rad] that turns
    the tool's axis to the direction, in tool axes.
    """

    def __init__(
        self, sea: Sea, vehicle: VehicleEntity, actions: Actions, *, sparse: bool = False
    ) -> None:
        """Same as `VehicleTask`.

        Raises:
            ConfigurationError: The vehicle has no arm.
        """
        if not len(vehicle.own.vehicle.joints):
            raise ConfigurationError("ReachPose: the vehicle must have an arm")

        super().__init__(sea, vehicle, actions, sparse=sparse)
        self._chain: Chain = vehicle.own.chain()
        self.X_WH = np.eye(4)  # tool pose to reach; its rotation about the tool's axis is free
        self._judge = KeptFor(self._at_goal, REACHED_TIME)

        self.add_goals(FARTHEST, goal_position=3, goal_turn=3)

    @property
    def judge(self) -> KeptFor:
        """Judge: the pose was kept for some time."""
        return self._judge

    def begin(self, random_state: Random) -> tuple[Array, Array]:
        """Draw the goal, and the initial posture of the arm near the ready one."""
        vehicle = self.vehicle.own.vehicle
        offset, turn = NEAR_MIDDLE
        X_WB = near(MIDDLE, random_state, offset=offset, turn=turn)

        # The goal is reachable, since it is the tool's pose at another posture within the limits.
        low, high = vehicle.q_limits[:, 0], vehicle.q_limits[:, 1]
        n = len(vehicle.joints)

        def near_ready() -> Array:
            return np.clip(vehicle.q_ready + random_state.uniform(-SPREAD, SPREAD, n), low, high)

        start = near_ready()
        self.X_WH = X_WB @ vehicle.X_BA @ self._chain.forward(near_ready())
        return X_WB, start

    def goal(self, truth: Truth) -> Mapping[str, Array]:
        """Point and direction of the goal in tool axes."""
        R_GW = truth.R_WG.T
        return {
            "goal_position": R_GW @ (self.X_WH[:3, 3] - truth.p_WG),
            "goal_turn": R_GW @ self._turn(truth),
        }

    def _turn(self, truth: Truth) -> Array:
        """Rotation vector (3,) [rad], W, that turns the tool's axis to the goal's."""
        z, z_goal = truth.R_WG[:, 2], self.X_WH[:3, 2]
        axis = np.array(cross(z, z_goal))
        sine = float(np.linalg.norm(axis))
        if sine > 1e-9:
            return np.arctan2(sine, float(z @ z_goal)) * axis / sine

        # Along the goal's axis, or half a turn off it about any axis across
        return np.zeros(3) if z @ z_goal > 0.0 else np.pi * truth.R_WG[:, 0]

    def _errors(self, truth: Truth) -> tuple[float, float]:
        """Distance [m] and angle [rad] from the goal."""
        distance = float(np.linalg.norm(self.X_WH[:3, 3] - truth.p_WG))
        return distance, float(np.linalg.norm(self._turn(truth)))

    def _at_goal(self, truth: Truth) -> bool:
        distance, angle = self._errors(truth)
        return distance <= REACHED.met and angle <= POINTED.met

    def shaped(self, truth: Truth) -> float:
        """Reward 1 at the goal, decreasing with distance and angle."""
        distance, angle = self._errors(truth)
        return REACHED.reward(distance) * POINTED.reward(angle)
