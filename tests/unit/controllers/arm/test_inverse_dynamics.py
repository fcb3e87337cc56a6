"""Newton-Euler kernel, uncompiled: against MuJoCo where dry; in water by power, virtual work and
invariance.
"""

from copy import copy
from typing import Any

import mujoco
import numpy as np
import pytest

from uncompiled import uncompiled
from uuv import models
from uuv.models import hydrodynamics
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.spatial import Array, exp_so3, pose

(dynamics,) = uncompiled("uuv.controllers.arm.inverse_dynamics")
_WORK: dict[int, Array] = {}  # by the number of bodies


def kept(layout: np.ndarray) -> Array:
    """Working memory of the kernel, which is that of the last call."""
    return _WORK.setdefault(layout.shape[1], np.zeros(39 * layout.shape[1] + 27))


vars(dynamics)["workspace"] = kept
WATER = ("added", "linear", "quadratic", "buoyancy", "cob")
STILL: dict[str, Any] = {
    "R_WB": np.eye(3),
    "nu_B": np.zeros(6),
    "a_B": np.zeros(6),
    "v_current_W": np.zeros(3),
    "wrench_tip_G": np.zeros(6),
}


@pytest.fixture(scope="module", params=["uuv_puma", "bluerov2_heavy_alpha5"])
def model(request: pytest.FixtureRequest) -> mujoco.MjModel:
    return models.load(request.param).compile()


@pytest.fixture
def arm(model: mujoco.MjModel) -> Any:
    """With slides as coordinates, and water drawn at random."""
    dynamics_of_arm = dynamics.ArmDynamics(model, passive=True)
    rng = np.random.default_rng(5)
    added, linear, quadratic, buoyancy, cob = dynamics_of_arm.of_bodies(
        dynamics_of_arm.parameters.numbers, *WATER
    )
    for b in range(len(buoyancy)):
        G, D = rng.normal(size=(2, 6, 6))
        added[b] = (G @ G.T).ravel()
        linear[b] = (D @ D.T + 0.3 * (D - D.T)).ravel()
        quadratic[b] = rng.uniform(0.0, 3.0, 6)
        cob[b] = rng.normal(size=3)
        buoyancy[b] = rng.uniform(0.5, 2.0)
    return dynamics_of_arm


def without(arm: Any, *names: str) -> None:
    for numbers in arm.of_bodies(arm.parameters.numbers, *names):
        numbers[:] = 0.0


def drawn(rng: np.random.Generator) -> dict[str, Any]:
    return {
        "R_WB": exp_so3(rng.normal(size=3)),
        "nu_B": rng.normal(size=6),
        "a_B": rng.normal(size=6),
        "v_current_W": rng.normal(size=3),
        "wrench_tip_G": np.zeros(6),
    }


def test_dry_it_is_mujocos_inverse_dynamics(
    model: mujoco.MjModel, arm: Any, rng: np.random.Generator
) -> None:
    without(arm, *WATER)
    arm.parameters = arm.parameters._replace(stations=arm.parameters.stations[:0])
    model = copy(model)
    model.body_user[:] = 0.0  # no water, whichever callback another test has installed
    data = mujoco.MjData(model)
    vehicle = Vehicle.of(model)
    case = drawn(rng)
    joints = [model.joint(name).id for name in arm.joint_names]
    at, dof = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
    q, qd, qdd = rng.uniform(-0.4, 0.4, (3, arm.n))
    R, nu, a = case["R_WB"], case["nu_B"], case["a_B"]
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, R.ravel())
    hull_at = vehicle.hull_qpos
    first = int(model.jnt_dofadr[model.body_jntadr[vehicle.hull]])
    data.qpos[hull_at + 3 : hull_at + 7], data.qpos[at] = quaternion, q
    data.qvel[first : first + 3], data.qvel[first + 3 : first + 6], data.qvel[dof] = (
        R @ nu[:3],
        nu[3:],
        qd,
    )
    data.qacc[first : first + 3], data.qacc[first + 3 : first + 6], data.qacc[dof] = (
        R @ a[:3],
        a[3:],
        qdd,
    )
    model.dof_armature[dof] = 0.0
    # Bias and inertia alone: no springs, dampers, friction or contacts.
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)
    tau_mujoco = np.zeros(model.nv)
    mujoco.mj_mulM(model, data, tau_mujoco, data.qacc)
    tau_mujoco += data.qfrc_bias
    tau, _ = arm.inverse(q, qd, qdd, **case)
    np.testing.assert_allclose(tau, tau_mujoco[dof], atol=1e-9 * np.abs(tau_mujoco).max())


def kinetic(arm: Any, q: Array, qd: Array, case: dict[str, Any]) -> float:
    """Kinetic energy [J] of bodies and added mass."""
    arm.inverse(q, qd, np.zeros(arm.n), **case)
    nb = arm.parameters.layout.shape[1]
    mass, com, inertia, added, origin = arm.of_bodies(
        arm.parameters.numbers, "mass", "com", "inertia", "added", "origin"
    )
    energy = 0.0
    for b, nu in enumerate(kept(arm.parameters.layout)[21 * nb : 27 * nb].reshape(nb, 6)):
        v = nu[:3]
        w = nu[3:]
        energy += (
            0.5 * mass[b, 0] * v @ v
            + mass[b, 0] * v @ np.cross(w, com[b])
            + 0.5 * w @ inertia[b].reshape(3, 3) @ w
        )
        twist = np.concatenate([v + np.cross(w, origin[b]), w])
        energy += 0.5 * twist @ added[b].reshape(6, 6) @ twist
    return energy


def power(arm: Any, q: Array, qd: Array, qdd: Array, case: dict[str, Any]) -> float:
    """Power [W] of the joints and of the hull on the arm."""
    tau, wrench_B = arm.inverse(q, qd, qdd, **case)
    return float(tau @ qd - wrench_B @ case["nu_B"])


def test_without_weight_and_drag_all_power_becomes_motion(
    arm: Any, rng: np.random.Generator
) -> None:
    without(arm, "linear", "quadratic")
    arm.weightless(arm.parameters.numbers)
    arm.parameters = arm.parameters._replace(stations=arm.parameters.stations[:0])
    for _ in range(3):
        case = drawn(rng) | {"v_current_W": np.zeros(3)}
        q, qd, qdd = rng.uniform(-0.4, 0.4, (3, arm.n))
        h = 1e-5
        nu = case["nu_B"]
        a = case["a_B"]
        rate = np.concatenate([a[:3] - np.cross(nu[3:], nu[:3]), a[3:]])  # of the components of nu
        ahead, behind = (
            kinetic(arm, q + s * h * qd, qd + s * h * qdd, case | {"nu_B": nu + s * h * rate})
            for s in (1, -1)
        )
        assert power(arm, q, qd, qdd, case) == pytest.approx((ahead - behind) / (2 * h), rel=1e-6)


def test_drag_takes_the_power_of_each_bodys_motion(arm: Any, rng: np.random.Generator) -> None:
    """At no acceleration, and of those bodies whose added mass and weight are none."""
    without(arm, "mass", "inertia", "added")
    arm.weightless(arm.parameters.numbers)
    nb = arm.parameters.layout.shape[1]
    linear, quadratic, origin = arm.of_bodies(
        arm.parameters.numbers, "linear", "quadratic", "origin"
    )
    stations = arm.parameters.stations
    for strips in (False, True):
        arm.parameters = arm.parameters._replace(stations=stations if strips else stations[:0])
        if strips:
            without(arm, "linear", "quadratic")
        case = drawn(rng)
        q, qd = rng.uniform(-0.4, 0.4, (2, arm.n))
        taken = power(arm, q, qd, np.zeros(arm.n), case | {"v_current_W": np.zeros(3)})
        lost = 0.0
        velocity = kept(arm.parameters.layout)[21 * nb : 27 * nb].reshape(nb, 6)
        for b, nu in enumerate(velocity):
            twist = np.concatenate([nu[:3] + np.cross(nu[3:], origin[b]), nu[3:]])
            lost += twist @ linear[b].reshape(6, 6) @ twist + quadratic[b] @ np.abs(twist) ** 3
        for row, *rest in arm.parameters.stations:
            b = int(row)
            p = np.array(rest[:3])
            along = np.array(rest[3:6])
            u = velocity[b, :3] + np.cross(velocity[b, 3:], p + origin[b])
            u_t = u @ along
            u_n = np.linalg.norm(u - u_t * along)
            lost += rest[6] * u_n**3 + rest[7] * abs(u_t) ** 3
        assert taken == pytest.approx(lost, rel=1e-9)


def test_a_current_is_the_opposite_motion_of_the_hull(arm: Any, rng: np.random.Generator) -> None:
    """Weight, and all water; the hull drifting with the current, or at rest in still water."""
    case = drawn(rng)
    q, qd, qdd = rng.uniform(-0.4, 0.4, (3, arm.n))
    v_W = case["v_current_W"]
    drifting = case["nu_B"] + np.concatenate([case["R_WB"].T @ v_W, np.zeros(3)])
    a = arm.inverse(q, qd, qdd, **case | {"nu_B": drifting})
    b = arm.inverse(q, qd, qdd, **case | {"v_current_W": np.zeros(3)})
    np.testing.assert_allclose(a[0], b[0], atol=1e-9)
    np.testing.assert_allclose(a[1], b[1], atol=1e-9)


def test_at_rest_torques_are_slopes_of_weight_and_buoyancy(
    model: mujoco.MjModel, arm: Any, rng: np.random.Generator
):
    nb, (mass, com, buoyancy, cob, origin) = (
        arm.parameters.layout.shape[1],
        arm.of_bodies(arm.parameters.numbers, "mass", "com", "buoyancy", "cob", "origin"),
    )
    R = exp_so3(rng.normal(size=3))
    g = np.array(model.opt.gravity)

    def potential(q: Array) -> float:
        arm.inverse(q, 0.0 * q, 0.0 * q, **STILL | {"R_WB": R})
        turns = kept(arm.parameters.layout)[: 9 * nb].reshape(nb, 3, 3).copy()
        places = kept(arm.parameters.layout)[9 * nb : 12 * nb].reshape(nb, 3).copy()
        energy = 0.0
        X = []
        for b in range(nb):
            up = arm.parameters.layout[0, b]
            X.append((pose(R) if up < 0 else X[up]) @ pose(turns[b], places[b]))
            energy -= g @ (X[b] @ [*(mass[b, 0] * com[b]), mass[b, 0]])[:3]
            energy += g @ (X[b] @ [*(buoyancy[b, 0] * (origin[b] + cob[b])), buoyancy[b, 0]])[:3]
        return energy

    q = rng.uniform(-0.4, 0.4, arm.n)
    tau, wrench_B = arm.inverse(q, 0.0 * q, 0.0 * q, **STILL | {"R_WB": R})
    for i, e in enumerate(1e-5 * np.eye(arm.n)):
        assert tau[i] == pytest.approx((potential(q + e) - potential(q - e)) / 2e-5, abs=1e-6)
    np.testing.assert_allclose(wrench_B[:3], R.T @ g * (mass.sum() - buoyancy.sum()), atol=1e-9)


def test_tip_kinematics_and_contact_are_virtual_work(
    model: mujoco.MjModel, arm: Any, rng: np.random.Generator
) -> None:
    data, vehicle = mujoco.MjData(model), Vehicle.of(model)
    q = rng.uniform(-0.4, 0.4, arm.n)
    data.qpos[model.jnt_qposadr[[model.joint(name).id for name in arm.joint_names]]] = q
    mujoco.mj_kinematics(model, data)
    X_WB = pose(data.xmat[vehicle.hull].reshape(3, 3), data.xpos[vehicle.hull])
    X_WG = pose(data.site_xmat[vehicle.tip].reshape(3, 3), data.site_xpos[vehicle.tip])
    none = np.zeros(arm.n)
    rest, hull_rest = arm.inverse(q, none, none, **STILL)
    X = np.empty((4, 4))
    J = np.empty((6, arm.n))
    dynamics.tip_kinematics(arm.parameters, kept(arm.parameters.layout), X, J)
    np.testing.assert_allclose(X_WB @ X, X_WG, atol=1e-9)
    h = 1e-6
    for i, e in enumerate(h * np.eye(arm.n)):
        arm.inverse(q + e, none, none, **STILL)
        moved = np.empty((4, 4))
        unused = np.empty((6, arm.n))
        dynamics.tip_kinematics(arm.parameters, kept(arm.parameters.layout), moved, unused)
        np.testing.assert_allclose(J[:3, i], (moved[:3, 3] - X[:3, 3]) / h, atol=1e-5)
        turn = moved[:3, :3] @ X[:3, :3].T
        angular = (
            0.5
            * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
            / h
        )
        np.testing.assert_allclose(J[3:, i], angular, atol=1e-5)
    wrench_G = rng.normal(size=6)
    f = X[:3, :3] @ wrench_G[:3]
    m = X[:3, :3] @ wrench_G[3:]
    tau, wrench_B = arm.inverse(q, none, none, **STILL | {"wrench_tip_G": wrench_G})
    np.testing.assert_allclose(tau - rest, -J.T @ np.concatenate([f, m]), atol=1e-9)
    np.testing.assert_allclose(wrench_B - hull_rest, [*f, *(m + np.cross(X[:3, 3], f))], atol=1e-9)


def test_stations_add_up_to_their_strip(model: mujoco.MjModel) -> None:
    """To its length times its coefficients, about its middle, in its direction."""
    dynamics_of_arm = dynamics.ArmDynamics(model, water_error=0.1)
    stations = dynamics_of_arm.parameters.stations
    assert len(stations)
    first = 0
    hull = Vehicle.of(model).hull
    for body in range(hull + 1, model.nbody):
        if not hydrodynamics.carries(model.body_user[body]):
            continue
        for strip in hydrodynamics.unpack(model.body_user[body]).segments:
            part = stations[first : first + strip.stations]
            first += strip.stations
            length = np.linalg.norm(strip.end - strip.start)
            np.testing.assert_allclose(
                part[:, 4:7], np.tile((strip.end - strip.start) / length, (len(part), 1))
            )
            np.testing.assert_allclose(
                part[:, 7:].sum(axis=0), 1.1 * length * np.array([strip.normal, strip.tangential])
            )
            middle = np.average(part[:, 1:4], axis=0, weights=part[:, 7])
            np.testing.assert_allclose(middle, 0.5 * (strip.start + strip.end), atol=1e-12)
            assert len(set(part[:, 0])) == 1
    assert first == len(stations)
