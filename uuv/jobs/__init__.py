"""The jobs: each a function with keyword arguments that returns a scenario (`uuv.jobs.job`).

    scenario = jobs.clean_barrel(path="transverse", seed=3, current=(0.2, 0.0, 0.0), forces=(60.0, 80.0))

Beside the arguments that stand here, a job takes the options of its scenario: seed, water, vehicle, sensors, object and
task. Units are those of the command line: metres and newtons, angles in degrees, clearances in millimetres.
"""

from typing import TYPE_CHECKING, Literal

import numpy as np

from uuv.jobs.job import BY_NAME, Job, as_job, job
from uuv.methods import Method
from uuv.models.registry import Registry
from uuv.sim.interfaces.options import MILLIMETRE
from uuv.sim.interfaces.spatial import finite_number

if TYPE_CHECKING:  # what a scenario is made of is imported when one is made: a list of jobs needs none of it
    from uuv.scenario import Scenario
    from uuv.site import Workpiece

__all__ = [
    "JOBS",
    "Job",
    "clean_barrel",
    "clean_object",
    "clean_pile",
    "identify_friction",
    "insert_sampler",
    "inspect_object",
    "job",
    "named",
    "open_water",
    "sample_seabed",
]

BOTTOM = 0.02  # [m] by which a hole is deeper than the depth to reach
ALONG, AROUND = (60.0, 90.0, 60.0), (60.0, 90.0)  # [N] set forces on a path along an object, and around it


@job(earlier="barrel")
def clean_barrel(
    *,
    path: Literal["longitudinal", "transverse", "corner"] = "longitudinal",
    arc: float | None = None,
    quick: bool = False,
) -> "Scenario":
    """Clean a barrel with a set force.

    Args:
        path: Along the barrel's top, half around it, or first along and then off to a side.
        arc: Arc of the transverse path [deg]; default 180, with --quick 60. Where the reach ends sooner, the largest
            from 150 deg on is worked and reported.
        quick: As in every job.
    """
    from uuv.site import Barrel

    angle = arc if arc is not None else 60.0 if quick else 180.0
    barrel = Barrel(length=0.2 if quick else 0.6, arc=float(np.radians(angle)))
    if path == "transverse":
        return _cleaning("clean_barrel", barrel, path, forces=AROUND, least=min(1.0, 150.0 / angle))
    return _cleaning("clean_barrel", barrel, path, forces=ALONG, least=1.0)


@job(earlier="pile")
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
        arc: Arc of ring and helix [deg]; default 100, with --quick 40. Where the reach ends sooner, the largest
            possible from 80 deg on is worked and reported.
        rise: Rise of the helix [m]; default 0.003 for each degree of its arc.
        quick: As in every job.
    """
    from uuv.site import Pile

    angle = arc if arc is not None else 40.0 if quick else 100.0
    pile = Pile(
        length=0.2 if quick else 0.5, arc=float(np.radians(angle)), rise=0.003 * angle if rise is None else rise
    )
    up = path == "vertical"
    forces, least = (ALONG, 1.0) if up else (AROUND, min(1.0, 80.0 / angle))
    return _cleaning("clean_pile", pile, path, forces=forces, least=least, scan_range=1.8, vehicle="uuv_puma_side")


@job(earlier="object")
def clean_object(*, quick: bool = False) -> "Scenario":
    """Clean a known object with a set force.

    Args:
        quick: As in every job.
    """
    from uuv.site import KnownObject

    return _cleaning(
        "clean_object", KnownObject(), None, forces=ALONG[:1] if quick else ALONG, least=0.6, scan_range=1.2
    )


def _cleaning(
    name: str,
    workpiece: "Workpiece",
    path: str | None,
    *,
    forces: tuple[float, ...],
    least: float,
    scan_range: float = 1.25,
    vehicle: str = "uuv_puma",
) -> "Scenario":
    """Work on a path of an object.

    Args:
        name: Of the scenario.
        workpiece: The object.
        path: Name of one of its paths; None: the first.
        forces: [N] set forces on equal parts of the path.
        least: Share of the path that must be within reach.
        scan_range: [m] from the camera to the object at the scan.
        vehicle: That does the work.
    """
    from uuv.scenario import Scenario, VehicleSetup
    from uuv.site import Site
    from uuv.tasks.surface_work import SurfaceWorkTask

    return Scenario(
        name=name,
        site=Site(object=workpiece),
        task=SurfaceWorkTask(path=path, forces=forces, least=least, range=scan_range),
        vehicle=VehicleSetup(vehicle=vehicle),
    )


@job(trials=True, earlier="insertion")
def insert_sampler(*, depth: float | None = None, quick: bool = False) -> "Scenario":
    """Insert a sampler into a hole.

    Args:
        depth: Depth to reach below the mouth [mm], default 60, with --quick 30; the hole is 20 mm deeper.
        quick: As in every job.
    """
    from uuv.scenario import Scenario
    from uuv.site import HoleManifold, Site
    from uuv.tasks.insertion import InsertionTask

    reached = MILLIMETRE * (depth if depth is not None else 30.0 if quick else 60.0)
    return Scenario(
        name="insert_sampler", site=Site(object=HoleManifold(depth=reached + BOTTOM)), task=InsertionTask(depth=reached)
    )


@job(trials=True, earlier="seabed")
def sample_seabed(
    *,
    work: Literal["core", "drag"] = "core",
    depth: float | None = None,
    without: tuple[Method, ...] = (),
    quick: bool = False,
) -> "Scenario":
    """Take a sample of the seabed.

    Args:
        work: core: push a tube in and withdraw it; drag: drag a box along the profile between the targets.
        depth: drag: depth of the box [mm], default 30; core: depth at which the tube is full [mm], default 180.
        without: Controller methods to leave out, e.g. compensation (ablation).
        quick: As in every job.
    """
    from uuv.scenario import Control, Scenario
    from uuv.site import Ground, Site
    from uuv.tasks.seabed_sampling import SeabedSamplingTask

    drag = work == "drag"
    return Scenario(
        name="sample_seabed",
        site=Site(object=Ground()),
        task=SeabedSamplingTask(
            drag=drag,
            push=40.0 if quick else 50.0,
            depth=MILLIMETRE * (depth if depth is not None else 30.0 if drag else 180.0),
        ),
        control=Control(without=without),
    )


@job(earlier="inspection")
def inspect_object(*, quick: bool = False) -> "Scenario":
    """Fly around a known object, once or until it is covered.

    Args:
        quick: As in every job.
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
def identify_friction(*, seed: int = 0, gear_spread: float = 0.3, quick: bool = False) -> "Scenario":
    """Identify the friction of the arm's gears.

    The vehicle keeps station while its joints swing, slowly, then fast. Encoders, torque sensors at the gear outputs
    and motor torques give the friction of each gear, which is compared with the true one. The true gears deviate from
    those that the vehicle believes in. Rotor inertias are known. No other command reads the result.

    Args:
        seed: Seed of everything random: the true gears, the noise of the sensors, the gusts.
        gear_spread: Share in +- by which the true friction of each gear deviates from the controller's model.
        quick: As in every job.
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
    """Keep station in open water, or do a task of one's own there (--task MODULE:CLASS).

    Args:
        quick: As in every job.
    """
    from uuv.scenario import Scenario
    from uuv.site import OpenWater, Site
    from uuv.tasks.station_keeping import StationKeepingTask

    task = StationKeepingTask(seconds=10.0) if quick else StationKeepingTask()
    return Scenario(name="open_water", site=Site(object=OpenWater()), task=task)


JOBS: Registry[Job] = Registry("job", {name: lambda made=made: made for name, made in BY_NAME.items()})


def named(name: str) -> Job:
    """The job of that name: ours, another package's, or a function MODULE:FUNCTION.

    Raises:
        ConfigurationError: There is none; the message lists those there are.
    """
    if JOBS.resolve(name) in BY_NAME:
        return BY_NAME[name]
    return as_job(JOBS.maker(name), name)
