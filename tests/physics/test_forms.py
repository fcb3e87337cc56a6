"""Forms of the water (`uuv.models.water.forms`): plain formulas at random states, power, symmetry,
closed forms, doors.
"""

import re
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.optimize import brentq

from tests.physics.random_trees import random_coefficients, random_spec, semidefinite, set_in_motion
from untyped import untyped
from uuv.controllers.hull.thrust_margin import ThrustMargin
from uuv.models import hydrodynamics as water
from uuv.models import load
from uuv.models.files import gz_sim
from uuv.models.hydrodynamics import LAYOUT, BodyHydrodynamics
from uuv.models.vehicles import reach_alpha_5
from uuv.models.water.forms import (
    CrossTerms,
    FadingDamping,
    Form,
    LiftDrag,
    MunkFactor,
    PlanarStrip,
)
from uuv.perturbations.vehicle import Water
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError, HydrodynamicsError, PhysicsWarning
from uuv.sim.interfaces.spatial import Array, unit_vector
from uuv.sim.plant import reaction_wrench
from uuv.sim.water import energy

X, Y, Z = np.eye(3)
MIRROR = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])  # of a six-vector in the plane y = 0


def directions(rng: np.random.Generator) -> tuple[Array, Array]:
    forward = unit_vector(rng.normal(size=3), "")
    return forward, unit_vector(np.cross(forward, rng.normal(size=3)), "")


def lift_drag(rng: np.random.Generator, **figures: float) -> LiftDrag:
    forward, upward = directions(rng)
    drawn = {
        "area": rng.uniform(0.5e-3, 2e-3),
        "lift_slope": rng.uniform(0.5, 5.0),
        "drag_0": rng.uniform(0.0, 0.5),
        "induced": rng.uniform(0.0, 0.5),
        "drag_slope": rng.uniform(0.0, 0.5),
        "incidence": rng.uniform(-0.3, 0.3),
        "stall": rng.uniform(0.2, 1.5),
    }
    sweep = int(rng.choice([-2, 0, 2]))
    return LiftDrag(
        **(drawn | figures), sweep=sweep, point=rng.normal(size=3), forward=forward, upward=upward
    )


def random_forms(rng: np.random.Generator) -> tuple[Form, ...]:
    """One of each kind; the cross terms are any."""
    terms = np.column_stack(
        [rng.integers(0, 6, (4, 3)), rng.integers(0, 2, 4), rng.normal(size=4)]
    ).astype(float)
    return (
        MunkFactor(factor=rng.uniform(size=3)),
        FadingDamping(linear=rng.uniform(size=6), rate=float(rng.uniform(0.0, 3.0))),
        lift_drag(rng),
        CrossTerms(terms=terms),
        PlanarStrip(
            start=rng.normal(size=3),
            end=rng.normal(size=3),
            direction=rng.normal(size=3),
            drag=float(rng.uniform(1, 5)),
        ),
    )


def of_lift(form: LiftDrag, u: Array) -> Array:
    """Lift and drag by vectors alone, as gz-sim's LiftDrag has them: without components along
    forward and upward.
    """
    span = np.cross(form.forward, form.upward)
    plane = u - (u @ span) * span
    V, speed = float(np.linalg.norm(plane)), float(np.linalg.norm(u))
    lift_way = np.cross(span, plane) / V
    angle = float(np.arctan2(lift_way @ form.forward, lift_way @ form.upward)) + form.incidence
    while abs(angle) > np.pi / 2.0:
        angle -= np.sign(angle) * np.pi
    assert form.stalled_slope is not None
    assert form.stalled_drag_slope is not None
    size = abs(angle)
    at_stall = form.lift_slope * form.stall
    if size <= form.stall:
        lift, drag = form.lift_slope * size, form.drag_slope * size
    else:
        lift = max(at_stall + form.stalled_slope * (size - form.stall), 0.0)
        drag = form.drag_slope * form.stall + form.stalled_drag_slope * (size - form.stall)
    drag += form.drag_0 + form.induced * lift**2
    q = 0.5 * form.water_density * V**2 * (V / speed) ** form.sweep
    return q * form.area * (np.sign(angle) * lift * lift_way - drag * plane / V)


def moments(u0: float, u1: float) -> tuple[float, float]:
    """Integrals over s from 0 to 1 of |u| u and of s |u| u, with u = u0 + s (u1 - u0)."""
    b = u1 - u0
    cubes = abs(u1) ** 3 - abs(u0) ** 3
    return cubes / (3.0 * b), ((abs(u1) * u1**3 - abs(u0) * u0**3) / 4.0 - u0 * cubes / 3.0) / b**2


def plain(form: Form, nu: Array, A: Array) -> Array:
    """Wrench (6,) of one form at one twist, written down anew."""
    v = nu[:3]
    w = nu[3:]
    if isinstance(form, MunkFactor):
        p = A[:3] @ nu
        whole = np.concatenate([-np.cross(w, p), -np.cross(v, p)])
        share = np.concatenate([-np.cross(form.factor * w, p), -form.factor * np.cross(v, p)])
        return share - whole
    if isinstance(form, FadingDamping):
        return -form.linear * np.exp(-form.rate * np.sqrt(v @ v)) * nu
    if isinstance(form, LiftDrag):
        force = of_lift(form, v + np.cross(w, form.point))
        return np.concatenate([force, np.cross(form.point, force)])
    if isinstance(form, CrossTerms):
        total = np.zeros(6)
        for i, j, k, absolute, c in form.terms.tolist():
            total[int(i)] -= c * nu[int(j)] * (abs(nu[int(k)]) if absolute else nu[int(k)])
        return total
    assert isinstance(form, PlanarStrip)
    along = form.end - form.start
    u0, u1 = (float((v + np.cross(w, p)) @ form.direction) for p in (form.start, form.end))
    b = u1 - u0
    if abs(b) < 1e-6:
        zeroth = abs(u0) * u0
        first = 0.5 * abs(u0) * u0
    else:
        zeroth, first = moments(u0, u1)
    scale = -form.drag * float(np.linalg.norm(along))
    lever = zeroth * form.start + first * along
    return scale * np.concatenate([zeroth * form.direction, np.cross(lever, form.direction)])


def floating(body: BodyHydrodynamics) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(
        '<mujoco><option gravity="0 0 0" timestep="1e-4"/><worldbody><body name="hull"><freejoint/>'
        '<inertial mass="10" pos="0 0 0" diaginertia="1 2 3"/></body></worldbody></mujoco>'
    )
    water.attach(spec, {"hull": body})
    return hydrodynamics.compile(spec)


def acted(
    forms: Form | tuple[Form, ...],
    nus: Array,
    added: Array | None = None,
    wind: Array | None = None,
) -> Array:
    """Wrenches (n, 6) of the forms on a free body by mj_forward at twists (n, 6): with them less
    without them.
    """
    A = np.zeros((6, 6)) if added is None else added
    wrenches = np.zeros((len(nus), 6))
    for share, some in ((1.0, forms), (-1.0, ())):
        model = floating(BodyHydrodynamics(volume=0.0, added_mass=A, forms=some))
        data = mujoco.MjData(model)
        model.opt.wind = np.zeros(3) if wind is None else wind
        for k, nu in enumerate(nus):
            data.qvel = nu
            mujoco.mj_forward(model, data)
            wrenches[k] += share * data.qfrc_passive
    return wrenches


@pytest.mark.check("forms of the water on random trees", "plain formulas")
def test_forms_are_their_formulas_on_random_trees(rng, within):
    """Kernel and NumPy method at random states, with current and shear; forms of other bodies leave
    a body alone.
    """
    worst = method = 0.0
    for _ in range(6):
        spec, bodies = random_spec(rng)
        bare = hydrodynamics.compile(spec.copy())
        carried = {
            name: replace(body, forms=random_forms(rng))
            for name, body in bodies.items()
            if rng.uniform() < 0.7
        }
        water.attach(spec, carried)
        model = hydrodynamics.compile(spec)
        data, without = mujoco.MjData(model), mujoco.MjData(bare)
        shear = model.body_user[0, LAYOUT.current_shear :][:3]
        for _ in range(4):
            set_in_motion(model, data, rng)
            without.qpos, without.qvel = data.qpos, data.qvel
            mujoco.mj_forward(model, data)
            mujoco.mj_forward(bare, without)
            tau = np.zeros(model.nv)
            for name, body in carried.items():
                i = model.body(name).id
                J = np.zeros((6, model.nv))
                if model.body_treeid[i] < 0:
                    continue  # welded to the world
                R = data.xmat[i].reshape(3, 3)
                mujoco.mj_jacBody(model, data, J[:3], J[3:], i)
                J_B = np.vstack([R.T @ J[:3], R.T @ J[3:]])
                nu = J_B @ data.qvel
                nu[:3] -= R.T @ (model.opt.wind + data.xpos[i, 2] * shear)
                for form in body.terms:
                    wrench = plain(form, nu, body.added_mass)
                    other = form.wrench(nu[None, :3], nu[None, 3:], body.added_mass)[0]
                    method = max(
                        method,
                        float(np.max(np.abs(other - wrench)) / (1.0 + np.max(np.abs(wrench)))),
                    )
                    tau += J_B.T @ wrench
            error = np.max(np.abs(data.qfrc_passive - without.qfrc_passive - tau)) / (
                1.0 + np.max(np.abs(tau))
            )
            worst = max(worst, float(error))
    within("kernel against the formulas, relative", worst, 1e-9)  # measured up to 2e-12
    # up to 2.4e-11: the strip's integral cancels here
    within("method against the formulas, relative", method, 1e-9)


def test_a_body_without_forms_has_the_row_that_it_always_had():
    body = random_coefficients(np.random.default_rng(0))
    assert len(water.pack(body)) == LAYOUT.size
    assert floating(body).nuser_body == LAYOUT.size
    assert floating(replace(body, forms=MunkFactor())).nuser_body == LAYOUT.size + 2 + 3


# -- power -----------------------------------------------------------------------------------------


@pytest.mark.check("Munk factors: power of couple and force", "zero for any factors")
def test_the_munk_pair_has_no_power_and_the_couple_alone_has(rng, within):
    A = semidefinite(rng, 3.0)
    nus = rng.normal(size=(40, 6))
    factor = rng.uniform(size=3)
    wrench = acted(MunkFactor(factor=factor), nus, A)
    power = np.sum(wrench * nus, axis=1)
    of_couple = np.sum(wrench[:, 3:] * nus[:, 3:], axis=1)
    within("power of the pair [W]", power, 1e-12)  # measured up to 5e-14
    assert np.max(of_couple) > 1.0  # the couple alone feeds in at some motion ...
    assert np.min(of_couple) < -1.0  # ... and takes at another
    gone = acted(MunkFactor(factor=np.zeros(3)), nus, A)
    p = nus @ A[:3].T
    within(
        "factor 0 takes all of it",
        gone - np.hstack([np.cross(nus[:, 3:], p), np.cross(nus[:, :3], p)]),
        1e-12,
    )
    within("factor 1 changes nothing", acted(MunkFactor(), nus, A), 0.0)


def test_lift_has_no_power_and_drag_takes(rng, within):
    nus = rng.normal(size=(40, 6))
    for _ in range(5):
        lift = lift_drag(rng, drag_0=0.0, induced=0.0, drag_slope=0.0)
        point = nus[:, :3] + np.cross(nus[:, 3:], lift.point)
        wrench = acted(lift, nus)
        assert np.max(np.abs(wrench)) > 0.1
        power = np.sum(wrench[:, :3] * point, axis=1)
        within("power of lift [W]", power, 1e-11)
        within("that at the origin [W]", np.sum(wrench * nus, axis=1), 1e-11)
        assert np.all(np.sum(acted(replace(lift, drag_0=0.1), nus) * nus, axis=1) < 0.0)


def test_the_other_damping_takes_power(rng):
    nus = rng.normal(size=(40, 6))
    for form in random_forms(rng)[1:3] + random_forms(rng)[4:]:
        assert np.all(np.sum(acted(form, nus) * nus, axis=1) <= 0.0)


# -- symmetry, invariance --------------------------------------------------------------------------


def mirrored(form: Form) -> Form:
    """The form of the body seen in the plane y = 0."""
    flip = MIRROR[:3]
    if isinstance(form, LiftDrag):
        return replace(
            form, point=flip * form.point, forward=flip * form.forward, upward=flip * form.upward
        )
    if isinstance(form, PlanarStrip):
        return replace(
            form, start=flip * form.start, end=flip * form.end, direction=flip * form.direction
        )
    if isinstance(form, CrossTerms):
        i, j, k = form.terms[:, :3].T.astype(int)
        signs = MIRROR[i] * MIRROR[j] * np.where(form.terms[:, 3] == 1.0, 1.0, MIRROR[k])
        return replace(form, terms=np.column_stack([form.terms[:, :4], signs * form.terms[:, 4]]))
    return form


def test_a_mirrored_body_feels_the_mirrored_wrench(rng, within):
    nus = rng.normal(size=(10, 6))
    A = semidefinite(rng, 1.0)
    for form in random_forms(rng):
        mirrored_wrench = acted(mirrored(form), nus * MIRROR, MIRROR[:, None] * A * MIRROR)
        here = acted(form, nus, A)
        within(f"{type(form).__name__}: mirrored", mirrored_wrench - here * MIRROR, 1e-11)
        assert np.max(np.abs(here)) > 1e-2


@pytest.mark.check(
    "forms of the water: a body moving in still water, and at rest in a current",
    "the same acceleration",
)
def test_forms_do_not_tell_a_current_from_a_motion(rng, within):
    body = replace(random_coefficients(rng), forms=random_forms(rng))
    model = floating(body)
    data = mujoco.MjData(model)
    for _ in range(10):
        velocity, spin, quat = rng.normal(size=3), rng.normal(size=3), rng.normal(size=4)
        accelerations = []
        for moving in (1.0, 0.0):
            data.qpos[3:7] = quat / np.linalg.norm(quat)
            data.qvel = np.concatenate([moving * velocity, spin])
            model.opt.wind = (moving - 1.0) * velocity
            mujoco.mj_forward(model, data)
            accelerations.append(np.array(data.qacc))
        within("acceleration", accelerations[0] - accelerations[1], 1e-11)  # of some 10


# -- closed forms ----------------------------------------------------------------------------------


def on_rails(
    body: BodyHydrodynamics, joints: str, mass: float = 2.0, gravity: float = 0.0
) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(
        f'<mujoco><option gravity="0 0 {-gravity}" timestep="4e-4"/><worldbody><body '
        f'name="hull">{joints}'
        f'<inertial mass="{mass}" pos="0 0 0" diaginertia="1 1 1"/></body></worldbody></mujoco>'
    )
    water.attach(spec, {"hull": body})
    return hydrodynamics.compile(spec)


def test_fading_damping_lets_a_push_go_on_at_its_speed(within):
    form = FadingDamping(linear=np.array([5.0, 0, 0, 0, 0, 0]), rate=0.5)
    model = on_rails(
        BodyHydrodynamics(volume=0.0, forms=form), '<joint type="slide" axis="1 0 0"/>'
    )
    data = mujoco.MjData(model)
    data.qfrc_applied = 5.0 * 0.8 * np.exp(-0.4)  # the force that 0.8 m/s takes
    mujoco.mj_step(model, data, 100_000)
    within("speed [m/s]", data.qvel[0] - 0.8, 1e-9)


@pytest.mark.check("steady glide of a wing", "tan(angle) = C_D / C_L, weight = resultant")
def test_a_wing_glides_at_the_angle_of_its_coefficients(within):
    """A level wing of 20 N on rails ahead and down."""
    wing = LiftDrag.of_wing(area=0.3, span=1.0, drag_0=0.05, water_density=1000.0)
    rails = '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>'
    model = on_rails(BodyHydrodynamics(volume=0.0, forms=wing), rails, gravity=10.0)

    def coefficients(angle: float) -> tuple[float, float]:
        lift, drag = wing.coefficients(np.array([angle]))
        return float(lift[0]), float(drag[0])

    steady = float(
        brentq(
            lambda angle: np.tan(angle) - coefficients(angle)[1] / coefficients(angle)[0], 0.02, 0.6
        )
    )
    speed = np.sqrt(20.0 / (0.5 * 1000.0 * 0.3 * np.hypot(*coefficients(steady))))
    data = mujoco.MjData(model)
    data.qvel = [0.2, -0.05]
    mujoco.mj_step(model, data, 50_000)
    within("speed ahead [m/s]", data.qvel[0] - speed * np.cos(steady), 1e-9)
    within("speed down [m/s]", data.qvel[1] + speed * np.sin(steady), 1e-9)
    assert 0.1 < steady < 0.6


def test_a_rod_spins_down_by_its_planar_strip(within):
    """I w' = -k L^4 / 32 w^2 about the middle; along the strip, and across its direction, nothing
    acts.
    """
    strip = PlanarStrip(start=-0.5 * X, end=0.5 * X, direction=Y, drag=40.0)
    model = on_rails(
        BodyHydrodynamics(volume=0.0, forms=strip), '<joint type="hinge" axis="0 0 1"/>'
    )
    data = mujoco.MjData(model)
    data.qvel[0] = 2.0
    mujoco.mj_step(model, data, 5000)
    spin = 2.0 / (1.0 + 40.0 / 32.0 * 2.0 * 2.0)
    within("spin after 2 s, relative", data.qvel[0] / spin - 1.0, 2e-3)  # Euler's error
    within("flow along and across", acted(strip, np.array([[1.0, 0, 2, 0, 0, 0]])), 0.0)
    side = acted(strip, np.array([[0, 3.0, 0, 0, 0, 0]]))
    within("flow from the side", side - [[0, -40.0 * 9.0, 0, 0, 0, 0]], 1e-12)


def test_a_diagonal_cross_term_is_quadratic_damping(rng, within):
    numbers = rng.uniform(size=6)
    nus = rng.normal(size=(10, 6))
    terms = np.array([[i, i, i, 1.0, c] for i, c in enumerate(numbers)])
    within("wrench", acted(CrossTerms(terms=terms), nus) + numbers * np.abs(nus) * nus, 1e-15)


# -- other doors -----------------------------------------------------------------------------------


def test_parameters_of_gz_sim_act_as_in_its_plugin(rng, within):
    """Force = + (xU + xUabsV |v| + xUV v) u and so on, as its source has it, with mass and damping
    apart.
    """
    forces, speeds = "xyzkmn", "UVWPQR"
    parameters = {f"{forces[i]}{speeds[i]}": -float(rng.uniform(1, 2)) for i in range(6)}
    parameters |= {
        f"{forces[i]}{speeds[i]}abs{speeds[i]}": -float(rng.uniform(1, 2)) for i in range(6)
    }
    parameters |= {
        "xUabsV": -0.3,
        "yVR": 0.4,
        "nUV": -0.2,
        "kPQ": 0.1,
        "mWabsQ": 0.5,
        "xUU": 0.1,
        "yVabsV": 0.7,
    }
    body = gz_sim.body_hydrodynamics({**parameters, "xDotU": -3.0, "nDotR": -0.5}, volume=0.02)
    assert (body.added_mass[0, 0], body.added_mass[5, 5]) == (3.0, 0.5)
    nus = rng.normal(size=(20, 6))
    expected = np.zeros((20, 6))
    for name, coefficient in parameters.items():
        i = forces.index(name[0])
        j = speeds.index(name[1])
        rest = name[2:]
        factor = np.ones(20) if not rest else nus[:, speeds.index(rest[-1])]
        expected[:, i] += coefficient * (np.abs(factor) if "abs" in rest else factor) * nus[:, j]
    within("damping", energy.damping_wrench(body, nus) - expected, 1e-14)
    with pytest.raises(
        ConfigurationError,
        match=r"unknown parameter 'xUabV' \(did you mean "
        r"xUabsV\?\)",
    ):
        gz_sim.body_hydrodynamics({"xUabV": 1.0}, volume=0.02)


def test_lift_and_drag_by_gz_sims_names():
    form = LiftDrag.of_gz(
        {
            "cla": 4.0,
            "cda": 0.2,
            "alpha_stall": 0.3,
            "cla_stall": -2.0,
            "area": 0.5,
            "cp": [0.1, 0, 0],
        }
    )
    assert (form.lift_slope, form.drag_slope, form.stall, form.stalled_slope, form.sweep) == (
        4.0,
        0.2,
        0.3,
        -2.0,
        2,
    )
    assert form.stalled_drag_slope == 1.0
    with pytest.raises(ConfigurationError, match=r"unknown parameter 'cal' \(did you mean cla\?\)"):
        LiftDrag.of_gz({"cal": 1.0})


def test_what_is_missing_has_gz_sims_default():
    spelled = {"area": 1.0, "cla": 1.0, "cda": 0.01, "a0": 0.0, "cp": [0.0, 0.0, 0.0]}
    axes = {"forward": [1.0, 0.0, 0.0], "upward": [0.0, 0.0, 1.0]}
    stalled = {"alpha_stall": np.pi / 2, "cla_stall": 0.0, "cda_stall": 1.0}
    assert LiftDrag.of_gz({}).numbers() == LiftDrag.of_gz({**spelled, **axes, **stalled}).numbers()


def test_rows_and_mjcf_keep_the_forms(rng):
    body = replace(random_coefficients(rng), forms=random_forms(rng))
    assert water.pack(water.unpack(water.pack(body))).tobytes() == water.pack(body).tobytes()
    spec = mujoco.MjSpec.from_string(
        '<mujoco><worldbody><body name="hull"><geom size="1"/></body></worldbody></mujoco>'
    )
    water.attach(spec, {"hull": body})
    back = water.attached(mujoco.MjSpec.from_string(spec.to_xml()))["hull"]
    for returned, here in zip(back.terms, body.terms, strict=True):
        np.testing.assert_allclose(returned.numbers(), here.numbers(), rtol=1e-5, atol=1e-6)
    water.attach(spec, {"hull": replace(body, forms=())})
    assert not water.attached(spec)["hull"].terms


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: MunkFactor(factor=np.array([1.0, 2.0, 0.0])), "must be in 0 to 1"),
        (lambda: FadingDamping(linear=-np.ones(6), rate=1.0), "must not be negative"),
        (lambda: FadingDamping(linear=np.ones(6), rate=np.nan), "finite"),
        (lambda: LiftDrag(area=0.0, lift_slope=1.0), "area .*must be positive"),
        (lambda: LiftDrag(area=1.0, lift_slope=-1.0), "lift_slope: must not be negative"),
        (lambda: LiftDrag(area=1.0, lift_slope=1.0, upward=X), "must be perpendicular"),
        (lambda: LiftDrag(area=1.0, lift_slope=1.0, forward=0 * X), "expected a direction"),
        (lambda: LiftDrag(area=1.0, lift_slope=1.0, stall=2.0), "stall"),
        (lambda: LiftDrag(area=1.0, lift_slope=1.0, sweep=1), "sweep: must be -2, 0 or 2"),
        (lambda: CrossTerms(terms=np.array([[0, 6, 0, 1, 1.0]])), "whole numbers 0 to 5"),
        (lambda: CrossTerms(terms=np.zeros((70, 5))), "at most 64"),
        (lambda: CrossTerms.of_gz({"xU": 1.0}), "expected names like xUabsV"),
        (lambda: PlanarStrip(start=X, end=X, direction=Y, drag=1.0), "coincide"),
        (
            lambda: BodyHydrodynamics(volume=1.0, forms=untyped(("lift",))),
            "forms: expected any of MunkFactor",
        ),
        (
            lambda: BodyHydrodynamics(volume=1.0, forms=(MunkFactor(), MunkFactor())),
            "at most one MunkFactor",
        ),
        (
            lambda: water.unpack([*water.pack(BodyHydrodynamics(volume=1.0)), 9.0, 2.0, 1.0, 1.0]),
            "unknown record of kind",
        ),
        (
            lambda: water.unpack([*water.pack(BodyHydrodynamics(volume=1.0)), 1.0, 30.0, 1.0]),
            "unknown record of kind",
        ),
    ],
)
def test_a_wrong_form_is_refused_in_one_line(make, said):
    with pytest.raises(ConfigurationError, match=said) as caught:
        make()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "tail", [[1.0, 50.0], [np.nan, 3.0], [1.0, -1.0], [1.0, np.nan], [77.0, 3.0], [np.inf, 1e300]]
)
def test_a_spoilt_record_does_not_lead_the_kernel_out_of_its_row(tail):
    model = floating(BodyHydrodynamics(volume=0.0, forms=MunkFactor()))
    model.body_user[1, LAYOUT.size :][:2] = tail
    data = mujoco.MjData(model)
    data.qvel = 1.0
    mujoco.mj_step(model, data)
    assert np.all(np.isfinite(data.qvel))


# -- judgement -------------------------------------------------------------------------------------


def test_the_slope_that_a_time_step_is_judged_by_bounds_every_form(rng):
    """No difference of the wrench at up to that speed shows more damping in its own direction."""
    for _ in range(20):
        for form in random_forms(rng):
            speed = float(rng.uniform(0.5, 3.0))
            A = np.eye(6)
            nu = rng.normal(size=(60, 6))
            if isinstance(form, LiftDrag):
                nu[:, 3:] = 0.0  # its bound is for the flow at the point, as a strip's is
                nu *= speed / np.linalg.norm(nu, axis=1)[:, None]
            elif isinstance(form, PlanarStrip):
                nu[:, 3:] = 0.0
                nu *= speed / np.linalg.norm(nu, axis=1)[:, None]
            else:
                nu *= speed / np.max(np.abs(nu), axis=1)[:, None]
            way = rng.normal(size=(60, 6))
            step = 1e-6
            ahead, behind = (
                form.wrench(at[:, :3], at[:, 3:], A) for at in (nu + step * way, nu - step * way)
            )
            damping = -np.sum(way * (ahead - behind), axis=1) / (2.0 * step)
            if isinstance(form, MunkFactor):
                continue  # it has no power
            # no slope bounds it where the flow runs along the span
            if isinstance(form, LiftDrag) and form.sweep < 0:
                across = nu[:, :3] @ np.cross(form.forward, form.upward)
                damping[np.abs(across) > 0.9 * speed] = 0.0
            bound = np.einsum("ni,ij,nj->n", way, form.slope(speed), way)
            assert np.all(damping <= bound * (1.0 + 1e-2) + 1e-6), type(form).__name__


def test_a_step_too_long_for_a_form_is_refused():
    strip = PlanarStrip(start=-X, end=X, direction=Y, drag=1.0)
    floating(BodyHydrodynamics(volume=0.0, forms=strip))
    with pytest.raises(HydrodynamicsError, match="rate of the drag"):
        floating(BodyHydrodynamics(volume=0.0, forms=strip.scaled(1e5)))
    wing = LiftDrag(area=0.1, lift_slope=3.0)
    floating(BodyHydrodynamics(volume=0.0, forms=wing))
    with pytest.raises(HydrodynamicsError, match="rate of the drag"):
        floating(BodyHydrodynamics(volume=0.0, forms=wing.scaled(1e3)))


def test_cross_terms_that_feed_energy_in_are_told():
    quadratic = np.full(6, 2.0)
    calm = BodyHydrodynamics(
        volume=0.0, quadratic_damping=quadratic, forms=CrossTerms.of_gz({"yVabsR": -1.0})
    )
    assert not [doubt for doubt in hydrodynamics.doubts(floating(calm)) if "cross" in doubt]
    # + 5 u v^2, against 2 |v|^3 and 2 |u|^3
    wild = replace(calm, forms=CrossTerms.of_gz({"yUV": 5.0}))
    (warning,) = [line for line in hydrodynamics.doubts(floating(wild)) if "cross" in line]
    match = re.search(r"at the twist \((.*?)\).* cross terms add (\S+) W", warning)
    assert match
    twist = np.array([float(x) for x in match[1].split(",")])
    power = float(twist @ energy.damping_wrench(wild, twist[None])[0])
    assert power == pytest.approx(float(match[2]), rel=0.1)  # the twist is told with two digits
    # At |v| = r |u| it is 5 r^2 - 2 r^3 - 2 per |u|^3: the search finds a motion near the best of
    # all.
    ratio = np.linspace(0.1, 5.0, 5000)
    best = np.max((5.0 * ratio**2 - 2.0 * ratio**3 - 2.0) / (1.0 + ratio**2) ** 1.5)
    assert power / float(np.linalg.norm(twist)) ** 3 == pytest.approx(best, rel=0.05)
    with pytest.warns(PhysicsWarning, match="cross terms add"):
        floating(wild)


# -- others who model ------------------------------------------------------------------------------


def test_the_reaction_of_a_free_vehicle_with_forms_is_nothing(rng, within):
    """Of the hull on the world in all directions, of a link on the hull about its free hinge."""
    spec = mujoco.MjSpec.from_string(
        '<mujoco><worldbody><body name="hull"><freejoint/><geom size=".3" mass="20"/>'
        '<body name="link" pos=".4 .1 0"><joint axis="0 0 1"/><geom size=".1" pos=".2 0 0" '
        'mass="3"/></body></body>'
        '</worldbody><option timestep="1e-4"/></mujoco>'
    )
    water.attach(
        spec,
        {
            name: replace(random_coefficients(rng), forms=random_forms(rng))
            for name in ("hull", "link")
        },
    )
    water.set_current(spec, rng.normal(size=3), rng.normal(size=3), rng.normal(size=3))
    model = hydrodynamics.compile(spec)
    data = mujoco.MjData(model)
    for _ in range(5):
        set_in_motion(model, data, rng)
        data.qfrc_applied[:] = 0.0
        mujoco.mj_forward(model, data)
        within("of the hull [N, N m]", reaction_wrench.wrench(model, data, "hull"), 1e-9)
        link = reaction_wrench.wrench(model, data, "link")
        within("of the link about its hinge [N m]", link[5], 1e-9)
        assert np.max(np.abs(link)) > 1.0


def test_perturbed_water_keeps_its_forms():
    spec = load("remus100")
    rng = np.random.default_rng(1)
    before = water.attached(spec)["hull"].terms
    Water(spread=0.2).on_vehicle(spec, rng)
    after = water.attached(spec)["hull"].terms
    assert [type(form) for form in after] == [type(form) for form in before]
    np.testing.assert_array_equal(after[0].numbers(), before[0].numbers())
    ratios = [
        changed.slope(1.0).max() / here.slope(1.0).max()
        for changed, here in zip(after, before, strict=True)
        if here.slope(1.0).any()
    ]
    assert len({round(r, 9) for r in ratios}) == 3
    assert all(0.8 <= r <= 1.2 for r in ratios)


def test_a_model_that_knows_no_forms_says_so():
    row = water.pack(
        BodyHydrodynamics(
            volume=1.0, forms=(MunkFactor(), FadingDamping(linear=np.ones(6), rate=1.0))
        )
    )
    with pytest.warns(PhysicsWarning, match="the arm does not include .*FadingDamping, MunkFactor"):
        assert not water.without_forms(row, "the arm").terms


def test_thrust_margin_counts_the_forms():
    """In a current: without its couple an added mass takes no thrust, and a strip that drags takes
    more.
    """
    spec = load("bluerov2_heavy_alpha5")
    hull = water.attached(spec)["hull"]
    current = np.array([0.4, 0.4, 0.0])
    no_couple = MunkFactor(factor=np.zeros(3))
    strip = PlanarStrip(start=-0.2 * X, end=0.2 * X, direction=Y, drag=300.0)
    used = []
    for body in (
        hull,
        replace(hull, forms=no_couple),
        replace(hull, added_mass=np.zeros((6, 6))),
        replace(hull, forms=(no_couple, strip)),
    ):
        water.attach(spec, {"hull": body})
        margin = ThrustMargin.of(hydrodynamics.compile(spec)).in_current(current)
        used.append(margin.used(np.array(reach_alpha_5.HOME), np.eye(3), np.zeros(3)))
    assert used[1] != used[0]
    assert used[1] == pytest.approx(used[2], abs=1e-12)
    assert used[3] > 1.1 * used[1]
