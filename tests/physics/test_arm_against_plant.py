"""Own Newton-Euler of the arm against the plant: random vehicles in random motion, the hull's
momentum included.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
import pytest

from tests.physics.random_trees import semidefinite
from uuv import models
from uuv.controllers.arm.inverse_dynamics import ArmDynamics, JointMotion
from uuv.controllers.arm.joint_servo import resolve_tool_motion
from uuv.controllers.estimation import force_from_torques
from uuv.controllers.estimation.tip_force_kernels import (
    SensedArm,
    TorqueErrors,
    estimate_tip_force,
    unfiltered_tip_force,
)
from uuv.models import hydrodynamics as water
from uuv.models.hydrodynamics import BodyHydrodynamics, StripDrag
from uuv.models.vehicle import Vehicle
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.spatial import Array, inverse, pose
from uuv.sim.plant.reaction_wrench import wrench

STATES = 3
# on the tip: nothing, some 50 N and 50 N m, a rock that it runs into
PUSHES = ["none", "wrench", "contact"]
RADIUS = 0.05  # [m] of the balls that touch
NOISE, FLOOR = 0.01, 0.1  # of the torque sensors: share of the reading, [N m]


def random_water(rng: np.random.Generator, scale: float) -> BodyHydrodynamics:
    skewed = rng.normal(size=(6, 6))
    return BodyHydrodynamics(
        volume=1e-3 * scale * rng.uniform(0.5, 2.0),
        center_of_buoyancy=0.1 * rng.normal(size=3),
        added_mass=semidefinite(rng, scale / 3.0),
        linear_damping=semidefinite(rng, scale) + scale * (skewed - skewed.T),
        quadratic_damping=scale * rng.uniform(0.0, 2.0, 6),
        strips=tuple(
            StripDrag(
                start=rng.normal(size=3),
                end=rng.normal(size=3),
                normal=20.0 * scale,
                tangential=scale,
            )
            for _ in range(rng.integers(0, 3))
        ),
    )


def wet(spec: mujoco.MjSpec, rng: np.random.Generator) -> mujoco.MjSpec:
    """`spec` with other coefficients on every body, some left dry."""
    bodies = {
        b.name: random_water(rng, 100.0 if b.name == "hull" else 1.0) for b in spec.bodies[1:]
    }
    dry = [name for name in bodies if name != "hull" and rng.uniform() < 0.15]
    water.attach(spec, {name: body for name, body in bodies.items() if name not in dry})
    # nothing is stepped; the check of the drag against the step must not stand in the way
    spec.option.timestep = 1e-6
    return spec


def random_vehicle(rng: np.random.Generator) -> mujoco.MjSpec:
    """A hull with a serial arm of hinges and slides off their bodies' origins, welded bodies and
    moving branches.
    """
    spec = mujoco.MjSpec()

    def body(parent: mujoco.MjsBody, name: str, joint: str) -> mujoco.MjsBody:
        b = parent.add_body(
            name=name, pos=0.3 * rng.normal(size=3), quat=rng.normal(size=4), explicitinertial=1
        )
        b.mass = rng.uniform(0.5, 5.0)
        b.inertia = rng.uniform(0.08, 0.12, 3)
        b.ipos = 0.1 * rng.normal(size=3)
        b.iquat = rng.normal(size=4)
        if joint:
            j = b.add_joint(name=name, type=getattr(mujoco.mjtJoint, f"mjJNT_{joint.upper()}"))
            j.axis = rng.normal(size=3)
            j.pos = 0.2 * rng.normal(size=3)
            j.range = [-1e3, 1e3]
            j.limited = 1
            j.armature = rng.uniform(0.0, 0.5)
            j.damping = [rng.uniform(), 0, 0]
            j.stiffness = [rng.uniform(), 0, 0]
        return b

    hull = body(spec.worldbody, "hull", "")
    hull.mass = 60.0
    hull.inertia = [6.0, 9.0, 8.0]
    hull.add_freejoint()
    carried = [hull, body(hull, "arm_base", "")]
    at = carried[1]
    for i in range(int(rng.integers(3, 8))):
        joint = "hinge" if i == 0 else rng.choice(["hinge", "hinge", "slide", ""])
        at = body(at, f"link{i}", joint)
        if joint:
            motor = spec.add_actuator(
                name=f"link{i}", target=f"link{i}", trntype=mujoco.mjtTrn.mjTRN_JOINT
            )
            motor.ctrlrange = [-100, 100]
            motor.ctrllimited = 1
        carried.append(at)
    at.add_site(name="tip", pos=0.3 * rng.normal(size=3), quat=rng.normal(size=4))
    for i in range(int(rng.integers(1, 4))):
        carried.append(
            body(
                carried[int(rng.integers(0, len(carried)))],
                f"branch{i}",
                rng.choice(["hinge", "slide", ""]),
            )
        )
    return spec


def uuv_puma(rng: np.random.Generator) -> mujoco.MjSpec:
    del rng
    return models.load("uuv_puma")


def add_rock(spec: mujoco.MjSpec) -> None:
    """A ball on the tip and a rock that stands where it is put; nothing else touches anything."""
    for geom in spec.geoms:
        geom.contype, geom.conaffinity = 0, 0
    tip = spec.site("tip")
    body = next(b for b in spec.bodies if tip in b.sites)
    body.add_geom(size=[RADIUS, 0, 0], pos=tip.pos, mass=0, condim=6, friction=[0.5, 0.02, 0.01])
    spec.worldbody.add_body(name="rock", mocap=True).add_geom(size=[RADIUS, 0, 0], condim=6)
    spec.option.tolerance = 0.0
    spec.option.iterations = 200


@dataclass(frozen=True, kw_only=True, eq=False)
class Moving:
    """The plant in one random state of motion, and what it tells of it."""

    model: mujoco.MjModel
    data: mujoco.MjData
    arm: ArmDynamics
    vehicle: Vehicle
    dofs: list[int]  # of the arm's coordinates
    tau: Array  # (n,) torque through every gear output [N m]
    f_tip_W: Array  # (6,) wrench of the world on the tip

    @classmethod
    def of(cls, spec: mujoco.MjSpec, rng: np.random.Generator, push: str) -> "Moving":
        if push == "contact":
            add_rock(spec)
        model = hydrodynamics.compile(spec)
        vehicle = Vehicle.of(model)
        arm = ArmDynamics(model, passive=True)
        data = mujoco.MjData(model)
        model.opt.wind = rng.normal(size=3)
        mujoco.mj_integratePos(model, data.qpos, rng.normal(size=model.nv), 1.0)
        joints = [model.joint(name) for name in arm.joint_names]
        # within the limits, so that nothing but gears, springs and motors acts
        for joint in joints:
            low, high = joint.range
            if high - low < 10.0:
                data.qpos[joint.qposadr[0]] = rng.uniform(0.9 * low, 0.9 * high)
        data.qvel = rng.normal(size=model.nv)
        data.qfrc_applied = 20.0 * rng.normal(size=model.nv)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        dofs = [int(joint.dofadr[0]) for joint in joints]
        applied = data.qfrc_applied[dofs]
        tip = int(model.site_bodyid[vehicle.tip])
        p_tip = data.site_xpos[vehicle.tip].copy()
        f_tip_W = (
            50.0
            * rng.normal(size=6)
            * np.repeat([push in ("force", "wrench"), push == "wrench"], 3)
        )
        lever = p_tip - data.xipos[tip]
        data.xfrc_applied[tip] = [*f_tip_W[:3], *(f_tip_W[3:] + np.cross(lever, f_tip_W[:3]))]
        if push == "contact":
            away = rng.normal(size=3)
            data.mocap_pos[0] = p_tip + 2.0 * RADIUS * away / np.linalg.norm(away) * rng.uniform(
                0.8, 0.99
            )
        mujoco.mj_forward(model, data)
        assert data.nefc == data.nf or push == "contact"
        assert data.ncon == (push == "contact")
        for i in range(data.ncon):
            frame = data.contact.frame[i].reshape(3, 3)
            f = np.zeros(6)
            mujoco.mj_contactForce(model, data, i, f)
            sign = 1.0 if model.geom_bodyid[data.contact.geom[i, 1]] == tip else -1.0
            force = sign * frame.T @ f[:3]
            torque = sign * frame.T @ f[3:]
            f_tip_W += np.concatenate(
                [force, torque + np.cross(data.contact.pos[i] - p_tip, force)]
            )
        stiffness = np.asarray(model.jnt_stiffness).reshape(model.njnt, -1)[
            [j.id for j in joints], 0
        ]
        damping = np.asarray(model.dof_damping).reshape(model.nv, -1)[dofs, 0]
        q = np.array([data.qpos[j.qposadr[0]] for j in joints])
        spring = np.array([model.qpos_spring[j.qposadr[0]] for j in joints])
        dry = np.zeros(model.nv)  # friction of the gears: a constraint for each that has some
        dry[np.asarray(model.dof_frictionloss) > 0.0] = data.efc_force[data.ne : data.ne + data.nf]
        tau = applied + dry[dofs] - stiffness * (q - spring) - damping * data.qvel[dofs]
        tau -= model.dof_armature[dofs] * data.qacc[dofs]
        return cls(
            model=model, data=data, arm=arm, vehicle=vehicle, dofs=dofs, tau=tau, f_tip_W=f_tip_W
        )

    @property
    def X_WB(self) -> Array:
        return pose(
            self.data.xmat[self.vehicle.hull].reshape(3, 3), self.data.xpos[self.vehicle.hull]
        )

    @property
    def q(self) -> Array:
        return np.array([self.data.joint(name).qpos[0] for name in self.arm.joint_names])

    def hull_motion(self) -> tuple[Array, Array]:
        """nu_B and a_B (6,), hull axes."""
        R = self.X_WB[:3, :3]
        dof = self.vehicle.hull_dof
        v, a = self.data.qvel[dof : dof + 6], self.data.qacc[dof : dof + 6]
        return np.concatenate([R.T @ v[:3], v[3:]]), np.concatenate([R.T @ a[:3], a[3:]])

    def inverse(self, wrench_tip_G: Array) -> tuple[Array, Array]:
        nu_B, a_B = self.hull_motion()
        return self.arm.inverse(
            self.q,
            self.data.qvel[self.dofs],
            self.data.qacc[self.dofs],
            R_WB=self.X_WB[:3, :3],
            nu_B=nu_B,
            a_B=a_B,
            v_current_W=np.array(self.model.opt.wind),
            wrench_tip_G=wrench_tip_G,
        )

    def wrench_tip_G(self) -> Array:
        R_WG = self.data.site_xmat[self.vehicle.tip].reshape(3, 3)
        return np.concatenate([R_WG.T @ self.f_tip_W[:3], R_WG.T @ self.f_tip_W[3:]])


def relative(got: Array, expected: Array) -> float:
    return float(np.max(np.abs(got - expected)) / np.max(np.abs(expected)))


@pytest.fixture(params=[uuv_puma, random_vehicle])
def vehicle_of(request: pytest.FixtureRequest):
    return request.param


@pytest.mark.check(
    "joint torques of arms on a moving hull, pushed, in contact", "own recursive Newton-Euler"
)
@pytest.mark.parametrize("push", PUSHES)
def test_torques(vehicle_of, push, rng, within):
    worst = 0.0
    for _ in range(STATES):
        moving = Moving.of(wet(vehicle_of(rng), rng), rng, push)
        assert np.max(np.abs(moving.data.qacc)) > 1.0
        worst = max(worst, relative(moving.inverse(moving.wrench_tip_G())[0], moving.tau))
    within("relative torque", worst, 3e-11)  # measured up to 3e-12, in contact


@pytest.mark.check(
    "wrench of the arm on the hull: Newton-Euler", "the hull alone moves alike under it"
)
@pytest.mark.parametrize("push", PUSHES)
def test_wrench_on_the_hull_moves_the_hull_alone_as_the_arm_does(vehicle_of, push, rng, within):
    worst = 0.0
    for _ in range(STATES):
        spec = wet(vehicle_of(rng), rng)
        moving = Moving.of(spec, rng, push)
        wrench_B = moving.inverse(moving.wrench_tip_G())[1]

        R = moving.X_WB[:3, :3]
        dof = moving.vehicle.hull_dof
        for actuator in list(spec.actuators):
            spec.delete(actuator)
        for key in list(spec.keys):
            spec.delete(key)
        for child in list(spec.body("hull").bodies):
            spec.delete(child)
        alone = hydrodynamics.compile(spec)
        assert alone.nv == 6
        alone.opt.wind = moving.model.opt.wind
        data = mujoco.MjData(alone)
        data.qpos, data.qvel = moving.data.qpos[:7], moving.data.qvel[:6]
        data.qfrc_applied = moving.data.qfrc_applied[dof : dof + 6] + np.concatenate(
            [R @ wrench_B[:3], wrench_B[3:]]
        )
        mujoco.mj_forward(alone, data)
        worst = max(worst, relative(data.qacc, moving.data.qacc[:6]))
    # measured up to 2.2e-13 over 200 seeds of 6 cases
    within("relative acceleration of the hull", worst, 2e-12)


@pytest.mark.check(
    "wrench of the arm on the hull: measured by uuv.sim.plant.reaction_wrench",
    "own recursive Newton-Euler",
)
@pytest.mark.parametrize("push", PUSHES)
def test_reaction_is_the_wrench_of_newton_and_euler(vehicle_of, push, rng, within):
    worst = 0.0
    for _ in range(STATES):
        moving = Moving.of(wet(vehicle_of(rng), rng), rng, push)
        model = moving.model
        hull = moving.vehicle.hull
        carried = [i for i in range(hull + 1, model.nbody) if model.body_parentid[i] == hull]
        measured = np.sum([wrench(model, moving.data, i, frame=hull) for i in carried], axis=0)
        worst = max(worst, relative(measured, moving.inverse(moving.wrench_tip_G())[1]))
    within("relative wrench", worst, 3e-13)  # measured up to 2e-14


def test_tip_kinematics(vehicle_of, rng, within):
    for _ in range(STATES):
        moving = Moving.of(wet(vehicle_of(rng), rng), rng, "none")
        X_BG, J_B = moving.arm.tip(moving.q)
        model = moving.model
        data = moving.data
        tip = moving.vehicle.tip
        J_W = np.zeros((6, model.nv))
        mujoco.mj_jacSite(model, data, J_W[:3], J_W[3:], tip)
        turn = np.kron(np.eye(2), moving.X_WB[:3, :3])
        within(
            "tip pose",
            moving.X_WB @ X_BG - pose(data.site_xmat[tip].reshape(3, 3), data.site_xpos[tip]),
            1e-13,
        )
        within("tip Jacobian", turn @ J_B - J_W[:, moving.dofs], 1e-13)


def test_joints_that_do_not_rest_at_zero(rng, within):
    """`ref`: MuJoCo turns and slides by q - qpos0, and a joint that is held stands at its qpos0."""
    spec = wet(random_vehicle(rng), rng)
    for joint in spec.joints:
        if joint.name in {body.name for body in spec.bodies}:
            # [deg], or [m] of a slide
            joint.ref = rng.choice([-1.0, 1.0]) * rng.uniform(20.0, 60.0)
    moving = Moving.of(spec, rng, "wrench")
    assert np.all(np.abs(moving.model.qpos0[7:]) > 0.3)
    within("relative torque", relative(moving.inverse(moving.wrench_tip_G())[0], moving.tau), 3e-11)

    model = moving.model
    vehicle = moving.vehicle
    data = mujoco.MjData(moving.model)
    held = ArmDynamics(model)
    q = rng.normal(size=held.n)
    rest = np.zeros(held.n)
    data.qpos[vehicle.qpos] = q
    mujoco.mj_inverse(model, data)
    R_WB = data.xmat[vehicle.hull].reshape(3, 3)
    still = np.zeros(6)
    tau, _ = held.inverse(
        q,
        rest,
        rest,
        R_WB=R_WB,
        nu_B=still,
        a_B=still,
        v_current_W=np.array(model.opt.wind),
        wrench_tip_G=still,
    )
    springs = np.asarray(model.jnt_stiffness).reshape(model.njnt, -1)[vehicle.joints, 0]
    expected = data.qfrc_inverse[vehicle.dof] - springs * (q - model.qpos_spring[vehicle.qpos])
    within("relative torque, others held", relative(tau, expected), 3e-12)


def felt(moving: Moving, bias: Array) -> tuple[Array, Array, Array]:
    """`unfiltered_tip_force` with all of the motion known: force (3,) in hull axes, external
    torques, Jacobian.
    """
    arm = moving.arm
    n = moving.arm.n
    nu_B, a_B = moving.hull_motion()
    a_B[:3] -= np.cross(nu_B[3:], nu_B[:3])
    hull = np.concatenate([moving.X_WB[:3, :3].ravel(), nu_B, a_B, moving.model.opt.wind])
    sensed = SensedArm.start(np.zeros(n), np.zeros(3))
    sensed.hull[:] = hull
    joints = JointMotion(moving.q, moving.data.qvel[moving.dofs], moving.data.qacc[moving.dofs])
    errors = TorqueErrors(bias, np.full(n, FLOOR), NOISE)
    f_B = unfiltered_tip_force(arm.parameters, joints, moving.tau, errors, sensed)
    return np.array(f_B), sensed.tau_e, sensed.J_B


def test_known_force_is_felt(vehicle_of, rng, within):
    """A pure force on the tip comes back from the plant's torques alone, but for the weak prior of
    1 kN.
    """
    worst = 0.0
    for _ in range(STATES):
        moving = Moving.of(wet(vehicle_of(rng), rng), rng, "force")
        f_B, _, J_B = felt(moving, np.zeros(moving.arm.n))
        sigma = FLOOR + NOISE * np.abs(moving.tau)
        information = (J_B[:3] / sigma**2) @ J_B[:3].T
        # (I + 1e-6) f_felt = I f: exact, whatever the posture lets be felt.
        expected = information @ moving.X_WB[:3, :3].T @ moving.f_tip_W[:3]
        worst = max(worst, relative((information + 1e-6 * np.eye(3)) @ f_B, expected))
    within("relative force", worst, 3e-11)  # measured up to 2e-12


def test_felt_force_is_that_of_the_plain_least_squares(vehicle_of, rng, within):
    for _ in range(STATES):
        moving = Moving.of(wet(vehicle_of(rng), rng), rng, "wrench")
        bias = 0.3 * rng.normal(size=moving.arm.n)
        f_B, tau_e, J_B = felt(moving, bias)
        sigma = FLOOR + NOISE * np.abs(moving.tau)
        expected, _ = force_from_torques.tip_force(tau_e - bias, J_B[:3], sigma)
        # Weighted by the information, since some postures hardly let the force be felt in some
        # direction.
        information = (J_B[:3] / sigma**2) @ J_B[:3].T
        # measured up to 7e-12
        within("relative force", relative(information @ f_B, information @ expected), 1e-9)


def test_feel_takes_the_acceleration_from_the_lag_and_the_rest_as_told(rng, within):
    """With filters shorter than the step it is the least squares again."""
    moving = Moving.of(wet(models.load("uuv_puma"), rng), rng, "wrench")
    arm = moving.arm
    n = moving.arm.n
    R = moving.X_WB[:3, :3]
    (nu_B, a_B), qd, qdd = (
        moving.hull_motion(),
        moving.data.qvel[moving.dofs],
        moving.data.qacc[moving.dofs],
    )
    lag = 0.01
    f_W = np.empty(3)
    sensed = SensedArm.start(qd - lag * qdd, nu_B[3:] - lag * a_B[3:])
    normal = estimate_tip_force(
        tuple(arm.parameters),
        (
            moving.X_WB,
            nu_B[:3],
            nu_B[3:],
            a_B[:3],
            np.array(moving.model.opt.wind),
            moving.q,
            qd,
            moving.tau,
        ),
        (np.zeros(n), np.full(n, FLOOR), NOISE),
        (0.02, lag, 0.015),
        tuple(sensed),
        f_W,
    )
    tau_e, wrench_B, f_B, f_G, J_B = (
        sensed.tau_e,
        sensed.wrench_B,
        sensed.f_B,
        sensed.f_G,
        sensed.J_B,
    )
    within("acceleration", relative(sensed.qdd, qdd), 1e-13)  # measured up to 1e-14
    expected_tau, expected_wrench = arm.inverse(
        moving.q,
        qd,
        qdd,
        R_WB=R,
        nu_B=nu_B,
        a_B=a_B,
        v_current_W=moving.model.opt.wind,
        wrench_tip_G=np.zeros(6),
    )
    # measured up to 2e-14: a lag is a difference
    within("torques", relative(tau_e, expected_tau - moving.tau), 1e-12)
    within("wrench", relative(wrench_B, expected_wrench), 1e-12)  # measured up to 3e-14
    sigma = FLOOR + NOISE * np.abs(moving.tau)
    expected, _ = force_from_torques.tip_force(tau_e, J_B[:3], sigma)
    # Weighted by the information, since some postures hardly let the force be felt in some
    # direction.
    information = (J_B[:3] / sigma**2) @ J_B[:3].T
    # measured up to 9e-14
    within("force, hull axes", relative(information @ f_B, information @ expected), 1e-11)
    R_WG = moving.data.site_xmat[moving.vehicle.tip].reshape(3, 3)
    within("force, world axes", relative(f_W, R @ f_B), 1e-13)  # measured up to 4e-16
    within("force, tool axes", relative(f_G, R_WG.T @ R @ f_B), 1e-13)  # measured up to 1e-15
    within("normal force", normal + f_G[2], 0.0)


@pytest.mark.parametrize("moving_hull", [True, False])
def test_aimed_arm_keeps_its_tool_still_on_the_object(moving_hull, rng, within):
    """Whatever the hull's speed, or from rest its acceleration, the tip of MuJoCo's model has
    none.
    """
    model = models.load("uuv_puma").compile()
    data, vehicle = mujoco.MjData(model), Vehicle.of(model)
    # MuJoCo turns a free body in its own axes, and moves it in the world's
    n = len(vehicle.joints)
    free = np.s_[:6]
    worst = 0.0
    for _ in range(20):
        data.qpos[vehicle.qpos] = vehicle.q_ready + rng.uniform(-0.3, 0.3, n)
        data.qpos[3:7] = rng.normal(size=4)
        mujoco.mj_normalizeQuat(model, data.qpos)
        mujoco.mj_forward(model, data)
        J_W = np.empty((6, model.nv))
        mujoco.mj_jacSite(model, data, J_W[:3], J_W[3:], vehicle.tip)
        R_WB = data.xmat[vehicle.hull].reshape(3, 3)
        change = rng.normal(size=6)
        X_WB = pose(R_WB, data.xpos[vehicle.hull])
        X_WG = pose(data.site_xmat[vehicle.tip].reshape(3, 3), data.site_xpos[vehicle.tip])
        J_B = np.vstack([R_WB.T @ J_W[:3], R_WB.T @ J_W[3:]])[:, vehicle.dof]
        hull = np.zeros(24)
        hull[9:15] = change if moving_hull else 0.0
        hull[15:21] = 0.0 if moving_hull else change
        qd = np.empty(n)
        qdd = np.empty(n)
        yielding = np.empty((2, n))
        resolve_tool_motion(
            np.eye(4),
            X_WB,
            (X_WG, np.zeros(3), np.zeros(3)),
            hull,
            (inverse(X_WB) @ X_WG, np.ascontiguousarray(J_B)),
            True,
            (np.inf, np.zeros(n)),
            (np.empty((4, 4)), qd, qdd, yielding),
        )
        rates = np.zeros(model.nv)
        rates[free] = np.concatenate([R_WB @ change[:3], change[3:]])
        carried = np.linalg.norm(J_W @ rates)
        rates[vehicle.dof] = qd if moving_hull else qdd
        worst = max(worst, float(np.linalg.norm(J_W @ rates)) / carried)
    # measured up to 2e-5: the damping of the inverse
    within("share of the hull's motion", worst, 1e-3)
