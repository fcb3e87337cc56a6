"""Joints that are held, and the keyframes of a model whose joints are held."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from uuv.models.files.holding import hold
from uuv.own_vehicle import vehicle_spec

INERTIAL = '<inertial pos="0 0 0.1" mass="1" diaginertia="0.01 0.01 0.01"/>'
TURNED = f"""<mujoco><compiler angle="radian"/><worldbody><body name="base">
  <body pos="0.1 0.2 0.3" euler="0.3 -0.2 0.5">{INERTIAL}
    <joint name="turn" axis="0 1 0" range="0.4 1.0"/>
    <body name="hand" pos="0 0 0.2">{INERTIAL}</body></body></body></worldbody></mujoco>"""
MOVING = f"""<mujoco><compiler angle="radian"/><worldbody>
  <body name="base"><freejoint name="base"/>{INERTIAL}
    <body name="mount"><body name="upper" pos="0.1 0 0">{INERTIAL}<joint name="turn" axis="0 1 0"/>
      <body name="lower" pos="0 0 0.2">{INERTIAL}<joint name="bend" axis="0 1 0"/></body></body>
    </body>
    <body name="flap" pos="-0.1 0 0">{INERTIAL}<joint name="flap" axis="0 0 1"/></body>
  </body></worldbody>
  <actuator><motor name="turn" joint="turn"/><motor name="flap" joint="flap"/>
    <motor name="bend" joint="bend"/></actuator>
  <keyframe>
    <key qpos="0 0 0 1 0 0 0 0.1 0.2 0.3" qvel="1 2 3 4 5 6 7 8 9" ctrl="0.1 0.2 0.3"/>
    <key qpos="0 0 1 1 0 0 0 0.4 0.5 0.6"/>
    <key name="home" qpos="0 0 2 1 0 0 0 0.7 0.8 0.9" qvel="0 0 0 0 0 0 0 0 5"/>
  </keyframe></mujoco>"""


def test_a_body_without_a_name_is_held_where_its_joint_has_it(within) -> None:
    spec = mujoco.MjSpec.from_string(TURNED)
    hold(spec, list(spec.joints), "for the test")
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    R = Rotation.from_euler("XYZ", [0.3, -0.2, 0.5]) * Rotation.from_euler("y", 0.4)
    within("hand", data.body("hand").xpos - R.apply([0.0, 0.0, 0.2]) - [0.1, 0.2, 0.3], 1e-12)
    assert model.body(2).name == ""


def test_each_keyframe_keeps_its_numbers_while_a_joint_is_held() -> None:
    spec = mujoco.MjSpec.from_string(MOVING)
    hold(spec, [spec.joint("flap")], "for the test")
    model = spec.compile()
    assert (model.nq, model.nv, model.nu, model.nkey) == (9, 8, 2, 3)
    assert model.key_qpos[:, 7:].tolist() == [[0.1, 0.2], [0.4, 0.5], [0.7, 0.8]]
    assert model.key_qpos[:, 2].tolist() == [0.0, 1.0, 2.0]
    assert model.key_qvel[0].tolist() == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]
    assert not np.any(model.key_qvel[1:])
    assert model.key_ctrl[0].tolist() == [0.1, 0.3]


def test_a_vehicle_with_moving_keyframes_may_lock_a_joint(tmp_path: Path) -> None:
    (tmp_path / "rov.xml").write_text(MOVING)
    (tmp_path / "rov.parts.yaml").write_text(
        "hull: base\narm_base: mount\ntip: {body: lower, pos: [0, 0, 0.2]}\n"
        "joints: {turn: 9, bend: 5}\n"
    )
    model = vehicle_spec(tmp_path / "rov.xml", computed=False).compile()
    assert "flap" not in [model.joint(j).name for j in range(model.njnt)]
    home = model.key("home").qpos
    assert home[model.joint("bend").qposadr[0]] == pytest.approx(0.8)
