"""Perturbations of gears and sensors against closed forms: twist under a torque, statistics of
drift.
"""

from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from untyped import untyped
from uuv import models
from uuv.assembly import assemble
from uuv.jobs import clean_barrel
from uuv.models.files.keyframes import keyframes_kept
from uuv.models.vehicle import Vehicle
from uuv.perturbations.elastic_gears import TWIST, ElasticGears
from uuv.perturbations.sensing import AttitudeError, DriftingTorque
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.sensors.proprioception import Imu, JointTorqueSensors
from uuv.sim.sensors.torque_drift import DriftingTorqueSensors

ARM = """
<mujoco>
  <option gravity="0 0 0" timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="link">
      <joint name="joint1" axis="0 0 1" armature="1e9"/>
      <geom size=".05" pos=".5 0 0" mass="4"/>
    </body>
  </worldbody>
  <actuator><motor name="joint1" joint="joint1" ctrllimited="true" ctrlrange="-100 100"/></actuator>
  <keyframe><key name="ready" qpos="0.7"/></keyframe>
</mujoco>
"""


@pytest.mark.parametrize("torque", [20.0, -20.0])
@pytest.mark.parametrize("backlash", [0.0, 2e-3])
def test_gear_twists_by_the_torque_over_its_stiffness_and_half_its_play(torque, backlash):
    """Behind a motor that cannot turn."""
    spec = mujoco.MjSpec.from_string(ARM)
    stiffness = 2e4
    ElasticGears(stiffness=stiffness, backlash=backlash, damping=0.3).on_vehicle(
        spec, np.random.default_rng(0)
    )
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qfrc_applied[model.joint("joint1" + TWIST).dofadr[0]] = torque
    for _ in range(round(3.0 / model.opt.timestep)):
        mujoco.mj_step(model, data)
    twist = data.qpos[model.joint("joint1" + TWIST).qposadr[0]]
    assert twist == pytest.approx(torque / stiffness + np.sign(torque) * 0.5 * backlash, rel=1e-6)
    assert model.key("ready").qpos.tolist() == [0.7, 0.0]


def test_free_gear_vibrates_at_the_frequency_of_motor_and_link():
    """Without play and damping: omega^2 = k (1 / A + 1 / I); the timestep resolves it."""
    spec = mujoco.MjSpec.from_string(ARM)
    stiffness = 2e4
    armature = 0.5
    spec.joint("joint1").armature = armature
    ElasticGears(stiffness=stiffness, damping=0.0).on_vehicle(spec, np.random.default_rng(0))
    model = spec.compile()
    assert model.opt.timestep < 0.002
    data = mujoco.MjData(model)
    data.qpos[1] = 1e-3
    inertia = 4.0 * 0.25 + 0.4 * 4.0 * 0.05**2
    deflection = []
    for _ in range(round(0.2 / model.opt.timestep)):
        mujoco.mj_step(model, data)
        deflection.append(data.qpos[1])
    crossings = np.flatnonzero(np.diff(np.sign(deflection)))
    omega = np.pi * (len(crossings) - 1) / ((crossings[-1] - crossings[0]) * model.opt.timestep)
    assert omega == pytest.approx(np.sqrt(stiffness * (1.0 / armature + 1.0 / inertia)), rel=0.02)


def test_vehicle_with_elastic_gears_keeps_its_joints_and_keyframes():
    spec = models.load("uuv_puma")
    before = Vehicle.of(spec.copy().compile())
    drawn = ElasticGears(stiffness=3e4).on_vehicle(spec, np.random.default_rng(0))
    after = Vehicle.of(spec.compile())
    assert after.joint_names == before.joint_names
    np.testing.assert_array_equal(after.q_home, before.q_home)
    np.testing.assert_array_equal(after.q_ready, before.q_ready)
    assert np.diff(after.qpos).tolist() == [2] * 5
    assert drawn == {"gear_stiffness": 3e4, "backlash": 0.0}
    with pytest.raises(ConfigurationError, match="ElasticGears backlash"):
        ElasticGears(backlash=-1.0)


def test_keyframes_keep_the_joints_that_stay():
    spec = mujoco.MjSpec.from_string(ARM)
    with keyframes_kept(spec):
        spec.worldbody.add_body(
            name="free", mass=1.0, inertia=[1.0] * 3, explicitinertial=True
        ).add_freejoint()
        spec.body("link").add_joint(name="other", axis=[0, 1, 0], ref=0.2)
    model = spec.compile()
    ready = model.key("ready").qpos
    assert ready[model.joint("joint1").qposadr[0]] == 0.7
    # MJCF counts in degrees
    assert ready[model.joint("other").qposadr[0]] == pytest.approx(np.radians(0.2))
    assert len(ready) == model.nq == 9


def test_torque_sensors_drift_as_said_and_draw_as_without():
    sigma = 0.4
    time = 0.5
    drift = 0.02
    n = 3
    sound = JointTorqueSensors()
    truth = SimpleNamespace(
        time=0.0,
        q=np.zeros(n),
        qd=np.zeros(n),
        qdd=np.zeros(n),
        tau_drive=np.full(n, 10.0),
        tau_friction=np.zeros(n),
        armature=np.zeros(n),
        joint_damping=np.zeros(n),
    )
    wrapped = DriftingTorqueSensors(sound, sigma=sigma, time=time, drift=drift)
    state, plain = wrapped.init(np.random.default_rng(5)), sound.init(np.random.default_rng(5))
    error = []
    for tick in range(60_000):  # 120 s
        truth.time = 0.002 * tick
        state, measured = wrapped.step(state, untyped(truth))
        plain, as_without = sound.step(plain, untyped(truth))
        error.append(measured.tau - as_without.tau)
    assert state.rate is not None
    coloured = np.array(error) - np.outer(0.002 * np.arange(60_000), state.rate)
    assert np.abs(state.rate).max() < 4.0 * drift
    assert coloured.std() == pytest.approx(sigma, rel=0.15)
    lag = round(time / 0.002)
    alike = np.mean(coloured[lag:] * coloured[:-lag]) / np.mean(coloured**2)
    assert alike == pytest.approx(np.exp(-1.0), abs=0.1)


def test_perturbed_sensors_reach_the_loop():
    scenario = replace(
        clean_barrel(), perturbations=(DriftingTorque(sigma=0.3), AttitudeError(sigma=2e-3))
    )
    sensors = assemble(scenario).parts.sensors
    assert [type(sensor) for sensor in sensors].count(DriftingTorqueSensors) == 1
    (imu,) = (sensor for sensor in sensors if isinstance(sensor, Imu))
    assert imu == Imu(attitude_bias=2e-3)
    for wrong in ({"time": 0.0}, {"sigma": -1.0}, {"drift": np.nan}):
        with pytest.raises(ConfigurationError, match=f"DriftingTorque {next(iter(wrong))}"):
            DriftingTorque(**wrong)
