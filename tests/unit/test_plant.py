"""The plant: what cannot be is said at its door, and a motion that blows up does not begin anew behind one's back."""

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest

import models
from sim import hydrodynamics
from sim.current import Current
from sim.interfaces.errors import ConfigurationError, HydrodynamicsError
from sim.interfaces.messages import Command
from sim.interfaces.spatial import pose
from sim.plant import Plant

STILL = Current((0.0, 0.0, 0.0))
REST = Command(time=0.0, joint_torque=np.zeros(6), thrusters=np.zeros(6), scan=False)


def advance(plant: Plant, steps: int) -> None:
    for _ in range(steps):
        plant.step(REST)
        plant.observe()


@pytest.mark.parametrize("steps", [0, 1, 50])
@pytest.mark.parametrize("speed", [np.nan, 1e12])
def test_a_motion_that_blows_up_is_an_error(steps, speed):
    plant = Plant(hydrodynamics.compile(models.load("uuv_puma")), current=Current((0.0, 0.0, 0.0)))
    plant.observe()
    advance(plant, steps)
    plant.data.qvel[3] = speed
    with pytest.raises(HydrodynamicsError, match=r"became unstable .* 'hull'"):
        advance(plant, 5)


def test_the_body_of_a_bad_position_is_named():
    """A free joint has seven positions for its six directions: qpos[7] is the first joint of the arm."""
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
    for name, value in change.items():
        setattr(wet.opt, name, value)
    with pytest.raises(HydrodynamicsError, match=says):
        Plant(wet, current=STILL)


def test_a_vehicle_without_coefficients_may_have_the_fluid_of_mujoco():
    spec = mujoco.MjSpec.from_string(
        '<mujoco><option density="1000"/><worldbody><body name="hull"><freejoint/><geom size=".1"/></body></worldbody>'
        "</mujoco>"
    )
    plant = Plant(hydrodynamics.compile(spec), current=STILL)
    plant.observe()
    plant.step(replace(REST, joint_torque=np.zeros(0), thrusters=np.zeros(0)))


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"model": mujoco.MjSpec()}, "expected a compiled mujoco.MjModel, got <mujoco"),
        ({"current": [0.0, 0.0, 0.0]}, r"current: expected a sim.current.Current, got \[0.0, 0.0, 0.0\]"),
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
        ({"thrusters": np.array([0.0, 0.0, np.nan, 0.0, 0.0, 0.0])}, "thruster command: every number must be finite"),
        ({"joint_torque": np.zeros(7)}, r"joint torque command .* expected shape \(6,\), got \(7,\)"),
        ({"joint_torque": np.full(6, np.inf)}, "joint torque command .* every number must be finite"),
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


def test_commands_that_are_no_plain_arrays_act_as_those():
    speeds = []
    for thrusters in (np.full(6, 1.0), [1] * 6, np.full(6, 1)):
        plant = Plant(hydrodynamics.compile(models.load("uuv_puma")), current=STILL)
        plant.observe()
        plant.step(replace(REST, thrusters=thrusters))  # pyright: ignore[reportArgumentType]
        speeds.append(plant.truth.propeller_speed.copy())
    assert np.all(speeds[0] > 0.0)
    assert np.array_equal(speeds[0], speeds[1])
    assert np.array_equal(speeds[0], speeds[2])
