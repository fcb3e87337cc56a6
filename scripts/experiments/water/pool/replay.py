"""Replay of pool trials: our vehicle begins as the real one and moves its joints as measured; what
differs.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import rollout
from scipy.spatial.transform import Rotation

from experiments.water.pool.pool_vehicle import PARAMETERS, joint_zeros, mount, pool_model
from experiments.water.pool.trials import PoolTrial
from uuv.calib.water.named_fit import values_of
from uuv.sim.interfaces.errors import UuvError
from uuv.sim.interfaces.spatial import Array, quat_wxyz_from_rotation

# Standard deviations by which residuals are weighed: tenths of a degree are within reach, the
# heading and the drift depend on the pool's own currents, and the height on a buoyancy that changes
# from day to day.
# [rad], [rad], [m]
ATTITUDE, HEADING, HEIGHT = float(np.radians(0.7)), float(np.radians(6.0)), 0.06
SAMPLES = 20.0  # independent ones that a record of a trial counts as
_STATE = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)


@dataclass(frozen=True, slots=True, eq=False)
class Replayed:
    """A trial as simulated, at its times."""

    attitude: Array  # (k, 3) [rad] roll, pitch, yaw of the IMU's axes
    position: Array  # (k, 3) [m] from the start, world axes


def replay(model: mujoco.MjModel, trial: PoolTrial, values: Mapping[str, float]) -> Replayed:
    """Simulate one trial.

    Args:
        model: Of `pool_model`.
        trial: The trial; only its start and its joint angles are used.
        values: The parameters that the model was made of.
    """
    dt = float(model.opt.timestep)
    begin, end = trial.times[0], trial.times[-1]

    # Joint angles of the servos at each step.
    grid = begin + dt * np.arange(max(2, round((end - begin) / dt) + 1))
    joints = np.column_stack(
        [np.interp(grid, trial.joint_times, trial.joints[:, j]) for j in range(4)]
    )
    joints = joints + joint_zeros(values)
    on_hull = mount(values)

    # The start as measured; the IMU's axes are turned to the hull's.
    data = mujoco.MjData(model)
    R_WB = trial.R_start @ on_hull.T
    data.qpos[3:7], data.qpos[7:] = quat_wxyz_from_rotation(R_WB), joints[0]
    data.qvel[:3], data.qvel[3:6] = trial.v_start, on_hull @ trial.w_start
    data.qvel[6:] = (joints[4] - joints[0]) / (4.0 * dt)

    start = np.empty(mujoco.mj_stateSize(model, _STATE))
    mujoco.mj_getState(model, data, start, _STATE)
    states = rollout.rollout(model, data, initial_state=start[None], control=joints[None])[0][0]

    # The states nearest to the times of comparison.
    at = np.clip(np.round((trial.times - begin) / dt).astype(np.int64) - 1, 0, len(states) - 1)
    qpos = states[at, 1 : 1 + model.nq]

    turned = Rotation.from_quat(qpos[:, [4, 5, 6, 3]]) * Rotation.from_matrix(on_hull)
    return Replayed(np.unwrap(turned.as_euler("ZYX"), axis=0)[:, ::-1], qpos[:, :3])


class Residuals:
    """Residuals of trials as a function of the parameters, for
    `uuv.calib.water.named_fit.fit_named`.
    """

    def __init__(self, hull: str, trials: Sequence[PoolTrial]) -> None:
        self._hull, self._trials = hull, tuple(trials)

    def __call__(self, deviations: Array) -> Array:
        """Residuals of roll, pitch, heading and height in their standard deviations; NaN where
        there is no vehicle.
        """
        values = values_of(PARAMETERS, deviations)

        try:
            model = pool_model(self._hull, values)
        except UuvError:
            return np.full(sum(4 * len(trial.times) for trial in self._trials), np.nan)
        return np.concatenate([self._of(model, trial, values) for trial in self._trials])

    @staticmethod
    def _of(model: mujoco.MjModel, trial: PoolTrial, values: Mapping[str, float]) -> Array:
        motion = replay(model, trial, values)

        off = motion.attitude - trial.attitude
        off[:, 2] -= off[0, 2]  # the IMU's heading has an origin of its own
        rise = motion.position[:, 2] - trial.position[:, 2]

        weight = np.sqrt(SAMPLES / len(trial.times))
        return weight * np.concatenate(
            [off[:, 0] / ATTITUDE, off[:, 1] / ATTITUDE, off[:, 2] / HEADING, rise / HEIGHT]
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialScore:
    """How a replayed trial differs from the real one; pairs are roll and pitch."""

    name: str
    rms: tuple[float, float]  # [rad]
    correlation: tuple[float, float]
    amplitude: tuple[float, float]  # standard deviation, simulated over measured
    rise: float  # [m] measured, from begin to end
    rise_error: float  # [m] simulated less measured
    drift: float  # [m] measured horizontal way from begin to end
    drift_error: float  # [m] horizontal distance of the two ends


def score_of(trial: PoolTrial, found: Replayed) -> TrialScore:
    """Figures of one trial."""
    off = found.attitude[:, :2] - trial.attitude[:, :2]
    spreads = trial.attitude[:, :2].std(axis=0)
    both = [float(np.corrcoef(trial.attitude[:, i], found.attitude[:, i])[0, 1]) for i in (0, 1)]
    ratio = found.attitude[:, :2].std(axis=0) / spreads
    rms = np.sqrt(np.mean(off**2, axis=0))
    apart = found.position[-1] - trial.position[-1]

    return TrialScore(
        name=trial.name,
        rms=(float(rms[0]), float(rms[1])),
        correlation=(both[0], both[1]),
        amplitude=(float(ratio[0]), float(ratio[1])),
        rise=float(trial.position[-1, 2]),
        rise_error=float(apart[2]),
        drift=float(np.linalg.norm(trial.position[-1, :2])),
        drift_error=float(np.linalg.norm(apart[:2])),
    )
