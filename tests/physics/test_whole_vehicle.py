"""A vehicle from the library is complete in its model: MuJoCo's own ways to step it all give the
same motion.
"""

import multiprocessing
from pathlib import Path

import mujoco
import mujoco.batch
import mujoco.rollout
import numpy as np
import pytest

from uuv import models
from uuv.models.vehicle import Vehicle
from uuv.models.water import thrusters
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.spatial import Array

STEPS = 150
PHYSICS = int(mujoco.mjtState.mjSTATE_FULLPHYSICS)


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    spec = models.load("uuv_puma")
    spec.option.wind = [0.2, -0.1, 0.05]
    return hydrodynamics.compile(spec)


@pytest.fixture(scope="module")
def controls(model: mujoco.MjModel) -> Array:
    """Commands (STEPS, nu) of thrusters and joints."""
    rng = np.random.default_rng(5)
    share = np.repeat(rng.uniform(-0.9, 0.9, (STEPS // 30, model.nu)), 30, axis=0)
    controls = 0.2 * share * model.actuator_ctrlrange[:, 1]
    driven = Vehicle.of(model).thruster_actuators
    controls[:, driven] = share[:, driven]
    return controls


def stepped(model: mujoco.MjModel, controls: Array) -> Array:
    """States (STEPS, n) under the controls, from the model's own start."""
    data = mujoco.MjData(model)
    states = np.empty((len(controls), mujoco.mj_stateSize(model, PHYSICS)))
    for control, state in zip(controls, states, strict=True):
        data.ctrl[:] = control
        mujoco.mj_step(model, data)
        mujoco.mj_getState(model, data, state, PHYSICS)
    return states


def start_of(model: mujoco.MjModel) -> Array:
    state = np.empty(mujoco.mj_stateSize(model, PHYSICS))
    mujoco.mj_getState(model, mujoco.MjData(model), state, PHYSICS)
    return state


def test_rollout_and_batch_are_the_loop(model, controls):
    alone = stepped(model, controls)
    assert np.abs(alone[-1, -model.na :]).max() > 0.5  # the propellers turn

    for threads in (1, 2):
        batch = mujoco.batch.Batch(model, nsim=3, nthread=threads)
        ctrl = batch.bind("ctrl")
        for control in controls:
            ctrl[:] = control
            batch.step()
        assert all(np.array_equal(act, alone[-1, -model.na :]) for act in batch.bind("act"))
        at = 1  # behind the time
        assert all(
            np.array_equal(qpos, alone[-1, at : at + model.nq]) for qpos in batch.bind("qpos")
        )

    data = [mujoco.MjData(model) for _ in range(2)]
    with mujoco.rollout.Rollout(nthread=2) as rollout:
        states, _ = rollout.rollout(
            [model] * 4, data, np.tile(start_of(model), (4, 1)), np.tile(controls, (4, 1, 1))
        )
    for state in states:
        assert np.array_equal(state, alone)


def test_a_copied_state_goes_on_alike(model, controls):
    alone = stepped(model, controls)
    first, second = mujoco.MjData(model), mujoco.MjData(model)
    for control in controls[:60]:
        first.ctrl[:] = control
        mujoco.mj_step(model, first)
    mujoco.mj_copyState(model, first, second, int(mujoco.mjtState.mjSTATE_INTEGRATION))
    for control in controls[60:]:
        second.ctrl[:] = control
        mujoco.mj_step(model, second)
    state = np.empty(alone.shape[1])
    mujoco.mj_getState(model, second, state, PHYSICS)
    assert np.array_equal(state, alone[-1])


def _stepped_from(file: str, controls: Array, answer: multiprocessing.SimpleQueue) -> None:
    answer.put(stepped(mujoco.MjModel.from_binary_path(file), controls))


def test_a_spawned_process_that_loads_the_binary_model_does_alike(model, controls, tmp_path: Path):
    mujoco.mj_saveModel(model, str(tmp_path / "vehicle.mjb"))
    spawn = multiprocessing.get_context("spawn")
    answer = spawn.SimpleQueue()
    child = spawn.Process(
        target=_stepped_from, args=(str(tmp_path / "vehicle.mjb"), controls, answer)
    )
    child.start()
    states = answer.get()
    child.join()
    assert np.array_equal(states, stepped(model, controls))


def test_derivatives_of_the_step_are_those_of_drive_and_lag(model, within):
    """Command to drive: 1, within the slew rate.

    Command and speed to speed: 1 - d and d, d = exp(-dt / T).
    """
    data = mujoco.MjData(model)
    index, rows = thrusters.read(model)
    at = model.actuator_actadr[index]
    lag = rows[:, thrusters.TIME_CONSTANT]
    data.ctrl[index] = data.act[at] = data.act[at + 1] = 0.4

    n = 2 * model.nv + model.na
    m = model.nu
    A, B = np.zeros((n, n)), np.zeros((n, m))
    mujoco.mjd_transitionFD(model, data, 1e-6, True, A, B, None, None)

    decay = np.exp(-model.opt.timestep / lag)
    passed, speed = 2 * model.nv + at + thrusters.PASSED, 2 * model.nv + at + thrusters.SPEED
    within("drive by command", B[passed, index] - 1.0, 1e-8)
    within("speed by command", B[speed, index] - (1.0 - decay), 1e-8)
    within("speed by speed", A[speed, speed] - decay, 1e-8)
    assert np.abs(B[model.nv : model.nv + 6, index]).max() > 0.0  # the hull's acceleration, at once
