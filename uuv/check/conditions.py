"""Conditions of a vehicle's check: number of object poses, and options of the jobs."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from uuv.models.water.battery import Battery
from uuv.sim.interfaces.spatial import whole_number
from uuv.sim.water.flow_field import FlowField

POSES = 20  # of the object, drawn for each job of the arm


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """Conditions under which jobs are checked; None and () keep the jobs' defaults."""

    poses: int = POSES
    seed: int = 0  # of the first pose; those of the others follow it
    forces: tuple[float, ...] = ()  # [N]
    speed: float | None = None  # [m/s] of the tool along its path
    current: tuple[float, float, float] | None = None  # [m/s] in world axes
    flow: FlowField | None = None  # on top of the current
    object: str | None = None  # of the job "object"
    battery: Battery | None = None  # of the thrusters; None: their voltage is constant

    def __post_init__(self) -> None:
        whole_number(self.poses, "poses", least=1)
        whole_number(self.seed, "seed")

    @property
    def options(self) -> Mapping[str, Any]:
        """The job options that are set, by option name."""
        stated = {
            "forces": self.forces or None,
            "speed": self.speed,
            "current": self.current,
            "object": self.object,
        }
        return {word: value for word, value in stated.items() if value is not None}
