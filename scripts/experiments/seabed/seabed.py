"""Reconstruction of the seabed and choice of the working height, on random terrains.

Each terrain is scanned by a coarse 3D sonar under the hull (`uuv.sim.sensors.sonar`) from 2.5 m
above. Two targets are projected, the profile between them is cut, and the working height is chosen.
All is compared with the true terrain. A refusal is right where the exactly known ground is refused
as well; work is right where it is not.
"""

from uuv.start import run_scenario  # isort: skip

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import mujoco
import numpy as np
from scipy.spatial import cKDTree

from uuv.controllers.planning.path_poses import tool_poses
from uuv.controllers.planning.seabed_height import WorkHeight, arm_gap, choose_height
from uuv.controllers.planning.work_vehicle import WorkVehicle
from uuv.experiment import Page, Row, column, experiment, stat
from uuv.models.naming import CAMERA_SITE, TOOL_GEOM
from uuv.models.site.seabed import KINDS, Seabed, seabed
from uuv.own_vehicle import OwnVehicle, vehicle_spec
from uuv.perception.seabed.seabed_finder import points_in_world
from uuv.perception.seabed.terrain_path import SeabedPlan, plan_seabed_work
from uuv.sim.interfaces.errors import ConfigurationError, PerceptionError, ReachError
from uuv.sim.interfaces.messages import SonarScan, ToolPath
from uuv.sim.interfaces.spatial import Array, exp_so3, pose
from uuv.sim.interfaces.streams import Streams
from uuv.sim.sensors.sonar import Sonar, SonarBeams, SonarNoise
from uuv.tasks.seabed_sampling import (
    ABOVE,
    AHEAD,
    APART,
    LOOKS,
    height_search,
    sonar_beams,
    sonar_on_hull,
)

SWATH = sonar_beams().azimuth  # [rad] swath of the sonar, both ways
FINEST = 0.05  # [deg] least spacing of the beams: millions of them
STANDOFF = 0.1  # [m] from which the tool approaches the path


@dataclass(frozen=True, kw_only=True)
class TerrainCase:
    """One terrain, whose kind follows from its seed."""

    seed: int
    beam: float = 1.0
    """Spacing of the sonar's beams [deg]."""
    noise: float = 0.3
    """Standard deviation along the beam [% of the range]."""
    vehicle: str = "uuv_puma"
    """A name of uuv.models.available(), or an MJCF file with the named parts
    (docs/own_vehicle.md).
    """

    def __post_init__(self) -> None:
        if not FINEST <= self.beam <= np.degrees(SWATH):
            raise ConfigurationError(
                f"--beam: must be {FINEST:g} to {np.degrees(SWATH):g} deg, got {self.beam}"
            )
        if not 0.0 <= self.noise <= 100.0:
            raise ConfigurationError(f"--noise: must be 0 to 100 %, got {self.noise}")
        searched_with(self.vehicle)  # refuses a vehicle without the parts


@dataclass(frozen=True, kw_only=True)
class TerrainRow:
    """Errors of targets and profile in units of 1 cm + 0.5 % of the range, and the height or the
    refusal.
    """

    kind: str = column("seabed")
    points: int = column("echoes")
    refused: str = column("refused")
    truly_refused: str = column("refused on the exactly known ground")
    targets: Sequence[float] | None = column("targets' error", "of limit", digits=2, default=None)
    profile: Sequence[float] | None = column("profile's error", "of limit", digits=2, default=None)
    margin: float | None = column("margin", digits=2, default=None)
    aside: float | None = column("hull aside", "m", digits=2, default=None)
    hull_gap: float | None = column("hull to true ground", "m", digits=2, default=None)
    arm_gap: float | None = column("arm to true ground", "m", digits=2, default=None)


@cache
def searched_with(vehicle: str) -> WorkVehicle:
    """The vehicle as its planner knows it."""
    return OwnVehicle.of(vehicle_spec(vehicle), (CAMERA_SITE, TOOL_GEOM)).at_work()


@experiment("seabed", seeds=100, quick={"runs": 8})
def terrains(case: TerrainCase) -> TerrainRow:
    """Scans a terrain, plans the work on it, and compares both with the truth."""
    vehicle = searched_with(case.vehicle)
    streams = Streams(case.seed)

    # The terrain, the hull above it, and the targets.
    kind = KINDS[case.seed % len(KINDS)]
    center_W = (*streams["center"].uniform(-5.0, 5.0, 2), -20.0)
    ground = seabed(kind, streams["ground"], center_W=center_W, half=3.0)
    R_WB = exp_so3([0.0, 0.0, streams["heading"].uniform(-np.pi, np.pi)])
    X_WB = pose(R_WB, ground.center_W + ABOVE)
    B = X_WB[:3, 3] + np.array([[AHEAD, -0.5 * APART, 0.0], [AHEAD, 0.5 * APART, 0.0]]) @ R_WB.T

    # The work by the echoes, and by the exactly known ground.
    beam = np.radians(case.beam)
    cloud = echoes(
        ground, X_WB, vehicle.hull_box, streams["echoes"], beam=beam, noise=0.01 * case.noise
    )
    true = ground.mesh()[0]
    plan, work, refused = _work(cloud, vehicle=vehicle, X_WB=X_WB, B=B)
    figures: dict[str, Any] = {}
    if plan is not None and plan.profile is not None:
        figures["targets"] = _errors(plan.targets.A, ground, X_WB).tolist()
        figures["profile"] = _errors(plan.profile.T, ground, X_WB).tolist()
    if work is not None and plan is not None and plan.path is not None:
        figures |= _gaps(vehicle, plan.path, work, true)
    return TerrainRow(
        kind=kind,
        points=len(cloud),
        refused=refused,
        truly_refused=_work(true, vehicle=vehicle, X_WB=X_WB, B=B)[2],
        **figures,
    )


def echoes(
    ground: Seabed, X_WB: Array, box: Array, rng: np.random.Generator, *, beam: float, noise: float
) -> Array:
    """Echoes of LOOKS pings of the sonar under the hull.

    Args:
        ground: True terrain.
        X_WB: (4, 4) pose of the hull.
        box: (2, 3) [m] corners of the hull's box in B.
        rng: Draws the noise.
        beam: [rad] spacing of the beams.
        noise: Standard deviation along the beam, share of the range.

    Returns:
        (N, 3) [m] in W.
    """
    # the terrain alone
    spec = mujoco.MjSpec()
    ground.add_to(spec)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)

    # the sonar above it
    X_BS = sonar_on_hull(box)
    count = 1 + round(SWATH / beam)
    sonar = Sonar(
        model,
        "world",
        X_WB @ X_BS,
        noise=SonarNoise(range_share=noise),
        beams=SonarBeams(rows=count, columns=count, elevation=SWATH, azimuth=SWATH),
    )

    pings = [SonarScan(time=0.0, points=sonar.ping(data, rng), X_BS=X_BS) for _ in range(LOOKS)]
    return np.concatenate([points_in_world(X_WB, ping) for ping in pings])


def _work(
    cloud: Array, *, vehicle: WorkVehicle, X_WB: Array, B: Array
) -> tuple[SeabedPlan | None, WorkHeight | None, str]:
    """Plan and working height on a cloud (N, 3) [m], None from a failed stage on; and the reason of
    the failure.
    """
    try:
        plan = plan_seabed_work(cloud, B)
    except PerceptionError as error:
        return None, None, str(error)

    assert plan.path is not None
    try:
        height = choose_height(
            vehicle,
            plan.path,
            ground=plan.terrain.vertices,
            X_WB=X_WB,
            force=60.0,
            standoff=STANDOFF,
            search=height_search(vehicle.hull_box, drag=True),
        )
    except ReachError as error:
        return plan, None, str(error)
    return plan, height, ""


def _errors(points: Array, ground: Seabed, X_WB: Array) -> Array:
    """Vertical error of points (N, 3) in units of the limit, 1 cm + 0.5 % of their range."""
    reach = np.linalg.norm(points - X_WB[:3, 3], axis=1)
    return np.abs(points[:, 2] - ground.height(points)) / (0.01 + 0.005 * reach)


def _gaps(vehicle: WorkVehicle, path: ToolPath, work: WorkHeight, true: Array) -> dict[str, float]:
    """Margin of the working height, and the gaps to the true ground (N, 3) [m] in W there."""
    at = work.placement
    box = vehicle.hull_box
    p_B = (true - at.X_WB[:3, 3]) @ at.X_WB[:3, :3]
    outside = np.maximum(0.0, np.maximum(box[0] - p_B, p_B - box[1]))

    tools = tool_poses(path, np.linspace(0.0, path.s[-1], 30), at.roll, STANDOFF)
    X_WA = at.X_WB @ vehicle.vehicle.X_BA
    return {
        "margin": at.margin,
        "aside": work.aside,
        "hull_gap": float(np.linalg.norm(outside, axis=1).min()),
        "arm_gap": arm_gap(vehicle.chain, X_WA, tools, at.q_start, cKDTree(true)),
    }


def within(name: str) -> Callable[[Mapping[str, Any]], list[bool] | None]:
    """Which errors of a column are within the limit."""
    return lambda row: row[name] and [error <= 1.0 for error in row[name]]


def wrong(row: Mapping[str, Any]) -> bool:
    """Whether a refusal is wrong, or the work."""
    return bool(row["refused"]) != bool(row["truly_refused"])


def refusals(rows: list[Row]) -> list[str]:
    """A line about each terrain that was refused, or should have been."""
    return [
        f"{row['kind']} {row['seed']}: {row['refused'] or 'worked'} | truly: "
        f"{row['truly_refused'] or 'would do'}"
        for row in rows
        if row["refused"] or row["truly_refused"]
    ]


terrains.page = (
    Page()
    .table(
        "Reconstruction of the seabed and choice of the working height",
        by="kind",
        columns=[
            stat("count", "kind", "terrains"),
            stat("share", within("targets"), "targets within the limit"),
            stat("share", within("profile"), "profile within the limit"),
            stat("p95", "profile"),
            stat("count", lambda row: row["margin"] is not None, "worked"),
            stat("least", "margin"),
            stat("least", "hull_gap"),
            stat("least", "arm_gap"),
            stat("count", wrong, "wrong"),
        ],
        total=True,
    )
    .add(refusals)
)

if __name__ == "__main__":
    run_scenario(terrains.main)
