"""Protocols of the exchangeable components. Their state is explicit, so that a run can be saved and
repeated.

`period` [s] is a whole multiple of the plant's step; `uuv.sim.loop.rollout` checks it and calls
`step` at that rate.
"""

from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np

from uuv.sim.interfaces.messages import (
    Command,
    Measurement,
    ObjectMotion,
    Reference,
    StateEstimate,
    Target,
)


@runtime_checkable
class Sensor(Protocol):
    """Simulated sensor: maps the true state to one measurement, or to None if no message is sent.

    `truth` is `uuv.sim.plant.truth.Truth`; only `sim` may read it.
    """

    @property
    def period(self) -> float:
        """Time between measurements [s]; 0 means on request (`Command.scan`)."""
        ...

    @property
    def delay(self) -> float:
        """Time between measurement and delivery [s]."""
        ...

    def init(self, rng: np.random.Generator) -> Any:
        """Initial state of the sensor, with its random stream."""
        ...

    def step(self, state: Any, truth: Any) -> tuple[Any, Measurement | None]:
        """Next state and measurement at `truth`; None if the sensor gives no message."""
        ...


@runtime_checkable
class Estimator(Protocol):
    """State estimator: maps measurements to an estimate of the vehicle's own state."""

    @property
    def period(self) -> float:
        """Time between estimates [s]."""
        ...

    def init(self, first: Sequence[Measurement]) -> Any:
        """Initial state from the first measurements."""
        ...

    def step(self, state: Any, measurements: Sequence[Measurement]) -> tuple[Any, StateEstimate]:
        """Next state and estimate from the measurements that arrived since the last step."""
        ...


@runtime_checkable
class TargetFinder(Protocol):
    """Target identification: maps depth frames, one for each call, to a target and its tool
    path.
    """

    def init(self) -> Any:
        """Initial state, before any frame."""
        ...

    def step(
        self, state: Any, estimate: StateEstimate, measurement: Measurement
    ) -> tuple[Any, Target | None]:
        """Process one frame.

        Args:
            state: State after the last frame.
            estimate: Vehicle state at the time of the frame.
            measurement: Depth frame or sonar scan.

        Returns:
            Next state, and the target; None if more frames are needed first.
        """
        ...


@runtime_checkable
class TargetFollower(Protocol):
    """Tracker of an identified target: maps depth frames to the target's motion during the scan."""

    @property
    def period(self) -> float:
        """Time between frames [s]."""
        ...

    def init(self) -> Any:
        """Initial state, before any target was identified."""
        ...

    def step(
        self, state: Any, estimate: StateEstimate, target: Target, measurement: Measurement
    ) -> tuple[Any, ObjectMotion | None]:
        """Process one frame.

        Args:
            state: State after the last frame.
            estimate: Vehicle state at the time of the frame.
            target: Last accepted target of the finder.
            measurement: Depth frame or sonar scan.

        Returns:
            Next state, and the motion; None as long as the motion is unknown.
        """
        ...


@runtime_checkable
class Planner(Protocol):
    """Task supervisor: maps estimates to set points."""

    @property
    def period(self) -> float:
        """Time between set points [s]."""
        ...

    def init(self, estimate: StateEstimate) -> Any:
        """Initial state from the first estimate."""
        ...

    def step(
        self, state: Any, estimate: StateEstimate, target: Target | None, last: Command | None
    ) -> tuple[Any, Reference]:
        """Compute the next set points.

        Args:
            state: State after the last step.
            estimate: Estimated vehicle state.
            target: Newest target, or None.
            last: Newest command of the controller, or None.

        Returns:
            Next state and set points.
        """
        ...


@runtime_checkable
class Controller(Protocol):
    """Controller: maps estimates and set points to commands."""

    @property
    def period(self) -> float:
        """Time between commands [s]."""
        ...

    def init(self, estimate: StateEstimate) -> Any:
        """Initial state from the first estimate."""
        ...

    def step(
        self, state: Any, estimate: StateEstimate, reference: Reference
    ) -> tuple[Any, Command]:
        """Compute the next command.

        Args:
            state: State after the last step.
            estimate: Estimated vehicle state.
            reference: Set points of the planner.

        Returns:
            Next state and command.
        """
        ...
