"""The hover loop: nothing winds up where the thrusters run out, and the current is told from what
pushes the hull.
"""

import mujoco
import numpy as np
import pytest

from uuv import models
from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.hull.allocation import Allocation
from uuv.controllers.hull.station_keeping import StationKeeping
from uuv.models import hydrodynamics as coefficients
from uuv.models.vehicle import Vehicle
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import StateEstimate
from uuv.sim.interfaces.spatial import Array, exp_so3, log_so3, pose, quat_wxyz_from_rotation

DT = 0.02  # [s]
NONE = np.zeros(6)


@pytest.fixture(scope="module")
def parts() -> tuple[StationKeeping, Allocation, Array]:
    model = models.load("uuv_puma").compile()
    vehicle = Vehicle.of(model)
    return StationKeeping(model, ArmDynamics(model)), Allocation(vehicle), vehicle.thruster_wrench


def estimate(X_WB: Array, nu_B: Array) -> StateEstimate:
    return StateEstimate(
        time=0.0,
        X_WB=X_WB,
        v_WB_B=nu_B[:3],
        w_WB_B=nu_B[3:],
        a_WB_B=np.zeros(3),
        q=NONE,
        qd=NONE,
        tau=NONE,
    )


def run(
    parts: tuple[StationKeeping, Allocation, Array], start: Array, seconds: float, *, told: bool
) -> Array:
    """Errors (steps, 6) of position in W and attitude, from `start`, on a body of the loop's own
    inertia.
    """
    hover, allocation, B = parts
    state = hover.init()
    X = start.copy()
    nu = np.zeros(6)
    errors = []
    for _ in range(round(seconds / DT)):
        wrench = hover.step(state, estimate(X, nu), np.eye(4), np.zeros(3), NONE, DT)
        thrust = allocation.thrust(wrench)
        if told:
            state.given_B[:] = B @ thrust
        R = X[:3, :3]
        # no water: no drag
        nu = nu + DT * np.linalg.solve(hover.inertia, B @ thrust + hover.static_wrench(R))
        X[:3, 3] += DT * (R @ nu[:3])
        X[:3, :3] = R @ exp_so3(DT * nu[3:])
        errors.append(np.concatenate([X[:3, 3], log_so3(X[:3, :3])]))
    return np.array(errors)


def test_a_long_way_overshoots_less_when_the_loop_knows_what_was_withheld(parts):
    """4 m aside asks for ten times the thrust there is."""
    start = pose(p=[-4.0, 4.0, 0.0])
    informed, untold = (run(parts, start, 60.0, told=is_told) for is_told in (True, False))
    overshoot, wound_up = (np.array([e[:, 0].max(), -e[:, 1].min()]) for e in (informed, untold))
    assert np.all(overshoot < 0.6 * wound_up), (overshoot, wound_up)
    assert np.abs(informed[-1]).max() < 0.02


@pytest.mark.parametrize("axis", range(6))
def test_a_small_error_dies_away_as_a_double_pole_at_1_6_per_second(parts, axis, within):
    """(1 + w t) exp(-w t) with w = 1.6 rad/s in each of the six directions, and nothing in the
    others.

    Measured 0.047 off, for the loop steps, and expects a drag that this body has not.
    """
    error = np.zeros(6)
    error[axis] = 0.02  # [m] or [rad]
    errors = run(parts, pose(exp_so3(error[3:]), error[:3]), 4.0, told=True)
    w_t = 1.6 * DT * np.arange(1, len(errors) + 1)
    within(
        "error, relative", errors / 0.02 - np.outer((1.0 + w_t) * np.exp(-w_t), error / 0.02), 0.08
    )


def test_feedback_is_proportional_in_hull_axes_wherever_the_hull_is_to_stand(parts, rng, within):
    """1.6^2 times the error and 3.2 times its rate, accelerations of the loop's inertia beyond its
    weight.
    """
    hover, _, _ = parts
    for _ in range(20):
        X_set = pose(exp_so3(rng.uniform(-1.0, 1.0, 3)), rng.uniform(-1.0, 1.0, 3))
        error, nu, turning_W = (
            rng.uniform(-0.3, 0.3, 6),
            rng.uniform(-0.2, 0.2, 6),
            rng.uniform(-0.2, 0.2, 3),
        )
        X = X_set @ pose(exp_so3(error[3:]))
        X[:3, 3] += X[:3, :3] @ error[:3]
        wrench = hover.step(hover.init(), estimate(X, nu), X_set, np.zeros(3), NONE, DT, turning_W)
        rate = nu - np.concatenate([np.zeros(3), X[:3, :3].T @ turning_W])
        acceleration = np.linalg.solve(hover.inertia, wrench + hover.static_wrench(X[:3, :3]))
        within("acceleration [m/s^2, rad/s^2]", acceleration + 1.6**2 * error + 3.2 * rate, 1e-12)


@pytest.mark.parametrize("name", ["uuv_puma", "bluerov2_heavy_wu2018", "bluerov2_heavy_benzon2022"])
def test_the_hull_weighs_and_floats_at_its_centres(name, rng, within):
    model = models.load(name).compile()
    hull = Vehicle.of(model).hull
    R_WB = exp_so3(rng.uniform(-1.0, 1.0, 3))
    water = coefficients.unpack(model.body_user[hull])
    up = R_WB.T @ [0.0, 0.0, -model.opt.gravity[2]]
    floats = coefficients.water_density(model) * water.volume * up
    weighs = -model.body_mass[hull] * up
    moment = np.cross(water.center_of_buoyancy, floats) + np.cross(model.body_ipos[hull], weighs)
    within(
        "wrench [N, N m]",
        StationKeeping(model).static_wrench(R_WB) - [*(floats + weighs), *moment],
        1e-10,
    )


def test_nothing_changes_while_the_thrusters_suffice(parts, within):
    start = pose(exp_so3([0.02, -0.03, 0.1]), [0.1, -0.1, 0.05])
    differing = run(parts, start, 5.0, told=True) - run(parts, start, 5.0, told=False)
    within("way of the hull [m, rad]", differing, 1e-12)


@pytest.mark.parametrize("current_W", [[0.2, -0.1, 0.05], [-0.05, 0.25, -0.1], [0.0, 0.0, 0.0]])
def test_the_force_that_is_held_tells_the_current(current_W, within):
    """A vehicle in MuJoCo's water, turned and level, held for a minute by the loop's own wrench."""
    spec = models.load("bluerov2_heavy_wu2018")
    model = hydrodynamics.compile(spec)
    hydrodynamics.install()
    model.opt.wind = current_W
    data = mujoco.MjData(model)
    hover = StationKeeping(model)
    hull = model.body("hull").id
    wanted_W = pose(exp_so3([0.0, 0.0, 0.7]))
    data.qpos[3:7] = quat_wxyz_from_rotation(wanted_W[:3, :3])
    state = hover.init()
    measured = estimate(wanted_W, NONE)
    for _ in range(round(60.0 / DT)):
        R = data.xmat[hull].reshape(3, 3).copy() if data.time else wanted_W[:3, :3]
        measured = estimate(
            pose(R, data.qpos[:3]), np.concatenate([R.T @ data.qvel[:3], data.qvel[3:6]])
        )
        wrench_B = hover.step(state, measured, wanted_W, np.zeros(3), NONE, DT)
        data.qfrc_applied[:] = 0.0
        mujoco.mj_applyFT(
            model, data, R @ wrench_B[:3], R @ wrench_B[3:], data.qpos[:3], hull, data.qfrc_applied
        )
        mujoco.mj_step(model, data, nstep=round(DT / model.opt.timestep))
    within("place held [m]", data.qpos[:3], 1e-11)  # measured 6e-13
    within("current [m/s]", hover.current(state) - current_W, 5e-3)  # 1.1e-3 is taken for gain


@pytest.mark.parametrize("name", ["frequency", "damping"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, "1"])
def test_figures_that_cannot_be(name, value):
    with pytest.raises(ConfigurationError, match=f"hover {name}: "):
        StationKeeping(models.load("bluerov2_heavy").compile(), **{name: value})
