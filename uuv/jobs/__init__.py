"""The jobs: each a function with keyword arguments that returns a scenario (`uuv.jobs.job`).

    scenario = jobs.clean_barrel(path="transverse", seed=3, forces=(60.0, 80.0))

Besides the arguments declared here, a job takes the options of its scenario: seed, water, vehicle,
sensors, object and task. Units are those of the command line: metres and newtons, angles in
degrees, clearances in millimetres.
"""

from typing import TYPE_CHECKING, Literal

import numpy as np

from uuv.jobs.job import BY_NAME, as_job
from uuv.jobs.job import Job as Job
from uuv.jobs.job import job as job
from uuv.methods import Method
from uuv.models.registry import Registry
from uuv.sim.interfaces.options import MILLIMETRE
from uuv.sim.interfaces.spatial import finite_number

if TYPE_CHECKING:  # listing the jobs does not need the parts of a scenario
    from uuv.scenario import Scenario, Task
    from uuv.site import Workpiece

BOTTOM = 0.02  # [m] by which a hole is deeper than the depth to reach
BOX = 0.03  # [m] depth of the dragged box in the ground
ALONG = (60.0, 90.0, 60.0)  # [N] set forces on a path along an object
AROUND = (60.0, 90.0)  # [N] set forces on a path around an object


@job
def clean_barrel(
    *,
    path: Literal["longitudinal", "transverse", "corner"] = "longitudinal",
    arc: float | None = None,
    quick: bool = False,
) -> "Scenario":
    """Clean a barrel with a set force.

    Args:
        path: Along the barrel's top, half around it, or first along and then off to a side.
        arc: Arc of the transverse path [deg]; default 180, with --quick 60. If the reach is too
            short for it, the largest arc from 150 deg on is worked and reported.
        quick: A shorter path, for a first look within a minute.
    """
    from uuv.site import Barrel
    from uuv.tasks.surface_work import SurfaceWorkTask

    around = arc if arc is not None else 60.0 if quick else float(np.degrees(Barrel.arc))
    finite_number(around, "arc [deg]", above=0.0)
    length = 0.2 if quick else Barrel.length
    barrel = Barrel(length=length, arc=float(np.radians(around)))

    if path == "transverse":
        task = SurfaceWorkTask(path=path, forces=AROUND, least=min(1.0, 150.0 / around))
    else:
        task = SurfaceWorkTask(path=path, forces=ALONG)
    return _on_object("clean_barrel", barrel, task)


@job
def clean_pile(
    *,
    path: Literal["vertical", "ring", "helix"] = "vertical",
    arc: float | None = None,
    rise: float | None = None,
    quick: bool = False,
) -> "Scenario":
    """Clean a vertical pile with a set force.

    Args:
        path: Up the pile, around it, or both at once.
        arc: Arc of ring and helix [deg]; default 100, with --quick 40. If the reach is too short
            for it, the largest arc from 80 deg on is worked and reported.
        rise: Rise of the helix [m]; default 0.003 for each degree of its arc.
        quick: A shorter path, for a first look within a minute.
    """
    from uuv.site import Pile
    from uuv.tasks.surface_work import SurfaceWorkTask

    around = arc if arc is not None else 40.0 if quick else float(np.degrees(Pile.arc))
    finite_number(around, "arc [deg]", above=0.0)
    per_degree = Pile.rise / float(np.degrees(Pile.arc))
    climb = per_degree * around if rise is None else rise
    length = 0.2 if quick else Pile.length
    pile = Pile(length=length, arc=float(np.radians(around)), rise=climb)

    if path == "vertical":
        task = SurfaceWorkTask(path=path, forces=ALONG, range=1.8)
    else:
        least = min(1.0, 80.0 / around)
        task = SurfaceWorkTask(path=path, forces=AROUND, least=least, range=1.8)
    return _on_object("clean_pile", pile, task, by="uuv_puma_side")


@job
def clean_object(*, quick: bool = False) -> "Scenario":
    """Clean a known object with a set force.

    Args:
        quick: One set force instead of three.
    """
    from uuv.site import KnownObject
    from uuv.tasks.surface_work import SurfaceWorkTask

    task = SurfaceWorkTask(forces=ALONG[:1] if quick else ALONG, least=0.6, range=1.2)
    return _on_object("clean_object", KnownObject(), task)


def _on_object(name: str, piece: "Workpiece", task: "Task", by: str = "uuv_puma") -> "Scenario":
    """Scenario of a task at an object, with the vehicle `by`."""
    from uuv.scenario import Scenario, VehicleSetup
    from uuv.site import Site

    vehicle = VehicleSetup(vehicle=by)
    return Scenario(name=name, site=Site(object=piece), task=task, vehicle=vehicle)


@job
def insert_sampler(*, depth: float | None = None, quick: bool = False) -> "Scenario":
    """Insert a sampler into a hole.

    Args:
        depth: Depth to reach below the mouth [mm], default 60, with --quick 30; the hole is 20 mm
            deeper.
        quick: A shallower hole.
    """
    from uuv.scenario import Scenario
    from uuv.site import HoleManifold, Site
    from uuv.tasks.insertion import InsertionTask

    reached = InsertionTask.depth if depth is None else MILLIMETRE * depth
    if depth is None and quick:
        reached *= 0.5
    manifold = HoleManifold(depth=reached + BOTTOM)
    task = InsertionTask(depth=reached)
    return Scenario(name="insert_sampler", site=Site(object=manifold), task=task)


@job
def sample_seabed(
    *,
    work: Literal["core", "drag"] = "core",
    depth: float | None = None,
    without: tuple[Method, ...] = (),
    quick: bool = False,
) -> "Scenario":
    """Take a sample of the seabed.

    Args:
        work: core: push a tube in and withdraw it; drag: drag a box along the profile between the
            targets.
        depth: drag: depth of the box [mm], default 30; core: depth at which the tube is full [mm],
            default 180.
        without: Controller methods to leave out, e.g. compensation (ablation).
        quick: A smaller force on the core tube.
    """
    from uuv.scenario import Control, Scenario
    from uuv.site import Ground, Site
    from uuv.tasks.seabed_sampling import SeabedSamplingTask

    drag = work == "drag"
    usual = BOX if drag else SeabedSamplingTask.depth
    reached = usual if depth is None else MILLIMETRE * depth
    return Scenario(
        name="sample_seabed",
        site=Site(object=Ground()),
        task=SeabedSamplingTask(drag=drag, push=40.0 if quick else 50.0, depth=reached),
        control=Control(without=without),
    )


@job
def collect(*, quick: bool = False) -> "Scenario":
    """Pick an object up from the seabed, and put it into a basket beside it.

    Args:
        quick: A faster way to the basket.
    """
    from uuv.scenario import Scenario
    from uuv.site import KnownObject, Site
    from uuv.tasks.collecting import CollectTask

    return Scenario(
        name="collect",
        site=Site(object=KnownObject(object="stone")),
        task=CollectTask(carry_speed=0.1) if quick else CollectTask(),
    )


@job
def turn_valve(
    *,
    handle: Literal["lever", "bar"] = "lever",
    moment: float | None = None,
    torque: float | None = None,
    quick: bool = False,
) -> "Scenario":
    """Turn a valve by a quarter, by its lever or its T-bar.

    Args:
        handle: lever: the tool is carried along on an arc; bar: it turns about its own axis.
        moment: Set moment about the valve's axis [N m], default 30, on a bar 9.
        torque: Moment at which the valve breaks away [N m], default 20, on a bar 6.
        quick: A faster turn.
    """
    from uuv.scenario import Scenario
    from uuv.site import HandValve, Site
    from uuv.tasks.turning import TurnValveTask

    usual = (30.0, 20.0) if handle == "lever" else (9.0, 6.0)
    most = usual[0] if moment is None else moment
    breaks = usual[1] if torque is None else torque
    viscous = 20.0 if handle == "lever" else 3.0
    return Scenario(
        name="turn_valve",
        site=Site(object=HandValve(handle=handle, torque=breaks, viscous=viscous)),
        task=TurnValveTask(moment=most, speed=0.2 if quick else TurnValveTask.speed),
    )


@job
def move_plug(*, quick: bool = False) -> "Scenario":
    """Move a plug out of one receptacle of a panel into the other.

    Args:
        quick: A faster way between the receptacles.
    """
    from uuv.scenario import Scenario
    from uuv.site import PlugBoard, Site
    from uuv.tasks.plugging import MovePlugTask

    return Scenario(
        name="move_plug",
        site=Site(object=PlugBoard()),
        task=MovePlugTask(carry_speed=0.08) if quick else MovePlugTask(),
    )


@job
def inspect_object(*, quick: bool = False) -> "Scenario":
    """Fly around a known object, once or until it is covered.

    Args:
        quick: A faster flight.
    """
    from uuv.scenario import Scenario
    from uuv.site import KnownObject, Site
    from uuv.tasks.inspection import InspectionTask

    return Scenario(
        name="inspect_object",
        site=Site(object=KnownObject(object="barrel")),
        task=InspectionTask(speed=0.25) if quick else InspectionTask(),
    )


@job
def identify_friction(
    *,
    seed: int = 0,  # also of the gears
    gear_spread: float = 0.3,
    quick: bool = False,
) -> "Scenario":
    """Identify the friction of the arm's gears.

    The vehicle keeps station while its joints swing, slowly, then fast. Encoders, torque sensors at
    the gear outputs and motor torques give the friction of each gear, which is compared with the
    true friction. The true friction deviates from that in the vehicle's model of itself. Rotor
    inertias are known. No other command reads the result.

    Args:
        seed: Seed of everything random: the true gears, the noise of the sensors, the gusts.
        gear_spread: Largest relative deviation (+-) of the true friction of each gear from the
            controller's model.
        quick: Shorter swings.
    """
    from uuv.perturbations.vehicle import Gears
    from uuv.scenario import Scenario
    from uuv.site import OpenWater, Site
    from uuv.tasks.gear_identification import GearIdentificationTask

    finite_number(gear_spread, "gear_spread", least=0.0, most=0.9)
    return Scenario(
        name="identify_friction",
        seed=seed,
        site=Site(object=OpenWater()),
        task=GearIdentificationTask(seconds=15.0 if quick else 30.0),
        perturbations=(Gears(spread=gear_spread),),
        perturbation_seed=seed,
    )


@job
def open_water(*, quick: bool = False) -> "Scenario":
    """Keep station in open water, or do a task of your own there (--task MODULE:CLASS).

    Args:
        quick: Station keeping for a shorter time.
    """
    from uuv.scenario import Scenario
    from uuv.site import OpenWater, Site
    from uuv.tasks.station_keeping import StationKeepingTask

    task = StationKeepingTask(seconds=10.0) if quick else StationKeepingTask()
    return Scenario(name="open_water", site=Site(object=OpenWater()), task=task)


JOBS: "Registry[Scenario]" = Registry("job", dict(BY_NAME))


def named(name: str) -> Job:
    """Job by name: of this project, of another package, or MODULE:FUNCTION.

    Raises:
        ConfigurationError: There is no such job; the message lists the jobs.
    """
    return as_job(JOBS.maker(name), name)
