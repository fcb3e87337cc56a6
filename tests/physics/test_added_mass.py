"""Added mass as part of the inertia: closed forms, conservation, equivalence with a heavier
body.
"""

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.physics.random_trees import semidefinite
from uuv.models import hydrodynamics as water
from uuv.models.hydrodynamics import BodyHydrodynamics
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.spatial import Array, exp_so3, quat_wxyz_from_rotation

NEWER = tuple(int(x) for x in mujoco.__version__.split(".")[:2]) >= (4, 0)

CHAIN = """
<mujoco>
  <option timestep="0.002" integrator="RK4" gravity="0 0 0"> <flag contact="disable"/> </option>
  <worldbody>
    <body name="a"> <freejoint/> <geom type="box" size=".3 .2 .1" mass="20" pos=".1 0 .05"/>
      <body name="b" pos=".4 0 0"> <joint type="ball"/>
        <geom type="capsule" size=".05 .2" pos=".2 .1 0" mass="5"/>
        <body name="c" pos=".4 .1 0"> <joint axis="1 2 3"/>
          <geom type="box" size=".1 .2 .1" mass="3" pos=".1 0 0"/>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def chain(rng: np.random.Generator) -> mujoco.MjModel:
    """Three bodies with full random added masses, no drag, no gravity."""
    spec = mujoco.MjSpec.from_string(CHAIN)
    water.attach(
        spec,
        {name: BodyHydrodynamics(volume=0.01, added_mass=semidefinite(rng, 1.0)) for name in "abc"},
    )
    return hydrodynamics.compile(spec)


def moving(model: mujoco.MjModel, rng: np.random.Generator, speed: float) -> mujoco.MjData:
    """In motion, the vector of speeds [m/s, rad/s] being `speed` long: what the integrator misses
    grows with it.
    """
    data = mujoco.MjData(model)
    direction = rng.normal(size=model.nv)
    data.qvel = speed * direction / np.linalg.norm(direction)
    mujoco.mj_forward(model, data)
    return data


def kinetic_energy(model: mujoco.MjModel, data: mujoco.MjData) -> float:
    """Of bodies and water [J]; `d.M` holds both."""
    p = np.zeros(model.nv)
    mujoco.mj_mulM(model, data, p, data.qvel)
    return 0.5 * float(data.qvel @ p)


def momentum(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """Linear [N s] and angular [N m s] momentum (6,) of bodies and water about the world origin,
    body by body.
    """
    total = np.zeros(6)
    for i in range(1, model.nbody):
        R = data.xmat[i].reshape(3, 3)
        p = data.xpos[i]
        twist = np.zeros(6)
        mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, i, twist, 0)
        w = twist[:3]
        v = twist[3:]
        turn = np.kron(np.eye(2), R)
        wet = turn @ water.unpack(model.body_user[i]).added_mass @ turn.T @ np.concatenate([v, w])
        c = data.xipos[i] - p
        C = data.ximat[i].reshape(3, 3)
        linear = model.body_mass[i] * (v + np.cross(w, c))
        angular = C @ (model.body_inertia[i] * (C.T @ w))
        total[:3] += linear + wet[:3]
        total[3:] += np.cross(p + c, linear) + angular + np.cross(p, wet[:3]) + wet[3:]
    return total


@pytest.mark.check(
    "rise of a buoyant sphere, 1 s: every integrator and solver", "(rho V - m) g t / (m + m_A)"
)
@pytest.mark.parametrize("integrator", ["EULER", "RK4", "IMPLICIT", "IMPLICITFAST", "DISCRETE"])
@pytest.mark.parametrize("solver", ["CG", "NEWTON"])
def test_buoyant_body_accelerates_with_its_added_mass(integrator, solver, within):
    """a = (rho V - m) g / (m + m_A), constant, so v = a t with every integrator."""
    spec = mujoco.MjSpec.from_string(
        '<mujoco><option timestep="0.002"/><worldbody>'
        '<body name="ball"><freejoint/><geom size=".1" mass="3"/></body></worldbody></mujoco>'
    )
    spec.option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}")
    spec.option.solver = getattr(mujoco.mjtSolver, f"mjSOL_{solver}")
    water.attach(
        spec, {"ball": water.sphere(0.1, drag_coefficient=0.0, water_density=1000.0)}, 1000.0
    )
    model = hydrodynamics.compile(spec)
    data = mujoco.MjData(model)
    for _ in range(500):
        mujoco.mj_step(model, data)
    displaced = 1000.0 * 4.0 / 3.0 * np.pi * 0.1**3
    expected = (displaced - 3.0) * 9.81 / (3.0 + 0.5 * displaced)
    within("relative speed after 1 s", data.qvel[2] / expected - 1.0, 1e-13)  # measured 6e-15
    within("sideways speed [m/s]", data.qvel[[0, 1, 3, 4, 5]], 1e-12)


@pytest.mark.check("energy of a free chain and its water, RK4 at 2 ms", "constant")
def test_energy_of_a_free_chain_is_constant(rng, within):
    model = chain(rng)
    data = moving(model, rng, 0.3)
    before = kinetic_energy(model, data)
    start = data.qpos.copy()
    mujoco.mj_step(model, data, 5000)
    mujoco.mj_forward(model, data)
    assert np.linalg.norm(data.qpos - start) > 0.5
    # Measured up to 3e-14 and 9e-8 over 40 and 250 seeds. Before 4.0, RK4 is second order in a free
    # body's orientation.
    within(
        "relative, after 10 s", kinetic_energy(model, data) / before - 1.0, 3e-13 if NEWER else 1e-6
    )


@pytest.mark.check("momentum of a free chain and its water", "constant")
def test_momentum_of_bodies_and_water_is_constant(rng, within):
    model = chain(rng)
    data = moving(model, rng, 0.2)
    before = momentum(model, data)
    start = data.qpos.copy()
    data.qfrc_applied[6:] = 0.03 * rng.normal(size=model.nv - 6)  # joint torques are internal
    for _ in range(1000):
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    assert np.linalg.norm(data.qpos - start) > 0.1
    change = (momentum(model, data) - before) / np.linalg.norm(before)
    # measured up to 1e-13, 1.4e-8
    within("relative momentum after 2 s", change, 1e-12 if NEWER else 2e-7)


@pytest.mark.check("work of the added Coriolis terms", "zero")
def test_velocity_terms_are_powerless(rng, within):
    """The power of the velocity terms is what the changing inertia stores: qvel . f = -1/2 qvel .
    dA/dt qvel.
    """
    model = chain(rng)
    data = moving(model, rng, 3.0)
    mujoco.mj_integratePos(model, data.qpos, rng.normal(size=model.nv), 1.0)
    mujoco.mj_forward(model, data)
    rate, h = 0.0, 5e-3
    for k, weight in ((1, 45.0), (2, -9.0), (3, 1.0)):
        for sign in (1.0, -1.0):
            moved = mujoco.MjData(model)
            moved.qpos = data.qpos
            mujoco.mj_integratePos(model, moved.qpos, data.qvel, sign * k * h)
            mujoco.mj_fwdPosition(model, moved)
            rate += (
                sign * weight * data.qvel @ hydrodynamics.added_inertia(model, moved) @ data.qvel
            )
    powers = data.qvel * data.qfrc_passive
    assert np.max(np.abs(powers)) > 0.1
    error = (np.sum(powers) + 0.5 * rate / (60.0 * h)) / np.sum(np.abs(powers))
    # measured up to 8e-12 over 250 seeds, of the differences
    within("relative power", error, 1e-10)


@pytest.mark.check("tumbling ellipsoid, RK4 at 1 ms", "Kirchhoff's equations, SciPy")
def test_free_ellipsoid_tumbles_as_kirchhoff_says(within):
    """Kirchhoff's equations P' = P x w, H' = H x w + P x v, integrated by SciPy (Lamb,
    Hydrodynamics, art. 124).
    """
    spec = mujoco.MjSpec.from_string(
        '<mujoco><option timestep="0.001" integrator="RK4"/><worldbody>'
        '<body name="e"><freejoint/><geom type="ellipsoid" size=".3 .2 .1" '
        'density="1000"/></body></worldbody></mujoco>'
    )
    water.attach(
        spec, {"e": water.ellipsoid([0.3, 0.2, 0.1], drag_coefficient=0, water_density=1000)}, 1000
    )
    model = hydrodynamics.compile(spec)
    A = water.unpack(model.body_user[1]).added_mass
    G = A + np.diag([*[model.body_mass[1]] * 3, *model.body_inertia[1]])
    Ginv: Array = np.linalg.inv(G).astype(np.float64)
    nu0 = np.array([0.3, 0.2, -0.4, 1.0, -2.0, 1.5])

    def rates(_: float, nu: Array) -> Array:
        P, H = np.split(G @ nu, 2)
        v, w = np.split(nu, 2)
        return Ginv @ np.concatenate([np.cross(P, w), np.cross(H, w) + np.cross(P, v)])

    exact = solve_ivp(rates, (0.0, 2.0), nu0, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    data = mujoco.MjData(model)
    data.qvel = nu0
    for _ in range(2000):
        mujoco.mj_step(model, data)
    mujoco.mj_kinematics(model, data)
    nu = np.concatenate([data.xmat[1].reshape(3, 3).T @ data.qvel[:3], data.qvel[3:]])
    assert np.linalg.norm(exact - nu0) > 1.0
    within("twist after 2 s", nu - exact, 3e-10 if NEWER else 3e-5)  # measured 3e-11, 3e-6


@pytest.mark.check("Munk moment, 100 attitudes", "(X' - Y') u v")
def test_munk_moment_turns_a_slender_body_broadside(rng, within):
    """N = -(Y' - X') u v in body axes: a body that moves bow up is turned further up."""
    spec = mujoco.MjSpec.from_string(
        '<mujoco><worldbody><body name="e"><freejoint/><geom type="ellipsoid" size=".5 .1 .1" '
        'density="1000"/>'
        "</body></worldbody></mujoco>"
    )
    body = water.ellipsoid([0.5, 0.1, 0.1], drag_coefficient=0, water_density=1000)
    water.attach(spec, {"e": body}, 1000.0)
    model = hydrodynamics.compile(spec)
    data = mujoco.MjData(model)
    errors = []
    for _ in range(100):
        R, (u, v) = exp_so3(rng.normal(size=3)), rng.uniform(0.3, 1.5, 2)
        data.qpos[3:] = quat_wxyz_from_rotation(R)
        data.qvel[:3] = R @ [u, v, 0.0]
        mujoco.mj_forward(model, data)
        expected = (body.added_mass[0, 0] - body.added_mass[1, 1]) * u * v
        assert expected < -1.0
        errors.append(data.qfrc_passive[5] / expected - 1.0)
    within("relative moment", errors, 3e-14)  # measured up to 3e-15


@pytest.mark.check("chain with drag in a steady current, 1 s", "still water in a moving frame")
def test_steady_current_is_a_moving_frame(rng, within):
    """Bodies that drift with the water move as in still water: added mass, damping and drag see the
    relative flow.
    """
    spec = mujoco.MjSpec.from_string(CHAIN)
    for name in "abc":
        body = BodyHydrodynamics(
            volume=0.004,
            center_of_buoyancy=0.1 * rng.normal(size=3),
            added_mass=semidefinite(rng, 1.0),
            linear_damping=rng.uniform(0, 3, 6),
            quadratic_damping=rng.uniform(0, 3, 6),
            strips=water.cylinder(0.03, [0, 0, 0], [0.3, 0, 0]).segments,
        )
        water.attach(spec, {name: body})
    spec.option.gravity = [0.0, 0.0, -9.81]
    model = hydrodynamics.compile(spec)
    velocity = 0.3 * rng.normal(size=model.nv)
    current = rng.normal(size=3)
    runs = []
    for v_c in (np.zeros(3), current):
        model.opt.wind = v_c
        data = mujoco.MjData(model)
        data.qvel = velocity
        data.qvel[:3] += v_c
        for _ in range(500):
            mujoco.mj_step(model, data)
        runs.append((data.qpos.copy(), data.qvel.copy()))
    (still, slow), (carried, fast) = runs
    assert np.linalg.norm(still[:3]) > 0.1
    still[:3] += current * 500 * model.opt.timestep
    slow[:3] += current
    difference = np.concatenate([carried - still, fast - slow])
    within("position and velocity after 1 s", difference, 3e-13)  # measured up to 3e-14


@pytest.mark.check("body of water in an accelerating flow", "accelerates with the flow")
def test_accelerating_flow_carries_neutral_water_along(within):
    """A body that is water itself (m = rho V) takes exactly the acceleration of the flow, whatever
    its added mass.
    """
    spec = mujoco.MjSpec.from_string(
        '<mujoco><worldbody><body name="e"><freejoint/><geom type="ellipsoid" size=".3 .2 .1" '
        'density="1000"/>'
        "</body></worldbody></mujoco>"
    )
    body = water.ellipsoid([0.3, 0.2, 0.1], water_density=1000)
    water.attach(spec, {"e": body}, 1000.0)
    flow = [0.3, -0.1, 0.2]
    water.set_current(spec, acceleration=flow)
    model = hydrodynamics.compile(spec)
    data = mujoco.MjData(model)
    data.qpos[3:] = [0.6, 0.5, -0.3, 0.2]
    mujoco.mj_forward(model, data)
    within("acceleration [m/s^2]", data.qacc - [*flow, 0, 0, 0], 3e-14)  # measured 3e-15


CRASH = """
<mujoco>
  <option timestep="0.002" gravity="0 0 0" integrator="{integrator}" cone="{cone}"/>
  <worldbody>
    <geom type="plane" size="5 5 1"/>
    <body name="box" pos="0 0 .3"> <freejoint/>
      <inertial pos="0 0 0" mass="{mass}" diaginertia="{i} {i} {i}"/>
      <geom type="box" size=".1 .15 .05" friction=".5"/>
      <body name="rod" pos=".1 0 0"> <joint name="j" axis="0 1 0" range="-30 30" damping=".1"/>
        <inertial pos="0 0 0" mass="{rod}" diaginertia=".1 .1 .1"/> <geom size=".04" pos=".1 0 0"/>
          </body>
    </body>
    <body name="pebble" pos=".02 .03 .5"> <freejoint/>
      <inertial pos="0 0 0" mass="{rod}" diaginertia="{i} {i} {i}"/>
      <geom size=".05"/> </body>
  </worldbody>
  <actuator> <position joint="j" kp="5" dampratio="1"/> </actuator>
</mujoco>
"""


def thrown(*, wet: bool, integrator: str = "Euler", cone: str = "pyramidal") -> mujoco.MjModel:
    """The world of CRASH: light bodies with isotropic added mass, or as much heavier ones
    without.
    """
    mass, rod, i = (1, 0.5, 0.2) if wet else (21, 2.5, 0.5)
    spec = mujoco.MjSpec.from_string(
        CRASH.format(integrator=integrator, cone=cone, mass=mass, rod=rod, i=i)
    )
    if wet:
        added = {
            "box": [20.0] * 3 + [0.3] * 3,
            "rod": [2.0] * 3 + [0.0] * 3,
            "pebble": [2.0] * 3 + [0.3] * 3,
        }
        water.attach(
            spec,
            {k: BodyHydrodynamics(volume=0.0, added_mass=np.diag(v)) for k, v in added.items()},
        )
    return hydrodynamics.compile(spec)


@pytest.mark.check("weights of contacts, limits and servos", "those of a heavier dry body")
def test_isotropic_added_mass_has_the_weights_of_a_heavier_body(within):
    """All that MuJoCo derives from the inertia: softness of contacts and limits, servo damping,
    solver scale.
    """
    light, heavy = thrown(wet=True), thrown(wet=False)
    for name in (
        "body_invweight0",
        "dof_invweight0",
        "dof_M0",
        "actuator_acc0",
        "actuator_biasprm",
    ):
        within(name, getattr(light, name) - getattr(heavy, name), 1e-14)
    within("meaninertia", light.stat.meaninertia / heavy.stat.meaninertia - 1.0, 1e-14)


@pytest.mark.check("crash on the floor with isotropic added mass", "a heavier dry body")
@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicit", "implicitfast", "discrete"])
@pytest.mark.parametrize("cone", ["pyramidal", "elliptic"])
def test_isotropic_added_mass_is_a_heavier_body_in_contact(integrator, cone, within):
    """One throw at the floor, a pebble thrown after it, a limit, a servo: 1 kg + 20 kg of water, or
    21 kg.
    """
    paths = []
    touched = 0
    for wet in (True, False):
        model = thrown(wet=wet, integrator=integrator, cone=cone)
        data = mujoco.MjData(model)
        data.qvel[:7] = [1.0, 0.2, -1.0, 0.5, -0.3, 0.8, 2.0]
        data.qvel[7:10] = [0.5, 0.1, -2.0]
        path = []
        for _ in range(400):
            mujoco.mj_step(model, data)
            touched += data.nisland == 1 and data.ncon > 1
            path.append(data.qpos.copy())
        paths.append(np.array(path))
    assert touched > 20
    # Measured up to 1e-14. "implicit" alone differentiates the velocity terms, and MuJoCo knows
    # only the dry ones.
    within(
        f"position [m, rad], {integrator}",
        paths[0] - paths[1],
        1e-3 if integrator == "implicit" else 1e-13,
    )
