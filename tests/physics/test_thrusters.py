"""Thrusters against their closed forms, and the trim of every vehicle that there is."""

import mujoco
import numpy as np
import pytest

import models
from models import thrusters
from models.hydrodynamics import LAYOUT, unpack
from models.thrusters import Thruster
from models.vehicle import HOME_KEY, Vehicle
from sim import hydrodynamics
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array, exp_so3, rotation_angle
from sim.thrusters import Thrusters

STEP = 0.002  # [s]
STILL = (np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3))  # attitude, velocities, current
ALONG_X = np.eye(6)[:, :1]  # wrench per newton of one thruster


def one(wrench: Array = ALONG_X, **changes: float) -> Thrusters:
    figures = {"forward": 300.0, "reverse": 220.0, "dead_band": 0.05, "time_constant": 0.0, "inflow_loss": 0.0}
    thruster = Thruster(**(figures | changes))
    return Thrusters(np.array([[getattr(thruster, name) for name in figures]]), wrench, STEP)


def settled(unit: Thrusters, command: float) -> float:
    unit.step(np.array([command]), *STILL)
    return float(unit.thrust[0])


def test_step_response_is_that_of_a_first_order_lag(within):
    unit, lag = one(time_constant=0.15), 0.15
    speed, thrust = [], []
    for _ in range(500):
        unit.step(np.array([0.8]), *STILL)
        speed.append(float(unit.speed[0]))
        thrust.append(float(unit.thrust[0]))
    time = STEP * np.arange(1, 501)
    exact = 0.8 * (1.0 - np.exp(-time / lag))
    within("speed", np.array(speed) - exact, 1e-14)  # measured 2e-15
    reach = np.maximum((exact - 0.05) / 0.95, 0.0)
    within("thrust [N]", np.array(thrust) - 300.0 * reach**2, 5e-12)  # measured 5e-13
    assert thrust[0] == 0.0
    assert thrust[-1] > 180.0


def test_dead_band_and_both_directions():
    unit = one()
    assert [settled(unit, u) for u in (0.0, 0.05, -0.05)] == [0.0, 0.0, 0.0]
    assert settled(unit, 0.051) > 0.0 > settled(unit, -0.051)
    assert settled(unit, 1.0) == pytest.approx(300.0, rel=1e-14)
    assert settled(unit, -1.0) == pytest.approx(-220.0, rel=1e-14)
    # Quadratic beyond the band: half of the way, a quarter of the thrust.
    assert settled(unit, 0.525) == pytest.approx(75.0, rel=1e-13)
    assert settled(unit, -0.525) == pytest.approx(-55.0, rel=1e-13)


@pytest.mark.parametrize(("command", "flag"), [(0.989, False), (1.0, True), (1.7, True), (-1.0, True), (-0.9, False)])
def test_saturation_is_told_and_kept(command, flag):
    unit = one(dead_band=0.0)
    assert unit.step(np.array([command]), *STILL) is flag
    assert abs(float(unit.speed[0])) == min(abs(command), 1.0)


def test_inflow_takes_thrust_in_proportion_to_speed():
    """Fossen 12.257: T = T_nn |n| n - T_nu |n| u_a, u_a the water's speed along the thrust."""
    unit, n, ahead = one(dead_band=0.0, inflow_loss=90.0), 0.6, np.array([0.5, 0.2, 0.0])
    R = exp_so3([0.3, -0.2, 1.1])
    current = np.array([0.1, -0.3, 0.2])
    unit.step(np.array([n]), R, R @ ahead + current, np.zeros(3), current)
    assert unit.thrust[0] == pytest.approx(300.0 * n**2 - 90.0 * n * 0.5, rel=1e-12)
    # Astern, an inflow from behind takes as much of the reverse thrust away.
    unit.step(np.array([-n]), R, R @ ahead + current, np.zeros(3), current)
    assert unit.thrust[0] == pytest.approx(-220.0 * n**2 - 90.0 * n * 0.5, rel=1e-12)


def test_inflow_of_a_turning_hull_is_taken_where_the_thruster_stands():
    p, axis, w = np.array([-0.7, 0.4, 0.1]), np.array([1.0, 0.0, 0.0]), np.array([0.1, -0.2, 0.3])
    unit = one(np.concatenate([axis, np.cross(p, axis)])[:, None], dead_band=0.0, inflow_loss=90.0)
    unit.step(np.array([0.5]), np.eye(3), np.zeros(3), w, np.zeros(3))
    assert unit.thrust[0] == pytest.approx(75.0 - 45.0 * axis @ np.cross(w, p), rel=1e-12)


@pytest.mark.parametrize(
    ("change", "named"),
    [({"forward": 0.0}, "forward"), ({"dead_band": 1.0}, "dead_band"), ({"time_constant": -1.0}, "time_constant")],
)
def test_thruster_figures_that_cannot_be(change, named):
    with pytest.raises(ConfigurationError, match=named):
        one(**change)


def test_table_for_an_actuator_that_is_not_there():
    with pytest.raises(ConfigurationError, match=r"thruster 'bow'.*thruster_sway"):
        thrusters.attach(models.load("uuv_puma"), {"bow": Thruster(forward=1.0, reverse=1.0)})


# --------------------------------------------------------------------------------------------------------------- trim


def at_home(name: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The vehicle in its home pose, its joints held there as if by brakes."""
    spec = models.load(name)
    model = spec.copy().compile()
    home = model.key(HOME_KEY).qpos
    for i in range(model.njnt):
        joint, address = model.joint(i), int(model.jnt_qposadr[i])
        if model.jnt_type[i] != mujoco.mjtJoint.mjJNT_FREE:
            stiff = 3e4 if model.jnt_stiffness[i] == 0.0 else model.jnt_stiffness[i]
            spec.joint(joint.name).stiffness = [stiff, 0, 0] if np.ndim(spec.joint(joint.name).stiffness) else stiff
            spec.joint(joint.name).springref = home[address]
    model = hydrodynamics.compile(spec)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(HOME_KEY).id)
    mujoco.mj_forward(model, data)
    return model, data


@pytest.mark.parametrize("name", models.available())
def test_weight_is_buoyancy_and_the_arm_of_righting_is_upright(name, within):
    model, data = at_home(name)
    density, gravity = model.body_user[0, LAYOUT.density], -model.opt.gravity[2]
    displaced, moment = 0.0, np.zeros(3)
    for b in range(1, model.nbody):
        body = unpack(model.body_user[b])
        displaced += density * body.volume
        moment += density * body.volume * (data.xpos[b] + data.xmat[b].reshape(3, 3) @ body.center_of_buoyancy)
    weighed = float(np.sum(model.body_mass))
    center = np.sum(model.body_mass[:, None] * data.xipos, axis=0) / weighed
    lever = moment / displaced - center
    within("net weight [N]", gravity * (displaced - weighed), 1e-10)  # measured 5e-13
    within("righting arm [m]", lever[:2], 1e-14)  # measured 3e-17
    assert 0.03 < lever[2] < 0.15  # stable: the centre of buoyancy above the centre of mass


@pytest.mark.parametrize("name", models.available())
def test_trimmed_vehicle_stays_where_it_is(name, within):
    model, data = at_home(name)
    hull = Vehicle.of(model).hull
    p, R = data.xpos[hull].copy(), data.xmat[hull].reshape(3, 3).copy()
    mujoco.mj_step(model, data, round(60.0 / model.opt.timestep))
    mujoco.mj_forward(model, data)
    within("drift in 60 s [m]", data.xpos[hull] - p, 5e-5)  # measured 4e-6
    within("turn in 60 s [rad]", rotation_angle(R, data.xmat[hull].reshape(3, 3)), 1e-4)  # measured 7e-6, 0.0004 deg


def test_an_untrimmed_vehicle_would_not_stay():
    """The same hold, a kilogram of lead on the bow: the figures above can fail."""
    model, data = at_home("uuv_puma")
    hull = Vehicle.of(model).hull
    data.xfrc_applied[hull, :3], data.xfrc_applied[hull, 4] = [0.0, 0.0, -9.81], 9.81 * 0.7
    mujoco.mj_step(model, data, round(60.0 / model.opt.timestep))
    assert data.xpos[hull][2] < -0.5
    assert rotation_angle(np.eye(3), data.xmat[hull].reshape(3, 3)) > np.radians(0.5)
