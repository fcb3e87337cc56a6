"""Perturbations of a scenario: what the plant then is, against its own compiled numbers and a press
on the pad.
"""

from dataclasses import is_dataclass, replace

import mujoco
import numpy as np
import pytest

from uuv import models
from uuv.assembly import assemble
from uuv.jobs import clean_barrel
from uuv.models import hydrodynamics
from uuv.models.site.sliding_contact import FRICTION_TIME, LONGEST, let_tool_slide
from uuv.models.vehicle import Vehicle
from uuv.models.water import thrusters
from uuv.perturbations import pad
from uuv.perturbations.pad import Pad
from uuv.perturbations.perturbation import perturb
from uuv.perturbations.sensing import WanderingVision
from uuv.perturbations.vehicle import Gears, Payload, ThrusterSpread, Water
from uuv.scenario import Sensing
from uuv.sim import hydrodynamics as hydrodynamics_of_plant
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.sensors import proprioception


def test_nominal_changes_nothing():
    spec = models.load("uuv_puma")
    before = spec.compile()
    nothing = [Water(), Payload(), ThrusterSpread(), Gears(), Pad()]
    assert perturb(spec, nothing) == {}
    after = spec.compile()
    assert np.array_equal(before.body_user, after.body_user)
    assert np.array_equal(before.actuator_user, after.actuator_user)
    assert np.array_equal(before.body_mass, after.body_mass)
    assert np.array_equal(before.dof_damping, after.dof_damping)


def test_sensors_of_a_job_that_varies_nothing_are_the_ones_that_come_by_default():
    _, torque, _, _, vision = Sensing().proprioception()
    assert vision == proprioception.VisionDrift()
    assert torque == proprioception.JointTorqueSensors()


def test_wandering_vision_wanders_as_said_and_no_other_sensor_changes():
    """Assembled: white noise, rate and delay of the job stay, and so do its other sensors."""
    plain = assemble(clean_barrel()).parts.sensors
    wandering = assemble(
        replace(clean_barrel(), perturbations=(WanderingVision(sigma=3e-3, time=60.0),))
    ).parts.sensors
    for sensor, other in zip(plain, wandering, strict=True):
        if isinstance(sensor, proprioception.VisionDrift):
            assert other == replace(sensor, bias=3e-3, bias_time=60.0)
        elif is_dataclass(sensor):
            assert other == sensor
    with pytest.raises(ConfigurationError, match="WanderingVision sigma"):
        WanderingVision(sigma=-1.0)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_each_coefficient_is_drawn_by_itself_within_its_spread(seed):
    plain, spec = models.load("uuv_puma"), models.load("uuv_puma")
    perturb(spec, [Water(spread=0.3)], seed)
    ratios = []
    old = hydrodynamics.attached(plain)
    for name, body in hydrodynamics.attached(spec).items():
        was = old[name]
        for new, before in (
            (body.added_mass.diagonal(), was.added_mass.diagonal()),
            (body.linear_damping.diagonal(), was.linear_damping.diagonal()),
            (body.quadratic_damping, was.quadratic_damping),
            ([s.normal for s in body.segments], [s.normal for s in was.segments]),
        ):
            nonzero = np.asarray(before) > 0.0
            ratios += (np.asarray(new)[nonzero] / np.asarray(before)[nonzero]).tolist()
        assert body.volume == was.volume
    assert len(ratios) > 50
    assert len(set(np.round(ratios, 12))) == len(ratios)
    assert 0.7 <= min(ratios) < 0.75
    assert 1.25 < max(ratios) <= 1.3


def test_payload_keeps_the_ballast_of_the_arm_as_drawn(within):
    plain, spec = models.load("uuv_puma"), models.load("uuv_puma")
    notes = perturb(spec, [Payload(spread=0.1, trim_error=0.05)], 4)
    before, after = plain.compile(), spec.compile()
    arm = [b for b in range(before.nbody) if before.body(b).name not in ("world", "hull")]
    factors = after.body_mass[arm] / before.body_mass[arm]
    assert np.all(np.abs(factors - 1.0) <= 0.1)
    assert len(set(np.round(factors, 9))) == len(arm)
    within(
        "inertia in proportion",
        after.body_inertia[arm] / before.body_inertia[arm] - factors[:, None],
        1e-9,
    )

    def net(model: mujoco.MjModel) -> float:
        displaced = sum(
            hydrodynamics.unpack(row).volume
            for row in model.body_user[1:]
            if hydrodynamics.carries(row)
        )
        return float(model.body_subtreemass[0]) - displaced * hydrodynamics.water_density(model)

    within("trimmed as drawn [kg]", net(before), 1e-6)
    within("said to be too heavy by [kg]", net(after) - notes["too_heavy_kg"], 1e-6)


def test_thrusters_are_slower_and_weaker_each_by_itself():
    plain, spec = models.load("bluerov2_heavy"), models.load("bluerov2_heavy")  # tables
    perturb(spec, [ThrusterSpread(lag=0.2, gain=0.2)], 1)
    (_, old), (_, new) = thrusters.read(plain.compile()), thrusters.read(spec.compile())
    for column in (thrusters.FORWARD, thrusters.TIME_CONSTANT):
        ratio = new[:, column] / old[:, column]
        assert np.all(np.abs(ratio - 1.0) <= 0.2)
        assert len(set(np.round(ratio, 9))) == len(ratio)


def test_gears_are_tighter_or_looser_each_by_itself(within):
    plain, spec = models.load("uuv_puma"), models.load("uuv_puma")
    notes = perturb(spec, [Gears(spread=0.3)], 2)
    old, new = (Vehicle.of(spec_of.compile()) for spec_of in (plain, spec))
    ratio = new.dry_friction.coulomb / old.dry_friction.coulomb
    assert np.all(np.abs(ratio - 1.0) <= 0.3)
    assert len(set(np.round(ratio, 9))) == len(ratio)
    within(
        "stiction in proportion",
        new.dry_friction.stiction / old.dry_friction.stiction - ratio,
        1e-12,
    )
    within("viscous in proportion", new.joint_damping / old.joint_damping - ratio, 1e-12)
    within("mean", notes["gear_friction"] - ratio.mean(), 1e-12)


def pressed(stiffness: float, depth: float) -> tuple[float, float]:
    """Mean and deviation of the force on a plate `depth` [m] before the tip of the rigid tool, all
    but the pad held.
    """
    varied = models.load("uuv_puma")
    perturb(varied, [Pad(stiffness=stiffness)])
    whole = hydrodynamics_of_plant.compile(varied)
    spec = models.load("uuv_puma")
    perturb(spec, [Pad(stiffness=stiffness)])
    for contact_force in (
        *spec.actuators,
        *spec.keys,
        *(joint for joint in spec.joints if joint.name != "pad"),
    ):
        spec.delete(contact_force)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    tip = model.site("tip").id
    R = np.array(data.site_xmat[tip]).reshape(3, 3)
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, R.ravel())
    plate = data.site_xpos[tip] + R[:, 2] * (0.1 - depth)
    spec.worldbody.add_geom(
        name="plate", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.5, 0.5, 0.1], pos=plate, quat=quat
    )
    model = spec.compile()
    model.opt.gravity[:] = 0.0
    pad = model.body("pad").id
    # as the plant has it, on its arm and in water
    model.body_invweight0[pad] = whole.body_invweight0[pad]
    data = mujoco.MjData(model)
    contact_force = np.zeros(6)
    force = []
    for _ in range(round(1.0 / model.opt.timestep)):
        mujoco.mj_step(model, data)
        if data.ncon:
            mujoco.mj_contactForce(model, data, 0, contact_force)
        force.append(contact_force[0] if data.ncon else 0.0)
    settled = force[len(force) // 2 :]
    return float(np.mean(settled)), float(np.std(settled))


@pytest.mark.parametrize("stiffness", [1e4, 3e4, 1e5, 3e5, 1e6])
def test_pad_and_surface_yield_as_said(stiffness, within):
    for force in (6.0, 60.0, 90.0):
        mean, deviation = pressed(stiffness, force / stiffness)
        within("stiffness, relative", mean / force - 1.0, 0.08)  # 0.067, at 6 N on 3e5 N/m
        within("chatter [N]", deviation, 1e-3)


def test_steps_are_as_long_as_the_pad_allows(rng):
    for stiffness in (1e4, 1e6, *np.exp(rng.uniform(np.log(1e4), np.log(1e6), 6))):
        plain, spec = models.load("uuv_puma"), models.load("uuv_puma")
        perturb(spec, [Pad(stiffness=stiffness)])
        old, new = plain.compile(), spec.compile()
        solref = new.geom("pad").solref[0]
        spring = float(new.joint("pad").stiffness[0])
        n = old.opt.timestep / new.opt.timestep
        assert n == pytest.approx(round(n), rel=1e-12)

        def rests(
            n: int,
            solref: float = solref,
            spring: float = spring,
            whole: float = old.opt.timestep,
            mass: float = new.body("pad").mass[0],
        ) -> bool:
            dt = whole / n
            soft = solref * (1.0 + 1e-9) >= pad.STEPS_PER_SOLREF * dt
            return soft and spring * dt**2 <= pad.RESTLESS * mass * (1.0 + 1e-9)

        assert rests(round(n))
        assert n < 1.5 or not rests(round(n) - 1)
        contact = 1.0 / (1.0 / stiffness - 1.0 / spring)
        most = solref < old.geom("pad").solref[0]
        assert contact >= pad.SOFTEST_CONTACT * stiffness * (1.0 - 1e-9)
        # it hardens: 0.2
        assert not most or contact == pytest.approx(pad.SOFTEST_CONTACT * stiffness, rel=0.3)


_MASS_WITH_PAD = """
<mujoco><option timestep="0.002" integrator="implicitfast" cone="elliptic" gravity="0 0 0"/>
  <worldbody> <geom type="plane" size="1 1 .1"/>
    <body pos="0 0 .061"> <joint name="press" type="slide" axis="0 0 1"/>
      <geom type="sphere" size=".01" mass="{mass}" contype="0" conaffinity="0"/>
      <body name="pad">
        <joint name="pad" type="slide" axis="0 0 1" stiffness="32000" damping="155"/>
        <geom name="pad" type="sphere" size=".06" mass=".325"
          solref=".006 1" solimp=".95 .99 .0005"/>
          </body></body>
  </worldbody> <actuator><motor joint="press"/></actuator></mujoco>"""


@pytest.mark.parametrize("stiffness", [1e4, 2.1e4, 3e4, 7.9e4, 1.5e5, 3e5, 1e6, None])
@pytest.mark.seeds(1)
def test_what_is_pressed_on_it_comes_to_rest(stiffness, seed, within):
    """A free mass under a constant force, nothing but the pad to damp it: too long a step, and it
    bounces for ever.
    """
    rng = np.random.default_rng(seed)
    stiffness = stiffness or float(np.exp(rng.uniform(*np.log([1e4, 1e6]))))
    spec = mujoco.MjSpec.from_string(_MASS_WITH_PAD.format(mass=rng.uniform(2.0, 8.0)))
    perturb(spec, [Pad(stiffness=stiffness)])
    model = spec.compile()
    data = mujoco.MjData(model)
    contact_force = np.zeros(6)
    force = []
    data.qvel[0], data.ctrl[0] = -0.03, -60.0
    for _ in range(round(3.0 / model.opt.timestep)):
        mujoco.mj_step(model, data)
        if data.ncon:
            mujoco.mj_contactForce(model, data, 0, contact_force)
        force.append(contact_force[0] if data.ncon else 0.0)
    # 2e-3
    within(
        f"force at rest, {stiffness:.2g} N/m [N]", np.array(force[-len(force) // 10 :]) - 60.0, 0.01
    )


_SLIDING = """
<mujoco><option timestep="0.002" integrator="implicitfast" cone="elliptic" gravity="0 0 0"/>
  <worldbody> <body name="target"> <geom name="target" type="plane" size="1 1 .1"/> </body>
    <body pos="0 0 .061"> <joint name="press" type="slide" axis="0 0 1"/>
      <joint name="along" type="slide" axis="1 0 0"/>
      <geom type="sphere" size=".01" mass="{mass}" contype="0" conaffinity="0"/>
      <body name="pad">
        <joint name="pad" type="slide" axis="0 0 1" stiffness="32000" damping="155"/>
        <geom name="pad" type="sphere" size=".06" mass=".325"
          solref=".006 1" solimp=".95 .99 .0005" condim="3"
          friction="{friction} .005 .0001" priority="1"/></body></body>
  </worldbody> <actuator><motor joint="press"/> <velocity joint="along" kv="2000"/>
    <motor joint="along"/></actuator>
</mujoco>"""


@pytest.mark.parametrize(
    ("stiffness", "least"),
    [(2e4, 60.0), (2e4, 5.0), (2e5, 60.0), (5e5, 60.0), (1e6, 60.0), (1e6, 5.0), (None, 60.0)],
)
@pytest.mark.seeds(1)
def test_what_slides_stays_in_contact_with_the_friction_it_has(stiffness, least, seed, within):
    """Pressed with 60 N and drawn at 2 cm/s: never off the surface, Coulomb's friction; at rest it
    hardly creeps.

    Also with the contact of a tool that is pressed with no more than `least` [N] elsewhere.
    """
    rng = np.random.default_rng(seed)
    stiffness = stiffness or float(np.exp(rng.uniform(*np.log([1e4, 1e6]))))
    mu = float(rng.uniform(0.1, 0.6))
    spec = mujoco.MjSpec.from_string(_SLIDING.format(mass=rng.uniform(2.0, 8.0), friction=mu))
    perturb(spec, [Pad(stiffness=stiffness)])
    let_tool_slide(spec, speed=0.02, force=least)
    model = spec.compile()
    data = mujoco.MjData(model)
    contact_force = np.zeros(6)

    def forces(seconds: float) -> np.ndarray:
        rows = np.zeros((round(seconds / model.opt.timestep), 2))
        for row in rows:
            mujoco.mj_step(model, data)
            if data.ncon:
                mujoco.mj_contactForce(model, data, 0, contact_force)
                row[:] = contact_force[0], np.hypot(contact_force[1], contact_force[2])
        return rows

    data.ctrl[:] = -60.0, 0.02, 0.0
    forces(1.0)
    normal, friction = forces(1.0).T
    assert normal.min() > 0.0
    within("normal force [N]", normal - 60.0, 0.5)
    within("friction, of the normal force", friction / normal - mu, 0.01)
    model.actuator_gainprm[1] = model.actuator_biasprm[1] = 0.0
    data.ctrl[:] = -60.0, 0.0, 0.8 * mu * 60.0
    forces(0.5)
    start = data.joint("along").qpos[0]
    forces(1.0)
    within("creep [m/s]", data.joint("along").qpos[0] - start, 2e-3)


@pytest.mark.parametrize("friction", [0.3, 0.6])
@pytest.mark.parametrize(("force", "speed"), [(5.0, 0.02), (5.0, 0.08), (10.0, 0.05)])
@pytest.mark.parametrize("stiffness", [2e4, 1e6])
def test_a_light_and_fast_tool_stays_in_contact(stiffness, force, speed, friction, within):
    """With the friction of a pressed tool, 5 N at 5 cm/s were lost for 5 to 14 % of the time."""
    spec = mujoco.MjSpec.from_string(_SLIDING.format(mass=4.0, friction=friction))
    perturb(spec, [Pad(stiffness=stiffness)])
    let_tool_slide(spec, speed=speed, force=force)
    model = spec.compile()
    data = mujoco.MjData(model)
    contact_force = np.zeros(6)
    data.ctrl[:] = -force, speed, 0.0
    mujoco.mj_step(model, data, nstep=round(2.0 / model.opt.timestep))
    for _ in range(round(0.5 / model.opt.timestep)):
        mujoco.mj_step(model, data)
        assert data.ncon == 1
        mujoco.mj_contactForce(model, data, 0, contact_force)
        within("normal force [N]", contact_force[0] - force, 0.01)
        within(
            "friction, of the normal force",
            np.hypot(contact_force[1], contact_force[2]) / contact_force[0] - friction,
            0.01,
        )


def test_friction_opposes_a_light_tool_that_slows_down(within):
    """From 2 cm/s to 1 cm/s within half a second, as where the tool pauses."""
    spec = mujoco.MjSpec.from_string(_SLIDING.format(mass=4.0, friction=0.3))
    let_tool_slide(spec, speed=0.02, force=5.0)
    model = spec.compile()
    data = mujoco.MjData(model)
    contact_force = np.zeros(6)
    data.ctrl[:] = -5.0, 0.02, 0.0
    mujoco.mj_step(model, data, nstep=500)
    sign = 0.0
    for k in range(125):
        data.ctrl[1] = 0.02 - 0.04 * 0.002 * k
        mujoco.mj_step(model, data)
        mujoco.mj_contactForce(model, data, 0, contact_force)
        along = float(data.contact[0].frame.reshape(3, 3)[1:, 0] @ contact_force[1:3])
        within(
            "friction against the motion, of the normal force",
            abs(along) / contact_force[0] - 0.3,
            0.02,
        )
        sign = sign or np.sign(along)
        assert along * sign > 0.0


def test_friction_as_usual_where_the_tool_is_pressed():
    usual, light = (
        mujoco.MjSpec.from_string(_SLIDING.format(mass=4.0, friction=0.6)) for _ in range(2)
    )
    let_tool_slide(usual, speed=0.02, force=60.0)
    let_tool_slide(light, speed=0.02, force=10.0)
    pressed, fast = usual.compile(), light.compile()
    assert pressed.pair_solreffriction[0, 0] == FRICTION_TIME
    assert fast.pair_solreffriction[0, 0] > FRICTION_TIME
    very_light = mujoco.MjSpec.from_string(_SLIDING.format(mass=4.0, friction=0.6))
    let_tool_slide(very_light, speed=1.0, force=0.1)
    assert very_light.compile().pair_solreffriction[0, 0] == LONGEST


@pytest.mark.parametrize("stiffness", [1e4, 1e6])
def test_a_short_timestep_leaves_the_contact_as_soft(stiffness):
    """Elastic gears shorten it; a contact as stiff as the timestep allows is lost under a tool that
    shakes.
    """
    usual, short = models.load("uuv_puma"), models.load("uuv_puma")
    short.option.timestep /= 7
    for spec in (usual, short):
        perturb(spec, [Pad(stiffness=stiffness)])
    usual, short = usual.compile(), short.compile()
    assert short.geom("pad").solref[0] == pytest.approx(usual.geom("pad").solref[0], rel=1e-12)
    assert short.joint("pad").stiffness[0] == pytest.approx(
        usual.joint("pad").stiffness[0], rel=1e-12
    )
    assert short.opt.timestep <= usual.opt.timestep


def test_friction_is_that_of_the_pad():
    spec = models.load("uuv_puma")
    perturb(spec, [Pad(friction=0.45)])
    model = spec.compile()
    pad = model.geom("pad").id
    assert model.geom_friction[pad, 0] == 0.45
    assert model.geom_priority[pad] > 0
    assert model.opt.timestep == 0.002


def test_what_cannot_be_is_refused():
    with pytest.raises(ConfigurationError, match="friction"):
        Pad(friction=0.0)
    with pytest.raises(ConfigurationError, match=r"Water spread: must be in \[0, 1\)"):
        Water(spread=1.0)
    with pytest.raises(ConfigurationError, match="vision_noise"):
        Sensing(vision_noise=float("nan"))
    with pytest.raises(ConfigurationError, match="arm_base"):
        perturb(models.load("bluerov2_heavy"), [Payload(spread=0.1)])
    with pytest.raises(ConfigurationError, match="pad"):
        perturb(models.load("bluerov2_heavy"), [Pad(stiffness=1e4)])
