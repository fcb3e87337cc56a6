"""A fixed-base arm against Pinocchio: its own kinematics and recursion, another code base.

Pinocchio's inertia cannot hold an anisotropic added mass, so the water enters as a wrench on each
body, computed from the velocities and accelerations that Pinocchio finds.
"""

from typing import Any

import mujoco
import numpy as np
import pytest

from tests.physics.random_trees import DENSITY, random_coefficients
from uuv.models import hydrodynamics as water
from uuv.models.hydrodynamics import BodyHydrodynamics
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.spatial import Array

pytestmark = pytest.mark.check("joint torques of a fixed-base arm of six joints", "Pinocchio")

GRAVITY = np.array([0.0, 0.0, -9.81])
CURRENT = np.array([0.4, -0.3, 0.2])


def random_arm(rng: np.random.Generator) -> tuple[mujoco.MjModel, list[BodyHydrodynamics]]:
    """Six bodies in a chain on hinges and slides, fixed to the world, in a steady current."""
    spec = mujoco.MjSpec.from_string('<mujoco><option timestep="1e-4"/></mujoco>')
    at = spec.worldbody
    bodies = []
    for i in range(6):
        at = at.add_body(
            name=f"link{i}",
            pos=0.3 * rng.normal(size=3),
            quat=rng.normal(size=4),
            explicitinertial=1,
        )
        at.mass = rng.uniform(0.5, 3.0)
        at.inertia = rng.uniform(0.08, 0.12, 3)
        at.ipos = 0.1 * rng.normal(size=3)
        at.iquat = rng.normal(size=4)
        kind = "SLIDE" if rng.uniform() < 0.3 else "HINGE"
        at.add_joint(type=getattr(mujoco.mjtJoint, f"mjJNT_{kind}"), axis=rng.normal(size=3))
        bodies.append(random_coefficients(rng))
    water.attach(spec, {f"link{i}": body for i, body in enumerate(bodies)}, DENSITY)
    water.set_current(spec, CURRENT)
    return hydrodynamics.compile(spec), bodies


def in_pinocchio(pin: Any, model: mujoco.MjModel) -> Any:
    """The same chain without the water."""
    arm = pin.Model()
    arm.gravity.linear = GRAVITY
    R = np.empty(9)

    def turned(quat_wxyz: Array) -> Array:
        mujoco.mju_quat2Mat(R, quat_wxyz)
        return R.reshape(3, 3).copy()

    joint = 0
    for i in range(1, model.nbody):
        kinds = {
            int(mujoco.mjtJoint.mjJNT_HINGE): pin.JointModelRevoluteUnaligned,
            int(mujoco.mjtJoint.mjJNT_SLIDE): pin.JointModelPrismaticUnaligned,
        }
        kind = kinds[int(model.jnt_type[i - 1])]
        X_parent = pin.SE3(turned(model.body_quat[i]), np.array(model.body_pos[i]))
        joint = arm.addJoint(joint, kind(np.array(model.jnt_axis[i - 1])), X_parent, f"joint{i}")
        C = turned(model.body_iquat[i])
        inertia = pin.Inertia(
            float(model.body_mass[i]), np.array(model.body_ipos[i]), C * model.body_inertia[i] @ C.T
        )
        arm.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    return arm


def wrench_of_water(body: BodyHydrodynamics, R: Array, nu: Array, nudot: Array) -> Array:
    """On a body with twist `nu` and its rate `nudot`, all in body axes (Fossen 2011, ch. 6 and
    8).
    """
    w = nu[3:]
    u = R.T @ CURRENT
    slip = nu - np.concatenate([u, np.zeros(3)])
    rate = nudot + np.concatenate([np.cross(w, u), np.zeros(3)])
    p = body.added_mass @ slip
    f = -body.added_mass @ rate - np.concatenate(
        [np.cross(w, p[:3]), np.cross(w, p[3:]) + np.cross(slip[:3], p[:3])]
    )
    f -= body.linear_damping @ slip + body.quadratic_damping * np.abs(slip) * slip
    for strip in body.segments:
        along = strip.end - strip.start
        length = float(np.linalg.norm(along))
        axis = along / length
        for x, share in zip(*np.polynomial.legendre.leggauss(strip.stations), strict=True):
            p_node = strip.start + 0.5 * (1.0 + x) * along
            v = slip[:3] + np.cross(w, p_node)
            slide = axis @ v * axis
            across = v - axis @ v * axis
            drag = (
                strip.normal * np.linalg.norm(across) * across
                + strip.tangential * np.linalg.norm(slide) * slide
            )
            f -= 0.5 * share * length * np.concatenate([drag, np.cross(p_node, drag)])
    lift = -DENSITY * body.volume * R.T @ GRAVITY
    return f + np.concatenate([lift, np.cross(body.center_of_buoyancy, lift)])


def test_torques(rng, within):
    pin: Any = pytest.importorskip(
        "pinocchio", reason="needs Pinocchio: ./uvw run --group reference"
    )
    worst = 0.0
    for _ in range(10):
        model, bodies = random_arm(rng)
        arm = in_pinocchio(pin, model)
        pin_data = arm.createData()
        data = mujoco.MjData(model)
        for _ in range(5):
            data.qpos, data.qvel = rng.normal(size=model.nv), rng.normal(size=model.nv)
            data.qfrc_applied = 5.0 * rng.normal(size=model.nv)
            mujoco.mj_forward(model, data)
            q, qd, qdd = np.array(data.qpos), np.array(data.qvel), np.array(data.qacc)
            pin.forwardKinematics(arm, pin_data, q, qd, qdd)
            pushes = pin.StdVec_Force()
            pushes.append(pin.Force.Zero())
            for i, body in enumerate(bodies, start=1):
                f = wrench_of_water(
                    body, pin_data.oMi[i].rotation, pin_data.v[i].vector, pin_data.a[i].vector
                )
                pushes.append(pin.Force(f[:3], f[3:]))
            tau = pin.rnea(arm, pin_data, q, qd, qdd, pushes)
            worst = max(
                worst,
                float(np.max(np.abs(tau - data.qfrc_applied)) / np.max(np.abs(data.qfrc_applied))),
            )
    within("relative torque", worst, 3e-12)  # measured up to 3e-13
