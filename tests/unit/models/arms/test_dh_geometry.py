"""Arms as DH rows, read from MJCF and put back, against MuJoCo's own kinematics."""

import mujoco
import numpy as np
import pytest

from uuv import models
from uuv.models.arms import dh_geometry
from uuv.models.arms.serial_arm import SerialArm
from uuv.models.vehicles import uuv_puma
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, exp_so3, inverse, pose, quat_wxyz_from_rotation


def random_arm(rng: np.random.Generator, n: int = 6) -> mujoco.MjSpec:
    """Hinges anywhere and any way round, some parallel or nearly, references, fixed bodies between,
    a tool body.
    """
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    body = spec.worldbody.add_body(
        name="base", pos=rng.uniform(-1, 1, 3), quat=rng.standard_normal(4)
    )
    for i in range(n):
        if rng.random() < 0.3:
            body = body.add_body(
                name=f"spacer{i}", pos=rng.uniform(-0.3, 0.3, 3), quat=rng.standard_normal(4)
            )
        tilt = rng.choice([0.0, 1e-3, 1.0]) * rng.standard_normal(3)
        turn = quat_wxyz_from_rotation(exp_so3(tilt))
        body = body.add_body(name=f"link{i}", pos=rng.uniform(-0.5, 0.5, 3), quat=turn)
        body.add_joint(
            name=f"j{i}", axis=[0, 0, 1], pos=rng.uniform(-0.1, 0.1, 3), ref=rng.choice([0.0, 0.4])
        )
        body.add_geom(size=[0.05, 0.05, 0.05], mass=1.0)
    tool = body.add_body(name="tool", pos=[0.0, 0.1, 0.2], quat=rng.standard_normal(4))
    tool.add_site(name="tip", pos=[0.05, 0.0, 0.1], quat=rng.standard_normal(4))
    return spec


def tip_by_mujoco(model: mujoco.MjModel, arm: SerialArm, q: Array) -> Array:
    data = mujoco.MjData(model)
    for name, angle in zip(arm.joint_names, q, strict=True):
        data.joint(name).qpos = angle
    mujoco.mj_kinematics(model, data)
    base, tip = data.body("base"), data.site("tip")
    X_WA = pose(base.xmat.reshape(3, 3), base.xpos)
    return inverse(X_WA) @ pose(tip.xmat.reshape(3, 3), tip.xpos)


def test_read_is_the_arm(rng, within):
    for _ in range(10):
        model = random_arm(rng, int(rng.integers(1, 8))).compile()
        arm = dh_geometry.read(model, "base", "tip")
        for q in rng.uniform(-3, 3, (5, arm.n)):
            within("tip [m, 1]", arm.flange([q])[0] - tip_by_mujoco(model, arm, q), 1e-13)  # 1e-14


def test_moved_arm_is_the_other_arm(rng, within):
    for _ in range(10):
        spec = random_arm(rng)
        old = dh_geometry.read(spec.compile(), "base", "tip")
        new = dh_geometry.with_errors(old, rng)
        dh_geometry.move(spec, old, new, "base")
        model = spec.compile()
        moved = 0.0
        for q in rng.uniform(-3, 3, (5, old.n)):
            within("tip [m, 1]", new.flange([q])[0] - tip_by_mujoco(model, old, q), 1e-13)
            moved = max(moved, float(np.linalg.norm((new.flange([q]) - old.flange([q]))[0, :3, 3])))
        assert 1e-3 < moved < 0.2


def test_the_vehicle_is_its_published_table(within):
    model = models.load("uuv_puma").compile()
    arm = dh_geometry.read(model, "arm_base", "tip", exclude=["pad"])
    published = SerialArm.from_dh(uuv_puma.DH)
    q = np.random.default_rng(0).uniform(arm.limits[:, 0], arm.limits[:, 1], (20, 6))
    within("tip [m, 1]", arm.flange(q) - published.flange(q), 1e-14)


def test_what_rides_on_the_links_rides_along(within):
    """Inertia, and the pad behind the tip; the hull and its thrusters stay."""
    spec = models.load("uuv_puma")
    before = spec.compile()
    old = dh_geometry.read(before, "arm_base", "tip", exclude=["pad"])
    new = dh_geometry.with_errors(old, np.random.default_rng(7))
    dh_geometry.move(spec, old, new, "arm_base")
    after = spec.compile()
    within("inertia [kg m^2]", after.body_inertia - before.body_inertia, 1e-15)
    within("centres of mass in the links [m]", after.body_ipos - before.body_ipos, 1e-15)
    data = [mujoco.MjData(model) for model in (before, after)]
    for model, state in zip((before, after), data, strict=True):
        mujoco.mj_kinematics(model, state)
    apart = [state.site("tip").xpos - state.site("pad_face").xpos for state in data]
    within("tip to pad's face [m]", np.subtract(*apart), 1e-12)
    for name in ("surge_left", "heave_right"):
        site = f"thruster_{name}"
        within("thruster [m]", data[0].site(site).xpos - data[1].site(site).xpos, 1e-15)


def test_refusals():
    spec = mujoco.MjSpec.from_string(
        """<mujoco><worldbody><body name="base">
        <body name="a"><joint name="slide" type="slide"/><geom size=".1"/>
        <body name="b"><joint name="x" axis="1 0 0"/><joint name="y" axis="0 1 0"/><geom size=".1"/>
          <site name="tip"/>
        </body></body><site name="near"/></body></worldbody></mujoco>"""
    )
    model = spec.compile()
    with pytest.raises(ConfigurationError, match="'slide': must be a hinge, as DH rows are read"):
        dh_geometry.read(model, "base", "tip")
    with pytest.raises(ConfigurationError, match="no joint between"):
        dh_geometry.read(model, "base", "near")
    with pytest.raises(ConfigurationError, match="has no site named 'top'"):
        dh_geometry.read(model, "base", "top")
    arm = dh_geometry.read(model, "a", "tip")
    with pytest.raises(ConfigurationError, match="body of its own"):
        dh_geometry.move(spec, arm, arm, "a")
    other = dh_geometry.read(models.load("uuv_puma").compile(), "arm_base", "tip", exclude=["pad"])
    with pytest.raises(ConfigurationError, match="cannot be moved"):
        dh_geometry.move(spec, arm, other, "a")
