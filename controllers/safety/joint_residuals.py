"""Residuals of torque sensors and encoders against redundant sources, at the drives' rate."""

from typing import NamedTuple

import numpy as np

from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.spatial import Array


class JointResiduals(NamedTuple):
    """Residuals of torque sensors and encoders, as arrays that are changed in place."""

    q: Array  # (n,) [rad] last readings
    qd: Array  # (n,) [rad/s]
    tau: Array  # (n,) [N m]
    tau_motor: Array  # (n,) [N m] last command
    same: np.ndarray  # (2, n) consecutive equal samples of torque sensor and encoder
    longest: np.ndarray  # (2, n) longest such run while healthy
    qd_slow: Array  # (n,) [rad/s] filtered
    gear: Array  # (n,) [N m] sensor minus motor, filtered, without rotor inertia
    excess: Array  # (n,) [N m] sensor minus motor, filtered
    usual: Array  # (n,) [N m] average of that difference
    beyond: Array  # (n,) [s] duration for which it has exceeded its bound
    slip: Array  # (n,) [rad] angle minus integral of speed

    @classmethod
    def start(cls, q: Array, qd: Array, tau: Array) -> "JointResiduals":
        """Initial residuals at the first readings (n,) [rad], [rad/s], [N m]."""
        n = len(q)
        counts, zeros = (
            [np.zeros((2, n), dtype=np.int64) for _ in range(2)],
            [np.zeros(n) for _ in range(6)],
        )
        return cls(
            q=np.array(q),
            qd=np.array(qd),
            tau=np.array(tau),
            tau_motor=zeros[0],
            same=counts[0],
            longest=counts[1],
            qd_slow=np.array(qd),
            gear=zeros[1],
            excess=zeros[2],
            usual=zeros[3],
            beyond=zeros[4],
            slip=zeros[5],
        )


class JointResidualModel(NamedTuple):
    """Gears, bounds and time constants of the residuals."""

    armature: Array  # (n,) [kg m^2]
    damping: Array  # (n,) [N m s/rad]
    floor: Array  # (n,) [N m] constant part of the torque bound
    share: float  # [-] part of the torque bound by the reading
    period: float  # [s] of the steps
    torque_time: float  # [s]
    encoder_time: float  # [s]
    learning_time: float  # [s]


@kernel
def update_residuals(model, seen, age, warm, residuals):
    """Update the residuals by one sample; True if any needs evaluation.

    Records are passed as plain tuples of their fields, which numba types faster.

    Args:
        model: `JointResidualModel`.
        seen: joint angles, speeds and torques, (n,) each.
        age: [s] since the first sample.
        warm: True once the initial learning is over.
        residuals: `JointResiduals`; updated.
    """
    model = JointResidualModel(*model)
    r = JointResiduals(*residuals)
    q, qd, tau = seen
    dt = model.period
    torque_time = model.torque_time
    encoder_time = model.encoder_time
    learning_time = model.learning_time
    q_last = r.q
    qd_last = r.qd
    tau_last = r.tau
    same = r.same
    longest = r.longest
    slip = r.slip
    gear = r.gear
    excess = r.excess
    usual = r.usual
    qd_slow = r.qd_slow

    lag, leak, learn = (
        min(1.0, dt / torque_time),
        dt / encoder_time,
        dt / min(learning_time, max(age, dt)),
    )

    look = False
    for j in range(q.shape[0]):
        # Frozen readings: bitwise equal samples in a row.
        for k in range(2):
            equal = tau[j] == tau_last[j] if k == 0 else (q[j] == q_last[j] and qd[j] == qd_last[j])
            if equal:
                same[k, j] += 1
                look |= same[k, j] > longest[k, j]
            else:
                longest[k, j] = max(longest[k, j], same[k, j])
                same[k, j] = 0

        # Encoder: angle less integral of speed, with a leak.
        slip[j] += q[j] - q_last[j] - 0.5 * dt * (qd[j] + qd_last[j]) - leak * slip[j]
        if not warm:
            slip[j] = 0.0
        look |= abs(slip[j]) > 1e-3

        # Torque sensor: reading less motor torque, rotor inertia and friction.
        gear[j] += lag * (tau[j] - r.tau_motor[j] + model.damping[j] * qd[j] - gear[j])
        excess[j] = gear[j] + model.armature[j] * (qd[j] - qd_slow[j]) / torque_time
        qd_slow[j] += lag * (qd[j] - qd_slow[j])

        # Compared with its average, which is updated while the reading is usual.
        off = abs(excess[j] - usual[j]) / (model.floor[j] + model.share * abs(tau[j]))
        if off < 0.5 or not warm:
            usual[j] += learn * (excess[j] - usual[j])
        r.beyond[j] = r.beyond[j] + dt if off > 1.0 else 0.0
        look |= off > 1.0

        q_last[j], qd_last[j], tau_last[j] = q[j], qd[j], tau[j]
    return look
