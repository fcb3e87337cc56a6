"""What a vehicle's plant says of an object in its jaws."""

import mujoco
import numpy as np
import pytest

from uuv.models.naming import READY_KEY, TIP_SITE
from uuv.models.site.grip_contact import let_gripper_hold
from uuv.models.tools.gripper import FINGERS, MOTOR
from uuv.own_vehicle import vehicle_spec
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.messages import Command
from uuv.sim.plant.arm_hold import ArmHold
from uuv.sim.plant.plant import Plant
from uuv.sim.water.current import Current

FORCE, RADIUS = 40.0, 0.02  # [N], [m]


def test_the_grip_force_is_felt_and_what_the_pads_hold_is_no_collision() -> None:
    spec = vehicle_spec("uuv_puma", tool="gripper")
    model = spec.copy().compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key(READY_KEY).id)
    mujoco.mj_kinematics(model, data)
    tip = data.site(TIP_SITE)
    place = tip.xpos - 0.03 * tip.xmat.reshape(3, 3)[:, 2]
    ball = spec.worldbody.add_body(name="ball", pos=place)
    ball.add_freejoint()
    ball.add_geom(size=[RADIUS, 0, 0], mass=0.2, contype=2, conaffinity=1)
    let_gripper_hold(spec, "ball")

    plant = Plant(hydrodynamics.compile(spec), current=Current([0.1, -0.05, 0.0]))
    hold = ArmHold(plant.vehicle, plant.vehicle.q_ready)
    plant.data.qpos[plant.vehicle.qpos] = plant.vehicle.q_ready
    for name in FINGERS:
        plant.data.joint(name).qpos = RADIUS + 1e-4
    plant.data.actuator(MOTOR).ctrl = -FORCE

    truth, still = plant.observe(), np.zeros(len(plant.vehicle.thruster_names))
    for _ in range(1000):
        torque = hold.torque(truth)
        plant.step(Command(time=truth.time, joint_torque=torque, thrusters=still, scan=False))
        truth = plant.observe()

    assert truth.contact_normal == pytest.approx(FORCE, rel=0.1)  # friction of the gear: 4 N
    assert not truth.collision
