"""The plant: what cannot be is said at its door, and a motion that blows up does not begin anew
behind one's back.
"""

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest

from untyped import untyped
from uuv import models
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError, HydrodynamicsError, PhysicsWarning
from uuv.sim.interfaces.messages import Command
from uuv.sim.interfaces.spatial import exp_so3, pose
from uuv.sim.plant.arm_hold import HOLD_ANGLE, ArmHold
from uuv.sim.plant.plant import Plant
from uuv.sim.water.current import Current

STILL = Current((0.0, 0.0, 0.0))
GUSTS = Current((0.0, 0.0, 0.0), gust=0.01, timestep=0.002, rng=np.random.default_rng(0))
REST = Command(time=0.0, joint_torque=np.zeros(6), thrusters=np.zeros(6), scan=False)


def advance(plant: Plant, steps: int) -> None:
    for _ in range(steps):
        plant.step(REST)
        plant.observe()


@pytest.mark.parametrize("substeps", [1, 4])
@pytest.mark.parametrize("steps", [0, 1, 50])
@pytest.mark.parametrize(
    ("what", "value"), [("qvel", np.nan), ("qvel", 1e12), ("qfrc_applied", np.inf)]
)
def test_a_motion_that_blows_up_is_an_error(substeps, steps, what, value):
    plant = Plant(hydrodynamics.compile(models.load("uuv_puma")), current=STILL, substeps=substeps)
    plant.observe()
    advance(plant, steps)
    getattr(plant.data, what)[3] = value
    with pytest.raises(HydrodynamicsError, match=r"became unstable .* 'hull'"):
        advance(plant, 5)


def test_the_body_of_a_bad_position_is_named():
    """A free joint has seven positions for its six directions: qpos[7] is the first joint of the
    arm.
    """
    plant = Plant(hydrodynamics.compile(models.load("uuv_puma")), current=STILL)
    plant.observe()
    at = int(plant.vehicle.qpos[0])
    body = plant.model.body(int(plant.model.jnt_bodyid[plant.vehicle.joints[0]])).name
    plant.data.qpos[at] = np.nan
    with pytest.raises(HydrodynamicsError, match=rf"qpos\[{at}\] \(body '{body}'\)"):
        advance(plant, 2)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"density": 1000.0}, "density 1000.0"),
        ({"solver": mujoco.mjtSolver.mjSOL_PGS}, "solver PGS"),
        ({"timestep": 5.0}, "timestep 5 s times the rate of the drag"),
    ],
)
def test_options_changed_after_compiling_are_refused(change: dict[str, Any], says):
    wet = hydrodynamics.compile(models.load("uuv_puma"))
    for name, setting in change.items():
        setattr(wet.opt, name, setting)
    with pytest.raises(HydrodynamicsError, match=says):
        Plant(wet, current=STILL)


def test_a_vehicle_without_coefficients_may_have_the_fluid_of_mujoco():
    spec = mujoco.MjSpec.from_string(
        '<mujoco><option density="1000"/><worldbody><body name="hull"><freejoint/><geom '
        'size=".1"/></body></worldbody>'
        "</mujoco>"
    )
    plant = Plant(hydrodynamics.compile(spec), current=STILL)
    plant.observe()
    plant.step(replace(REST, joint_torque=np.zeros(0), thrusters=np.zeros(0)))


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"model": mujoco.MjSpec()}, "expected a compiled mujoco.MjModel, got <mujoco"),
        (
            {"current": [0.0, 0.0, 0.0]},
            r"current: expected a uuv.sim.water.current.Current, got "
            r"\[0.0, 0.0, 0.0\]",
        ),
        ({"substeps": 0}, "substeps must be a whole number >= 1, got 0"),
        ({"substeps": -4}, "substeps must be a whole number >= 1, got -4"),
        ({"substeps": 2.0}, "substeps must be a whole number >= 1, got 2.0"),
        ({"substeps": None}, "substeps must be a whole number >= 1, got None"),
        (
            {"substeps": 2, "current": GUSTS},
            "current: its timestep must be that of the plant, 0.004 s, got 0.002 s",
        ),
        ({"X_WB": np.eye(3)}, r"X_WB: expected shape \(4, 4\), got \(3, 3\)"),
        ({"X_WB": 2.0 * np.eye(4)}, "X_WB: expected a pose"),
        ({"X_WB": pose(np.diag([1.0, 1.0, -1.0]))}, "X_WB: expected a pose"),
        ({"X_WB": np.eye(4) + np.eye(4, k=-3)}, "X_WB: expected a pose .*last row 0 0 0 1"),
        ({"X_WB": pose(p=[0.0, np.nan, 0.0])}, "X_WB: every number must be finite"),
    ],
)
def test_arguments_that_cannot_be(given: dict[str, Any], says):
    wet = hydrodynamics.compile(models.load("uuv_puma"))
    with pytest.raises(ConfigurationError, match=says):
        Plant(**{"model": wet, "current": STILL, **given})


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"thrusters": np.zeros(2)}, r"thruster command: expected shape \(6,\), got \(2,\)"),
        (
            {"thrusters": np.array([0.0, 0.0, np.nan, 0.0, 0.0, 0.0])},
            "thruster command: every number must be finite",
        ),
        (
            {"joint_torque": np.zeros(7)},
            r"joint torque command .* expected shape \(6,\), got "
            r"\(7,\)",
        ),
        (
            {"joint_torque": np.full(6, np.inf)},
            "joint torque command .* every number must be finite",
        ),
        ({"joint_torque": np.full(6, 1j)}, r"joint torque command .* expected \(6,\) numbers"),
        ({"thrusters": ["0.5"] * 6}, r"thruster command: expected \(6,\) numbers"),
    ],
)
def test_a_command_that_cannot_be_changes_nothing(change: dict[str, Any], says):
    plant = Plant(hydrodynamics.compile(models.load("uuv_puma")), current=STILL)
    plant.observe()
    with pytest.raises(ConfigurationError, match=says):
        plant.step(replace(REST, **change))
    assert not np.any(plant.truth.propeller_speed)
    assert not np.any(plant.data.ctrl)


def test_a_vehicle_without_any_water_is_told_of():
    """Such as an MJCF that MuJoCo has read, whose water is in a file beside it."""
    spec = mujoco.MjSpec.from_string(
        "<mujoco><worldbody><body name='hull'><freejoint/><geom size='.2' "
        "mass='9'/></body></worldbody></mujoco>"
    )
    with pytest.warns(
        PhysicsWarning, match="no hydrodynamic coefficients: it falls as in a vacuum"
    ):
        Plant(hydrodynamics.compile(spec), current=STILL)


def test_reset_leaves_nothing_behind():
    """After a run in gusts, a plant that is reset moves as a new one does, to the bit."""
    used = Plant(hydrodynamics.compile(models.load("uuv_puma")), current=STILL)
    used.reset(
        current=Current([0.3, 0.0, 0.0], gust=0.1, timestep=0.002, rng=np.random.default_rng(0))
    )
    commands = [
        replace(REST, thrusters=u) for u in np.random.default_rng(7).uniform(-0.8, 0.8, (100, 6))
    ]
    for command in commands:
        used.observe()
        used.step(command)

    current = Current([0.0, 0.2, 0.0])
    X_WB = pose(exp_so3([0.1, -0.2, 0.3]), [1.0, 2.0, -3.0])
    used.reset(current=current, X_WB=X_WB)
    fresh = Plant(hydrodynamics.compile(models.load("uuv_puma")), current=current, X_WB=X_WB)
    for command in commands:
        assert used.observe().time == fresh.observe().time
        for name in (
            "R_WB",
            "acceleration",
            "current_W",
            "propeller_speed",
            "q",
            "tau_drive",
            "thrust",
            "v_WB_W",
        ):
            np.testing.assert_array_equal(
                getattr(used.truth, name), getattr(fresh.truth, name), err_msg=name
            )
        used.step(command)
        fresh.step(command)
    np.testing.assert_array_equal(used.data.qpos, fresh.data.qpos)
    assert np.linalg.norm(used.truth.v_WB_W) > 0.01


def test_the_arm_is_held_while_the_hull_is_shaken():
    """By `ArmHold`, within the torques of its drives."""
    plant = Plant(hydrodynamics.compile(models.load("uuv_puma")), current=STILL)
    vehicle = plant.vehicle
    truth = plant.observe()
    hold = ArmHold(vehicle, vehicle.q_home)
    fastest = 0.0

    for thrusters in np.random.default_rng(0).choice([-1.0, 1.0], (50, 6)):
        for _ in range(50):
            plant.step(replace(REST, joint_torque=hold.torque(truth), thrusters=thrusters))
            plant.observe()
        assert np.max(np.abs(truth.q - vehicle.q_home)) < HOLD_ANGLE
        assert np.all(np.abs(truth.tau_drive) <= vehicle.torque_limits)
        fastest = max(fastest, float(np.linalg.norm(truth.w_WB_B)))
    assert fastest > 0.1


def test_commands_that_are_no_plain_arrays_act_as_those():
    speeds = []
    for thrusters in (np.full(6, 1.0), [1] * 6, np.full(6, 1)):
        plant = Plant(hydrodynamics.compile(models.load("uuv_puma")), current=STILL)
        plant.observe()
        plant.step(replace(REST, thrusters=untyped(thrusters)))
        speeds.append(plant.truth.propeller_speed.copy())
    assert np.all(speeds[0] > 0.0)
    assert np.array_equal(speeds[0], speeds[1])
    assert np.array_equal(speeds[0], speeds[2])


def pressing(substeps: int) -> Plant:
    """At 0.5 ms, in a current, the pad on a plate and the hull pressed a millimetre into a
    shelf.
    """
    spec = models.load("uuv_puma")
    spec.option.timestep = 5e-4
    plain = spec.compile()
    data = mujoco.MjData(plain)
    mujoco.mj_resetDataKeyframe(plain, data, 0)
    mujoco.mj_kinematics(plain, data)
    pad = data.geom_xpos[plain.geom("pad").id]
    below = pad - [0.0, 0.0, 0.1 + plain.geom("pad").rbound[0]]
    spec.worldbody.add_geom(
        name="plate", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1, 0.1, 0.1], pos=below
    )
    shelf = [-0.6, 0.0, -0.399 - 0.1]
    spec.worldbody.add_geom(
        name="shelf", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1, 0.1, 0.1], pos=shelf
    )
    return Plant(
        hydrodynamics.compile(spec), current=Current((0.1, -0.05, -0.1)), substeps=substeps
    )


def test_substeps_are_the_steps_of_a_finer_plant():
    """Four of them under one command, and what was touched in all four."""
    whole, fine = pressing(4), pressing(1)
    assert whole.timestep == 4.0 * fine.timestep == 2e-3
    held = replace(REST, joint_torque=np.linspace(-20.0, 20.0, 6))
    whole.observe()
    fine.observe()
    most = 0.0
    spread = 0.0
    parts = set()
    for _ in range(150):
        whole.step(held)
        normal = np.zeros(4)
        force = np.zeros((4, 3))
        collided = np.zeros(4, dtype=bool)
        for i in range(4):
            fine.step(held)
            fine.observe()
            truth_fine = fine.truth
            normal[i], force[i], collided[i] = (
                truth_fine.contact_normal,
                truth_fine.contact_force_W,
                truth_fine.collision,
            )
            assert truth_fine.contact_least == truth_fine.contact_normal == truth_fine.contact_most
        truth = whole.observe()
        assert truth.time == fine.truth.time
        for name in ("qpos", "qvel", "qacc", "qfrc_actuator"):
            assert np.array_equal(getattr(whole.data, name), getattr(fine.data, name))
        assert np.array_equal(truth.tau_friction, fine.truth.tau_friction)
        assert np.allclose(truth.contact_force_W, force.mean(axis=0), rtol=1e-12, atol=1e-12)
        assert truth.contact_normal == pytest.approx(normal.mean(), rel=1e-12)
        assert (truth.contact_least, truth.contact_most) == (normal.min(), normal.max())
        assert truth.collision is bool(collided.any())
        most = max(most, normal.max())
        spread = max(spread, np.ptp(normal))
        parts.add(int(collided.sum()))
    assert most > 10.0
    assert spread > 1.0
    assert {0, 4} < parts  # of some steps only a part was spent in collision


def test_the_truth_tells_the_damping_that_the_model_has_now():
    """As a fault changes it: the torque sensors take the friction from the truth."""
    plant = Plant(hydrodynamics.compile(models.load("uuv_puma")), current=Current(np.zeros(3)))
    before = plant.observe().joint_damping.copy()
    plant.model.dof_damping[plant.vehicle.dof[1]] *= 1.3
    expected = before * np.where(np.arange(len(before)) == 1, 1.3, 1.0)
    np.testing.assert_array_equal(plant.truth.joint_damping, expected)
