"""A step of the plant in compiled code, which calls MuJoCo by address, without Python or GIL.

`advance` and `observe` have the effect of `Plant.step` and `Plant.observe`, with the same kernels
on the same arrays. Both give the same bits, and calls of both may alternate. Components in Python
are called as hooks (`PlantRecord`).

MuJoCo's binding turns a fatal error of MuJoCo (no memory left on its stack) into an exception.
Compiled code has no such handling: MuJoCo prints its message and ends the process. Warnings of
MuJoCo are the same in both cases.
"""

from typing import NamedTuple

import numpy as np

from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.kernels.slots import FINE, Slot, call
from uuv.sim.interfaces.spatial import Array
from uuv.sim.native.native_memory import call_physics, f64
from uuv.sim.native.passive_callback import WET_MARK
from uuv.sim.plant.readout import DATA, MODEL, STEP1, STEP2, TIME, Readout, gears_and_contacts
from uuv.sim.plant.soil_contact import SoilContact, feel_soil
from uuv.sim.plant.supply import Supply, feed
from uuv.sim.plant.thrusters import Drive, command_thrusters, read_thrusters


class Flow(NamedTuple):
    """Current of the water: rows computed ahead (`uuv.sim.water.current.Current`), and the index of
    the next.
    """

    velocity: Array  # (N, 3) [m/s]
    acceleration: Array  # (N, 3) [m/s^2]
    row: np.ndarray  # (2,) next row, rows per step
    wind: Array  # (3,) [m/s] for the hydrodynamics (`uuv.sim.plant.driven_water`)
    current_acceleration: Array  # (3,) [m/s^2] for the hydrodynamics
    current_W: Array  # (3,) [m/s] current in the truth


class Watch(NamedTuple):
    """Time, and the marks by which a failed simulation is detected."""

    time: Array  # (1,) [s] of the last `observe`
    observed: np.ndarray  # (1,) bool: the next step may be taken
    seen: Array  # (1,) bits of the warnings of the hydrodynamics
    told: Array  # (1,) bits of the warnings that were passed on
    mark: Array  # (1,) WET_MARK if the last forward pass included the hydrodynamics
    tick: np.ndarray  # (1,) steps of the plant since its start
    failed: np.ndarray  # (1,) bool: a hook has raised an error, which `Plant.check` raises
    # [s] a smaller advance of the time means that MuJoCo reset a diverged simulation
    least_gain: float


class PlantRecord(NamedTuple):
    """Record of one plant for `observe` and `advance`, with the arrays of the plant and of its
    `truth`.

    The slots are hooks in Python; a slot is empty if there is no hook.
    """

    drive: Drive
    supply: Supply
    readout: Readout
    flow: Flow
    watch: Watch
    soil: SoilContact
    joints: np.ndarray  # (n,) indices of the joint motors into `drive.ctrl`
    substeps: int
    placed: Slot  # hook that places bodies before the kinematics
    commanded: Slot  # hook that changes the commands of the thrusters
    flowed: Slot  # hook that writes the current of the next step, in place of the rows of `flow`


@kernel
def verdict(time, before, least_gain, warned, mark):
    """True if `Plant.check` must be called: after a reset, a new warning, or a step without
    hydrodynamics.
    """
    # On NaN MuJoCo resets the simulation, which appears in the time, except possibly in the first
    # step.
    return time - before < least_gain or before == 0.0 or warned or mark != WET_MARK


@kernel
def observe(plant):
    """Update the kinematics, as `Plant.observe`; True if `Plant.check` must be called now."""
    places = plant.readout.places
    watch = plant.watch
    _call_hook(plant.placed, watch)
    call_physics(places[STEP1], places[MODEL], places[DATA])

    time = f64(places[DATA] + places[TIME], 0)
    doubtful = verdict(
        time, watch.time[0], watch.least_gain, watch.seen[0] != watch.told[0], watch.mark[0]
    )

    watch.time[0] = time
    watch.observed[0] = True
    return doubtful or watch.failed[0]


@kernel
def advance(plant, joint_torque, thrusters):
    """Advance by one step, as `Plant.step`; `observe` must precede each.

    Args:
        plant: `PlantRecord`.
        joint_torque: (n,) [N m]
        thrusters: (m,) normalised commands.

    Returns:
        False if a command is not finite; nothing has changed in that case.
    """
    if not (np.isfinite(joint_torque).all() and np.isfinite(thrusters).all()):
        return False

    places = plant.readout.places
    ctrl = plant.drive.ctrl
    last = plant.substeps - 1

    # Commands.
    plant.drive.commanded[:] = thrusters
    _call_hook(plant.commanded, plant.watch)
    if not feed(plant.supply):
        plant.drive.commanded[:] = 0.0
    command_thrusters(plant.drive)
    for i in range(plant.joints.shape[0]):
        ctrl[plant.joints[i]] = joint_torque[i]

    # All substeps except the last.
    for substep in range(last):
        feel_soil(plant.soil)
        call_physics(places[STEP2], places[MODEL], places[DATA])
        gears_and_contacts(plant.readout, substep, last + 1)
        call_physics(places[STEP1], places[MODEL], places[DATA])

    # The last substep.
    feel_soil(plant.soil)
    call_physics(places[STEP2], places[MODEL], places[DATA])

    plant.watch.observed[0] = False
    plant.watch.tick[0] += 1
    read_thrusters(plant.drive)
    gears_and_contacts(plant.readout, last, last + 1)

    if plant.flowed.address:
        _call_hook(plant.flowed, plant.watch)
    else:
        next_flow(plant.flow)
    return True


@kernel
def next_flow(flow):
    """Write the current of the next step, before `observe`; takes a `Flow` or its fields."""
    velocity, acceleration, row, wind, current_acceleration, current_W = flow

    at = row[0]
    for k in range(3):
        wind[k] = current_W[k] = velocity[at, k]
        current_acceleration[k] = acceleration[at, k]

    row[0] += row[1]


@kernel
def _call_hook(slot, watch):
    """Call a hook in Python if the slot has one."""
    if slot.address != 0 and call(slot) != FINE:
        watch.failed[0] = True
