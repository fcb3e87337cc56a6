"""A vehicle's names: each that is missing is named, with what there is; poses through welded
bodies.
"""

from collections.abc import Callable

import mujoco
import pytest

from uuv import models
from uuv.models.naming import find
from uuv.models.vehicle import Vehicle, body_in_body, pose_in_body
from uuv.models.water import thrusters
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError


def rename(kind: str, name: str) -> Callable[[mujoco.MjSpec], None]:
    def change(spec: mujoco.MjSpec) -> None:
        getattr(spec, kind)(name).name = "other"

    return change


def without_actuators(spec: mujoco.MjSpec) -> None:
    for actuator in list(spec.actuators):
        if actuator.name.startswith("joint"):
            spec.delete(actuator)


def fixed(spec: mujoco.MjSpec) -> None:
    spec.delete(spec.joint("hull"))
    for key in list(spec.keys):
        spec.delete(key)


def unlimited_joint(spec: mujoco.MjSpec) -> None:
    spec.joint("joint3").limited = 0


def unlimited_motor(spec: mujoco.MjSpec) -> None:
    spec.actuator("joint2").ctrllimited = 0


def thruster_on_a_joint(spec: mujoco.MjSpec) -> None:
    thruster = spec.actuator("thruster_sway")
    thruster.trntype = mujoco.mjtTrn.mjTRN_JOINT
    thruster.target = "pad"


def tip_on_the_hull(spec: mujoco.MjSpec) -> None:
    spec.site("tip").name = "old_tip"
    spec.body("hull").add_site(name="tip")


def base_on_a_joint(spec: mujoco.MjSpec) -> None:
    spec.body("arm_base").add_joint(name="rail", type=mujoco.mjtJoint.mjJNT_SLIDE, range=[-1, 1])
    for key in list(spec.keys):
        spec.delete(key)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (rename("body", "hull"), r"no body named 'hull'; the names are .*'other'.*'arm_base'"),
        (rename("body", "arm_base"), r"no body named 'arm_base'; the names are .*'hull'"),
        (rename("site", "tip"), r"no site named 'tip'; the names are .*'camera'"),
        (fixed, r"body 'hull' must have exactly one joint, a free joint"),
        (without_actuators, r"no driven joint between body 'arm_base' and site 'tip'"),
        (unlimited_joint, r"joint 'joint3' of the arm must have a range"),
        (unlimited_motor, r"actuator of joint 'joint2' must be a motor with a ctrlrange"),
        (
            thruster_on_a_joint,
            r"thruster 'thruster_sway': its actuator must be.*on a site.*trntype",
        ),
        (tip_on_the_hull, r"site 'tip' must be on the arm that starts at body 'arm_base'"),
        (base_on_a_joint, r"body 'arm_base' must be fixed to body 'hull'"),
    ],
)
def test_what_is_missing_is_named(change, said):
    spec = models.load("uuv_puma")
    change(spec)
    model = spec.compile()
    with pytest.raises(ConfigurationError, match=said):
        Vehicle.of(model)


def test_missing_camera_is_named():
    spec = models.load("uuv_puma")
    rename("site", "camera")(spec)
    with pytest.raises(ConfigurationError, match=r"no site named 'camera'; the names are .*'tip'"):
        find(spec.compile(), mujoco.mjtObj.mjOBJ_SITE, "camera")


def test_unknown_model_lists_those_there_are():
    with pytest.raises(
        ConfigurationError,
        match=r"unknown vehicle 'nautilus'; there are "
        r".*uuv_puma",
    ):
        models.load("nautilus")


def test_default_vehicle():
    model = models.load("uuv_puma").compile()
    vehicle = Vehicle.of(model)
    assert vehicle.joint_names == tuple(f"joint{i}" for i in range(1, 7))
    assert vehicle.torque_limits.tolist() == [150.0, 200.0, 120.0, 60.0, 30.0, 15.0]
    assert len(vehicle.thruster_names) == 6
    # Thrusters against MuJoCo: each at full speed in turn, the wrench on the hull read from the
    # free joint.
    hydrodynamics.install()
    data = mujoco.MjData(model)
    for column, actuator in enumerate(vehicle.thruster_actuators):
        mujoco.mj_resetData(model, data)
        data.ctrl[actuator] = data.act[model.actuator_actadr[actuator] + thrusters.SPEED] = 1.0
        mujoco.mj_forward(model, data)
        assert 300.0 * vehicle.thruster_wrench[:, column] == pytest.approx(
            data.qfrc_actuator[:6], abs=1e-12
        )


def test_poses_through_welded_bodies():
    model = models.load("uuv_puma").compile()
    data = mujoco.MjData(model)
    data.qpos[:7] = [1.0, 2.0, 3.0, 0.5, -0.1, 0.7, 0.5]
    mujoco.mj_kinematics(model, data)
    camera, hull = model.site("camera").id, model.body("hull").id
    R = data.xmat[hull].reshape(3, 3)
    X = pose_in_body(model, camera, hull)
    assert X[:3, 3] == pytest.approx(R.T @ (data.site_xpos[camera] - data.xpos[hull]), abs=1e-14)
    assert X[:3, :3] == pytest.approx(R.T @ data.site_xmat[camera].reshape(3, 3), abs=1e-14)
    with pytest.raises(ConfigurationError, match="'link1' must be fixed to body 'hull'"):
        body_in_body(model, model.body("link1").id, hull)
