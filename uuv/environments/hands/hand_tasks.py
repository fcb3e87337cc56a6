"""Tasks of a hand: grasp an object and lift it off the seabed, turn a valve by its lever."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from dm_control import mjcf
from dm_control.utils import rewards

from uuv.controllers.hull.thrust_margin import ThrustMargin
from uuv.controllers.planning.grasp_choice import GraspChoice, GraspLimits, PlacedGrasp, carry_path
from uuv.controllers.tasks.grasping.collecting import CollectJob, longest_lever
from uuv.controllers.tasks.grasping.turning import TurnJob, ValveTurning
from uuv.environments.actions import Actions
from uuv.environments.contact_tasks import BELOW, OFFSET, TURN
from uuv.environments.entities import Sea, VehicleEntity, put
from uuv.environments.hands.handled_objects import LooseObjectEntity, ValveEntity, let_hold
from uuv.environments.judges import KeptFor, TurnedTo
from uuv.environments.sensing import FARTHEST, FARTHEST_TURN
from uuv.environments.vehicle_task import Random, VehicleTask, near
from uuv.environments.work_place import WorkPlace, standing, surveyed
from uuv.models.hydrodynamics import water_density
from uuv.models.naming import SLOT_BOTTOM, TOOL_GEOM, check_parts
from uuv.models.objects import targets
from uuv.models.site.pick_site import LooseObject, at_rest
from uuv.models.site.turned_valve import QUARTER, TurnedValve
from uuv.models.site.valve_site import HingeFriction
from uuv.models.tools.jaw_shape import JawShape
from uuv.own_vehicle import OwnVehicle
from uuv.sim.evaluation.bounds import DAMAGE
from uuv.sim.evaluation.handling.turn_metrics import TurnBounds
from uuv.sim.interfaces.errors import ConfigurationError, ReachError
from uuv.sim.interfaces.spatial import (
    Array,
    inverse,
    log_so3,
    pose,
    quat_wxyz_from_rotation,
    readonly,
    rotation_from_quat_wxyz,
)
from uuv.sim.plant.truth import Truth

LIFTED = 0.1  # [m] height over its place to which an object is to be lifted
KEPT = 1.0  # [s] for which it must be held there, or a handle must stay at its stop
STONE = 2600.0  # [kg/m^3]
MOMENT = 25.0  # [N m] set moment of a turn
STICTION = (5.0, 20.0)  # [N m] of the valve, drawn in each episode
VISCOUS = 5.0  # [N m s/rad] of the valve
NEAR = 0.1  # [m] distance of the tool from its place at which the reward for it is a tenth
ALIGNED = 0.5  # [rad] angle at which it is
_ALONG = 0.01  # [m] length of the path that stands for a grasp


class HandTask(VehicleTask):
    """Base of tasks with a handle or an object in the tool.

    The goal has the position (3,) [m] and the rotation vector (3,) [rad] from the tool to its place
    at the object, which moves with the object, in tool axes.
    """

    def __init__(
        self,
        sea: Sea,
        vehicle: VehicleEntity,
        actions: Actions,
        place: WorkPlace,
        *,
        sparse: bool = False,
    ) -> None:
        """Same as `VehicleTask`; `place` is the place of the work."""
        super().__init__(sea, vehicle, actions, sparse=sparse)
        self.place = place
        self.add_goals(FARTHEST, goal_position=3)
        self.add_goals(FARTHEST_TURN, goal_turn=3)

    def begin(self, random_state: Random) -> tuple[Array, Array]:
        """Begin with the hull near its place of work, and the tool at the stand-off."""
        placement = self.place.placement
        return near(placement.X_WB, random_state, offset=OFFSET, turn=TURN), placement.q_start

    @abstractmethod
    def tool_place(self) -> Array:
        """Pose X_WG (4, 4) of the tool at the object, as this is now."""

    def goal(self, truth: Truth) -> Mapping[str, Array]:
        """From the tool to its place at the object."""
        X_WG = self.tool_place()
        R_GW = truth.R_WG.T
        return {
            "goal_position": R_GW @ (X_WG[:3, 3] - truth.p_WG),
            "goal_turn": log_so3(R_GW @ X_WG[:3, :3]),
        }

    def nearness(self, truth: Truth) -> float:
        """Reward for the tool at its place, aligned with it."""
        # Distance and angle from the tool to its place.
        goal = self.goal(truth)
        gap = float(np.linalg.norm(goal["goal_position"]))
        angle = float(np.linalg.norm(goal["goal_turn"]))

        close = rewards.tolerance(gap, bounds=(0.0, 0.005), margin=NEAR)
        return close * rewards.tolerance(angle, bounds=(0.0, 0.05), margin=ALIGNED)


class GraspObject(HandTask):
    """Grasp a loose object with driven jaws, and lift it off the seabed.

    The work is done once the jaws have held the object LIFTED above its place for KEPT. A grip
    above 1.5 times the job's is damage. The goal has, besides that of `HandTask`, the object's
    height (1,) [m] above its place and the opening (1,) [m] of the jaws.
    """

    def __init__(
        self,
        sea: Sea,
        vehicle: VehicleEntity,
        actions: Actions,
        place: WorkPlace,
        grasp: PlacedGrasp,
        loose: LooseObject,
        *,
        sparse: bool = False,
    ) -> None:
        """Same as `HandTask`.

        Args:
            sea: The arena.
            vehicle: Vehicle in the arena, with a gripper.
            actions: Actions of the agent.
            place: Place of the work.
            grasp: Grasp of the object where it lies.
            loose: Mass and volume of the object.
            sparse: Whether only success is rewarded.
        """
        super().__init__(sea, vehicle, actions, place, sparse=sparse)
        self.grasp = grasp
        self.job = CollectJob()
        self.displaced = water_density(vehicle.own.model) * loose.volume  # [kg] of water
        self.largest_force = DAMAGE * self.job.grip
        self._X_TG = inverse(place.X_WT) @ grasp.X_WG

        # The object lies loose in the sea, and the jaws can hold it.
        self.object = LooseObjectEntity(place.target, loose, water_density(vehicle.own.model))
        sea.add_free_entity(self.object)
        let_hold(sea, vehicle, self.object)

        self._judge = KeptFor(self._held_up, KEPT)
        self.add_goals(FARTHEST, object_height=1, jaw_opening=1)

    @property
    def judge(self) -> KeptFor:
        """Judge: the object was held up for some time."""
        return self._judge

    def after_compile(self, physics: mjcf.Physics, random_state: Random) -> None:
        """Find the object in the compiled model."""
        super().after_compile(physics, random_state)
        self._bound = physics.bind(self.object.body)

    def initialize_episode(self, physics: mjcf.Physics, random_state: Random) -> None:
        """Draw the episode, and put the object down at its place."""
        super().initialize_episode(physics, random_state)
        lying = self.place.X_WT
        self.object.set_pose(physics, lying[:3, 3], quat_wxyz_from_rotation(lying[:3, :3]))

    def X_WT(self) -> Array:
        """Present pose (4, 4) of the object."""
        return pose(rotation_from_quat_wxyz(self._bound.xquat), np.array(self._bound.xpos))

    def height(self) -> float:
        """Height [m] of the object above its place."""
        return float(self._bound.xpos[2] - self.place.X_WT[2, 3])

    def tool_place(self) -> Array:
        """Tool in the grasp of the object, where this is now."""
        return self.X_WT() @ self._X_TG

    def goal(self, truth: Truth) -> Mapping[str, Array]:
        """The grasp, height and opening."""
        more = {"object_height": np.array([self.height()]), "jaw_opening": truth.jaws.opening}
        return {**super().goal(truth), **more}

    def _held_up(self, truth: Truth) -> bool:
        return truth.contact_normal > 0.0 and self.height() >= LIFTED

    def shaped(self, truth: Truth) -> float:
        """A quarter for the tool in the grasp, a quarter for the grip force there, half for the
        height with it.
        """
        near_grasp = self.nearness(truth)

        # Force and height count only with the tool in the grasp.
        grip = near_grasp * min(1.0, truth.contact_normal / self.job.grip)
        high = min(1.0, max(0.0, self.height() / LIFTED))
        return 0.25 * near_grasp + 0.25 * grip + 0.5 * grip * high


class TurnValve(HandTask):
    """Turn a valve by a quarter, by its lever; the moment at which it breaks away is drawn.

    The work is done once the handle has stayed within the job's bound of its second stop for KEPT;
    it fails at a moment above 1.5 times the job's. The goal has, besides that of `HandTask`, the
    angle (1,) [rad] that is left.
    """

    def __init__(
        self,
        sea: Sea,
        vehicle: VehicleEntity,
        actions: Actions,
        work: "ValveWork",
        *,
        sparse: bool = False,
    ) -> None:
        """Same as `HandTask`; `work` is the valve's turn at its place."""
        super().__init__(sea, vehicle, actions, work.place, sparse=sparse)
        self.work = work
        friction = HingeFriction(stiction=STICTION[1], viscous=VISCOUS)
        self.object = ValveEntity(work.valve, work.place.X_WT, friction)
        put(sea, self.object, np.eye(4))

        # A handle at its stop, never forced.
        bounds = TurnBounds()
        self._judge = TurnedTo(
            QUARTER - bounds.angle, KEPT, most=bounds.peak * work.job.moment, handle=self._read
        )
        self.add_goals(FARTHEST_TURN, goal_angle=1)

    @property
    def judge(self) -> TurnedTo:
        """Judge: the handle was turned."""
        return self._judge

    def after_compile(self, physics: mjcf.Physics, random_state: Random) -> None:
        """Find the handle in the compiled model."""
        super().after_compile(physics, random_state)
        self._handle = self.object.handle(physics)

    def initialize_episode(self, physics: mjcf.Physics, random_state: Random) -> None:
        """Draw the episode, and the friction of the valve."""
        super().initialize_episode(physics, random_state)
        stiction = float(random_state.uniform(*STICTION))
        self.object.set_friction(physics, HingeFriction(stiction=stiction, viscous=VISCOUS))

    def _read(self) -> tuple[float, float]:
        """Angle [rad] of the handle, and moment [N m] on it."""
        return float(self._handle.angle[0]), float(self._handle.moment[0])

    def tool_place(self) -> Array:
        """Tool on the lever, where this is now."""
        axis = self.work.planner.axis(self.place.X_WT)
        end = float(self.place.path.s[-1])
        return self.place.tool_at(min(max(0.0, axis.pace * self._read()[0]), end))

    def goal(self, truth: Truth) -> Mapping[str, Array]:
        """The lever, and the angle that is left."""
        return {**super().goal(truth), "goal_angle": np.array([QUARTER - self._read()[0]])}

    def shaped(self, truth: Truth) -> float:
        """A quarter for the tool on the lever, the rest for the angle."""
        turned = min(1.0, max(0.0, self._read()[0] / QUARTER))
        return 0.25 * self.nearness(truth) + 0.75 * turned


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ValveWork:
    """A valve at its place, and the job's planner for it."""

    valve: TurnedValve
    job: TurnJob
    planner: ValveTurning
    place: WorkPlace


def place_at_valve(vehicle: OwnVehicle) -> ValveWork:
    """Place of work at a valve 1.5 m below the centre of the site.

    Raises:
        ConfigurationError: The vehicle lacks a part.
        ReachError: The arm turns the handle from no hull pose.
    """
    check_parts(vehicle.model, but=("camera", "home", "ready"))

    slot = TOOL_GEOM + SLOT_BOTTOM
    if mujoco.mj_name2id(vehicle.model, mujoco.mjtObj.mjOBJ_GEOM, slot) < 0:
        raise ConfigurationError("turn: the vehicle's tool must be a handle_socket")

    # The planner of the job stands the hull where it would turn the valve from.
    valve = TurnedValve()
    job = TurnJob(moment=MOMENT)

    # The job's planner chooses the place for the hull.
    planner = ValveTurning(
        vehicle.at_work(), valve, job, X_WB_scan=np.eye(4), holding=ThrustMargin.of(vehicle.model)
    )
    target = planner.with_path(surveyed(BELOW))
    assert target.path is not None

    placement, path, _ = planner.stand(target, target.path, np.zeros(3))
    place = WorkPlace(target=valve.target, X_WT=BELOW, path=path, placement=placement)
    return ValveWork(valve=valve, job=job, planner=planner, place=place)


def place_at_stone(vehicle: OwnVehicle) -> tuple[WorkPlace, PlacedGrasp, LooseObject]:
    """Place of work at a stone that lies on the seabed, 1.5 m below the centre of the site.

    Raises:
        ConfigurationError: The vehicle lacks a part, such as a gripper.
        ReachError: The arm reaches no grasp from any hull pose.
    """
    check_parts(vehicle.model, but=("camera", "home", "ready"))

    # Object and gripper.
    jaws = JawShape.of(vehicle.model)
    job = CollectJob()
    target = targets.of("stone", None)
    loose = LooseObject.of(target, density=STONE, mass=None)

    seabed = float(BELOW[2, 3])
    X_WT = at_rest(target, BELOW, seabed)

    # The first grasp that the arm reaches, either way round.
    choice = GraspChoice.of(target, jaws, GraspLimits(aside=longest_lever(job, jaws)))

    # The best grasp that is within reach, with the fingers either way round.
    failure: ReachError | None = None
    for grasp in choice.ranked(X_WT, seabed):
        path = carry_path(grasp, grasp.X_WG[:3, 3] + _ALONG * grasp.X_WG[:3, 0])
        for turned in (path, replace(path, x=readonly(-path.x))):
            try:
                place = standing(
                    vehicle,
                    target,
                    turned,
                    X_WT,
                    force=-job.load,
                    standoff=job.axial.standoff,
                    floor=seabed,
                )
            except ReachError as error:
                failure = failure or error
                continue
            return place, grasp, loose
    raise failure or ReachError("there is no grasp")
