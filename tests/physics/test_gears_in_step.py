"""Gear friction acts inside MuJoCo's step: a joint's bound follows Stribeck's curve of its
speed.
"""

import math
import pickle
import subprocess
import sys
from pathlib import Path

import mujoco
import mujoco.batch
import numpy as np
import pytest

from uuv import models
from uuv.models.arms import gear_friction
from uuv.models.arms.gear_friction import GearFriction
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import HydrodynamicsError
from uuv.sim.interfaces.messages import Command
from uuv.sim.interfaces.spatial import Array
from uuv.sim.plant.plant import Plant
from uuv.sim.water.current import Current

ARM = """
<mujoco>
  <option timestep="0.002" integrator="{integrator}" solver="{solver}" cone="elliptic"/>
  <worldbody>
    <geom type="plane" size="9 9 1" pos="0 0 -.4"/>
    <body pos="0 0 .3"> <joint name="low" axis="0 1 0" damping=".1"/>
      <geom type="capsule" size=".05" fromto="0 0 0 .6 0 0" mass="3"/>
      <body pos=".6 0 0"> <joint name="high" axis="0 1 .2"/>
        <geom type="capsule" size=".05" fromto="0 0 0 .5 .1 0" mass="1"/> </body>
    </body>
    <body pos="3 0 -.3"> <freejoint/> <geom size=".1"/> </body>
    <body pos="0 4 0"> <joint name="apart" axis="0 1 0"/>
      <geom type="capsule" size=".05" fromto="0 0 0 .6 0 0" mass="3"/> </body>
    <body pos="0 6 0"> <joint name="plain" axis="0 1 0" frictionloss=".4"/>
      <geom type="capsule" size=".05" fromto="0 0 0 .6 0 0" mass="3"/> </body>
  </worldbody>
  <tendon> <fixed name="t" frictionloss=".2"> <joint joint="low" coef="1"/> </fixed> </tendon>
  <equality> <joint joint1="high" joint2="low" polycoef="0 -.5 0 0 0" solref=".1 1"/> </equality>
</mujoco>
"""
GEARS = {
    "low": GearFriction(coulomb=1.0, stiction=1.6, stribeck_speed=0.2),
    "high": GearFriction(coulomb=0.7, stiction=0.9, stribeck_speed=0.1),
    "apart": GearFriction(coulomb=2.0, stiction=3.0, stribeck_speed=0.3),
}


def spec_of(*, integrator: str = "implicitfast", solver: str = "Newton") -> mujoco.MjSpec:
    """Dry arm with gears on a floor; beside it another, one with Coulomb friction, and a ball."""
    spec = mujoco.MjSpec.from_string(ARM.format(integrator=integrator, solver=solver))
    gear_friction.attach(spec, GEARS)
    return spec


def run(model: mujoco.MjModel, steps: int = 400, *, outside: bool = False) -> Array:
    """Positions of a run; `outside`: the bounds are written into the model before each step."""
    data = mujoco.MjData(model)
    path = np.empty((steps, model.nq))
    for k in range(steps):
        if outside:
            for name, gear in GEARS.items():
                dof = model.joint(name).dofadr[0]
                ratio = float(data.qvel[dof]) / gear.stribeck_speed
                share = math.exp(-(ratio * ratio))
                model.dof_frictionloss[dof] = gear.coulomb + (gear.stiction - gear.coulomb) * share
        mujoco.mj_step(model, data)
        path[k] = data.qpos
    assert np.ptp(path, axis=0).max() > 0.3
    return path


@pytest.mark.parametrize("islands", [True, False])
@pytest.mark.parametrize("solver", ["Newton", "CG", "PGS"])
@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
def test_it_is_the_bound_of_the_speed_at_the_beginning_of_each_step(islands, integrator, solver):
    paths = []
    for outside in (False, True):
        model = hydrodynamics.compile(spec_of(integrator=integrator, solver=solver))
        if not islands:
            model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
        if outside:
            model.jnt_user[:] = 0.0
        paths.append(run(model, outside=outside))
    assert np.array_equal(*paths)


def test_without_the_callback_it_is_another_motion():
    model = hydrodynamics.compile(spec_of())
    path = run(model)
    hydrodynamics.uninstall()
    message = "gear friction but its gears have Coulomb friction alone: call"
    with pytest.warns(RuntimeWarning, match=message):
        assert not hydrodynamics.check_installed(model)
    assert np.abs(run(model) - path).max() > 1e-2


def test_the_model_of_a_run_stays_as_it_was(tmp_path: Path):
    """Vehicle with arm in gusts: the same MJB before and after."""
    model = hydrodynamics.compile(models.load("uuv_puma"))
    plant = Plant(model, current=Current([0.2, 0.1, 0.0], gust=0.1, rng=np.random.default_rng(3)))
    files = [tmp_path / name for name in ("before.mjb", "after.mjb")]
    mujoco.mj_saveModel(model, str(files[0]))
    for _ in range(200):
        plant.observe()
        plant.step(command(plant, 20.0))
    assert np.abs(plant.truth.qd).max() > 0.05
    mujoco.mj_saveModel(model, str(files[1]))
    assert files[0].read_bytes() == files[1].read_bytes()


def command(plant: Plant, torque: float) -> Command:
    n, m = len(plant.vehicle.joints), len(plant.vehicle.thruster_names)
    return Command(time=0.0, joint_torque=np.full(n, torque), thrusters=np.zeros(m), scan=False)


def test_two_plants_with_gears_share_one_model():
    """Arms that move at different speeds: as on models of their own."""
    spec = models.load("uuv_puma")
    still = [0.1, 0.0, 0.0]
    model = hydrodynamics.compile(spec)
    shared = [Plant(model, current=Current(still)) for _ in range(2)]
    apart = [Plant(hydrodynamics.compile(spec), current=Current(still)) for _ in range(2)]
    for _ in range(100):
        for plants in (shared, apart):
            for plant, torque in zip(plants, (9.0, 30.0), strict=True):
                plant.observe()
                plant.step(command(plant, torque))
    for plant, other in zip(shared, apart, strict=True):
        assert np.array_equal(plant.data.qvel, other.data.qvel)
        assert np.array_equal(plant.truth.tau_friction, other.truth.tau_friction)
    assert np.abs(shared[0].truth.qd - shared[1].truth.qd).max() > 0.01


@pytest.mark.parametrize("threads", [1, 2])
def test_a_batch_has_it_in_each_simulation(threads):
    model = hydrodynamics.compile(spec_of())
    starts = np.random.default_rng(5).normal(size=(8, model.nv))
    ends = []
    for start in starts:
        data = mujoco.MjData(model)
        data.qvel = start
        mujoco.mj_step(model, data, 200)
        ends.append(data.qpos.copy())
    batch = mujoco.batch.Batch(model, nsim=len(starts), nthread=threads)
    batch.bind("qvel")[:] = starts
    batch.step(nstep=200)
    assert np.array_equal(batch.bind("qpos"), ends)


def test_files_and_pickles_of_a_dry_model_bring_it(tmp_path: Path):
    """MJCF with its six digits; MJB and pickle into a new process, whose callback they install."""
    spec = spec_of()
    model = hydrodynamics.compile(spec)
    path = tmp_path / "arm.mjb"
    again = hydrodynamics.compile(mujoco.MjSpec.from_string(spec.to_xml()))
    np.testing.assert_allclose(run(again), run(model), rtol=0.0, atol=1e-5)  # measured 4e-7
    mujoco.mj_saveModel(model, str(path))
    pickled = tmp_path / "arm.pkl"
    pickled.write_bytes(pickle.dumps(model))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 400)
    for line in (
        "from uuv.sim import hydrodynamics; model = "
        f"mujoco.MjModel.from_binary_path({str(path)!r})",
        f"import pickle; model = pickle.load(open({str(pickled)!r}, 'rb'))",
    ):
        code = f"""
import mujoco
{line}
data = mujoco.MjData(model)
mujoco.mj_step(model, data, 400)
print(data.qpos.tobytes().hex())
"""
        ran = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        )
        assert ran.stdout.strip() == data.qpos.tobytes().hex()


def test_another_frictionloss_is_coulomb_alone():
    """As `gear_friction.read` says: whoever changes the bound in the model gets that bound."""
    model = hydrodynamics.compile(spec_of())
    plain = hydrodynamics.compile(spec_of())
    plain.jnt_user[:] = 0.0
    for variant in (model, plain):
        variant.dof_frictionloss[variant.joint("low").dofadr] = 1.3
        variant.dof_frictionloss[variant.joint("high").dofadr] = 0.75
        variant.dof_frictionloss[variant.joint("apart").dofadr] = 0.0  # turned off
    joints = np.array([model.joint(name).id for name in GEARS])
    dry = gear_friction.read(model, joints)
    assert dry.stiction.tolist() == dry.coulomb.tolist() == [1.3, 0.75, 0.0]
    assert np.array_equal(run(model), run(plain))


def test_gears_that_were_left_out_are_said_at_the_next_step_of_a_dry_plant():
    """A vehicle in air: no water tells that the callback is missing."""
    spec = models.load("uuv_puma")
    for body in spec.bodies:
        body.userdata = []
    spec.option.gravity = [0.0, 0.0, 0.0]
    plant = Plant(hydrodynamics.compile(spec), current=Current([0.0, 0.0, 0.0]))
    plant.observe()
    plant.step(command(plant, 1.0))
    plant.observe()
    hydrodynamics.uninstall()
    plant.step(command(plant, 1.0))
    with pytest.raises(HydrodynamicsError, match="its gears have Coulomb friction alone: call"):
        plant.observe()
    hydrodynamics.install()
    flags = mujoco.mjtDisableBit
    plant.model.opt.disableflags |= int(flags.mjDSBL_SPRING | flags.mjDSBL_DAMPER)
    with pytest.raises(HydrodynamicsError, match="MuJoCo did not call"):
        plant.observe()
