"""Cases of random scenes: the depth frame, the coarse pose it is identified from, the result."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from math import radians
from time import process_time
from typing import Literal, TypeVar

from uuv.clouds.frames import ObjectScene
from uuv.clouds.object_scenes import RANGES, check_limits, object_scene
from uuv.clouds.scene_kinds import object_of
from uuv.experiment import Row
from uuv.perception.registration.identification import Identification, identify
from uuv.perception.registration.model_surface import ModelSurface
from uuv.sim.interfaces.spatial import Array

Start = Literal["coarse", "place", "any"]
Result = TypeVar("Result")


@dataclass(frozen=True, kw_only=True)
class SceneCase:
    """One scene for one sensor."""

    object: str
    """Name of the object."""
    sensor: str
    """Name of the sensor."""
    start: Start = "coarse"
    """Prior knowledge: position and attitude within --start-error (coarse), position only (place),
    or none (any).
    """
    start_error: tuple[float, float] = (0.3, 45.0)
    """Largest error of the coarse start [m], [deg]."""
    ranges: tuple[float, float] = RANGES
    """Distance from camera to object [m]."""
    gap: tuple[float, float] = (0.05, 0.4)
    """Distance from the object down to the seabed [m]; 0 0: it lies on it."""
    seed: int

    def __post_init__(self) -> None:
        check_limits(self.ranges, self._error)

    @property
    def _error(self) -> tuple[float, float]:
        """Largest error of the coarse start [m], [rad]."""
        return self.start_error[0], radians(self.start_error[1])

    def scene(self) -> ObjectScene:
        """The scene."""
        return object_scene(
            self.object,
            self.seed,
            self.sensor,
            ranges=self.ranges,
            start_error=self._error,
            gap=self.gap,
        )


@cache
def surface_of(name: str) -> ModelSurface:
    """Surface model of an object of `uuv.clouds.scene_kinds.NAMES`."""
    return ModelSurface.of(object_of(name))


def prior(scene: ObjectScene, start: Start = "coarse") -> tuple[Array | None, Array | None]:
    """What is known of a scene: position (3,) [m] of the object's centre and rotation (3, 3) of T,
    in C; None if not.
    """
    return (
        scene.approach if start != "any" else None,
        scene.orientation if start == "coarse" else None,
    )


def identified(
    scene: ObjectScene, surface: ModelSurface, start: Start = "coarse"
) -> Identification:
    """Identification of the object in a scene."""
    return identify(scene.scan, surface, *prior(scene, start), sensor=scene.sensor.model)


def timed(function: Callable[[], Result]) -> tuple[float, Result]:
    """Processor time [s] of a function, of all threads, and what it returns."""
    began = process_time()
    result = function()

    return process_time() - began, result


def conditions(rows: list[Row]) -> list[str]:
    """Lines about prior knowledge, range and height of the scenes."""
    words = {
        "coarse": "position within {0} m and attitude within {1:.0f} deg known",
        "place": "position within {0} m known, attitude unknown",
        "any": "position and attitude unknown",
    }

    lines = [
        f"{words[row['start']].format(*row['start_error'])}; camera {row['ranges'][0]:g} to "
        f"{row['ranges'][1]:g} m from the object, which is {row['gap'][0]:g} to "
        f"{row['gap'][1]:g} m above the seabed"
        for row in rows
    ]
    # one line where all rows share them
    return list(dict.fromkeys(lines))
