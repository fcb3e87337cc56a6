"""Tasks with contact: press at a point, wipe a path, tap points, insert a sampler into a hole."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from dm_control.utils import rewards

from uuv.controllers.tasks.insertion import axis_path
from uuv.environments.actions import Actions, ToolTwist
from uuv.environments.entities import Sea, VehicleEntity, WorkObjectEntity, let_slide, put
from uuv.environments.judges import InsertedTo, PressedAt, SetForce, TappedAt, WipedAlong
from uuv.environments.sensing import FARTHEST, STRONGEST
from uuv.environments.vehicle_task import SITE_DEPTH, Random, VehicleTask, near
from uuv.environments.work_place import WorkPlace, on_path, standing
from uuv.models.objects.manifold import Manifold
from uuv.models.objects.target_model import TargetModel
from uuv.sim.evaluation.bounds import DAMAGE
from uuv.sim.evaluation.insertion_metrics import InsertionBounds, TrueHole
from uuv.sim.interfaces.spatial import Array, pose, readonly
from uuv.sim.plant.truth import Truth
from uuv.tasks.surface_work import work_bounds

STANDOFF = 0.06  # [m] distance of the tool from the surface at the start
OFFSET, TURN = 0.02, 0.02  # [m], [rad] largest errors of the initial hull pose
HELD = 2.0  # [s] for which a force must be held
TOUCHED = 0.3  # [s] duration of a tap
BELOW = readonly(pose(p=[0.0, 0.0, -SITE_DEPTH - 1.5]))  # pose X_WT of objects to work on
NEAR = 0.1  # [m] distance from the place of work at which the reward for position is a tenth


class ContactTask(VehicleTask):
    """Base of work on an object fixed to the world. The arm begins unfolded in front of the
    surface.

    The goal consists of the next point of the path in tool axes (3,) [m], the path's tool axis
    there in tool axes (3,), and the set force [N].
    """

    def __init__(
        self,
        sea: Sea,
        vehicle: VehicleEntity,
        actions: Actions,
        place: WorkPlace,
        *,
        force: float,
        sparse: bool = False,
    ) -> None:
        """Put the object into the sea.

        Args:
            sea: The arena.
            vehicle: Vehicle in the arena.
            actions: Actions of the agent.
            place: Place of the work.
            force: [N] set force.
            sparse: Whether only success is rewarded.
        """
        super().__init__(sea, vehicle, actions, sparse=sparse)
        self.place = place
        self.force = force
        self._next: tuple[float, Array] | None = None  # arc length [m] and pose of the next point

        self.object = WorkObjectEntity(place.target)
        put(sea, self.object, place.X_WT)
        self.largest_force = DAMAGE * force
        self.bounds = work_bounds(vehicle.own)

        self.add_goals(FARTHEST, goal_position=3, goal_axis=3)
        self.add_goals(STRONGEST, goal_force=1)

        if self.slides:
            let_slide(sea, vehicle, self.object, speed=ToolTwist.SPEED, force=force)

    in_contact = True
    slides = True  # the tool slides on the object

    def begin(self, random_state: Random) -> tuple[Array, Array]:
        """Begin with the hull near its place of work, and the tool at the stand-off."""
        return near(
            self.place.placement.X_WB, random_state, offset=OFFSET, turn=TURN
        ), self.place.placement.q_start

    def next_s(self) -> float:
        """Arc length [m] of the next point of the path."""
        return 0.0

    def next_pose(self) -> Array:
        """Tool pose X_WG (4, 4) at the next point."""
        s = self.next_s()
        if self._next is None or self._next[0] != s:
            self._next = s, self.place.tool_at(s)
        return self._next[1]

    def goal(self, truth: Truth) -> Mapping[str, Array]:
        """Next point, axis there, and set force."""
        X_WG = self.next_pose()
        R_GW = truth.R_WG.T

        return {
            "goal_position": R_GW @ (X_WG[:3, 3] - truth.p_WG),
            "goal_axis": R_GW @ X_WG[:3, 2],
            "goal_force": np.array([self.force]),
        }

    def nearness(self, truth: Truth) -> float:
        """Reward for the tool at the next point with its axis along the path's axis."""
        X_WG = self.next_pose()
        gap = float(np.linalg.norm(truth.p_pad - X_WG[:3, 3]))
        across = float(truth.R_WG[:, 2] @ X_WG[:3, 2])

        bounds = self.bounds
        close = rewards.tolerance(gap, bounds=(0.0, bounds.path_deviation), margin=NEAR)
        return close * rewards.tolerance(
            float(np.arccos(np.clip(across, -1.0, 1.0))), (0.0, bounds.tilt), margin=0.5
        )

    def pressing(self, truth: Truth) -> float:
        """Reward for the set force."""
        band = self.bounds.force_error_rms
        return rewards.tolerance(
            truth.contact_normal, (self.force - band, self.force + band), margin=self.force
        )


class PressPoint(ContactTask):
    """Press at a point. The work is done once the set force was held for HELD within the bounds of
    the jobs.
    """

    @cached_property
    def _judge(self) -> PressedAt:
        whole = self.place.path
        point = replace(whole, s=whole.s[:1], p=whole.p[:1], z=whole.z[:1], x=whole.x[:1])
        return PressedAt(SetForce(point, self.force, self.bounds), HELD)

    @property
    def judge(self) -> PressedAt:
        """Judge of the force held at the first point of the path."""
        return self._judge

    def shaped(self, truth: Truth) -> float:
        """Half of the reward for the pose, half for the force."""
        nearness = self.nearness(truth)
        return 0.5 * nearness + 0.5 * nearness * self.pressing(truth)


class WipePath(ContactTask):
    """Move the tool along a path with a set force; the goal is a point ahead on the path."""

    AHEAD = 0.01  # [m] distance of the goal ahead of the point reached

    @cached_property
    def _judge(self) -> WipedAlong:
        return WipedAlong(SetForce(self.place.path, self.force, self.bounds))

    @property
    def judge(self) -> WipedAlong:
        """Judge of the whole path with the force."""
        return self._judge

    def next_s(self) -> float:
        """Arc length a little ahead of the point reached."""
        end = float(self.place.path.s[-1])
        return min(self.judge.s + self.AHEAD, end) if self.judge.s > 0.0 else 0.0

    def shaped(self, truth: Truth) -> float:
        """A third each for the pose, for the force there, and for the completed share of the
        path.
        """
        nearness = self.nearness(truth)

        return (
            nearness + nearness * self.pressing(truth) + self.judge.s / float(self.place.path.s[-1])
        ) / 3.0


class TapPoints(ContactTask):
    """Touch points of a path one after another with a set force, leaving the surface in between."""

    def __init__(
        self,
        sea: Sea,
        vehicle: VehicleEntity,
        actions: Actions,
        place: WorkPlace,
        *,
        force: float,
        points: Sequence[float],
        sparse: bool = False,
    ) -> None:
        """Same as `ContactTask`; `points` are arc lengths [m] >= 0."""
        super().__init__(sea, vehicle, actions, place, force=force, sparse=sparse)
        self.points = tuple(points)

        along = SetForce(self.place.path, self.force, self.bounds)
        self._judge = TappedAt(along, self.points, TOUCHED)

    @property
    def judge(self) -> TappedAt:
        """Judge of all points touched."""
        return self._judge

    def next_s(self) -> float:
        """Arc length of the next point."""
        return self.points[min(self._judge.count, len(self.points) - 1)]

    def shaped(self, truth: Truth) -> float:
        """Share of the points touched, and a part of the next one for pose and force there."""
        count = len(self.points)
        nearness = self.nearness(truth)
        return (
            self._judge.count
            + (0.5 * nearness + 0.5 * nearness * self.pressing(truth)) * (not self._judge.done)
        ) / count


class InsertSampler(ContactTask):
    """Insert a sampler into a hole of a manifold to a depth; the work fails if forces exceed their
    bounds.
    """

    slides = False

    def __init__(
        self,
        sea: Sea,
        vehicle: VehicleEntity,
        actions: Actions,
        place: WorkPlace,
        hole: TrueHole,
        *,
        sparse: bool = False,
    ) -> None:
        """Same as `ContactTask`; the path runs along the hole's axis."""
        super().__init__(
            sea, vehicle, actions, place, force=InsertionBounds().axial_force, sparse=sparse
        )
        self.hole = hole
        self.largest_force = np.inf  # the judge has the bounds
        self._judge = InsertedTo(hole)

    @property
    def judge(self) -> InsertedTo:
        """Judge of the depth reached."""
        return self._judge

    def next_s(self) -> float:
        """Arc length of the mouth and, once it is reached, of the end."""
        return float(self.place.path.s[-1]) if self._judge.depth > 0.0 else 0.0

    def shaped(self, truth: Truth) -> float:
        """Half of the reward for the pose at the mouth, half for the depth."""
        depth = max(self._judge.depth, 0.0) / self.hole.depth
        return 0.5 * max(self.nearness(truth), min(1.0, depth)) + 0.5 * min(1.0, depth)


def place_on(vehicle: VehicleEntity, target: TargetModel, path: str, *, force: float) -> WorkPlace:
    """Place of work on a path of an object that lies 1.5 m below the centre of the site."""
    return on_path(vehicle.own, target, target.path(path), BELOW, force=force, standoff=STANDOFF)


def place_at_hole(vehicle: VehicleEntity, block: Manifold, hole: str, depth: float) -> WorkPlace:
    """Place of work at a hole of a manifold that lies 1.5 m below the centre of the site."""
    path = axis_path(BELOW, block.hole(hole), depth)
    force = InsertionBounds().axial_force
    return standing(vehicle.own, block.target, path, BELOW, force=force, standoff=STANDOFF)
