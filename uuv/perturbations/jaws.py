"""Perturbation of a gripper: jaws that are stuck, or a motor without force."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

from uuv.models.tools.gripper import MOTOR
from uuv.perturbations.loop import Failure
from uuv.perturbations.perturbation import Loop
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import shown

if TYPE_CHECKING:
    import mujoco

EFFECTS = ("stuck", "dead")


@dataclass(frozen=True, kw_only=True)
class JawFailure(Failure):
    """Fault of a gripper: its jaws are stuck where they are, or its motor gives no force.

    The readings of the drive stay true.
    """

    effect: Literal["stuck", "dead"] = "stuck"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.effect not in EFFECTS:
            raise ConfigurationError(
                f"JawFailure effect: allowed {', '.join(EFFECTS)}, got {shown(self.effect)}"
            )

    def check_inputs(self, spec: "mujoco.MjSpec") -> None:
        """Refuse a vehicle without a gripper."""
        if spec.actuator(MOTOR) is None:
            raise ConfigurationError("JawFailure: the vehicle has no gripper")

    def on_loop(self, loop: Loop) -> Loop:
        """Wrap the drive of the jaws."""
        from uuv.sim.plant.jaw_drive import FaultyJaws

        onset = self.onset()
        sound: Any = loop.plant
        while not hasattr(sound, "jaws"):
            sound = sound.plant
        sound.jaws = FaultyJaws(sound.jaws, onset, stuck=self.effect == "stuck")
        return replace(loop, observers=(*loop.observers, *self._observers(onset)))
