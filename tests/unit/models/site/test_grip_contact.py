"""Contact of a gripper: creep, stiffness and grip force against their closed forms."""

import mujoco
import numpy as np
import pytest

from uuv.models.site.grip_contact import CREEP, STEPS, STIFFNESS, GripContact, let_gripper_hold
from uuv.models.tools.gripper import FINGERS, MOTOR, PADS, Gripper, add_gripper
from uuv.sim.interfaces.errors import ConfigurationError

TURNED = np.array([0.6, -0.3, 0.5, 0.55]) / np.linalg.norm([0.6, -0.3, 0.5, 0.55])
FORCE = 40.0  # [N]
MASS = 1.5  # [kg]
RADIUS = 0.02  # [m]


def scene(gripper: Gripper | None = None, *, timestep: float = 0.002) -> mujoco.MjSpec:
    """A ball without weight between the open jaws of a fixed gripper."""
    gripper = gripper or Gripper()
    spec = mujoco.MjSpec()
    spec.option.timestep = timestep
    spec.option.gravity = [0.0, 0.0, 0.0]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    hand = spec.worldbody.add_body(name="hand", pos=[0.3, -0.2, 0.5], quat=TURNED)
    add_gripper(
        spec, hand, np.zeros(3), np.array([1.0, 0, 0, 0]), hand.add_site(name="tip"), gripper
    )
    R = np.empty(9)
    mujoco.mju_quat2Mat(R, TURNED)
    along = R.reshape(3, 3)[:, 2]
    ball = spec.worldbody.add_body(name="ball", pos=hand.pos + (gripper.length - 0.03) * along)
    ball.add_freejoint()
    ball.add_geom(size=[RADIUS, 0, 0], mass=MASS, contype=2, conaffinity=1)
    return spec


def closed(spec: mujoco.MjSpec) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The scene after eight seconds in which the jaws have closed and friction has crept."""
    model = spec.compile()
    data = mujoco.MjData(model)
    for name in FINGERS:
        data.joint(name).qpos = RADIUS + 1e-4
    data.actuator(MOTOR).ctrl = -FORCE
    mujoco.mj_step(model, data, nstep=round(8.0 / model.opt.timestep))
    return model, data


def weight_of(model: mujoco.MjModel) -> float:
    """Inverse weight [1/kg] of a finger and the ball."""
    return float(sum(model.body(name).invweight0[0] for name in (FINGERS[0], "ball")))


@pytest.mark.parametrize("timestep", [0.001, 0.002])
def test_creep_stiffness_and_grip_force_are_those_of_the_closed_forms(timestep: float) -> None:
    spec = scene(timestep=timestep)
    let_gripper_hold(spec, "ball")
    model, data = closed(spec)
    contact = GripContact(
        time=float(model.pair_solref[0, 0]),
        impedance=float(model.pair_solimp[0, 0]),
        inverse_weight=weight_of(model),
    )
    assert contact.time >= STEPS * timestep
    assert contact.stiffness == pytest.approx(STIFFNESS, rel=1e-6)

    # Each pad is pressed in by the motor's force.
    wrench = np.empty(6)
    mujoco.mj_contactForce(model, data, 0, wrench)
    assert data.ncon == 2
    assert wrench[0] == pytest.approx(FORCE, rel=1e-3)  # measured 2e-5
    assert -data.contact.dist[0] == pytest.approx(FORCE / STIFFNESS, rel=1e-3)

    # Under a load across the jaws, half of which each pad bears.
    R = data.body("hand").xmat.reshape(3, 3)
    load = 15.0
    data.body("ball").xfrc_applied[:3] = load * R[:, 1]
    mujoco.mj_step(model, data, nstep=round(0.5 / timestep))
    begin = data.body("ball").xpos.copy()
    mujoco.mj_step(model, data, nstep=round(1.0 / timestep))
    moved = R.T @ (data.body("ball").xpos - begin)
    expected = contact.creep(0.5 * load, model.opt.impratio)
    assert moved[1] == pytest.approx(expected, rel=5e-3)  # measured 5e-4
    assert moved[1] < CREEP


def test_a_light_body_stays_between_the_jaws_of_a_heavy_vehicle_that_shakes() -> None:
    """Against the solver's usual tolerance, which the vehicle's inertia makes a loose one."""
    spec = scene()
    box = spec.body("ball")
    box.quat = TURNED
    box.geoms[0].type = mujoco.mjtGeom.mjGEOM_BOX
    box.geoms[0].size = [RADIUS, 0.025, 0.02]
    box.geoms[0].mass = 0.25
    hull = spec.worldbody.add_body(name="hull", pos=[5.0, 0.0, 0.0])
    hull.add_freejoint()
    hull.add_geom(size=[0.5, 0.0, 0.0], mass=3000.0)
    let_gripper_hold(spec, "ball")

    def fastest(tolerance: float) -> float:
        """Largest angular rate [rad/s] of the box, with fingers that shake."""
        model, data = closed(spec)
        model.opt.tolerance = tolerance
        rng = np.random.default_rng(0)
        spins = []
        for k in range(2000):
            t = k * model.opt.timestep
            push = 8.0 * np.sin([2.0 * t, 3.0 * t + 1.5, 1.3 * t + 1.0])
            data.body("ball").xfrc_applied[:3] = push
            data.body(FINGERS[0]).xfrc_applied[:3] = 20.0 * rng.standard_normal(3)
            mujoco.mj_step(model, data)
            spins.append(np.abs(data.body("ball").cvel[:3]).max())
        return max(spins)

    tolerance = spec.option.tolerance
    assert tolerance < 1e-10
    assert fastest(tolerance) == pytest.approx(fastest(0.0), rel=0.1)
    assert fastest(1e-8) > 10.0 * fastest(tolerance)


def test_the_creep_allowed_sets_impratio_and_elliptic_cones() -> None:
    ratios = []
    for creep in (1e-4, 1e-5):
        spec = scene()
        let_gripper_hold(spec, "ball", creep=creep)
        assert spec.option.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
        ratios.append(spec.option.impratio)
    assert ratios[1] == pytest.approx(10.0 * ratios[0])
    assert ratios[0] > 1.0


def test_a_larger_impratio_stays_and_a_pyramid_s_does_not() -> None:
    spec = scene()
    spec.option.cone, spec.option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, 1e5
    let_gripper_hold(spec, "ball")
    assert spec.option.impratio == 1e5
    spec = scene()
    spec.option.cone, spec.option.impratio = mujoco.mjtCone.mjCONE_PYRAMIDAL, 1e5
    let_gripper_hold(spec, "ball")
    assert spec.option.impratio < 1e4


def test_a_contact_that_the_scene_has_already_is_replaced() -> None:
    spec = scene()
    let_gripper_hold(spec, "ball", stiffness=1e4)
    let_gripper_hold(spec, "ball")
    model = spec.compile()
    assert model.npair == len(PADS)
    assert closed(spec)[1].ncon == 2


def test_soft_pads_take_a_longer_time_and_hard_ones_a_harder_impedance() -> None:
    soft = GripContact.of(2.0, 0.002, 1e4)
    hard = GripContact.of(2.0, 0.002, 1e7)
    assert soft.stiffness == pytest.approx(1e4)
    assert hard.stiffness == pytest.approx(1e7)
    assert soft.time > STEPS * 0.002
    assert hard.time == STEPS * 0.002
    assert soft.impedance < hard.impedance


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"body": "stone"}, "no body 'stone'"),
        ({"body": "hand"}, "body 'hand' has no geom that touches"),
        ({"creep": 0.0}, r"creep \[m/s\]"),
        ({"stiffness": -1.0}, r"stiffness \[N/m\]"),
    ],
)
def test_what_cannot_be_gripped_is_refused(changes: dict, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        let_gripper_hold(scene(), **{"body": "ball", **changes})


def test_a_fixed_body_and_a_scene_without_a_gripper_are_refused() -> None:
    spec = scene()
    spec.worldbody.add_body(name="post").add_geom(size=[0.01, 0, 0])
    with pytest.raises(ConfigurationError, match="'post' has no joint"):
        let_gripper_hold(spec, "post")

    spec = mujoco.MjSpec()
    ball = spec.worldbody.add_body(name="ball")
    ball.add_freejoint()
    ball.add_geom(size=[0.01, 0, 0])
    with pytest.raises(ConfigurationError, match="no gripper; give a vehicle tool='gripper'"):
        let_gripper_hold(spec, "ball")


def test_a_timestep_at_which_the_mount_shakes_the_object_out_is_refused() -> None:
    light = Gripper(mass=0.2)
    with pytest.raises(ConfigurationError, match=r"at most 0.002 s .* got 0.004 s"):
        let_gripper_hold(scene(light, timestep=0.004), "ball")
    let_gripper_hold(scene(light, timestep=0.002), "ball")
