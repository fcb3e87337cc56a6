"""Readings of a gripper's drive, as a part of the vehicle's state."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from uuv.sim.interfaces.messages import JawMeasurement, Measurement, StateEstimate
from uuv.sim.interfaces.protocols import Estimator


@dataclass(slots=True, eq=False)
class JawState:
    """State of `JawReadings`; `inner` is that of the wrapped estimator."""

    inner: Any
    jaws: JawMeasurement | None = None  # newest reading


@dataclass(frozen=True, slots=True)
class JawReadings:
    """Estimator wrapper that adds the newest reading of a gripper to the state estimate.

    Implements `uuv.sim.interfaces.protocols.Estimator`.
    """

    estimator: Estimator

    @property
    def period(self) -> float:
        """Sampling period [s] of the wrapped estimator."""
        return self.estimator.period

    def init(self, first: Sequence[Measurement]) -> JawState:
        """Initial state from the first measurements of every sensor."""
        return JawState(inner=self.estimator.init(first))

    def step(
        self, state: JawState, measurements: Sequence[Measurement]
    ) -> tuple[JawState, StateEstimate]:
        """Update the wrapped estimator; keep the newest reading among `measurements`."""
        state.inner, estimate = self.estimator.step(state.inner, measurements)
        for measurement in measurements:
            if isinstance(measurement, JawMeasurement):
                state.jaws = measurement
        return state, self.completed(state, estimate)

    def records(self, state: JawState) -> Any:
        """Arrays of the wrapped estimator, if it has a kernel."""
        inner: Any = self.estimator
        return inner.records(state.inner)

    def completed(self, state: JawState, estimate: StateEstimate) -> StateEstimate:
        """An estimate of the wrapped estimator with the newest reading."""
        return replace(estimate, jaws=state.jaws)
