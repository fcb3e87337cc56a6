"""Controller as the outermost slot of a tick, called by its address, be it a kernel or Python code.

A controller with a kernel has `tick_on(state, inputs)`, which returns its `ControlTick`. A
controller without one is called through `PythonControl`. Both write their command into the arrays
of `Commanded`.
"""

from collections.abc import Callable
from dataclasses import fields
from typing import Any, Generic, NamedTuple, Protocol, TypeGuard, TypeVar

import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.kernels import slots
from uuv.sim.interfaces.kernels.record_box import new_box
from uuv.sim.interfaces.kernels.slots import FINE, PythonSlots, address_of_box, call_at
from uuv.sim.interfaces.kernels.stored import kernel
from uuv.sim.interfaces.messages import Command, Reference, StateEstimate
from uuv.sim.interfaces.records import (
    EstimateRecord,
    ReferenceRecord,
    reference_record,
    state_estimate,
    take_estimate,
    take_reference,
)
from uuv.sim.interfaces.spatial import Array

# Answers of a controller's tick, besides those of every slot
UNSOUND = 3  # nothing was done, because the estimate is not finite or too old
BROKEN = 4  # done, but the command is not finite
STOPPED = 5  # done; Python continues this tick, because a frame is requested or a fault was found
NO_POSE = 6  # nothing was commanded, because the tool's target is not a valid pose
REFUSED = 7  # done, but the command's shape does not fit the vehicle; the plant reports it

Made = TypeVar("Made")
Complete = Callable[[StateEstimate], StateEstimate]


class Commanded(NamedTuple):
    """Command of a controller and its estimated contact force, as arrays that are changed in
    place.
    """

    tau: Array  # (n,) [N m] of the motors
    thrusters: Array  # (m,) normalised
    f_W: Array  # (3,) [N] force of the world on the tip, W
    felt: Array  # (1,) [N] normal force
    sigma_G: Array  # (3,) [N] standard deviation of the force, in tool axes; inf if it is unknown
    arm_wrench_B: Array  # (6,) [N, N m] of `HullLoad`; NaN if it is not reported
    current_W: Array  # (3,) [m/s] of `HullLoad`
    hull_steps: np.ndarray  # (1,) steps of the hull so far


def commanded(joints: int, thrusters: int) -> Commanded:
    """`Commanded` before the first tick: no command and no force."""
    return Commanded(
        tau=np.zeros(joints),
        thrusters=np.zeros(thrusters),
        f_W=np.full(3, np.nan),
        felt=np.full(1, np.nan),
        sigma_G=np.full(3, np.inf),
        arm_wrench_B=np.full(6, np.nan),
        current_W=np.zeros(3),
        hull_steps=np.zeros(1, dtype=np.int64),
    )


@kernel
def estimate_box(record):
    """`RecordBox` of an `EstimateRecord`."""
    return new_box(record)


@kernel
def call_control(address, memory, estimate):
    """Call a controller's `ControlTick` at `address` with the address of an `estimate_box`."""
    return call_at(address, memory, estimate)


class Inputs:
    """Inputs of a controller's ticks, and the messages made of them for parts in Python."""

    def __init__(self, record: EstimateRecord, complete: Complete | None = None) -> None:
        """Take the record of the estimates, and a function that completes a message made of it."""
        self.record = record
        self._complete = complete
        self.box = estimate_box(record)
        self.address: int = address_of_box(self.box)
        # The message that `record` was made from, or that was made from it.
        self.message: StateEstimate | None = None
        self._reference: Reference | None = None
        # Set points of a table, while a table is in use.
        self.ahead: Callable[[], Reference | None] | None = None

    @property
    def reference(self) -> Reference:
        """Set points of the present ticks."""
        reference = None if self.ahead is None else self.ahead()
        reference = reference or self._reference
        assert reference is not None
        return reference

    @reference.setter
    def reference(self, reference: Reference) -> None:
        """Set points of the ticks that follow."""
        self._reference = reference

    def take(self, estimate: StateEstimate) -> None:
        """Write a message into the record."""
        self.message = estimate
        take_estimate(self.record, estimate)

    def seen(self) -> StateEstimate:
        """Estimate of the present tick."""
        if self.message is None or self.message.time != self.record.time[0]:
            self.message = self.message_of(self.record)
        return self.message

    def message_of(self, record: EstimateRecord) -> StateEstimate:
        """Estimate as a message for the planner."""
        estimate = state_estimate(record)
        return estimate if self._complete is None else self._complete(estimate)


class Unsaved(Generic[Made]):
    """Data that a state keeps besides its arrays, made on first use; a copy of the state makes its
    own.
    """

    def __init__(self) -> None:
        self._content: Made | None = None

    def get(self, make: Callable[[], Made]) -> Made:
        """The content, which `make` creates at the first call."""
        if self._content is None:
            self._content = make()
        return self._content

    def __reduce__(self) -> tuple[Any, tuple[()]]:
        return Unsaved, ()


class BoundFields:
    """Fields of states whose arrays a tick is bound to: they may be written into, but not
    replaced.
    """

    def __init__(self, *states: Any) -> None:
        """Take the fields of dataclasses that are arrays or records of arrays."""
        self._bound = [
            (state, item.name, value)
            for state in states
            for item in fields(state)
            if isinstance(value := getattr(state, item.name), np.ndarray)
            or hasattr(value, "_fields")
        ]

    def check(self) -> None:
        """Raise if one of these arrays was replaced by another array.

        Raises:
            ConfigurationError: a field was assigned after the first step.
        """
        for state, name, value in self._bound:
            if getattr(state, name) is not value:
                raise ConfigurationError(
                    f"{type(state).__name__}.{name}: must not be replaced after the first step, "
                    f"which has bound its arrays; write into the array instead: state.{name}[...] "
                    "= ..."
                )


class ControlTick(Protocol):
    """Tick of a controller, bound to the arrays that it works on, for one run."""

    address: int  # address of its kernel or trampoline
    memory: int  # address of the memory that the kernel works on
    command: Commanded
    reference: ReferenceRecord  # set points that the tick follows
    slots: PythonSlots
    slow: tuple[str, ...]  # parts of the controller in plain Python that are called at every tick

    def refer(self, reference: Reference) -> None:
        """Take the set points of the ticks that follow."""
        ...

    def ready(self, reference: Reference) -> bool:
        """False if `Controller.step` has to make the next tick."""
        ...

    def done(self, estimate: StateEstimate, reference: Reference, answer: int) -> Command:
        """Command of the last tick, which returned `answer`; the state is the same as after
        `step`.
        """
        ...


class HasTick(Protocol):
    """Controller with a kernel."""

    def tick_on(self, state: Any, inputs: Inputs) -> ControlTick | None:
        """The tick of this controller on the arrays of `state`; None if it is not ready yet."""
        ...


def has_tick(controller: object) -> TypeGuard[HasTick]:
    """True if `controller` provides its tick as a kernel (`gives_kernel`)."""
    return slots.gives_kernel(controller, "tick_on")


# step function of a controller, which keeps the controller's state
Step = Callable[[StateEstimate, Reference], Command]


class PythonControl:
    """Tick of a controller in plain Python (`ControlTick`)."""

    memory = 0

    def __init__(self, step: Step, inputs: Inputs, command: Commanded, name: str) -> None:
        """Make a trampoline.

        Args:
            step: Step function of the controller.
            inputs: Inputs of the controller.
            command: Arrays that the command is written into.
            name: Name of the controller.
        """
        self._step = step
        self._inputs = inputs

        # Fields of `ControlTick`.
        self.command = command
        self.reference = reference_record(len(command.tau))
        self.slots = PythonSlots()
        self.slow = (name,)
        self.address = self.slots.add(self._called)

        # The last command, as a message.
        self.last: Command | None = None

    def refer(self, reference: Reference) -> None:
        """Take the set points of the ticks that follow."""
        self._inputs.reference = reference
        take_reference(self.reference, reference)

    def ready(self, reference: Reference) -> bool:
        """True: Python code can be called at every tick."""
        del reference
        return True

    def done(self, estimate: StateEstimate, reference: Reference, answer: int) -> Command:
        """The command of the last tick."""
        del estimate, reference, answer
        assert self.last is not None
        return self.last

    def load(self, command: Command) -> bool:
        """Copy a command into the arrays; False if its shape does not fit the vehicle."""
        out = self.command
        before = None if self.last is None else self.last.hull_load
        load = command.hull_load
        if load is None or load is not before:
            out.hull_steps[0] += 1
        out.arm_wrench_B[:] = np.nan if load is None else load.arm_wrench_B
        out.current_W[:] = 0.0 if load is None else load.current_W
        self.last = command

        # The plant refuses a command of another shape.
        if np.shape(command.joint_torque) != out.tau.shape:
            return False
        if np.shape(command.thrusters) != out.thrusters.shape:
            return False

        out.tau[:] = command.joint_torque
        out.thrusters[:] = command.thrusters
        out.f_W[:] = command.contact.force_W
        out.felt[0] = command.contact.normal
        out.sigma_G[:] = command.contact.sigma_G
        return True

    def _called(self) -> int:
        command = self._step(self._inputs.seen(), self._inputs.reference)
        if not self.load(command):
            return REFUSED
        return STOPPED if command.scan else FINE
