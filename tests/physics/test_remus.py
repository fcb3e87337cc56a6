"""REMUS 100 against the equations of its source (`experiments.water.remus100`), integrated by
SciPy.
"""

import math

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from experiments.water import remus
from experiments.water import remus100 as source
from uuv import models
from uuv.models.vehicles import remus100
from uuv.sim import hydrodynamics

FLIP = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])


def test_accelerations_are_those_of_the_source(rng, within):
    """To rounding where its sum of strips has nothing to sum and the propeller stands; else to the
    sum's coarseness.
    """
    model = hydrodynamics.compile(models.load("remus100"))
    data = mujoco.MjData(model)
    hull = 1
    for smooth in (True, False):
        worst = 0.0
        for _ in range(40):
            nu = rng.uniform(-0.3, 0.3, 6)
            nu[0] += rng.uniform(0.4, 2.0)
            nu[[1, 5]] *= 0.0 if smooth else 1.0
            phi, theta, rudder, stern = rng.uniform(-0.2, 0.2, 4)
            state = np.concatenate([np.zeros(3), [phi, theta, 0.0], nu, [rudder, stern, 0.0]])
            expected = source.rates(state, rudder, stern, 0.0)[6:12]
            R = np.empty(9)
            quat = np.empty(4)
            mujoco.mju_mulQuat(
                quat,
                [math.cos(theta / 2), 0, -math.sin(theta / 2), 0],
                [math.cos(phi / 2), math.sin(phi / 2), 0, 0],
            )
            mujoco.mju_quat2Mat(R, quat)
            R = R.reshape(3, 3)
            data.qpos[3:7] = quat
            twist = FLIP * nu
            data.qvel = np.concatenate([R @ twist[:3], twist[3:]])
            wrench = remus100.fin_wrench(twist[:3], rudder, stern)
            force = R @ wrench[:3]
            data.xfrc_applied[hull] = [
                *force,
                *(R @ wrench[3:] - np.cross(R @ model.body_ipos[hull], force)),
            ]
            mujoco.mj_forward(model, data)
            measured = np.concatenate(
                [R.T @ data.qacc[:3] - np.cross(twist[3:], twist[:3]), data.qacc[3:]]
            )
            worst = max(worst, float(np.max(np.abs(FLIP * measured - expected))))
        if smooth:
            within("acceleration [m/s^2, rad/s^2]", worst, 1e-12)  # measured 4e-14
        else:
            # measured 2.3e-3, of some 1
            within("acceleration with its 21 strips [m/s^2, rad/s^2]", worst, 5e-3)


@pytest.mark.check(
    "REMUS 100, rudder put over, first 6 s", "PythonVehicleSimulator's equations, by SciPy"
)
def test_the_first_seconds_are_those_of_the_source(within):
    rudder = math.radians(5.0)
    mine = remus.ours(6.0, rudder, 1000.0)
    times = np.arange(0.0, 6.001, 0.1)
    exact = solve_ivp(
        lambda _, state: source.rates(state, rudder, 0.0, 1000.0),
        (0.0, 6.0),
        np.zeros(15),
        t_eval=times,
        rtol=1e-9,
        atol=1e-10,
    ).y.T
    off = np.abs(mine[::50] - exact[:, :12]).max(axis=0)
    assert exact[-1, 6] > 1.2
    assert exact[-1, 5] > 0.08
    within("surge and sway [m/s]", off[6:8], 2e-3)  # measured 1.1e-3
    within("yaw rate [rad/s]", off[11], 1e-4)  # measured 3e-5
    within("heading [rad]", off[5], 2e-4)  # measured 5e-5
    within("way [m]", off[:2], 1e-2)  # measured 5.6e-3 of 6.2: step and inflow
