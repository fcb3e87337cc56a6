"""The shapes of pluggable parts. Each has explicit state, so a run can be replayed and shared.

`period` [s] is a whole multiple of the plant's step; `sim.loop.rollout` checks it and calls `step` at that rate.
"""

from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np

from sim.interfaces.messages import Command, Measurement, Reference, StateEstimate, Target


@runtime_checkable
class Sensor(Protocol):
    """Truth in, one measurement out, or None where no message comes.

    `truth` is `sim.plant.plant.Truth`; only `sim` may look into it.
    """

    @property
    def period(self) -> float: ...  # [s]; 0 means on request (`Command.scan`)

    @property
    def delay(self) -> float: ...  # [s] between the moment measured and the moment delivered

    def init(self, rng: np.random.Generator) -> Any: ...

    def step(self, state: Any, truth: Any) -> tuple[Any, Measurement | None]: ...


@runtime_checkable
class Estimator(Protocol):
    """Measurements in, the vehicle's own state out."""

    @property
    def period(self) -> float: ...  # [s]

    def init(self, first: Sequence[Measurement]) -> Any: ...

    def step(self, state: Any, measurements: Sequence[Measurement]) -> tuple[Any, StateEstimate]: ...


@runtime_checkable
class TargetFinder(Protocol):
    """Depth frames in, the target and its tool path out, or None where more are wanted first. Called once per frame."""

    def init(self) -> Any: ...

    def step(self, state: Any, estimate: StateEstimate, measurement: Measurement) -> tuple[Any, Target | None]: ...


@runtime_checkable
class Planner(Protocol):
    """Estimates in, references out: the supervisor of the work."""

    @property
    def period(self) -> float: ...  # [s]

    def init(self, estimate: StateEstimate) -> Any: ...

    def step(
        self, state: Any, estimate: StateEstimate, target: Target | None, last: Command | None
    ) -> tuple[Any, Reference]: ...


@runtime_checkable
class Controller(Protocol):
    """Estimates and references in, commands out."""

    @property
    def period(self) -> float: ...  # [s]

    def init(self, estimate: StateEstimate) -> Any: ...

    def step(self, state: Any, estimate: StateEstimate, reference: Reference) -> tuple[Any, Command]: ...
