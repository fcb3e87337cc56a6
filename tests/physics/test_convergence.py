"""Order of convergence of every integrator with the water in it, by halving the step."""

from itertools import pairwise

import mujoco
import numpy as np
import pytest

from tests.physics.random_trees import semidefinite
from uuv.models import hydrodynamics as water
from uuv.models.hydrodynamics import BodyHydrodynamics
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.spatial import Array

NEWER = tuple(int(x) for x in mujoco.__version__.split(".")[:2]) >= (4, 0)
TIME = 0.512  # [s]

TREE = """
<mujoco>
  <option integrator="{integrator}"/>
  <worldbody>
    <body name="a"> {root} <geom type="box" size=".3 .2 .1" mass="20" pos=".1 0 .05"/>
      <body name="b" pos=".4 0 0">
        {middle} <geom type="capsule" size=".05 .2" pos=".2 .1 0" mass="5"/>
        <body name="c" pos=".4 .1 0"> <joint axis="1 2 3" damping="2"/>
          <geom type="box" size=".1 .2 .1" mass="3" pos=".1 0 0"/>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
FLOATING = {"root": "<freejoint/>", "middle": '<joint type="ball"/>'}
FIXED = {"root": '<joint axis="0 1 0"/>', "middle": '<joint type="slide" axis="1 1 0"/>'}


def end_state(
    integrator: str, joints: dict[str, str], timestep: float
) -> tuple[mujoco.MjModel, Array, Array]:
    """Model, positions and velocities after TIME; smooth water: linear damping, buoyancy, shear,
    accelerating flow.
    """
    rng = np.random.default_rng(1)
    spec = mujoco.MjSpec.from_string(TREE.format(integrator=integrator, **joints))
    spec.option.timestep = timestep
    bodies = {
        name: BodyHydrodynamics(
            volume=0.01,
            center_of_buoyancy=0.05 * rng.normal(size=3),
            added_mass=semidefinite(rng, 1.0),
            linear_damping=semidefinite(rng, 1.0),
        )
        for name in "abc"
    }
    water.attach(spec, bodies, 1000.0)
    water.set_current(spec, [0.5, -0.3, 0.2], [0.3, 0.1, -0.2], [0.2, 0.1, 0.0])
    model = hydrodynamics.compile(spec)
    data = mujoco.MjData(model)
    data.qvel = rng.normal(size=model.nv)
    mujoco.mj_step(model, data, round(TIME / timestep))
    return model, data.qpos.copy(), data.qvel.copy()


def order(integrator: str, joints: dict[str, str], steps: tuple[float, float, float]) -> float:
    """log2 of how much closer the results come when the step is halved twice."""
    ends = [end_state(integrator, joints, step) for step in steps]
    gaps = []
    for (model, qpos, qvel), (_, finer, faster) in pairwise(ends):
        apart = np.zeros(model.nv)
        mujoco.mj_differentiatePos(model, apart, 1.0, qpos, finer)
        gaps.append(float(np.linalg.norm([apart, faster - qvel])))
    return float(np.log2(gaps[0] / gaps[1]))


@pytest.mark.check("order of convergence: Euler, implicit, implicitfast, discrete", "1")
@pytest.mark.parametrize("joints", [FLOATING, FIXED], ids=["floating", "fixed"])
@pytest.mark.parametrize("integrator", ["Euler", "implicit", "implicitfast", "discrete"])
def test_first_order(integrator, joints, within):
    error = order(integrator, joints, (0.002, 0.001, 0.0005)) - 1.0
    within(f"order - 1, {integrator}", error, 0.04)  # measured 0.004


@pytest.mark.check("order of convergence: RK4, fixed base", "4")
def test_runge_kutta_on_a_fixed_base(within):
    within("order - 4", order("RK4", FIXED, (0.016, 0.008, 0.004)) - 4.0, 0.01)  # measured 0.0008


@pytest.mark.check(
    "order of convergence: RK4, floating with a ball joint", "4 from MuJoCo 4.0 on, 2 before"
)
def test_runge_kutta_afloat(within):
    expected, tolerance = (4.0, 0.4) if NEWER else (2.0, 0.04)  # measured 0.05 and 0.0035
    within(
        f"order - {expected:.0f}",
        order("RK4", FLOATING, (0.016, 0.008, 0.004)) - expected,
        tolerance,
    )
