"""Flow field: the water's velocity as a function of place and time, on top of a current that is uniform in space."""

import inspect
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, shown

if TYPE_CHECKING:
    import mujoco


@dataclass(frozen=True, kw_only=True)
class FlowField(ABC):
    """Velocity of the water by place and time, added to the current; its fields are keys of a scenario's `site.flow`.

    Any dataclass with a method `velocity` of these arguments counts as one: it need not inherit this class.

    The field is read at the origin of the hull, and acts on all bodies of the vehicle alike: it must change little over
    the vehicle's length. The pressure in it follows from its acceleration along the water's own path [Auton 1988].
    """

    @abstractmethod
    def velocity(self, p_W: Array, time: float) -> Array:
        """Velocity (3,) [m/s] of the water in world axes, what the current has elsewhere left out.

        Args:
            p_W: Place (3,) [m] in W; a copy.
            time: [s] since the start of the run.
        """

    def placed(self, model: "mujoco.MjModel") -> "FlowField":
        """The field in the compiled world `model`, as one that depends on its objects; here, the field itself."""
        del model
        return self

    @classmethod
    def __subclasshook__(cls, other: type) -> Any:
        """Any class with a method `velocity` is a flow field, as any class with `__iter__` is iterable."""
        if cls is not FlowField:
            return NotImplemented
        return True if callable(getattr(other, "velocity", None)) else NotImplemented


def checked_flow(flow: Any, what: str) -> FlowField:
    """`flow`, if it has a method `velocity(p_W, time)`.

    Args:
        flow: What a user handed in.
        what: Begins the error message, such as the key of a scenario.

    Raises:
        ConfigurationError: It has none, or one of other arguments, or it is a class.
    """
    if isinstance(flow, type):
        raise ConfigurationError(f"{what}: must be an instance, got the class {flow.__name__}")
    if not isinstance(flow, FlowField):
        raise ConfigurationError(f"{what}: needs a method velocity(p_W, time), got {shown(flow)}")
    signature = inspect.signature(flow.velocity)
    try:
        signature.bind(np.zeros(3), 0.0)
    except TypeError:
        name = type(flow).__name__
        raise ConfigurationError(f"{what}: {name}.velocity takes (p_W, time), this one {signature}") from None
    return flow


def placed_in(model: "mujoco.MjModel", flows: Sequence[FlowField]) -> tuple[FlowField, ...]:
    """The flow fields in a compiled world; one without `placed` depends on none of its objects."""
    placed = [flow.placed(model) if hasattr(flow, "placed") else flow for flow in flows]
    return tuple(checked_flow(flow, "flow") for flow in placed)


def total_velocity(flows: Sequence[FlowField], p_W: Array, time: float) -> Array:
    """Sum (3,) [m/s] of the velocities of flow fields at a place (3,) [m] and a time [s].

    Raises:
        ConfigurationError: One gives something else than three finite numbers.
    """
    total = np.zeros(3)
    for flow in flows:
        given: Any = flow.velocity(np.array(p_W), time)
        try:
            velocity = np.asarray(given, dtype=np.float64)
        except (TypeError, ValueError):
            velocity = np.full(1, np.nan)
        if velocity.shape != (3,) or not np.isfinite(velocity).all():
            place = ", ".join(f"{x:.3f}" for x in p_W)
            raise ConfigurationError(
                f"flow {type(flow).__name__}: velocity must be (3,) finite numbers [m/s], got {shown(given)} at "
                f"({place}) m, {time:.3f} s"
            )
        total += velocity
    return total
