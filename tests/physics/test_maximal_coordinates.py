"""Random trees against an independent formulation: every body by itself, joint reactions as unknowns."""

import mujoco
import numpy as np

from models import hydrodynamics as water
from models.hydrodynamics import LAYOUT, BodyHydrodynamics, StripDrag
from sim import hydrodynamics
from sim.interfaces.spatial import Array, skew

DENSITY = 1000.0


def numbers(values: Array) -> str:
    return " ".join(repr(float(x)) for x in values)


def semidefinite(rng: np.random.Generator, scale: float) -> Array:
    L = rng.normal(size=(6, 6))
    return scale * L @ L.T


def random_coefficients(rng: np.random.Generator) -> BodyHydrodynamics:
    skewed = rng.normal(size=(6, 6))
    return BodyHydrodynamics(
        volume=rng.uniform(0.001, 0.004),
        center_of_buoyancy=0.1 * rng.normal(size=3),
        added_mass=semidefinite(rng, 1.0),
        linear_damping=semidefinite(rng, 0.3) + skewed - skewed.T,
        quadratic_damping=rng.uniform(0.0, 2.0, size=6),
        strips=tuple(
            StripDrag(
                start=0.2 * rng.normal(size=3),
                end=0.2 * rng.normal(size=3),
                normal=rng.uniform(1.0, 5.0),
                tangential=rng.uniform(0.0, 1.0),
                stations=int(rng.integers(1, 9)),
            )
            for _ in range(rng.integers(0, 3))
        ),
    )


def random_tree(rng: np.random.Generator) -> tuple[mujoco.MjModel, dict[int, BodyHydrodynamics]]:
    """Free, ball, hinge and slide joints, two on one body, welded bodies, branches, a static root, dry bodies."""
    spec = mujoco.MjSpec.from_string('<mujoco><option timestep="1e-4"/></mujoco>')
    bodies = [spec.worldbody]
    coefficients: dict[str, BodyHydrodynamics] = {}
    for i in range(int(rng.integers(3, 9))):
        parent = bodies[int(rng.integers(0, len(bodies)))]
        body = parent.add_body(name=f"b{i}", pos=0.3 * rng.normal(size=3), quat=rng.normal(size=4))
        body.explicitinertial = 1
        body.mass = rng.uniform(0.5, 3.0)
        body.ipos, body.iquat = 0.1 * rng.normal(size=3), rng.normal(size=4)
        body.inertia = rng.uniform(0.08, 0.12, size=3)
        kinds = ["hinge", "slide", "ball", "hinge slide", "slide hinge", "weld"] + ["free"] * 3 * (
            parent is spec.worldbody
        )
        kind = kinds[int(rng.integers(0, len(kinds)))]
        if i == 0:
            kind = "hinge"  # at least one thing moves
        for name in kind.split():
            if name != "weld":
                joint = body.add_joint(type=getattr(mujoco.mjtJoint, f"mjJNT_{name.upper()}"))
                joint.axis, joint.pos = rng.normal(size=3), 0.1 * rng.normal(size=3) * (name != "free")
                joint.armature = rng.uniform(0.0, 0.1) * (name in {"hinge", "slide"})
        if rng.uniform() < 0.85:
            coefficients[body.name] = random_coefficients(rng)
        bodies.append(body)
    water.attach(spec, coefficients, DENSITY)
    water.set_current(spec, rng.normal(size=3), rng.normal(size=3), 0.3 * rng.normal(size=3))
    model = hydrodynamics.compile(spec)
    return model, {model.body(name).id: body for name, body in coefficients.items()}


def body_jacobians(model: mujoco.MjModel, qpos: Array) -> Array:
    """(nbody, 6, nv) of the body origins, world axes, linear over angular."""
    data = mujoco.MjData(model)
    data.qpos = qpos
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    J = np.zeros((model.nbody, 6, model.nv))
    for i in range(model.nbody):
        mujoco.mj_jacBody(model, data, J[i, :3], J[i, 3:], i)
    return J


def body_accelerations(model: mujoco.MjModel, qpos: Array, qvel: Array) -> Array:
    """(nbody, 6) accelerations of the body origins with qacc = 0: sixth-order differences of the kinematics."""
    h, total = 5e-3, np.zeros((model.nbody, 6))
    for k, weight in ((1, 45.0), (2, -9.0), (3, 1.0)):
        for sign in (1.0, -1.0):
            moved = qpos.copy()
            mujoco.mj_integratePos(model, moved, qvel, sign * k * h)
            total += sign * weight * body_jacobians(model, moved) @ qvel
    return total / (60.0 * h)


def forces(body: BodyHydrodynamics, model: mujoco.MjModel, z: float, R: Array, v_W: Array, w_W: Array) -> Array:
    """Hydrodynamic wrench (6,) in body axes, without -A nudot: Kirchhoff's equations, drag and buoyancy."""
    shear = model.body_user[0, LAYOUT.current_shear :][:3]
    current = model.opt.wind + z * shear
    flow = model.body_user[0, LAYOUT.current_acceleration :][:3] + current[2] * shear
    w, u = R.T @ w_W, R.T @ current
    nu_r = np.concatenate([R.T @ v_W - u, w])
    p = body.added_mass @ nu_r
    f = np.concatenate([-np.cross(w, p[:3]), -np.cross(w, p[3:]) - np.cross(nu_r[:3], p[:3])])
    f -= body.added_mass[:, :3] @ (np.cross(w, u) - R.T @ flow)
    f -= body.linear_damping @ nu_r + body.quadratic_damping * np.abs(nu_r) * nu_r
    for strip in body.segments:
        x, weights = np.polynomial.legendre.leggauss(strip.stations)
        along = strip.end - strip.start
        length = np.linalg.norm(along)
        P = np.outer(along, along) / length**2
        for node, weight in zip(x, weights, strict=True):
            point = strip.start + (node + 1.0) / 2.0 * along
            u_p = nu_r[:3] + np.cross(w, point)
            u_t, u_n = P @ u_p, u_p - P @ u_p
            df = strip.normal * np.linalg.norm(u_n) * u_n + strip.tangential * np.linalg.norm(u_t) * u_t
            f -= weight / 2.0 * length * np.concatenate([df, np.cross(point, df)])
    lift = DENSITY * body.volume * R.T @ (flow - model.opt.gravity)
    return f + np.concatenate([lift, np.cross(body.center_of_buoyancy, lift)])


def independent_acceleration(
    model: mujoco.MjModel, coefficients: dict[int, BodyHydrodynamics], qpos: Array, qvel: Array, tau: Array
) -> Array:
    """qacc (nv,) from G a - r = F for each body, a = J qacc + b for its motion, and sum J^T r = tau for its joints."""
    data = mujoco.MjData(model)
    data.qpos = qpos
    mujoco.mj_kinematics(model, data)
    J, bias = body_jacobians(model, qpos), body_accelerations(model, qpos, qvel)
    count = 6 * (model.nbody - 1)
    G, F = np.zeros((count, count)), np.zeros(count)
    for i in range(1, model.nbody):
        R = data.xmat[i].reshape(3, 3)
        v, w = (J[i] @ qvel)[:3], (J[i] @ qvel)[3:]
        c = data.xipos[i] - data.xpos[i]
        m, C = model.body_mass[i], data.ximat[i].reshape(3, 3)
        inertia = C @ np.diag(model.body_inertia[i]) @ C.T - m * skew(c) @ skew(c)
        here = slice(6 * i - 6, 6 * i)
        G[here, here] = np.block([[m * np.eye(3), -m * skew(c)], [m * skew(c), inertia]])
        F[here] = np.concatenate(
            [
                m * model.opt.gravity - m * np.cross(w, np.cross(w, c)),
                m * np.cross(c, model.opt.gravity) - np.cross(w, inertia @ w),
            ]
        )
        if i in coefficients:
            turn = np.kron(np.eye(2), R)
            G[here, here] += turn @ coefficients[i].added_mass @ turn.T
            F[here] += turn @ forces(coefficients[i], model, data.xpos[i, 2], R, v, w)
            # nudot is the rate seen in body axes: R^T (a - w x v), so G a above counts A R^T (w x v) too much.
            F[here] += turn @ coefficients[i].added_mass[:, :3] @ R.T @ np.cross(w, v)
    Js = J[1:].reshape(count, model.nv)
    zero, eye = np.zeros, np.eye(count)
    system = np.block(
        [
            [G, zero((count, model.nv)), -eye],
            [eye, -Js, zero((count, count))],
            [zero((model.nv, count)), np.diag(model.dof_armature), Js.T],
        ]
    )
    solution: Array = np.linalg.solve(system, np.concatenate([F, bias[1:].ravel(), tau])).astype(np.float64)
    return solution[count : count + model.nv]


def test_acceleration_of_random_trees(rng, within):
    worst = largest = 0.0
    for _ in range(15):
        model, coefficients = random_tree(rng)
        data = mujoco.MjData(model)
        data.qvel = rng.normal(size=model.nv)
        mujoco.mj_integratePos(model, data.qpos, rng.normal(size=model.nv), 1.0)
        data.qfrc_applied = rng.normal(size=model.nv)
        mujoco.mj_forward(model, data)
        expected = independent_acceleration(model, coefficients, data.qpos, data.qvel, data.qfrc_applied)
        largest = max(largest, float(np.max(np.abs(expected))))
        worst = max(worst, float(np.max(np.abs(data.qacc - expected)) / np.max(np.abs(expected))))
    assert largest > 1.0
    within("relative qacc", worst, 3e-11)  # measured up to 3e-12
