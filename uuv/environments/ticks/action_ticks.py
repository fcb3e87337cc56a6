"""Substeps of an action as a kernel: inputs of judges, controller on the true state, plant.

Each substep has the effect of `VehicleTask.before_substep`, the vehicle's hooks and dm_control's
`Physics.step`, with the same kernels on the same arrays. Both give the same bits, and may
alternate.
"""

import ctypes
from functools import cache
from typing import NamedTuple

import numpy as np

from uuv.environments.true_state import Sight, take_truth
from uuv.models.water.mujoco_library import library
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.kernels.control import REFUSED, Commanded, call_control
from uuv.sim.interfaces.kernels.record_box import new_box
from uuv.sim.interfaces.kernels.slots import FINE
from uuv.sim.interfaces.records import FOLLOWS, EstimateRecord, ReferenceRecord
from uuv.sim.interfaces.spatial import Array
from uuv.sim.native.native_memory import call_physics, f64
from uuv.sim.plant import readout
from uuv.sim.plant.compiled_step import PlantRecord, advance, observe
from uuv.sim.plant.readout import CONTACTS, DATA, MODEL, TIME

# Entries of a row with the inputs of judges before a step: face of the pad (3,) [m], and the
# contacts of the preceding step (`uuv.sim.plant.readout`)
STEP_PAD = 0
_CONTACTS = 3  # first entry of the contacts
STEP_NORMAL = _CONTACTS + readout.NORMAL
STEP_FORCE = _CONTACTS + readout.FORCE
STEP_COLLISION = _CONTACTS + readout.COLLISION
STEP_LEAST = _CONTACTS + readout.LEAST
STEP_MOST = _CONTACTS + readout.MOST
STEP = _CONTACTS + CONTACTS  # number of entries

DIVERGED = 8  # answer of `run_substeps`, besides those of a controller: a warning of MuJoCo


class ActionRecord(NamedTuple):
    """Everything that changes within an action, as arrays; those of MuJoCo are views."""

    plant: PlantRecord
    sight: Sight
    estimate: EstimateRecord
    p_WG: Array  # (3,) [m] tip of the tool
    p_pad: Array  # (3,) [m] face of the pad
    control: np.ndarray  # (3,) addresses of `ActionDrive`
    reference: ReferenceRecord  # set points, which move by their velocities from their own time on
    leash: float  # [m] largest distance of the tool's set point from the tool
    command: Commanded
    rows: Array  # (substeps, STEP) inputs of judges before each substep
    warnings: np.ndarray  # (k,) MuJoCo's counters of warnings
    kinematics: int  # address of `mj_kinematics`


@kernel
def action_box(record):
    """`RecordBox` of an `ActionRecord`."""
    return new_box(record)


@kernel
def keep_near(X_WG, v_WG_W, since, p_WG, leash):
    """Limit the distance of the tool's set point from the tool.

    Args:
        X_WG: (4, 4) set point at the time `since` ago; its position is changed.
        v_WG_W: (3,) [m/s] velocity of the set point.
        since: [s] age of `X_WG`.
        p_WG: (3,) [m] tip of the tool.
        leash: [m] largest distance.
    """
    lead = np.empty(3)
    for i in range(3):
        lead[i] = X_WG[i, 3] + since * v_WG_W[i] - p_WG[i]

    far = np.sqrt(lead[0] * lead[0] + lead[1] * lead[1] + lead[2] * lead[2])
    if far > leash:
        for i in range(3):
            X_WG[i, 3] -= (1.0 - leash / far) * lead[i]


@kernel(nogil=True)
def run_substeps(box, substeps):
    """Run substeps of an action.

    Args:
        box: `RecordBox` of an `ActionRecord`.
        substeps: Number of substeps, at most the number of rows.

    Returns:
        Number of substeps completed, and an answer: FINE, DIVERGED, REFUSED for a command that is
            not finite, or the answer of a controller that failed.
    """
    record = box.record
    plant = record.plant
    control = record.control
    command = record.command
    reference = record.reference
    warned = _count(record.warnings)

    for done in range(substeps):
        observe(plant)
        if _count(record.warnings) > warned:
            return done, DIVERGED
        time = plant.watch.time[0]
        _write_row(record, done)
        take_truth(record.sight, time, record.estimate)

        # Controller.
        if control[0]:
            if reference.flags[FOLLOWS]:
                since = time - reference.time[0]
                keep_near(reference.X_WG, reference.v_WG_W, since, record.p_WG, record.leash)
            answer = call_control(control[0], control[1], control[2])
            if answer != FINE:
                return done, answer

        # Plant.
        if not advance(plant, command.tau, command.thrusters):
            return done, REFUSED
        if _count(record.warnings) > warned:
            return done + 1, DIVERGED

    # Positions at the end of the substep, for hooks after it.
    places = plant.readout.places
    call_physics(record.kinematics, places[MODEL], places[DATA])
    plant.watch.time[0] = f64(places[DATA] + places[TIME], 0)
    return substeps, FINE


@kernel
def _count(warnings):
    total = 0
    for i in range(warnings.shape[0]):
        total += warnings[i]
    return total


@kernel
def _write_row(record, at):
    """Write the inputs of judges at the present state."""
    row = record.rows[at]
    for i in range(3):
        row[STEP_PAD + i] = record.p_pad[i]
    for i in range(CONTACTS):
        row[_CONTACTS + i] = record.plant.readout.contacts[i]


@cache
def address_of_kinematics() -> int:
    """Address of `mj_kinematics`."""
    return ctypes.cast(library().mj_kinematics, ctypes.c_void_p).value or 0
