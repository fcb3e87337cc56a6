"""Tools by their drawings: three orthogonal contacts of a nest, and the water that a tool
displaces.
"""

import mujoco
import numpy as np
import pytest

from uuv import models
from uuv.models import hydrodynamics
from uuv.models.naming import PAD_BODY, TIP_SITE, TOOL_GEOM
from uuv.models.tools import attachment, sampler, touch_rig
from uuv.models.tools.sampler import BOX, CORER, SAMPLER
from uuv.models.tools.tools import TOOLS
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import exp_so3


def test_a_nest_holds_a_ball_by_three_orthogonal_contacts() -> None:
    z = exp_so3([0.4, 0.3, 0.0])[:, 2]
    spec = mujoco.MjSpec()
    touch_rig.add_nests(spec, [[0.1, 0.2, 0.3], [1.0, 0.0, 0.0]], np.vstack([z, [0.0, 0.0, 1.0]]))
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for k, (p, axis) in enumerate(
        (((0.1, 0.2, 0.3), z), ((1.0, 0.0, 0.0), np.array([0.0, 0.0, 1.0])))
    ):
        balls = data.geom_xpos[model.geom_bodyid == model.body(f"nest{k}").id] - p
        assert len(balls) == 3
        normals = balls / (touch_rig.BALL + touch_rig.SEAT)
        np.testing.assert_allclose(normals @ normals.T, np.eye(3), atol=1e-12)
        np.testing.assert_allclose(normals @ axis, -np.sqrt(1.0 / 3.0))
        apart = np.linalg.norm(balls - np.roll(balls, 1, axis=0), axis=1)
        assert np.all(apart > 2.0 * touch_rig.SEAT)  # they clear each other, just
        assert np.all(apart < 2.02 * touch_rig.SEAT)
    assert np.all((model.geom_rgba >= 0.0) & (model.geom_rgba <= 1.0))
    assert np.all(model.geom_condim == 1)


def test_a_pin_alone_is_felt() -> None:
    spec = models.load("uuv_puma")
    p_tip = spec.site(TIP_SITE).pos.copy()
    weight = spec.copy().compile().body_mass.sum()
    touch_rig.add_pin(spec)
    model = spec.compile()
    assert model.body_mass.sum() == pytest.approx(weight)
    pin = model.geom(TOOL_GEOM)
    np.testing.assert_allclose(pin.pos, p_tip)
    assert pin.size[0] == touch_rig.BALL
    link = model.site(TIP_SITE).bodyid[0]
    near = [
        i
        for i in range(model.ngeom)
        if model.geom_bodyid[i] == link or model.body_parentid[model.geom_bodyid[i]] == link
    ]
    assert len(near) > 1
    felt = [i for i in near if model.geom_contype[i] or model.geom_conaffinity[i]]
    assert felt == [pin.id]
    assert (pin.contype[0], pin.conaffinity[0], pin.condim[0]) == (1, 2, 1)
    assert model.geom_rgba[pin.id].min() >= 0.0
    assert model.geom_rgba[pin.id].max() <= 1.0


@pytest.mark.parametrize("tool", [SAMPLER, CORER, BOX], ids=["sampler", "corer", "box"])
def test_a_tool_displaces_its_own_volume_and_ends_at_the_tip(tool) -> None:
    spec = models.load("uuv_puma")
    pad = spec.body(PAD_BODY)
    p_pad = pad.pos.copy()
    axis = np.array(pad.joints[0].axis)
    R = np.empty(9)
    mujoco.mju_quat2Mat(R, pad.quat)
    along = R.reshape(3, 3) @ axis
    water = sampler.fit(spec, tool)[PAD_BODY]
    if tool is BOX:
        volume = tool.width * tool.breadth * tool.length
    else:  # a dome is counted as no cylinder: the part before it
        volume = np.pi * tool.radius**2 * (tool.length - (tool.radius if tool.domed else 0.0))
    assert water.volume == pytest.approx(volume)
    np.testing.assert_allclose(
        water.center_of_buoyancy / np.linalg.norm(water.center_of_buoyancy), axis, atol=1e-12
    )
    np.testing.assert_allclose(spec.site(TIP_SITE).pos, p_pad + tool.length * along, atol=1e-12)
    model = spec.compile()
    body = model.body(PAD_BODY)
    assert body.mass[0] == pytest.approx(tool.mass)
    np.testing.assert_allclose(body.ipos, 0.5 * tool.length * axis)
    # Three springs across one another, alike.
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    joints = [model.joint(name).id for name in ("mount_x", "mount_y", "pad")]
    axes = data.xaxis[joints]
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(model.jnt_stiffness[joints], sampler.STIFFNESS)
    low, high = model.jnt_range[joints].T
    assert np.all(low < 0.0)
    assert np.all(high > 0.0)
    np.testing.assert_allclose(low[:2], -high[:2])
    face = data.site("pad_face").xpos
    np.testing.assert_allclose(face, data.site(TIP_SITE).xpos, atol=1e-9)
    geom = model.geom(TOOL_GEOM).id
    tip = data.geom_xpos[geom] + 0.5 * tool.length * axes[2] if tool is BOX else face
    np.testing.assert_allclose(tip, face, atol=1e-9)
    assert np.all((model.geom_rgba[geom] >= 0.0) & (model.geom_rgba[geom] <= 1.0))


@pytest.mark.parametrize("name", TOOLS.names())
@pytest.mark.parametrize("vehicle", ["uuv_puma_side", "bluerov2_heavy_alpha5"])
def test_a_tool_by_name_is_put_on_any_arm_and_leaves_the_trim(vehicle: str, name: str) -> None:
    spec = models.load(vehicle)
    before, tip = weight_and_moment(spec), tip_of(spec)
    tool = TOOLS.load(name)
    attachment.attach(spec, tool)
    after, moved = weight_and_moment(spec), tip_of(spec)
    np.testing.assert_allclose(after, before, atol=1e-9)
    np.testing.assert_allclose(moved[1], tip[1], atol=1e-9)  # the axes stay
    along = moved[0] - tip[0]
    # along the tool
    np.testing.assert_allclose(along - (along @ tip[1][:, 2]) * tip[1][:, 2], 0.0, atol=1e-9)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    geom = model.geom(TOOL_GEOM).id
    R_WG = moved[1].T @ data.geom_xmat[geom].reshape(3, 3)
    middle = moved[1].T @ (data.geom_xpos[geom] - moved[0])
    # its end is at the tip
    assert middle[2] + support(model, geom, R_WG) == pytest.approx(0.0, abs=1e-9)
    assert tool.contact.most_force == pytest.approx(
        model.jnt_stiffness.reshape(model.njnt, -1)[model.joint("pad").id, 0]
        * -model.joint("pad").range[0]
    )


def weight_and_moment(spec: mujoco.MjSpec) -> np.ndarray:
    """Weight less lift [kg], and its moment [kg m] about W's origin, at home: by MuJoCo's centres
    and by hand.
    """
    model = spec.copy().compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    mujoco.mj_forward(model, data)
    total = float(model.body_mass.sum()) * np.array([1.0, *data.subtree_com[1]])
    for body, water in hydrodynamics.attached(spec).items():
        frame = data.body(body)
        center = frame.xpos + frame.xmat.reshape(3, 3) @ water.center_of_buoyancy
        total -= hydrodynamics.density_of(spec) * water.volume * np.array([1.0, *center])
    return total


def tip_of(spec: mujoco.MjSpec) -> tuple[np.ndarray, np.ndarray]:
    """Place (3,) and axes (3, 3) of the tip in W at qpos0."""
    model = spec.copy().compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    tip = data.site(TIP_SITE)
    return tip.xpos.copy(), tip.xmat.reshape(3, 3).copy()


def support(model: mujoco.MjModel, geom: int, R: np.ndarray) -> float:
    """How far [m] a geom, turned by R, reaches along z from its middle."""
    size = model.geom_size[geom]
    kinds = mujoco.mjtGeom
    match kinds(int(model.geom_type[geom])):
        case kinds.mjGEOM_SPHERE:
            return float(size[0])
        case kinds.mjGEOM_CAPSULE:
            return float(size[0] + size[1] * abs(R[2, 2]))
        case kinds.mjGEOM_CYLINDER:
            return float(size[1] * abs(R[2, 2]))
        case _:
            return float(np.abs(R[2]) @ size)


def test_jaws_hold_their_opening_and_close_on_command() -> None:
    spec = models.load("bluerov2_heavy_alpha5")
    attachment.attach(spec, TOOLS.load("jaws"))
    model = spec.compile()
    model.opt.gravity[:] = 0.0
    data = mujoco.MjData(model)
    left, right = (model.joint(name).qposadr[0] for name in ("jaw_left", "jaw_right"))
    mujoco.mj_step(model, data, nstep=200)
    assert abs(data.qpos[left]) < 1e-4
    data.actuator("jaws").ctrl = -20.0  # [N] closes: against the spring of each finger, 2 kN/m
    mujoco.mj_step(model, data, nstep=1000)
    assert data.qpos[left] == pytest.approx(-20.0 / 2e3, rel=1e-3)
    assert data.qpos[right] == pytest.approx(data.qpos[left], abs=1e-5)


def test_a_tool_needs_a_tip() -> None:
    with pytest.raises(ConfigurationError, match="needs a site 'tip'"):
        attachment.attach(models.load("bluerov2_heavy"), TOOLS.load("pad"))
