"""The drive of a gripper in the plant: it goes to an opening, and grips with a bounded force."""

from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from uuv.models.naming import READY_KEY, TIP_SITE, has_gripper
from uuv.models.site.grip_contact import let_gripper_hold
from uuv.models.tools.gripper import FINGERS
from uuv.models.tools.jaw_shape import JawShape
from uuv.own_vehicle import vehicle_spec
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import Command, JawSetpoint
from uuv.sim.plant.arm_hold import ArmHold
from uuv.sim.plant.jaw_drive import JawDrive
from uuv.sim.plant.plant import Plant
from uuv.sim.plant.truth import Truth
from uuv.sim.sensors.jaws import JawSensor
from uuv.sim.water.current import Current

FORCE, SPEED, RADIUS = 40.0, 0.02, 0.02  # [N], [m/s] of the opening, [m]


def plant_with(ball: bool) -> Plant:
    """A vehicle with a gripper, maybe with a ball between its open jaws."""
    spec = vehicle_spec("uuv_puma", tool="gripper")
    model = spec.copy().compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(READY_KEY).id)
    mujoco.mj_kinematics(model, data)
    if ball:
        tip = data.site(TIP_SITE)
        place = tip.xpos - 0.03 * tip.xmat.reshape(3, 3)[:, 2]
        body = spec.worldbody.add_body(name="ball", pos=place, gravcomp=1.0)
        body.add_freejoint()
        body.add_geom(size=[RADIUS, 0, 0], mass=0.2, contype=2, conaffinity=1)
        let_gripper_hold(spec, "ball")

    plant = Plant(hydrodynamics.compile(spec), current=Current([0.0, 0.0, 0.0]))
    plant.data.qpos[plant.vehicle.qpos] = plant.vehicle.q_ready
    for name in FINGERS:
        plant.data.joint(name).qpos = RADIUS + 7e-4
    return plant


def run(
    plant: Plant, setpoint: JawSetpoint, seconds: float, seen: Callable[[Truth], None]
) -> Truth:
    """Ask for a set point once, and hold the arm."""
    hold = ArmHold(plant.vehicle, plant.vehicle.q_ready)
    still = np.zeros(len(plant.vehicle.thruster_names))
    truth = plant.observe()
    plant.jaws.follow(setpoint)
    for _ in range(round(seconds / plant.timestep)):
        torque = hold.torque(truth)
        plant.step(Command(time=truth.time, joint_torque=torque, thrusters=still, scan=False))
        truth = plant.observe()
        seen(truth)
    return truth


def test_free_jaws_reach_an_opening_at_the_set_speed_and_stay() -> None:
    plant = plant_with(ball=False)
    speeds: list[float] = []
    asked = JawSetpoint(opening=0.09, speed=SPEED, force=FORCE)
    truth = run(plant, asked, 3.0, lambda seen: speeds.append(float(seen.jaws.speed[0])))

    assert truth.jaws.opening[0] == pytest.approx(0.09, abs=5e-4)
    assert max(speeds) == pytest.approx(SPEED, rel=0.1)
    assert truth.jaws.force[0] == 0.0  # the spindle holds them


def test_jaws_press_what_they_meet_with_the_set_force_and_never_far_above_it() -> None:
    plant = plant_with(ball=True)
    pressed: list[float] = []
    asked = JawSetpoint(opening=0.0, speed=SPEED, force=FORCE)
    truth = run(plant, asked, 3.0, lambda seen: pressed.append(seen.contact_normal))

    assert truth.jaws.opening[0] == pytest.approx(2.0 * RADIUS, abs=1e-3)
    assert truth.jaws.force[0] == pytest.approx(-FORCE)
    assert truth.contact_normal == pytest.approx(FORCE, rel=0.1)
    assert max(pressed) < 1.5 * FORCE

    sensor = JawSensor(force_bias=0.0)
    _, reading = sensor.step(sensor.init(np.random.default_rng(3)), truth)
    assert reading.opening == pytest.approx(2.0 * RADIUS, abs=1e-3)
    assert reading.force == pytest.approx(FORCE, rel=0.1)


def test_the_last_set_point_holds_and_a_reset_forgets_it() -> None:
    plant = plant_with(ball=False)
    openings: list[float] = []

    def see(truth: Truth) -> None:
        openings.append(float(truth.jaws.opening[0]))

    # 60 mm are reached, not passed, although nothing is sent again.
    run(plant, JawSetpoint(opening=0.06, speed=SPEED, force=FORCE), 4.0, see)
    assert max(openings) < 0.0605
    assert openings[-1] == pytest.approx(0.06, abs=5e-4)

    run(plant, JawSetpoint(opening=0.09, speed=SPEED, force=FORCE), 0.5, see)
    plant.reset(current=Current([0.0, 0.0, 0.0]))
    assert not plant.jaws.memory.any()
    assert plant.observe().jaws.force[0] == 0.0


def test_an_arm_joint_whose_motor_is_called_gripper_is_no_gripper() -> None:
    spec = vehicle_spec("uuv_puma")
    motor = spec.actuators[-1]
    motor.name = "gripper"
    model = hydrodynamics.compile(spec)
    assert not has_gripper(model)

    data = mujoco.MjData(model)
    drive = JawDrive.of(model, data, 0.002)
    assert not len(drive.jaws.opening)
    with pytest.raises(ConfigurationError, match="gripper: this vehicle has none"):
        drive.follow(JawSetpoint(opening=0.05, speed=SPEED, force=FORCE))
    with pytest.raises(ConfigurationError, match="the work needs driven jaws"):
        JawShape.of(model)


def test_a_set_point_beyond_the_gripper_and_a_vehicle_without_one_are_refused() -> None:
    plant = plant_with(ball=False)
    with pytest.raises(ConfigurationError, match=r"jaws: opening \[m\]"):
        plant.jaws.follow(JawSetpoint(opening=0.2, speed=SPEED, force=FORCE))
    with pytest.raises(ConfigurationError, match=r"jaws: force \[N\]"):
        plant.jaws.follow(JawSetpoint(opening=0.05, speed=SPEED, force=1e3))

    bare = Plant(hydrodynamics.compile(vehicle_spec("uuv_puma")), current=Current([0.0, 0.0, 0.0]))
    assert not len(bare.observe().jaws.opening)
    with pytest.raises(ConfigurationError, match="gripper: this vehicle has none"):
        bare.jaws.follow(JawSetpoint(opening=0.05, speed=SPEED, force=FORCE))
