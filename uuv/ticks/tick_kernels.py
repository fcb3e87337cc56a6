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
# Called by other kernels only. Entries from Python would take a third of the compilation time of
# `run_ticks`.
_WITHIN: Any = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}


class Sensed(NamedTuple):
    """Memories of the sensors, and the truth that they measure, as views."""

    encoders: Array  # (1,) records of their kind, as below
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
    sound: EstimateRecord  # command of the last completed tick
    # (3,) addresses of the controller's tick, of its memory, and of the estimate's box
    control: np.ndarray
    command: Commanded
    reference: ReferenceRecord  # set points that the controller follows
    table: TableRecord  # set points of the next periods
    rows: RecorderRecord
    sampled: np.ndarray  # (3,) bool: which sensors of `Sensed` are compiled
    sensors: int  # address of the slot of the other sensors; 0: there are none
    referred: np.ndarray  # (1,) index of the present reference in the recording
    every: int  # number of ticks in a period of the controller
    plans: int  # number of ticks in a period of the planner
    # address of the slot of observers that are called at every tick; 0: there are none
    observers: int
    present: np.ndarray  # (1,) number of the present tick, for these observers


@kernel
def box_of(world):
    """`RecordBox` of a `World`, or of another tuple of records."""
    return new_box(world)


@kernel(nogil=True)
def run_ticks(box, first, ticks, begun, onward):
    """Run ticks, from any `Stage` of the first tick to any stage of the tick after the last.

    Args:
        box: `RecordBox` of a `World`.
        first: Number of the first tick in the run.
        ticks: Number of ticks to be completed.
        begun: Stage that the first tick has reached. PLANNED: its estimate is made, and the planner
            has made its step.
        onward: Stage that the tick after the last is to reach.

    Returns:
        Number of ticks completed, stage that the next tick has reached, and answer of the
        controller. Fewer ticks than requested, with PLANNED and FINE, mean that the planner must
        decide there.
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

            # Planner, as long as its foreseen set points hold.
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

        # Recording, observers called at every tick, and plant.
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
    """Sample the sensors, pass the samples to the filter, and write its estimate.

    Args:
        s: `Sensed`.
        sampled: As in `World`.
        others: Address of the slot of sensors in Python.
        memory: Memory of the filter.
        time: [s] Present time.
        seen: `JointRecord`, `ImuRecord` and `EstimateRecord`, which are written.

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
    """Write one row of the recording, with the index of its reference."""
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
    """Memories of the sensors of every tick, and the truth of `plant` that they measure.

    Args:
        plant: Plant of the run.
        memories: Memories of encoders, torque sensors and IMU, (1,) each.
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
