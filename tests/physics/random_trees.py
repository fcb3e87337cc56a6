"""Random trees of bodies in water, for the tests that compare formulations."""

import mujoco
import numpy as np

from uuv.models import hydrodynamics as water
from uuv.models.hydrodynamics import BodyHydrodynamics, StripDrag
from uuv.sim.interfaces.spatial import Array

DENSITY = 1000.0  # [kg/m^3]


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


def random_spec(
    rng: np.random.Generator, *, most: int = 12
) -> tuple[mujoco.MjSpec, dict[str, BodyHydrodynamics]]:
    """3 to `most` bodies on free, ball, hinge and slide joints, two on one body, welded, branched,
    fixed, dry.
    """
    spec = mujoco.MjSpec.from_string('<mujoco><option timestep="1e-4"/></mujoco>')
    bodies = [spec.worldbody]
    coefficients: dict[str, BodyHydrodynamics] = {}
    for i in range(int(rng.integers(3, most + 1))):
        parent = bodies[int(rng.integers(0, len(bodies)))]
        body = parent.add_body(name=f"b{i}", pos=0.3 * rng.normal(size=3), quat=rng.normal(size=4))
        body.explicitinertial = 1
        body.mass = rng.uniform(0.5, 3.0)
        body.ipos = 0.1 * rng.normal(size=3)
        body.iquat = rng.normal(size=4)
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
                joint.axis = rng.normal(size=3)
                joint.pos = 0.1 * rng.normal(size=3) * (name != "free")
                joint.armature = rng.uniform(0.0, 0.1) * (name in {"hinge", "slide"})
        if rng.uniform() < 0.85:
            coefficients[body.name] = random_coefficients(rng)
        bodies.append(body)
    water.attach(spec, coefficients, DENSITY)
    water.set_current(spec, rng.normal(size=3), rng.normal(size=3), 0.3 * rng.normal(size=3))
    return spec, coefficients


def set_in_motion(model: mujoco.MjModel, data: mujoco.MjData, rng: np.random.Generator) -> None:
    """A random configuration, velocity and force on every coordinate."""
    mujoco.mj_resetData(model, data)
    mujoco.mj_integratePos(model, data.qpos, rng.normal(size=model.nv), 1.0)
    data.qvel = rng.normal(size=model.nv)
    data.qfrc_applied = rng.normal(size=model.nv)
