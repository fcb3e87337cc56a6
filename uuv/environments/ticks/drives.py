"""Commands to the vehicle within an action, in the form in which a kernel calls them."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from uuv.environments.true_state import Seeing
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.kernels.control import Commanded, estimate_box
from uuv.sim.interfaces.kernels.record_box import as_annotated, new_box
from uuv.sim.interfaces.kernels.slots import FINE, PythonSlots, address_of_box, address_of_kernel
from uuv.sim.interfaces.messages import Command
from uuv.sim.interfaces.records import ReferenceRecord, reference_record
from uuv.sim.plant.arm_hold import ArmHold, HoldGains, hold_torque


@dataclass(slots=True, kw_only=True, eq=False)
class ActionDrive:
    """Source of the commands during the substeps of the actions of one episode."""

    seeing: Seeing  # the true state, and the estimate equal to it
    command: Commanded
    reference: ReferenceRecord
    # called before some substeps: writes set points and constant commands
    begin: Callable[[], None]
    # called after them with the last answer; returns the last command
    done: Callable[[int], Command]
    # Addresses of its tick, its memory and the box of the estimate; 0: the command is constant.
    control: tuple[int, int, int] = (0, 0, 0)
    slots: PythonSlots = field(default_factory=PythonSlots)
    leash: float = np.inf  # [m] largest distance of the tool's set point from the tool
    kept: Any = None  # objects that must exist as long as the addresses are used


class HoldRecord(NamedTuple):
    """Record of an arm that is held in a posture."""

    gains: HoldGains
    command: Commanded


@kernel
def hold_box(record):
    """`RecordBox` of a `HoldRecord`."""
    return new_box(record)


@kernel(nogil=True)
def hold_tick(box, estimate):
    """Torques that hold the arm, from the boxes of a `HoldRecord` and of an EstimateRecord."""
    record = box.record
    e = estimate.record
    hold_torque(record.gains, e.q, e.qd, record.command.tau)
    return FINE


def constant(seeing: Seeing, command: Commanded, begin: Callable[[], None]) -> ActionDrive:
    """Commands that are constant during an action.

    Args:
        seeing: The true state.
        command: Arrays to which they are written.
        begin: Function that writes them.
    """

    def done(_answer: int) -> Command:
        return Command(
            time=float(seeing.estimate.time[0]),
            joint_torque=command.tau.copy(),
            thrusters=command.thrusters.copy(),
            scan=False,
        )

    unused = reference_record(len(command.tau))
    return ActionDrive(seeing=seeing, command=command, reference=unused, begin=begin, done=done)


def holding(arm: ArmHold, usual: ActionDrive) -> ActionDrive:
    """The same as `constant`, with an arm that is held in its posture."""
    arm_box = hold_box(as_annotated(HoldRecord(arm.gains, usual.command)))
    seen_box = estimate_box(usual.seeing.estimate)
    address = address_of_kernel(hold_tick, arm_box, seen_box)
    control = address, address_of_box(arm_box), address_of_box(seen_box)
    return replace(usual, control=control, kept=(arm_box, seen_box))
