"""What a vehicle is checked under: how many poses of the object, and options of the jobs."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from uuv.models.water.battery import Battery
from uuv.sim.interfaces.spatial import whole_number
from uuv.sim.water.flow_field import FlowField

POSES = 20  # of the object, drawn for each job of the arm


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """What jobs are checked under; None and () leave what the jobs have."""

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
        """Options of a job by their words, where they are set."""
        stated = {
            "forces": self.forces or None,
            "speed": self.speed,
            "current": self.current,
            "object": self.object,
        }
        return {word: value for word, value in stated.items() if value is not None}
