"""How far away an object is identified, against the stated 0.3 to 10 m and 1 % of the range.

Scenes are those of `uuv.clouds.object_scenes` with a stereo camera at a set range, in water of a
set attenuation. The bound of stereo noise is that of the object's mean depth: the noise of a
reading, z^2 sigma_d / (f b), over the root of the number of independent readings on the object.
Along the line of sight no method does better with one frame on the average.

Accepted: no frame is accepted whose error is above 1 % of its range.
"""

from uuv.start import run_scenario  # isort: skip

from dataclasses import dataclass

import numpy as np

from uuv.clouds.frames import Camera, ObjectScene
from uuv.clouds.object_scenes import object_scene
from uuv.experiment import Page, column, experiment, stat
from uuv.perception.registration.identification import identify
from uuv.sim.interfaces.spatial import finite_number, transform_points
from uuv.sim.sensors.stereo_noise import StereoNoise

RANGES = (0.3, 0.5, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0)  # [m]
OBJECTS = ("starfish", "barrel", "manifold")
STATED = 0.01  # [-] error over range [Konoplin 2022, results]


@dataclass(frozen=True, kw_only=True)
class RangeCase:
    """One frame of an object at a range."""

    object: str
    """Object of the scene."""
    range: float
    """Range of the camera [m]."""
    attenuation: float = 0.15
    """Attenuation of a beam of light [1/m]; 0.15 is clear ocean, 0.4 coast."""
    seed: int = 0
    """Seed of the scene."""

    def __post_init__(self) -> None:
        finite_number(self.range, "--range [m]", above=0.0)
        finite_number(self.attenuation, "--attenuation [1/m]", least=0.0)


@dataclass(frozen=True, kw_only=True)
class RangeRow:
    """Error of the pose, and the bound of the sensor's noise."""

    position: float = column("error", "mm", factor=1e3)
    over_range: float = column("error over range", "%", factor=100.0)
    bound: float = column("bound of stereo noise", "%", factor=100.0)
    identified: bool = column("found")
    accepted: bool = column("accepted")
    reason: str = column("reason")


@experiment(
    "range_map",
    seeds=3,
    vary={"object": OBJECTS, "range": RANGES},
    paired=True,
    quick={"object": ("starfish",), "range": (1.0, 5.0), "runs": 1},
)
def range_map(case: RangeCase) -> RangeRow:
    """Identifies the object at the range."""
    camera = Camera(stereo=StereoNoise(attenuation=case.attenuation))
    scene = object_scene(case.object, case.seed, camera, ranges=(case.range, case.range))
    outcome = identify(
        scene.scan,
        scene.target,
        scene.approach,
        scene.orientation,
        sensor=camera.model,
        seed=case.seed,
    )

    position, _ = scene.error(outcome.X_sensor_target)
    return RangeRow(
        position=position,
        over_range=position / case.range,
        bound=noise_bound(scene, camera) / case.range,
        identified=scene.is_found(outcome.X_sensor_target),
        accepted=outcome.accepted,
        reason=outcome.reason,
    )


def noise_bound(scene: ObjectScene, camera: Camera) -> float:
    """Standard deviation [m] of the mean depth of the readings on the object; inf: no reading."""
    center = transform_points(scene.X_CT, scene.target.center)
    points = scene.scan.points.reshape(-1, 3)
    near = np.linalg.norm(points - center, axis=1) < scene.target.radius
    count = int(near.sum())  # readings that are not NaN
    if count == 0:
        return float("inf")

    sigma = float(np.sqrt(np.mean(camera.model.sigma(points[near, 2]) ** 2)))
    independent = max(1.0, count / camera.model.noise_length**2)
    return sigma / float(np.sqrt(independent))


range_map.page = (
    Page()
    .table(
        "Error over range by range",
        by="range",
        columns=[
            stat("share", "identified", "found"),
            stat("share", "accepted", "accepted"),
            stat("median", "over_range", "error over range, median"),
            stat("largest", "over_range", "error over range, largest"),
            stat("median", "bound", "bound of stereo noise, median"),
        ],
    )
    .table(
        "Frames accepted",
        by="range",
        across="object",
        columns=[stat("count", "accepted", "accepted")],
    )
    .accept(
        stat("largest", "over_range", "error over range of accepted frames"),
        most=STATED,
        where=lambda row: row["accepted"],
    )
)

if __name__ == "__main__":
    run_scenario(range_map.main)
