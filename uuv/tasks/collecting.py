"""Collection: an object is picked up from the seabed, and put into a basket beside it."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from uuv.controllers.tasks.settings import CollectSettings, settings_of
from uuv.models.naming import HULL_BODY
from uuv.models.site import pick_site
from uuv.outcome import RunResult
from uuv.scenario import PlacedTask, Scenario, Task
from uuv.sensors.coarse_detection import coarse_detection
from uuv.sim.evaluation.handling.collect_metrics import TrueCollection, assess_collection
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import HeldLoad, JawReference, WorkState
from uuv.sim.interfaces.options import option
from uuv.sim.interfaces.protocols import Estimator, Sensor
from uuv.sim.interfaces.spatial import GRAVITY, Array, finite_number, pose, transform_points
from uuv.sim.loop.rollout import Moment, Observer
from uuv.site import Workpiece
from uuv.tasks.approach import object_of, scan_pose

if TYPE_CHECKING:
    import mujoco

    from uuv.controllers.planning.grasp_choice import GraspChoice
    from uuv.controllers.tasks.grasping.collecting import Basket, Collecting
    from uuv.models.objects.target_model import TargetModel
    from uuv.own_vehicle import OwnVehicle
    from uuv.perception.clouds.scan import SensorModel
    from uuv.perception.finding.target_finder import KnownObjectFinder
    from uuv.sim.evaluation.assessment import Assessment

STONE = 2600.0  # [kg/m^3]
GAP = 0.12  # [m] between the object's sphere and the basket's wall, or more
_CHARTED = 0.003  # [m] standard deviation of the basket's charted place, each axis


@dataclass(frozen=True, kw_only=True)
class CollectTask(CollectSettings, Task):
    """Pick an object up from the seabed, and put it into a basket beside it."""

    schema: ClassVar[str] = "collect"
    looks: ClassVar[bool] = True
    mass: float | None = option(
        None,
        "Mass of the object [kg], unknown to the vehicle; default: that of stone, 2600 kg/m3.",
        group="object",
    )
    range: float = option(0.7, "Range from camera to object at the scan [m].", group="work")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.mass is not None:
            finite_number(self.mass, "task.mass [kg]", above=0.0, most=100.0)

    @property
    def tool(self) -> str:
        """Driven jaws."""
        return "gripper"

    def check_inputs(self, scenario: Scenario) -> None:
        """Refuses an object that there is not, and growth or dents, which no grasp allows for."""
        super().check_inputs(scenario)
        workpiece: Workpiece = object_of(scenario, Workpiece)
        workpiece.model()
        for name in ("fouled", "dented"):
            if getattr(workpiece, name):
                height = getattr(workpiece, name)
                raise ConfigurationError(
                    f"site.object.{name} [m]: an object to be gripped must be clean, got {height:g}"
                )

    def place(
        self, scenario: Scenario, own: "OwnVehicle", rng: np.random.Generator
    ) -> "PlacedCollection":
        """The collection at the site; draws the object's pose and detection, and the basket's."""
        from uuv.controllers.planning.grasp_choice import GraspChoice, GraspLimits
        from uuv.controllers.tasks.grasping.collecting import CollectJob, check_grip, longest_lever
        from uuv.models.tools.jaw_shape import JawShape

        workpiece: Workpiece = object_of(scenario, Workpiece)
        target = workpiece.model()
        jaws = JawShape.of(own.model)
        collect = CollectJob(**settings_of(CollectSettings, self))
        check_grip(collect, jaws)
        limits = GraspLimits(aside=longest_lever(collect, jaws))
        choice = GraspChoice.of(target, jaws, limits)

        # The object lies as it comes to rest.
        drawn = scenario.site.pose(rng)
        seabed = float(transform_points(drawn, target.vertices)[:, 2].min())
        X_WT = pick_site.at_rest(target, drawn, seabed)
        center_W = transform_points(X_WT, target.center)
        approach_W, orientation_W = coarse_detection(pose(X_WT[:3, :3], center_W), rng)

        # The basket, a square, stands on any side of it.
        half = pick_site.basket_half(target)
        aside = rng.uniform(-np.pi, np.pi)
        toward = np.array([np.cos(aside), np.sin(aside), 0.0])
        away = GAP + target.radius + (half + pick_site.WALL) / np.abs(toward).max()
        basket_W = center_W + away * toward
        basket_W[2] = seabed + pick_site.WALL
        charted_W = basket_W + _CHARTED * rng.standard_normal(3)

        loose = pick_site.LooseObject.of(target, density=STONE, mass=self.mass)
        return PlacedCollection(
            scenario=scenario,
            vehicle=own,
            task=self,
            target=target,
            choice=choice,
            loose=loose,
            X_WT=X_WT,
            seabed=seabed,
            approach_W=approach_W,
            orientation_W=orientation_W,
            basket_W=basket_W,
            charted_W=charted_W,
            half=half,
        )


@dataclass(slots=True, eq=False)
class LoadWatch:
    """Observer that keeps the object as the vehicle has weighed it."""

    weighed: HeldLoad | None = None
    slow_ticks: tuple[int, ...] = ()

    def observe(self, moment: Moment) -> None:
        """Keeps the load, where it is known."""
        reference = moment.reference
        load = reference.jaws.holds if isinstance(reference, JawReference) else None
        if load is not None:
            self.weighed = load

    def save(self) -> HeldLoad | None:
        """What was weighed."""
        return self.weighed

    def resume(self, saved: HeldLoad | None) -> None:
        """Continue from a result of `save`."""
        self.weighed = saved


@dataclass(frozen=True, kw_only=True, eq=False)
class PlacedCollection(PlacedTask):
    """A collection at its site."""

    begun: ClassVar[tuple[WorkState, ...]] = (WorkState.APPROACH,)
    scenario: Scenario
    vehicle: "OwnVehicle"
    task: CollectTask
    target: "TargetModel"
    choice: "GraspChoice"
    loose: pick_site.LooseObject
    X_WT: Array  # (4, 4) true pose
    seabed: float  # [m] height in W
    approach_W: Array  # (3,) [m] coarse position of its centre
    orientation_W: Array  # (3, 3) its coarse orientation
    basket_W: Array  # (3,) [m] middle of the basket's floor
    charted_W: Array  # (3,) [m] the same as the vehicle knows it
    half: float  # [m] half of the basket's inner side
    watch: LoadWatch = field(default_factory=LoadWatch)

    @property
    def title(self) -> str:
        """Title of log and report."""
        return f"Collection of the {self.target.name}, seed {self.scenario.seed}"

    @property
    def X_WB(self) -> Array:
        """Scan pose of the hull: its height by the charted depth, not by the coarse detection."""
        lying_W = np.array([*self.approach_W[:2], self.seabed])
        return scan_pose(self.vehicle.X_BC, lying_W, self.task.range)

    @property
    def basket(self) -> "Basket":
        """The basket as the vehicle knows it."""
        from uuv.controllers.tasks.grasping.collecting import Basket

        return Basket(floor_W=self.charted_W, rim=pick_site.RIM, half=self.half)

    def scene(self, vehicle: "mujoco.MjSpec") -> "mujoco.MjSpec":
        """Adds the loose object, the basket and flat seabed."""
        return pick_site.pick_site(
            vehicle,
            self.target,
            self.X_WT,
            self.loose,
            seabed=self.seabed,
            basket=(self.basket_W, self.half),
        )

    def sensors(self, model: "mujoco.MjModel") -> "tuple[list[Sensor], SensorModel | None]":
        """The depth camera, and the readings of the gripper's drive."""
        from uuv.sim.sensors.depth_camera import DepthCamera
        from uuv.sim.sensors.jaws import JawSensor

        return [DepthCamera(model, HULL_BODY, self.vehicle.X_BC), JawSensor()], None

    def estimator(self, navigation: Estimator) -> Estimator:
        """Navigation with the gripper's readings."""
        from uuv.perception.navigation.jaw_readings import JawReadings

        return JawReadings(navigation)

    def finder(self, sensor: "SensorModel | None", seed: int) -> "KnownObjectFinder":
        """Finder of the object."""
        from uuv.perception.finding.target_finder import KnownObjectFinder

        return KnownObjectFinder(
            self.target, None, self.approach_W, self.orientation_W, sensor=sensor, seed=seed
        )

    def planner(self) -> "Collecting":
        """Planner of the collection."""
        from uuv.controllers.hull.thrust_margin import ThrustMargin
        from uuv.controllers.tasks.grasping.collecting import Collecting, CollectJob

        return Collecting(
            self.vehicle.at_work(),
            self.choice,
            CollectJob(**settings_of(CollectSettings, self.task)),
            X_WB_scan=self.X_WB,
            basket=self.basket,
            displaced=self._displaced,
            holding=ThrustMargin.of(self.vehicle.model),
        )

    def assess(self, ran: RunResult, seed: int) -> "Assessment":
        """Assessment against the true object."""
        truth = TrueCollection(
            basket_W=self.basket_W,
            center_T=self.target.center,
            half=self.half,
            mass=self.loose.mass,
            weight=GRAVITY * (self.loose.mass - self._displaced),
            grip=self.task.grip,
        )
        return assess_collection(
            ran.recording, truth, seed=seed, wall_s=ran.wall_s, weighed=self.watch.weighed
        )

    @property
    def _displaced(self) -> float:
        """Water [kg] that the object displaces."""
        from uuv.models.hydrodynamics import water_density

        return water_density(self.vehicle.model) * self.loose.volume

    def observers(self) -> tuple[Observer, ...]:
        """The reader of the weight."""
        return (self.watch,)
