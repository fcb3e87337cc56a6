"""Kernel of the loop's ticks: sensors, navigation, controller, recording and plant."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from uuv.perception.navigation.filter_kernel import put_out, take_sample
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.kernels.control import REFUSED, UNSOUND, Commanded, call_control
from uuv.sim.interfaces.kernels.foresight import TableRecord, take_row
from uuv.sim.interfaces.kernels.record_box import new_box
from uuv.sim.interfaces.kernels.slots import FINE, call_at
from uuv.sim.interfaces.records import EstimateRecord, ImuRecord, JointRecord, ReferenceRecord
from uuv.sim.interfaces.spatial import Array
from uuv.sim.loop.recording import RecorderRecord, write_row
from uuv.sim.loop.rollout import Stage
from uuv.sim.plant.compiled_step import PlantRecord, advance, observe
from uuv.sim.plant.plant import Plant
from uuv.sim.plant.readout import COLLISION, LEAST, MOST, NORMAL
from uuv.sim.sensors.proprioception import encode, sense_motion, transmit

NEW = int(Stage.NEW)
PLANNED = int(Stage.PLANNED)
COMMANDED = int(Stage.COMMANDED)
# Called by other kernels only: entries from Python would take a third of the time of compiling
# `run_ticks`.
_WITHIN: Any = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}


class Sensed(NamedTuple):
    """Memories of the sensors, and the truth that they read; views."""

    encoders: Array  # (1,) of their kind, likewise below
    torques: Array
    imu: Array
    R_WB: Array  # (3, 3)
    acceleration: Array  # (6,)
    w_WB_B: Array  # (3,)
    q: Array  # (n,)
    qd: Array  # (n,)
    qdd: Array  # (n,)
    tau_drive: Array  # (n,)
    tau_friction: Array  # (n,)
    armature: Array  # (n,)
    damping: Array  # (n,)


class World(NamedTuple):
    """Everything that changes at the rate of the drives."""

    plant: PlantRecord
    sensed: Sensed
    filter: Array  # (1,) of `filter_kernel.FILTER`
    sample: ImuRecord
    joints: JointRecord
    estimate: EstimateRecord
    sound: EstimateRecord  # that of the last tick completed
    control: np.ndarray  # (3,) addresses: of the controller's tick, its memory, the estimate's box
    command: Commanded
    reference: ReferenceRecord  # that the controller follows
    table: TableRecord  # of the next ones
    rows: RecorderRecord
    sampled: np.ndarray  # (3,) bool: sensors of `Sensed` that are compiled
    sensors: int  # address of the slot of the others; 0: there are none
    referred: np.ndarray  # (1,) index of the present reference in the recording
    every: int  # ticks in a period of the controller
    plans: int  # ticks in one of the planner
    observers: int  # address of the slot of observers that see every tick; 0: there are none
    present: np.ndarray  # (1,) number of the present tick, for them


@kernel
def box_of(world):
    """`RecordBox` of a `World`, or of another tuple of records."""
    return new_box(world)


@kernel(nogil=True)
def run_ticks(box, first, ticks, begun, onward):
    """Run ticks, from any `Stage` of the first one to any stage of the tick after the last one.

    Args:
        box: `RecordBox` of a `World`.
        first: number of the first one in the run.
        ticks: number of ticks to be completed.
        begun: stage that the first one has reached; PLANNED: its estimate is made, and the planner
            has seen it.
        onward: stage that the tick after the last one shall reach.

    Returns:
        Number of ticks completed; stage that the next one has reached; answer of the controller.
        Fewer ticks than asked for, with PLANNED and FINE: the planner has to decide there.
    """
    world = box.record
    plant = world.plant
    command = world.command
    control = world.control
    estimate = world.estimate
    stage = begun

    for done in range(ticks + 1):
        last_stage = onward if done == ticks else COMMANDED

        # Sensors and navigation.
        if stage < PLANNED and last_stage > NEW:
            if observe(plant):
                return done, NEW, FINE
            time = plant.watch.time[0]
            seen = world.joints, world.sample, estimate
            answer = perceive(world.sensed, world.sampled, world.sensors, world.filter, time, seen)
            if answer != FINE:
                return done, NEW, answer
            stage = PLANNED

            # Planner, as far as it foresaw its steps.
            if (first + done) % world.plans == 0 and done < ticks:
                if not take_row(world.table, estimate, command, world.reference):
                    return done, PLANNED, FINE
                world.referred[0] += 1

        # Controller.
        if stage < COMMANDED and last_stage == COMMANDED:
            if (first + done) % world.every == 0:
                answer = call_control(control[0], control[1], control[2])
                if answer == UNSOUND:
                    return done, PLANNED, answer
                if answer != FINE:
                    return done, COMMANDED, answer
                if not (np.isfinite(command.tau).all() and np.isfinite(command.thrusters).all()):
                    return done, COMMANDED, REFUSED
            stage = COMMANDED

        if done == ticks:
            break

        # Recording, observers of every tick, and plant.
        contacts = plant.readout.contacts
        time = plant.watch.time[0]
        saturated = plant.drive.saturated[0]
        record_row(world.rows, time, contacts, saturated, world.referred[0], command)
        if world.observers:
            world.present[0] = first + done
            answer = call_at(world.observers, 0, 0)
            if answer != FINE:
                return done, COMMANDED, answer

        _copy(estimate, world.sound)
        advance(plant, command.tau, command.thrusters)
        stage = NEW
    return ticks, stage, FINE


@kernel(**_WITHIN)
def perceive(s, sampled, others, memory, time, seen):
    """Samples of the sensors into the filter, and its estimate.

    Args:
        s: `Sensed`.
        sampled: as in `World`.
        others: address of the slot of sensors in Python.
        memory: of the filter.
        time: [s] now.
        seen: `JointRecord`, `ImuRecord` and `EstimateRecord`; written.

    Returns:
        The answer of the slot.
    """
    joints, sample, estimate = seen

    # Compiled sensors.
    if sampled[0]:
        encode(s.encoders, s.q, s.qd, joints.q, joints.qd)
    if sampled[1]:
        transmit(
            s.torques, s.tau_drive, s.tau_friction, s.armature, s.qdd, s.damping, s.qd, joints.tau
        )
    if sampled[2]:
        force_B = sample.specific_force_B
        w_B = sample.w_WB_B
        R_WB = sample.R_WB
        sense_motion(s.imu, s.R_WB, s.acceleration, s.w_WB_B, force_B, w_B, R_WB)

    sample.time[0] = time

    # Other sensors, in Python.
    if others:
        answer = call_at(others, 0, 0)
        if answer != FINE:
            return answer

    # Navigation.
    take_sample(memory, sample)
    put_out(memory, joints, estimate)
    return FINE


@kernel(**_WITHIN)
def record_row(rows, time, contacts, saturated, reference, command):
    """Write one row of the recording, under the reference of this index."""
    scalars = (
        contacts[NORMAL],
        contacts[LEAST],
        contacts[MOST],
        saturated,
        contacts[COLLISION] != 0.0,
    )
    write_row(rows, time, scalars, reference, command.f_W, command.felt[0])


@kernel(**_WITHIN)
def _copy(source, target):
    """Copy one EstimateRecord into another by loops, which compile ten times as fast as slices."""
    target.time[0] = source.time[0]
    target.attitude_sigma[0] = source.attitude_sigma[0]

    for i in range(4):
        for j in range(4):
            target.X_WB[i, j] = source.X_WB[i, j]

    for i in range(3):
        target.v_WB_B[i] = source.v_WB_B[i]
        target.w_WB_B[i] = source.w_WB_B[i]
        target.a_WB_B[i] = source.a_WB_B[i]
        target.position_sigma[i] = source.position_sigma[i]
        target.ages[i] = source.ages[i]
        target.object_moved_W[i] = source.object_moved_W[i]
        target.gyro_off_B[i] = source.gyro_off_B[i]
        target.attitude_off_B[i] = source.attitude_off_B[i]

    for j in range(source.q.shape[0]):
        target.q[j] = source.q[j]
        target.qd[j] = source.qd[j]
        target.tau[j] = source.tau[j]


def sensed_by(plant: Plant, memories: Sequence[np.ndarray]) -> Sensed:
    """Memories of the sensors of every tick, and the truth of `plant` that they read.

    Args:
        plant: of the run.
        memories: of encoders, torque sensors and IMU, (1,) each.
    """
    truth = plant.truth
    return Sensed(
        *memories,
        R_WB=truth.R_WB,
        acceleration=truth.acceleration,
        w_WB_B=truth.w_WB_B,
        q=truth.q,
        qd=truth.qd,
        qdd=truth.qdd,
        tau_drive=truth.tau_drive,
        tau_friction=truth.tau_friction,
        armature=truth.armature,
        damping=truth.joint_damping,
    )
