"""Pool trials [Kolano 2022] as logs: thrusters off, joints measured, attitude of the IMU, height of
the mocap.
"""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from experiments.water.pool.trials import PoolTrial
from uuv.calib.water.logs import ATTITUDE, DEPTH, Channel, WaterLog

JOINTS = ("joint1", "joint2", "joint3", "joint4")


def log_of_trial(trial: PoolTrial) -> WaterLog:
    """One trial as a log; its times begin at zero."""
    begin = trial.times[0]

    time = trial.times - begin
    quats = Rotation.from_euler("ZYX", trial.attitude[:, ::-1]).as_quat()
    at = trial.joint_times - begin

    return WaterLog(
        name=trial.name,
        time=time,
        channels={
            ATTITUDE: Channel(time=time, values=quats),
            DEPTH: Channel(time=time, values=-trial.position[:, 2:3]),
        },
        commands={},
        thrusts={},
        joints={name: np.interp(time, at, trial.joints[:, j]) for j, name in enumerate(JOINTS)},
    )


def logs_of_trials(trials: Sequence[PoolTrial]) -> list[WaterLog]:
    """All trials as logs."""
    return [log_of_trial(trial) for trial in trials]
