"""Inspection of a known object: one orbit at a set distance with the camera on it [Konoplin 2019, eq. 6].

The object lies on the seabed; the vehicle knows its model and its coarse pose. Where the orbit would bring hull or arm
too near, the vehicle stays where it is: one line with the reason, exit code 2.
"""

from scenarios.start import ScenarioOptions, parse, run_scenario  # isort: skip

import time
from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np
from matplotlib.figure import Figure
from rich.console import Console

from controllers.mkps import Chain
from controllers.tasks.inspection import Inspection, InspectionJob
from models.naming import ARM_BASE_BODY, CAMERA_SITE, HULL_BODY, TIP_SITE, TOOL_GEOM, find
from models.objects import targets
from models.site import scenes
from models.vehicle import pose_in_body
from perception.navigation.strapdown_filter import Navigation
from perception.target_finder import KnownObjectFinder
from scenarios.campaigns.domain_randomisation import NOMINAL
from scenarios.contact_options import coarse_detection
from scenarios.contact_parts import checked_vehicle, controller, hull_box, passive_joints, scan_pose
from scenarios.runner import Evaluation, PreparedRun, run_with_report
from sim import hydrodynamics
from sim.evaluation.inspection_metrics import TrueInspection, assess_inspection
from sim.interfaces.messages import WorkState
from sim.interfaces.spatial import exp_so3, pose, transform_points
from sim.loop.recording import Recording
from sim.loop.rollout import Parts
from sim.plant.plant import Plant
from sim.sensors import proprioception
from sim.sensors.depth_camera import DepthCamera
from sim.water.current import Current

FAR = 5.0  # [m] largest range at which a surface point counts as seen


@dataclass(kw_only=True)
class Options(ScenarioOptions):
    """Fly one orbit around a known object."""

    object: str = "barrel"
    """A name (barrel, starfish, anode, valve, rock ...), or a mesh file, STL, OBJ or PLY [m]."""
    distance: float = 1.4
    """Distance from the camera to the object's outline [m]."""
    clearance: float = 0.3
    """Least clearance of hull and folded arm to the object and the seabed [m]."""
    speed: float = 0.15
    """Speed of the hull [m/s]."""
    vehicle: str = "uuv_puma"
    """A name of models.available(), or an MJCF file with the named parts (docs/concepts.md)."""
    controller: str = "work"
    """Controller: work, a registered name, or MODULE:CLASS."""


def prepare(options: Options) -> tuple[PreparedRun, TrueInspection]:
    """Builds one flight, drawn from the seed: plant, parts and the truth for evaluation.

    Raises:
        UuvError: The object or the vehicle is unknown, or an option is out of range.
    """
    rng = np.random.default_rng(options.seed)
    target = targets.of(options.object)
    job = InspectionJob(distance=options.distance, clearance=options.clearance, speed=options.speed)
    X_WT = pose(exp_so3([0.0, 0.0, rng.uniform(-0.6, 0.6)]), rng.uniform(-0.2, 0.2, 3) - [0.0, 0.0, 1.5])
    approach, orientation = coarse_detection(X_WT @ pose(p=target.center), rng)
    gusts, loop, start, sampling = rng.spawn(4)
    own = scenes.vehicle_spec(options.vehicle).compile()
    arm = checked_vehicle(own, but=(TOOL_GEOM,))
    X_BC = pose_in_body(own, find(own, mujoco.mjtObj.mjOBJ_SITE, CAMERA_SITE), arm.hull)
    X_WB = scan_pose(X_BC, approach, options.distance)
    offset = pose(exp_so3([0.0, 0.0, start.uniform(-0.02, 0.02)]), start.uniform(-0.03, 0.03, 3))
    model = hydrodynamics.compile(scenes.work_site(scenes.vehicle_spec(options.vehicle), target, X_WT))
    plant = Plant(model, current=Current(options.current), X_WB=X_WB @ offset)
    flow = Current(options.current, gust=options.gust, timestep=model.opt.timestep, rng=gusts)
    camera = DepthCamera(model, HULL_BODY, X_BC)
    parts = Parts(
        sensors=[
            proprioception.Encoders(),
            proprioception.JointTorqueSensors(),
            proprioception.Imu(),
            proprioception.Dvl(),
            proprioception.VisionDrift(),
            camera,
        ],
        estimator=Navigation(),
        finder=KnownObjectFinder(target, None, approach, orientation, seed=int(sampling.integers(2**31))),
        planner=Inspection(
            arm,
            Chain.from_mjcf(own, ARM_BASE_BODY, TIP_SITE, exclude=passive_joints(own, arm)),
            target,
            job,
            X_WB_scan=X_WB,
            hull_box=hull_box(own, arm),
            X_BC=X_BC,
            floor=scenes.seabed_height(target, X_WT),
        ),
        controller=controller(options.controller, own, without=frozenset(), water_error=NOMINAL.water_error),
    )
    truth = TrueInspection(
        target=target,
        X_WT=X_WT,
        X_BC=X_BC,
        distance=options.distance,
        far=FAR,
        half_view=(camera.K[0, 2] / camera.K[0, 0], camera.K[1, 2] / camera.K[1, 1]),
    )
    ready = PreparedRun(
        seed=options.seed,
        plant=plant,
        parts=parts,
        loop=loop,
        restart=lambda: plant.reset(current=flow, X_WB=X_WB @ offset),
    )
    return ready, truth


def pictures(recording: Recording, truth: TrueInspection) -> Iterator[tuple[str, str, Figure]]:
    """Plan view of the hull's reference and true path around the object."""
    work = recording.within(WorkState.WORK)
    if not work.any():
        return
    figure = Figure(figsize=(7.0, 6.0), layout="constrained")
    axes = figure.subplots()
    vertices = transform_points(truth.X_WT, truth.target.vertices)
    axes.triplot(vertices[:, 0], vertices[:, 1], truth.target.triangles, lw=0.2, color="0.5")
    axes.plot(*recording["p_WB_reference"].value[work][:, :2].T, "--", lw=1.0, label="hull, asked")
    axes.plot(*recording["p_WB"].value[work][:, :2].T, lw=1.0, label="hull")
    axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    axes.legend(frameon=False, fontsize=9)
    yield "The way around", "The hull's way around the object, from above.", figure


def main() -> int:
    """Runs the flight and returns the exit code."""
    started = time.perf_counter()
    options = parse(Options)
    console = Console()
    folder = options.folder("inspect_object")
    ready, truth = prepare(options)
    judging = Evaluation(
        assess=lambda ran: assess_inspection(ran.recording, truth, seed=options.seed, wall_s=ran.wall_s),
        pictures=lambda ran: pictures(ran.recording, truth),
        begun=(WorkState.WORK,),
    )
    title = f"Inspection of the {options.object} from {options.distance:g} m, seed {options.seed}"
    return run_with_report("inspect_object", ready, judging, title, options, folder, console, started)


if __name__ == "__main__":
    run_scenario(main)
