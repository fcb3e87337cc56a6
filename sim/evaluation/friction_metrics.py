"""Metrics of a friction identification, as metrics.json holds them."""

from dataclasses import dataclass
from typing import Any

from uuv.sim.evaluation.run_metrics import run_schema
from uuv.sim.evaluation.schemas import metric


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionParameter:
    """One parameter of a joint's friction."""

    believed: float = metric("Value in the controller's model.")
    identified: float
    sigma: float | None = metric(
        "Standard deviation; null if the motion does not determine the parameter.", minimum=0
    )
    true: float


@dataclass(frozen=True, slots=True, kw_only=True)
class JointFriction:
    """Identified friction of one joint."""

    name: str
    sensor_bias_nm: float = metric("Identified bias of the torque sensor.")
    residual_nm: float | None = metric("Standard deviation of the residual.", minimum=0)
    coulomb: FrictionParameter
    stiction: FrictionParameter
    viscous: FrictionParameter
    stribeck_speed: FrictionParameter


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionMetrics:
    """Errors of the worst joint, and the parameters of all."""

    coulomb_error: float | None = metric(
        "Error of the worst joint as a share of the true value, or of 4 % of the torque limit if "
        "its gear has no such friction.",
        minimum=0,
    )
    stiction_error: float | None = metric("The same for stiction.", minimum=0)
    viscous_error: float | None = metric("The same, at the joint's highest speed.", minimum=0)
    error_sigmas: float | None = metric(
        "Largest ratio of one of these errors to its standard deviation.", minimum=0
    )
    joints: list[JointFriction]


@dataclass(frozen=True, slots=True, kw_only=True)
class FrictionRunMetrics:
    """Metrics of a friction identification."""

    friction: FrictionMetrics


def schema() -> dict[str, Any]:
    """JSON Schema of the metrics.json of a friction identification."""
    about = "What uuv identify friction writes to metrics.json"
    return run_schema(FrictionRunMetrics, "Figures of a friction identification", about)
