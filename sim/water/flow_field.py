"""Flow field: velocity of the water as a function of position and time, added to a uniform
current.
"""

import inspect
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, shown

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True, kw_only=True)
class FlowField(ABC):
    """Velocity of the water as a function of position and time, added to the current.

    The fields of a flow field are keys of a scenario, under `site.flow`. Any dataclass with a
    method `velocity` of these arguments counts as a flow field, without inheriting this class.

    The field is evaluated at the origin of the hull, and acts on all bodies of the vehicle equally,
    so it must change little over the vehicle's length. The force of its pressure gradient follows
    from the acceleration along the path of the water [Auton 1988].
    """

    needs: ClassVar[str] = "has a method velocity(p_W, time)"  # for messages

    @abstractmethod
    def velocity(self, p_W: Array, time: float) -> Array:
        """Velocity (3,) [m/s] of the water in world axes, without the uniform current.

        Args:
            p_W: Position (3,) [m] in W; a copy.
            time: [s] since the start of the run.
        """

    def placed(self, model: "mujoco.MjModel") -> "FlowField":
        """The field for the compiled world `model`, for fields that depend on an object; by default
        the same field.
        """
        del model
        return self

    @classmethod
    def __subclasshook__(cls, other: type) -> Any:
        """Any class with a method `velocity` is a subclass, just as any class with `__iter__` is
        iterable.
        """
        if cls is not FlowField:
            return NotImplemented
        return True if callable(getattr(other, "velocity", None)) else NotImplemented


def checked_flow(flow: Any, what: str) -> FlowField:
    """Return `flow` if it has a method `velocity(p_W, time)`.

    Args:
        flow: Flow field of a user.
        what: Begins the error message, such as the key of a scenario.

    Raises:
        ConfigurationError: `flow` has no such method, a method with other arguments, or it is a
            class.
    """
    # Objects that are not flow fields at all.
    if isinstance(flow, type):
        raise ConfigurationError(f"{what}: must be an instance, got the class {flow.__name__}")
    if not isinstance(flow, FlowField):
        raise ConfigurationError(f"{what}: needs a method velocity(p_W, time), got {shown(flow)}")

    # A method with other arguments would fail in the first step.
    signature = inspect.signature(flow.velocity)
    try:
        signature.bind(np.zeros(3), 0.0)
    except TypeError:
        name = f"{type(flow).__name__}.velocity"
        message = f"{what}: {name} must take (p_W, time), this method takes {signature}"
        raise ConfigurationError(message) from None
    return flow


def placed_in(model: "mujoco.MjModel", flows: Sequence[FlowField]) -> tuple[FlowField, ...]:
    """The flow fields for a compiled world; a field without `placed` does not depend on its
    objects.
    """
    placed = [flow.placed(model) if hasattr(flow, "placed") else flow for flow in flows]
    return tuple(checked_flow(flow, "flow") for flow in placed)


def total_velocity(flows: Sequence[FlowField], p_W: Array, time: float) -> Array:
    """Sum (3,) [m/s] of the velocities of flow fields at a position (3,) [m] and a time [s].

    Raises:
        ConfigurationError: A field does not return three finite numbers.
    """
    total = np.zeros(3)
    for flow in flows:
        answer: Any = flow.velocity(np.array(p_W), time)
        try:
            velocity = np.asarray(answer, dtype=np.float64)
        except (TypeError, ValueError):
            velocity = np.full(1, np.nan)

        # One error line now, instead of a motion that diverges.
        if velocity.shape != (3,) or not np.isfinite(velocity).all():
            position = ", ".join(f"{x:.3f}" for x in p_W)
            raise ConfigurationError(
                f"flow {type(flow).__name__}: velocity must be (3,) finite numbers [m/s], "
                f"got {shown(answer)} at ({position}) m, {time:.3f} s"
            )
        total += velocity
    return total
