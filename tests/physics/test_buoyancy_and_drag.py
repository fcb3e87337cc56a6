"""Buoyancy, trim and drag against closed forms."""

import mujoco
import numpy as np
import pytest
from scipy.special import ellipk

from uuv.models import hydrodynamics as water
from uuv.models.hydrodynamics import BodyHydrodynamics, StripDrag
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.spatial import exp_so3, quat_wxyz_from_rotation

RHO = 1000.0
FREE = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody> <body name="hull" pos="0 0 -5"> <freejoint/> <geom {geom}/> </body> </worldbody>
</mujoco>
"""
VEHICLE = """
<mujoco>
  <option timestep="0.01" integrator="implicitfast"/>
  <worldbody>
    <body name="hull" pos="0 0 -5"> <freejoint/>
      <geom type="box" size=".5 .3 .2" mass="80" pos=".02 -.01 -.03"/>
      <body name="upper" pos=".4 0 -.2"> <joint axis="0 1 0" damping="5" stiffness="300"/>
        <geom type="capsule" size=".04 .2" pos="0 0 -.25" mass="6"/>
        <body name="lower" pos="0 0 -.5"> <joint axis="0 1 0" damping="5" stiffness="300"/>
          <geom type="capsule" size=".04 .2" pos="0 0 -.25" mass="5"/>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.mark.check("terminal velocity of a light sphere", "sqrt(2 (rho V - m) g / (rho C_d A))")
def test_terminal_velocity(within):
    """A light sphere rises at sqrt(2 (rho V - m) g / (rho C_d pi r^2))."""
    spec = mujoco.MjSpec.from_string(FREE.format(geom='size=".1" mass="3"'))
    water.attach(spec, {"hull": water.sphere(0.1, drag_coefficient=0.47, water_density=RHO)}, RHO)
    model = hydrodynamics.compile(spec)
    data = mujoco.MjData(model)
    for _ in range(5000):
        mujoco.mj_step(model, data)
    lift = (RHO * 4.0 / 3.0 * np.pi * 0.1**3 - 3.0) * 9.81
    expected = np.sqrt(2.0 * lift / (RHO * 0.47 * np.pi * 0.1**2))
    within("relative terminal velocity", data.qvel[2] / expected - 1.0, 1e-13)  # measured 1e-15


def test_no_buoyancy_where_gravity_is_disabled(within):
    spec = mujoco.MjSpec.from_string(FREE.format(geom='size=".1" mass="3"'))
    spec.option.disableflags = mujoco.mjtDisableBit.mjDSBL_GRAVITY
    water.attach(spec, {"hull": water.sphere(0.1)})
    model = hydrodynamics.compile(spec)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    within("acceleration", data.qacc, 0.0)


def test_righting_acceleration(within):
    """A trimmed body that is pitched turns back with m g h sin(pitch) / (I + I_A)."""
    h = 0.05
    spec = mujoco.MjSpec.from_string(FREE.format(geom='type="ellipsoid" size=".5 .2 .2" mass="80"'))
    body = water.ellipsoid([0.5, 0.2, 0.2], drag_coefficient=0.0, water_density=RHO)
    water.attach(spec, {"hull": body}, RHO)
    water.trim(spec, "hull", metacentric_height=h)
    model = hydrodynamics.compile(spec)
    data = mujoco.MjData(model)
    pitch = 1e-4
    data.qpos[3:] = [np.cos(pitch / 2), 0.0, np.sin(pitch / 2), 0.0]
    mujoco.mj_forward(model, data)
    inertia = model.body_inertia[1, 1] + body.added_mass[4, 4]
    expected = -80.0 * 9.81 * h * np.sin(pitch) / inertia
    # rounding of the angle
    within("relative pitch acceleration", data.qacc[4] / expected - 1.0, 1e-11)


@pytest.mark.check("righting period from 60 degrees, RK4", "4 K(k) sqrt((I + I_A) / (m g h))")
def test_righting_period(within):
    """From 60 degrees, at rest, a trimmed body swings as a pendulum of inertia I + I_A: T = 4 K(k)
    / omega_0.
    """
    h = 0.05
    pitch = np.pi / 3.0
    spec = mujoco.MjSpec.from_string(FREE.format(geom='type="ellipsoid" size=".5 .2 .2" mass="80"'))
    body = water.ellipsoid([0.5, 0.2, 0.2], drag_coefficient=0.0, water_density=RHO)
    water.attach(spec, {"hull": body}, RHO)
    water.trim(spec, "hull", metacentric_height=h)
    model = hydrodynamics.compile(spec)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    rate = np.sqrt(80.0 * 9.81 * h / (model.body_inertia[1, 1] + body.added_mass[4, 4]))
    period = 4.0 * ellipk(np.sin(pitch / 2.0) ** 2) / rate
    model.opt.timestep = period / 1000.0
    data = mujoco.MjData(model)
    data.qpos[3:] = [np.cos(pitch / 2), 0.0, np.sin(pitch / 2), 0.0]
    begin = data.qpos.copy()
    lowest = 1.0
    for _ in range(1000):
        mujoco.mj_step(model, data)
        lowest = min(lowest, float(data.qpos[5]))
    assert lowest < -0.49
    # At rest again, so a period that is wrong by dT shows as a rate of rate^2 sin(60 deg) dT.
    error = data.qvel[4] / (rate**2 * np.sin(pitch) * period)
    within("relative period", error, 1e-10)  # measured 1e-11
    within("pose [m, -]", data.qpos - begin, 3e-12)  # measured 3e-13


@pytest.mark.check(
    "drift to the speed of the current, RK4", "u_0 / (1 + k u_0 t / (m + m_A)) of slip"
)
def test_drift_to_the_speed_of_the_current(within):
    """Drag alone: the slip u of a neutral sphere decays as u_0 / (1 + k u_0 t / (m + m_A))."""
    radius = 0.1
    displaced = RHO * 4.0 / 3.0 * np.pi * radius**3
    spec = mujoco.MjSpec.from_string(FREE.format(geom=f'size="{radius}" mass="{displaced}"'))
    water.attach(spec, {"hull": water.sphere(radius, water_density=RHO)}, RHO)
    water.set_current(spec, [0.5, 0.0, 0.0])
    model = hydrodynamics.compile(spec)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 30000)
    k = 0.5 * RHO * 0.47 * np.pi * radius**2
    slip = 0.5 / (1.0 + k * 0.5 * 60.0 / (1.5 * displaced))
    assert slip < 0.015
    # measured 3e-16
    within("speed after 60 s [m/s]", data.qvel[:3] - [0.5 - slip, 0.0, 0.0], 5e-15)


@pytest.mark.check("trimmed vehicle with an arm, 60 s", "stays where it is")
@pytest.mark.parametrize("bend", [0.0, 0.7])
def test_trimmed_vehicle_stays_for_a_minute(bend, within):
    """Weight equals buoyancy and both act on one vertical, at home or with the arm bent."""
    spec = mujoco.MjSpec.from_string(VEHICLE)
    link = water.cylinder(0.04, [0, 0, 0], [0, 0, -0.5], water_density=RHO)
    water.attach(
        spec,
        {"hull": water.box([1.0, 0.6, 0.4], water_density=RHO), "upper": link, "lower": link},
        RHO,
    )
    home = np.array([0, 0, -5, 1, 0, 0, 0, bend, -bend])
    for i, joint in enumerate(spec.joints[1:]):
        joint.springref = home[7 + i]
    water.trim(spec, "hull", metacentric_height=0.03, qpos=home)
    model = hydrodynamics.compile(spec)
    data = mujoco.MjData(model)
    data.qpos = home
    mujoco.mj_forward(model, data)
    # a static arm needs torque against its net weight
    hold = -data.qfrc_passive[6:] + data.qfrc_bias[6:]
    for _ in range(6000):
        data.qfrc_applied[6:] = hold
        mujoco.mj_step(model, data)
    within("drift [m, rad]", data.qpos - home, 3e-14)  # measured up to 3e-15


def test_trim_puts_the_buoyancy_of_the_whole_tree_above_its_weight_however_it_is_turned(
    rng, within
):
    """In a pose with every body tilted, and gravity aslant: the same volume, and the centres on one
    vertical.
    """
    spec = mujoco.MjSpec.from_string(VEHICLE)
    link = water.cylinder(0.04, [0, 0, 0], [0.1, 0.05, -0.5], water_density=RHO)
    water.attach(
        spec,
        {"hull": water.box([1.0, 0.6, 0.4], water_density=RHO), "upper": link, "lower": link},
        RHO,
    )
    spec.option.gravity = exp_so3(rng.uniform(-1.0, 1.0, 3)) @ [0.0, 0.0, -9.81]
    turned = quat_wxyz_from_rotation(exp_so3(rng.uniform(-2.0, 2.0, 3)))
    qpos = np.array([*rng.uniform(-3.0, 3.0, 3), *turned, *rng.uniform(-1.0, 1.0, 2)])
    water.trim(spec, "hull", metacentric_height=0.04, qpos=qpos)
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos = qpos
    mujoco.mj_forward(model, data)
    volume = 0.0
    moment = np.zeros(3)
    for name, body in water.attached(spec).items():
        X = data.body(name)
        volume += body.volume
        moment += body.volume * (X.xpos + X.xmat.reshape(3, 3) @ body.center_of_buoyancy)
    up = -model.opt.gravity / 9.81
    within("volume [m^3]", volume - 91.0 / RHO, 1e-15)
    within("centre of buoyancy [m]", moment / volume - data.subtree_com[1] - 0.04 * up, 1e-14)


def test_simple_neutral_body_stays_for_a_minute(within):
    """Its inertial frame is its body frame: MuJoCo would store only the diagonal of its inertia."""
    spec = mujoco.MjSpec.from_string(FREE.format(geom='type="ellipsoid" size=".3 .2 .1" mass="20"'))
    water.attach(spec, {"hull": water.ellipsoid([0.3, 0.2, 0.1])})
    water.trim(spec, "hull", metacentric_height=0.02)
    model = hydrodynamics.compile(spec)
    assert model.M_rownnz.tolist() == [1, 2, 3, 4, 5, 6]
    data = mujoco.MjData(model)
    for _ in range(30000):
        mujoco.mj_step(model, data)
    within("drift [m]", data.qpos[:3] - [0.0, 0.0, -5.0], 1e-11)  # measured 1e-12
    within("tilt", data.qpos[3:] - [1.0, 0.0, 0.0, 0.0], 1e-14)


@pytest.mark.check("drag of a turning and of a slipping strip", "k w^2 L^4 / 4, k v^2 L")
def test_drag_of_a_swinging_strip(within):
    """About one end, k w |w| x^3 integrates to k w^2 L^4 / 4; across, k v^2 L acts in the
    middle.
    """
    k, L, w, v = 30.0, 0.6, 1.5, 0.8
    strip = StripDrag(
        start=np.zeros(3), end=np.array([L, 0.0, 0.0]), normal=k, tangential=2.0, stations=2
    )
    spec = mujoco.MjSpec.from_string(FREE.format(geom='size=".1" mass="50"'))
    water.attach(spec, {"hull": BodyHydrodynamics(volume=0.0, strips=strip)}, RHO)
    spec.option.gravity = [0.0, 0.0, 0.0]
    model = hydrodynamics.compile(spec)
    data = mujoco.MjData(model)
    data.qvel[5] = w
    mujoco.mj_forward(model, data)
    within("relative torque", data.qfrc_passive[5] / (-k * w**2 * L**4 / 4.0) - 1.0, 1e-14)
    within("relative force", data.qfrc_passive[1] / (-k * w**2 * L**3 / 3.0) - 1.0, 1e-14)
    data.qvel[:] = [v, v, 0, 0, 0, 0]
    mujoco.mj_forward(model, data)
    expected = np.array([-2.0 * v**2 * L, -k * v**2 * L, 0.0, 0.0, 0.0, -k * v**2 * L * L / 2.0])
    within("force [N, N m]", data.qfrc_passive - expected, 1e-13)


@pytest.mark.check("drag in a sheared current, 400 states", "the speed at the depth of the body")
def test_drag_follows_the_shear_of_the_current(rng, within):
    """At depth z the current is v + z dv/dz, and a body that drifts with it feels no drag."""
    spec = mujoco.MjSpec.from_string(FREE.format(geom='size=".1" mass="3"'))
    linear, quadratic = np.array([3.0, 5.0, 7.0]), np.array([20.0, 30.0, 40.0])
    body = BodyHydrodynamics(
        volume=0.0,
        linear_damping=np.array([*linear, 0, 0, 0]),
        quadratic_damping=np.array([*quadratic, 0, 0, 0]),
    )
    water.attach(spec, {"hull": body}, RHO)
    start = np.array([0.5, -0.3, 0.0])
    shear = np.array([0.1, 0.04, 0.0])
    water.set_current(spec, velocity=start, shear=shear)
    model = hydrodynamics.compile(spec)
    data = mujoco.MjData(model)
    moving = []
    adrift = []
    for _ in range(100):
        R = exp_so3(rng.normal(size=3))
        depth = rng.uniform(1.0, 30.0)
        v = rng.normal(size=3)
        data.qpos[2] = -depth
        data.qpos[3:] = quat_wxyz_from_rotation(R)
        current = start - depth * shear
        data.qvel[:3] = v
        mujoco.mj_forward(model, data)
        u = R.T @ (v - current)
        expected = -R @ (linear * u + quadratic * np.abs(u) * u)
        strength = np.linalg.norm(expected)
        moving.append((data.qfrc_passive[:3] - expected) / strength)
        data.qvel[:3] = current
        mujoco.mj_forward(model, data)
        adrift.append(data.qfrc_passive[:3] / strength)
    within("relative force", moving, 2e-14)  # measured up to 2e-15
    within("force adrift, to that", adrift, 1e-14)  # measured up to 1e-15


@pytest.mark.check(
    "power of drag, full 6x6 and strips, 800 twists", "that of each part, by hand; never positive"
)
def test_drag_never_feeds_energy(rng, within):
    """With a full linear 6x6, quadratic rows and strips, the power of drag is that of its parts,
    each negative.
    """
    skewed = rng.normal(size=(6, 6))
    spec = mujoco.MjSpec.from_string(FREE.format(geom='size=".1" mass="50"'))
    body = BodyHydrodynamics(
        volume=0.0,
        linear_damping=np.eye(6) + skewed - skewed.T,
        quadratic_damping=rng.uniform(0, 5, 6),
        strips=water.cylinder(0.03, [0.1, 0, 0], [0.5, 0.2, 0]).segments,
    )
    water.attach(spec, {"hull": body})
    spec.option.gravity = [0.0, 0.0, 0.0]
    model = hydrodynamics.compile(spec)
    (strip,) = body.segments
    along = (strip.end - strip.start) / np.linalg.norm(strip.end - strip.start)
    x, weights = np.polynomial.legendre.leggauss(strip.stations)
    weights *= 0.5 * np.linalg.norm(strip.end - strip.start)
    points = 0.5 * (strip.start + strip.end) + 0.5 * x[:, None] * (strip.end - strip.start)
    data = mujoco.MjData(model)
    errors = []
    for _ in range(200):
        R = exp_so3(rng.normal(size=3))
        v = rng.normal(size=3)
        w = rng.normal(size=3)
        data.qpos[3:] = quat_wxyz_from_rotation(R)
        data.qvel[:3] = R @ v
        data.qvel[3:] = w
        mujoco.mj_forward(model, data)
        nu = np.concatenate([v, w])
        u = v + np.cross(w, points)
        ahead = np.abs(u @ along)
        across = np.linalg.norm(u - np.outer(u @ along, along), axis=1)
        # the skewed part of D does no work
        lost = nu @ nu + body.quadratic_damping @ np.abs(nu) ** 3
        lost += weights @ (strip.normal * across**3 + strip.tangential * ahead**3)
        power = data.qvel @ data.qfrc_passive
        assert power < 0.0
        errors.append(power / lost + 1.0)
    within("relative power", errors, 3e-14)  # measured up to 3e-15
