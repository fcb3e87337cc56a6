"""Options of the commands that run one scenario, and the scenario that they describe; angles in degrees, as typed."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from uuv.controllers.ik.method import Method as IkMethod
from uuv.experiment.engines import EngineName
from uuv.experiment.options import at_least
from uuv.methods import AblatedMethod, Method, PublishedMethod
from uuv.models.site.terrain_kinds import Kind
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import finite_number
from uuv.sim.runs.command_line import ScenarioOptions

if TYPE_CHECKING:  # what a scenario is made of is imported when one is made: a help text needs none of it
    from uuv.scenario import Scenario, VehicleSetup
    from uuv.site import Site, SiteObject

BOTTOM = 0.02  # [m] by which a hole is deeper than the depth to reach


def site_of(options: ScenarioOptions, of: "SiteObject") -> "Site":
    """The site with that object, and the water of the options."""
    from uuv.site import Site, flow_of

    return Site(
        object=of,
        current=options.current,
        flow=None if options.flow is None else flow_of(options.flow),
        gust=options.gust,
        wave=options.wave,
        wave_frequency=options.wave_frequency,
    )


@dataclass(kw_only=True)
class VehicleOptions(ScenarioOptions):
    """Options of every command that drives the whole vehicle."""

    groups: ClassVar[Mapping[str, str]] = {"vehicle": "vehicle arm_errors tool parts"}

    vehicle: str = "uuv_puma"
    """A name of uuv.models.available(), a file with the named parts, MJCF or URDF (docs/own_vehicle.md), or
    MODULE:FUNCTION."""
    tool: str | None = None
    """Tool on the arm's tip: a name of `uuv list tools`; default: the vehicle's own, or the one that the job needs."""
    parts: Path | None = None
    """File that maps the model's names to those of the contract; default: NAME.parts.yaml beside the vehicle's file."""
    controller: str = "work"
    """Controller: work, a registered name, or MODULE:CLASS."""

    def site(self, of: "SiteObject") -> "Site":
        """The site with that object."""
        return site_of(self, of)

    def vehicle_setup(self, arm_errors: int | None = None) -> "VehicleSetup":
        """The vehicle with its tool."""
        from uuv.scenario import VehicleSetup

        parts = None if self.parts is None else str(self.parts)
        return VehicleSetup(vehicle=self.vehicle, arm_errors=arm_errors, tool=self.tool, parts=parts)


@dataclass(kw_only=True)
class ContactOptions(VehicleOptions):
    """Options that all contact scenarios share."""

    groups: ClassVar[Mapping[str, str]] = {
        "work": "forces speed stop_every contactless turn blend dwell least_chance range",
        "object": "path length arc rise azimuth height corner object scale line least fouled dented",
        "sensing": "sensor target_pose looks follow arm_camera",
        "control": "controller without published ik calibrated arm",
    }
    keys: ClassVar[Mapping[str, str]] = {
        "turn": "task.turn.angle",
        "stop_every": "task.promise.stops",
        "least_chance": "task.promise.least",
    }

    forces: tuple[float, ...] = ()
    """Set forces [N] on equal parts of the path; default: 60 90 60 along an object, 60 90 around it."""
    speed: float = 0.02
    """Speed of the tool along the path [m/s]."""
    stop_every: float = 0.0
    """The pressed tool stands still for a moment after so many seconds of motion [s], and its joints then tell
    navigation how the hull moves; 0: it does not stop."""
    contactless: float | None = None
    """Keep the tool at this distance [m] from the surface instead of pressing [Konoplin 2019]."""
    turn: float | None = None
    """Angle [deg] of the tool's x axis from the path, about the tool axis, that a tool which is not round keeps;
    default: the tool is round."""
    blend: float = 0.0
    """Length [m] of the path over which a tool with --turn turns at a corner; at least 0.04."""
    dwell: bool = False
    """A tool with --turn stops at a corner and turns there, pressing on, in place of --blend."""
    fouled: float = 0.0
    """Growth on the object along the path, up to this height [m]; the vehicle knows the clean object only."""
    dented: float = 0.0
    """Dents in the object along the path, up to this depth [m]; the vehicle knows the undamaged object only."""
    looks: int = 1
    """Successive depth frames, or pings, whose median the tool path is planned on; 16 where growth or dents are
    possible."""
    sensor: str = "camera"
    """Sensor for identification: camera, sonar, survey (the pose is known), a registered name, or MODULE:FUNCTION."""
    target_pose: Literal["found", "known"] = "found"
    """known: the object's pose is known from a survey, and no sensor looks for it, nor for growth and dents."""
    follow: bool = False
    """Follow the object by further depth frames while the vehicle scans it, and say if it moves."""
    arm_camera: bool = False
    """A small stereo camera beside the tool, which tells navigation how the tool moves over the surface."""
    least_chance: float = 0.0
    """Chance to keep the path within 3 mm, below which the work is refused before contact; 0: it is only said."""
    without: tuple[AblatedMethod, ...] = ()
    """Controller methods to leave out (ablation)."""
    published: tuple[PublishedMethod, ...] = ()
    """Methods as in [Konoplin 2022], in place of the default ones: force-law or normal-force-law,
    tip-force, identification."""
    ik: IkMethod = "hybrid"
    """Inverse kinematics that tracks the tool pose: hybrid, or a method of [Danilov 2021], jacobian_free or plain."""
    arm_errors: int | None = None
    """Seed of an arm built 2 mm and 0.3 deg wrong in every joint, unknown to the controller."""
    calibrated: bool = False
    """Calibrate the arm first: four points touched with a hand's noise of 0.1 mm, one known distance."""
    arm: Path | None = None
    """File of the controller's arm model: arm.yaml of uuv calibrate."""
    range: float = 1.25
    """Range from camera to object at the scan [m]."""

    def work(
        self, name: str, of: "SiteObject", path: str | None, *, forces: tuple[float, ...], least: float
    ) -> "Scenario":
        """Surface work.

        Args:
            name: Name of the scenario.
            of: The object.
            path: Name of one of its paths; None: the first.
            forces: [N] set forces where --forces gives none.
            least: Share of the path that must be within reach.

        Raises:
            ConfigurationError: An option is out of range.
        """
        if self.turn is None and (self.blend or self.dwell):
            said = "--dwell" if self.dwell else f"--blend {self.blend:g}"
            raise ConfigurationError(f"{said}: a round tool does not turn in a corner; give --turn too")
        if self.target_pose == "known" and (self.sensor, self.looks) != ("camera", 1):
            raise ConfigurationError("--target-pose known: nothing looks for the object, so no --sensor and --looks")
        if self.target_pose == "known" and "identification" in self.published:
            raise ConfigurationError("--target-pose known and --published identification: one of the two")
        from uuv.controllers.planning.promise import WANTED, PromiseLimits, StopLimits
        from uuv.kinds import SURVEY
        from uuv.scenario import Belief, Control, Scenario, Sensing
        from uuv.sensors.arm_camera import ArmCameraSetup
        from uuv.tasks.surface_work import SurfaceWorkTask, ToolTurn

        turn = None
        if self.turn is not None:
            turn = ToolTurn(angle=float(np.radians(self.turn)), blend=self.blend, dwell=self.dwell)
        return Scenario(
            name=name,
            seed=self.seed,
            site=self.site(of),
            task=SurfaceWorkTask(
                path=path,
                turn=turn,
                forces=self.forces or forces,
                speed=self.speed,
                contactless=self.contactless,
                least=least,
                range=self.range,
                promise=PromiseLimits(
                    least=self.least_chance,
                    wanted=max(WANTED, self.least_chance),
                    stops=StopLimits(every=self.stop_every) if self.stop_every else None,
                ),
            ),
            vehicle=self.vehicle_setup(self.arm_errors),
            belief=Belief(calibrated=self.calibrated, arm=None if self.arm is None else str(self.arm)),
            sensing=Sensing(
                sensor=SURVEY if self.target_pose == "known" else self.sensor,
                looks=self.looks,
                follow=self.follow,
                arm_camera=ArmCameraSetup() if self.arm_camera else None,
            ),
            control=Control(controller=self.controller, without=self.without, published=self.published, ik=self.ik),
        )


@dataclass(kw_only=True)
class BarrelOptions(ContactOptions):
    """Clean a barrel with a set force."""

    path: Literal["longitudinal", "transverse", "corner"] = "longitudinal"
    """Along the barrel's top, half around it, or first along and then off to a side."""
    length: float | None = None
    """Length of the longitudinal path [m]; default 0.6, with --quick 0.2."""
    arc: float | None = None
    """Arc of the transverse path [deg]; default 180, with --quick 60. Where the reach ends sooner, the largest from 150
    deg on is worked and reported."""
    azimuth: float = 0.0
    """Azimuth of the path around the barrel [deg], from the top; a large one is out of reach."""
    corner: float = 90.0
    """Angle [deg] by which the path corner turns, on the barrel's top."""

    def scenario(self) -> "Scenario":
        """The work on the barrel."""
        from uuv.site import Barrel

        arc = self.usual(self.arc, 180.0, quick=60.0)
        along = self.path != "transverse"
        of = Barrel(
            length=self.usual(self.length, 0.6, quick=0.2),
            arc=float(np.radians(arc)),
            azimuth=float(np.radians(self.azimuth)),
            corner=float(np.radians(self.corner)),
            fouled=self.fouled,
            dented=self.dented,
        )
        forces = (60.0, 90.0, 60.0) if along else (60.0, 90.0)
        least = 1.0 if along else min(1.0, 150.0 / arc)
        return self.work("clean_barrel", of, self.path, forces=forces, least=least)


@dataclass(kw_only=True)
class PileOptions(ContactOptions):
    """Clean a vertical pile with a set force."""

    path: Literal["vertical", "ring", "helix"] = "vertical"
    """Up the pile, around it, or both at once."""
    length: float | None = None
    """Length of the vertical path [m]; default 0.5, with --quick 0.2."""
    arc: float | None = None
    """Arc of ring and helix [deg]; default 100, with --quick 40. Where the reach ends sooner, the largest possible from
    80 deg on is worked and reported."""
    rise: float | None = None
    """Rise of the helix [m]; default 0.003 for each degree of its arc."""
    azimuth: float = 0.0
    """Azimuth of the path's middle [deg], from the side that the vehicle approaches."""
    height: float = -0.15
    """Height of the path's middle above the pile's [m]; the flange is 0.2 to 0.3 m above it."""
    range: float = 1.8
    """Range from camera to the pile's axis at the scan [m]."""
    vehicle: str = "uuv_puma_side"

    def scenario(self) -> "Scenario":
        """The work on the pile."""
        from uuv.site import Pile

        arc = self.usual(self.arc, 100.0, quick=40.0)
        up = self.path == "vertical"
        of = Pile(
            length=self.usual(self.length, 0.5, quick=0.2),
            arc=float(np.radians(arc)),
            rise=0.003 * arc if self.rise is None else self.rise,
            azimuth=float(np.radians(self.azimuth)),
            height=self.height,
            fouled=self.fouled,
            dented=self.dented,
        )
        forces = (60.0, 90.0, 60.0) if up else (60.0, 90.0)
        return self.work("clean_pile", of, self.path, forces=forces, least=1.0 if up else min(1.0, 80.0 / arc))


@dataclass(kw_only=True)
class ObjectOptions(ContactOptions):
    """Clean a known object with a set force."""

    object: str = "rock"
    """A name of uuv.models.objects.targets.available(), a mesh file, or MODULE:FUNCTION."""
    scale: float | None = None
    """Unit of a mesh file [m]: 0.001 for one in mm; default: metres."""
    path: str | None = None
    """Name of one of the object's paths; default: the first."""
    length: float = 0.3
    """Length of the line over a mesh [m]."""
    line: tuple[float, float, float, float] | None = None
    """A path of one's own instead: x0 y0 x1 y1 [m] in the object's frame, straight over it, projected from above."""
    least: float = 0.6
    """Least share of the path that must be within reach; the rest is dropped at both ends, and reported."""
    range: float = 1.2

    def scenario(self) -> "Scenario":
        """The work on the object."""
        if self.line is not None and self.path is not None:
            raise ConfigurationError("--path and --line: one of the two")
        from uuv.site import KnownObject

        of = KnownObject(
            object=self.object,
            scale=self.scale,
            length=self.length,
            line=self.line,
            fouled=self.fouled,
            dented=self.dented,
        )
        forces = (60.0,) if self.quick else (60.0, 90.0, 60.0)
        return self.work("clean_object", of, self.path, forces=forces, least=self.least)


@dataclass(kw_only=True)
class TrialOptions(VehicleOptions):
    """Options of commands that can run many seeds."""

    trials: int = 0
    """Number of seeds to run, without recording; 0: one run with recording."""
    engine: EngineName = "processes"
    """processes: of this machine. ray: a Ray cluster, that of RAY_ADDRESS or one started here (extra cluster)."""
    workers: int = 0
    """Processes for the trials; 0: one for each core, 1: this one."""
    anew: bool = False
    """Delete the trials in the folder of an earlier command; without it they are resumed."""

    def __post_init__(self) -> None:
        at_least(self, trials=0, workers=0)


@dataclass(kw_only=True)
class InsertionOptions(TrialOptions):
    """Insert a sampler into a hole."""

    hole: Literal["a", "b"] = "a"
    """Hole of the manifold."""
    clearance: float = 2.0
    """Radial clearance between sampler and hole [mm]."""
    depth: float | None = None
    """Depth to reach below the mouth [mm], default 60, with --quick 30; the hole is 20 mm deeper."""
    chamfer: float = 2.0
    """Chamfer of the hole's mouth [mm]."""
    error: tuple[float, float] = (0.0, 0.0)
    """Error added to the identified hole position along the hole's x and y [mm]; search and compliance must correct
    it."""
    compliance: bool = True
    """Compliance to side forces (--no-compliance: none, for ablation)."""
    range: float = 1.25
    """Range from camera to manifold at the scan [m]."""
    vehicle: str = "uuv_puma"
    """A name or a file (docs/own_vehicle.md); it carries the sampler in place of its own tool, unless that is a
    capsule, a sampler too."""

    def scenario(self) -> "Scenario":
        """The insertion."""
        from uuv.scenario import Control, Scenario
        from uuv.site import HoleManifold
        from uuv.tasks.insertion import InsertionTask

        depth = 1e-3 * self.usual(self.depth, 60.0, quick=30.0)
        of = HoleManifold(clearance=1e-3 * self.clearance, depth=depth + BOTTOM, chamfer=1e-3 * self.chamfer)
        return Scenario(
            name="insert_sampler",
            seed=self.seed,
            site=self.site(of),
            task=InsertionTask(
                hole=self.hole,
                depth=depth,
                error=(1e-3 * self.error[0], 1e-3 * self.error[1]),
                compliance=self.compliance,
                range=self.range,
            ),
            vehicle=self.vehicle_setup(),
            control=Control(controller=self.controller),
        )


@dataclass(kw_only=True)
class SeabedOptions(TrialOptions):
    """Take a sample of the seabed."""

    terrain: Kind | Literal["any"] = "ripples"
    """Kind of terrain, drawn from the seed; any: the kinds in turn."""
    soil: str = "sand"
    """Kind of soil (models/site/soil.py)."""
    work: Literal["core", "drag"] = "core"
    """core: push a tube in and withdraw it; drag: drag a box along the profile between the targets."""
    push: float | None = None
    """Set force on the core tube [N]; default 50, with --quick 40."""
    depth: float | None = None
    """drag: depth of the box [mm], default 30; core: depth at which the tube is full [mm], default 180."""
    targets: Path | None = None
    """Text file: points B_i over the seabed and a line `z X Y Z`, in the axes of a level hull 2.5 m above the terrain's
    middle; default: ahead of the hull."""
    cloud: Path | None = None
    """Text, PLY or PCD, in the same axes: replaces the scan, and is judged before the vehicle approaches."""
    dead_beams: tuple[int, ...] = ()
    """Beams of the Doppler log, 1 to 4, that return no echo."""
    without: tuple[Method, ...] = ()
    """Controller methods to leave out, e.g. compensation (ablation)."""
    vehicle: str = "uuv_puma"
    """A name or a file (docs/own_vehicle.md); it carries a core tube or a box in place of its own tool, unless that is
    one too."""

    def scenario(self) -> "Scenario":
        """The sampling."""
        from uuv.scenario import Control, Scenario, Sensing
        from uuv.site import Ground
        from uuv.tasks.seabed_sampling import SeabedSamplingTask

        drag = self.work == "drag"
        depth = self.depth if self.depth is not None else 30.0 if drag else 180.0
        return Scenario(
            name="sample_seabed",
            seed=self.seed,
            site=self.site(Ground(terrain=self.terrain, soil=self.soil)),
            task=SeabedSamplingTask(
                drag=drag,
                push=self.usual(self.push, 50.0, quick=40.0),
                depth=1e-3 * depth,
                cloud=None if self.cloud is None else str(self.cloud),
                targets=None if self.targets is None else str(self.targets),
            ),
            vehicle=self.vehicle_setup(),
            sensing=Sensing(dead_beams=self.dead_beams),
            control=Control(controller=self.controller, without=self.without),
        )


@dataclass(kw_only=True)
class InspectionOptions(VehicleOptions):
    """Fly around a known object, once or until it is covered."""

    object: str = "barrel"
    """A name (barrel, starfish, anode, valve, rock ...), or a mesh file, STL, OBJ or PLY [m]."""
    distance: float = 1.4
    """Distance from the camera to the object's outline [m]."""
    clearance: float = 0.3
    """Least clearance of hull and folded arm to the object and the seabed [m]."""
    speed: float = 0.15
    """Speed of the hull [m/s]."""
    cover: bool = False
    """Fly further orbits, at other heights and distances, until all that can be seen is seen."""
    mesh: bool = False
    """Leave mesh.ply, a mesh of what was seen in the colours of its deviation from the model (extra open3d)."""
    fouled: float = 0.0
    """Growth anywhere on the object, up to this height [m]; the vehicle knows the clean object only."""
    dented: float = 0.0
    """Dents anywhere in the object, up to this depth [m]; the vehicle knows the undamaged object only."""

    def scenario(self) -> "Scenario":
        """The inspection."""
        from uuv.scenario import Control, Scenario
        from uuv.site import KnownObject
        from uuv.tasks.inspection import InspectionTask

        return Scenario(
            name="inspect_object",
            seed=self.seed,
            site=self.site(KnownObject(object=self.object, fouled=self.fouled, dented=self.dented)),
            task=InspectionTask(
                distance=self.distance, clearance=self.clearance, speed=self.speed, cover=self.cover, mesh=self.mesh
            ),
            vehicle=self.vehicle_setup(),
            control=Control(controller=self.controller),
        )


@dataclass(kw_only=True)
class GearOptions(ScenarioOptions):
    """Identify the friction of the arm's gears."""

    vehicle: str = "uuv_puma"
    """A name of uuv.models.available(), or an MJCF file with the named parts (docs/own_vehicle.md)."""
    seconds: float | None = None
    """Duration of the swings [s], after 4 s of unfolding; default 30, with --quick 15."""
    gear_spread: float = 0.3
    """Share in +- by which the true friction of each gear deviates from the controller's model, drawn from the seed."""

    def scenario(self) -> "Scenario":
        """The identification."""
        from uuv.perturbations.vehicle import Gears
        from uuv.scenario import Scenario, VehicleSetup
        from uuv.site import OpenWater
        from uuv.tasks.gear_identification import GearIdentificationTask

        finite_number(self.gear_spread, "--gear-spread", least=0.0, most=0.9)
        seconds = self.usual(self.seconds, 30.0, quick=15.0)

        return Scenario(
            name="identify_friction",
            seed=self.seed,
            site=site_of(self, OpenWater()),
            task=GearIdentificationTask(seconds=seconds),
            vehicle=VehicleSetup(vehicle=self.vehicle),
            perturbations=(Gears(spread=self.gear_spread),),
            perturbation_seed=self.seed,
        )


def barrel(**options: Any) -> "Scenario":
    """The main job, cleaning of a barrel; `options` are those of `BarrelOptions`, such as seed=3 or quick=True."""
    return BarrelOptions(**options).scenario()
