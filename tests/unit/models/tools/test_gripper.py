"""Gripper: the motor's speed and force, the end stops, and the fingers' equal travel."""

import mujoco
import numpy as np
import pytest

from uuv.models.tools.gripper import FINGERS, MOTOR, Gripper, add_gripper
from uuv.sim.interfaces.errors import ConfigurationError

TURNED = np.array([0.5, -0.1, 0.7, 0.5]) / np.linalg.norm([0.5, -0.1, 0.7, 0.5])


def gripper_alone(gripper: Gripper) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """A gripper on a fixed hand, turned somehow, without weight."""
    spec = mujoco.MjSpec()
    spec.option.timestep = 0.002
    spec.option.gravity = [0.0, 0.0, 0.0]
    hand = spec.worldbody.add_body(name="hand", pos=[0.3, -0.2, 0.5], quat=TURNED)
    tip = hand.add_site(name="tip")
    add_gripper(spec, hand, np.array([0.01, 0.02, 0.03]), TURNED, tip, gripper)
    model = spec.compile()
    return model, mujoco.MjData(model)


@pytest.mark.parametrize("force", [100.0, 40.0])
def test_the_jaws_open_at_the_motor_s_speed_up_to_their_stops(force: float) -> None:
    gripper = Gripper()
    model, data = gripper_alone(gripper)
    motor = data.actuator(MOTOR)
    motor.ctrl = force
    mujoco.mj_step(model, data, nstep=round(10.0 * gripper.time_constant / 0.002))

    # Its speed falls with the force that is left after friction.
    expected = gripper.speed * (force - gripper.loss) / (gripper.force - gripper.loss)
    assert motor.velocity == pytest.approx(expected, rel=2e-3)  # measured 5e-4

    mujoco.mj_step(model, data, nstep=round(2.5 * gripper.opening / expected / 0.002))
    assert motor.length == pytest.approx(gripper.opening, abs=5e-4)  # stops give 0.12 mm
    motor.ctrl = -force
    mujoco.mj_step(model, data, nstep=round(2.5 * gripper.opening / expected / 0.002))
    assert motor.length == pytest.approx(0.0, abs=5e-4)


def test_less_force_than_friction_moves_nothing() -> None:
    gripper = Gripper()
    model, data = gripper_alone(gripper)
    data.joint(FINGERS[0]).qpos = data.joint(FINGERS[1]).qpos = 0.02
    data.actuator(MOTOR).ctrl = 0.9 * gripper.loss
    mujoco.mj_step(model, data, nstep=1000)
    # measured 3e-5: 2 s at the creep of the gear's friction
    assert data.actuator(MOTOR).length == pytest.approx(0.04, abs=3e-4)

    data.actuator(MOTOR).ctrl = 1.5 * gripper.loss
    mujoco.mj_step(model, data, nstep=1000)
    assert data.actuator(MOTOR).length > 0.0405


def test_the_fingers_move_alike_under_a_load_on_one_of_them() -> None:
    model, data = gripper_alone(Gripper())
    data.actuator(MOTOR).ctrl = 60.0
    data.body(FINGERS[0]).xfrc_applied[:3] = -20.0 * data.body("hand").xmat.reshape(3, 3)[:, 0]
    mujoco.mj_step(model, data, nstep=500)
    left, right = (float(data.joint(name).qpos[0]) for name in FINGERS)
    assert left > 0.01
    assert left == pytest.approx(right, abs=1e-4)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"opening": 0.0}, "gripper: opening"),
        ({"speed": -1.0}, "gripper: speed"),
        ({"time_constant": 0.0}, "gripper: time_constant"),
        ({"mass": float("nan")}, "gripper: mass"),
        ({"loss": -1.0}, "gripper: loss"),
        ({"loss": 100.0}, "loss must be less than its force 100 N, got 100 N"),
    ],
)
def test_a_gripper_that_cannot_close_is_refused(changed: dict, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        Gripper(**changed)
