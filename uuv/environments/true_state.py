"""The true state as an estimate, which controllers inside an environment use as navigation."""

import math
from typing import Any, NamedTuple

import numpy as np

from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.kernels.record_box import as_annotated, new_box
from uuv.sim.interfaces.messages import StateEstimate
from uuv.sim.interfaces.records import EstimateRecord, estimate_record, state_estimate
from uuv.sim.interfaces.spatial import Array, pose
from uuv.sim.loop.true_estimate import SIGMA
from uuv.sim.plant.truth import Truth
from uuv.sim.sensors.proprioception import JointTorqueSensors, transmit

_EXACT = JointTorqueSensors(noise=0.0, bias=0.0)


class Sight(NamedTuple):
    """Inputs of an estimate, as views of a truth."""

    torques: Array  # (1,) memory of torque sensors without errors
    R_WB: Array  # (3, 3)
    p_WB: Array  # (3,) [m]
    v_WB_W: Array  # (3,) [m/s]
    w_WB_B: Array  # (3,) [rad/s]
    acceleration: Array  # (6,) acceleration of the free joint
    q: Array  # (n,) [rad]
    qd: Array  # (n,) [rad/s]
    qdd: Array  # (n,) [rad/s^2]
    tau_drive: Array  # (n,) [N m]
    tau_friction: Array  # (n,) [N m]
    armature: Array  # (n,) [kg m^2]
    damping: Array  # (n,) [N m s/rad]


class Seeing(NamedTuple):
    """A truth, and the estimate that equals it."""

    sight: Sight
    estimate: EstimateRecord


@kernel
def seeing_box(seeing):
    """`RecordBox` of a `Seeing`."""
    return new_box(seeing)


@kernel
def take_truth(sight, time, estimate):
    """Write the truth at `time` [s] into an EstimateRecord, torques at the gear outputs."""
    estimate.time[0] = time

    # Pose; velocity and acceleration in the hull's axes.
    for i in range(3):
        v = a = 0.0
        for j in range(3):
            estimate.X_WB[i, j] = sight.R_WB[i, j]
            v += sight.R_WB[j, i] * sight.v_WB_W[j]
            a += sight.R_WB[j, i] * sight.acceleration[j]
        estimate.X_WB[i, 3] = sight.p_WB[i]
        estimate.v_WB_B[i] = v
        estimate.a_WB_B[i] = a
        estimate.w_WB_B[i] = sight.w_WB_B[i]

    for j in range(estimate.q.shape[0]):
        estimate.q[j] = sight.q[j]
        estimate.qd[j] = sight.qd[j]

    # The sensors' noise is zero, so the same numbers of its block serve every time.
    sight.torques[0].used = 0
    transmit(
        sight.torques,
        sight.tau_drive,
        sight.tau_friction,
        sight.armature,
        sight.qdd,
        sight.damping,
        sight.qd,
        estimate.tau,
    )


@kernel
def take_boxed_truth(box, time):
    """Same as `take_truth`, for the box of a `Seeing`."""
    seeing = box.record
    take_truth(seeing.sight, time, seeing.estimate)


class TrueState:
    """Makes estimates that equal the truth of one vehicle; torques are those at the gear
    outputs.
    """

    def __init__(self) -> None:
        self._torques: Any = _EXACT.init(np.random.default_rng(0))
        self._truth: Truth | None = None
        self._seeing: Seeing | None = None
        self._box: Any = None

    def of(self, truth: Truth) -> Seeing:
        """The truth, and the record of the estimate; both are kept until another truth is given."""
        if self._seeing is None or truth is not self._truth:
            estimate = estimate_record(len(truth.q))
            estimate.position_sigma[:] = SIGMA
            estimate.attitude_sigma[0] = 0.0
            estimate.ages[3] = math.inf  # no jump of the IMU

            self._truth = truth
            self._seeing = Seeing(self._sight(truth), estimate)
            self._box = seeing_box(as_annotated(self._seeing))
        return self._seeing

    def _sight(self, truth: Truth) -> Sight:
        self._torques.draw(len(truth.q))

        return Sight(
            torques=self._torques.record,
            R_WB=truth.R_WB,
            p_WB=truth.p_WB,
            v_WB_W=truth.v_WB_W,
            w_WB_B=truth.w_WB_B,
            acceleration=truth.acceleration,
            q=truth.q,
            qd=truth.qd,
            qdd=truth.qdd,
            tau_drive=truth.tau_drive,
            tau_friction=truth.tau_friction,
            armature=truth.armature,
            damping=truth.joint_damping,
        )

    def take(self, truth: Truth) -> EstimateRecord:
        """The record of the estimate, updated."""
        seeing = self.of(truth)
        take_boxed_truth(self._box, truth.time)
        return seeing.estimate

    def estimate(self, truth: Truth) -> StateEstimate:
        """Estimate that equals the truth."""
        return state_estimate(self.take(truth))


def tool_pose(truth: Truth) -> Array:
    """Pose X_WG (4, 4) of the tool's tip."""
    return pose(truth.R_WG, truth.p_WG)
