"""How far away an object is identified, against the stated 0.3 to 10 m and 1 % of the range.

Scenes are those of `uuv.clouds.object_scenes` with a stereo camera at a set range, in water of a
set attenuation a. The error of the pose stands beside the standard deviation of the object's mean
depth by stereo noise alone: that of a reading, z^2 sigma_d exp(a r) / (f b), over the root of the
number of independent readings on the object.

Accepted: no frame is accepted whose error is above 1 % of its range; without an accepted frame
there is nothing to judge.
"""

from uuv.start import run_scenario  # isort: skip

from dataclasses import dataclass

import numpy as np

from uuv.clouds.frames import FOCAL, MIDDLE, Camera, ObjectScene
from uuv.clouds.object_scenes import object_scene
from uuv.experiment import Page, column, experiment, stat
from uuv.perception.registration.identification import identify
from uuv.sim.interfaces.spatial import finite_number, inverse, transform_points
from uuv.sim.sensors.stereo_noise import StereoNoise

RANGES = (0.3, 0.5, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0)  # [m]
OBJECTS = ("starfish", "barrel", "manifold")
_EDGE = 2e-3  # [m] beyond the object's box that still counts as on it
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
    """Error of the pose, and what of it the sensor's noise alone would cause."""

    position: float = column("error", "mm", factor=1e3)
    over_range: float = column("error over range", "%", factor=100.0)
    noise: float = column("deviation of the mean depth", "%", factor=100.0)
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
        noise=depth_deviation(scene, camera) / case.range,
        identified=scene.is_found(outcome.X_sensor_target),
        accepted=outcome.accepted,
        reason=outcome.reason,
    )


def depth_deviation(scene: ObjectScene, camera: Camera) -> float:
    """Standard deviation [m] of the mean depth of the readings on the object; inf: no reading."""
    assert camera.stereo is not None

    # Where the object is seen, by the image without noise.
    depth = camera.exact(scene.model)
    v, u = np.nonzero(np.isfinite(depth))
    z = depth[v, u]
    rays = np.column_stack([(np.column_stack([u, v]) - MIDDLE) / FOCAL, np.ones(len(z))])
    points = z[:, None] * rays
    p_T = transform_points(inverse(scene.X_CT), points)
    vertices = scene.target.vertices
    on_it = ((p_T > vertices.min(axis=0) - _EDGE) & (p_T < vertices.max(axis=0) + _EDGE)).all(
        axis=1
    )

    # Of these, the readings that the camera gave.
    on_it &= np.isfinite(scene.scan.points[v, u]).all(axis=1)
    count = int(on_it.sum())
    if count == 0:
        return float("inf")

    # The error of a match grows as the contrast falls [Duntley 1963].
    lost = np.exp(camera.stereo.attenuation * np.linalg.norm(points[on_it], axis=1))
    sigma = float(np.sqrt(np.mean((camera.model.sigma(z[on_it]) * lost) ** 2)))
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
            stat("median", "noise", "deviation of the mean depth, median"),
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
