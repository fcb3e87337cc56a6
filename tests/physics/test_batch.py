"""Any way to run any wet model is the same run: batches, copies, files, islands, integrators, a
flow that changes.
"""

import copy
import pickle
from pathlib import Path
from typing import Any

import mujoco
import mujoco.batch
import numpy as np
import pytest

from uuv.models import hydrodynamics as water
from uuv.models.hydrodynamics import BodyHydrodynamics
from uuv.models.water import thrusters
from uuv.models.water.thrusters import Thruster
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.spatial import Array
from uuv.sim.water.current import Current

NEWER = tuple(int(x) for x in mujoco.__version__.split(".")[:2]) >= (4, 0)
INTEGRATORS = ["EULER", "RK4", "IMPLICIT", "IMPLICITFAST"]

# Two vehicles, one with an arm that has every kind of joint, a fixed-base arm, a mocap body, bodies
# without joints.
WORLD = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom type="plane" size="9 9 1" pos="0 0 -.35"/>
    <body name="hull"> <freejoint/> <geom type="box" size=".5 .3 .2" mass="110"/> <site name="eye"/>
      <body name="frame" pos="0 0 .3"> <geom type="box" size=".1 .1 .1" mass="3"/> </body>
      <body name="upper" pos=".5 0 0"> <joint type="ball"/>
        <geom type="capsule" size=".05 .2" pos=".2 0 .1" mass="5"/>
        <body name="rail" pos=".4 0 .2"> <joint name="s" type="slide" axis="1 0 0"/>
          <geom size=".1" mass="4"/>
          <body name="wrist" pos=".2 0 0"> <joint name="y"/>
            <joint name="p" axis="0 1 0" range="-60 60"/>
            <geom size=".06" mass="2"/> <site name="tip"/> </body> </body> </body>
    </body>
    <body name="eel" pos="0 3 0"> <joint type="slide" axis="1 0 0"/>
      <joint type="slide" axis="0 1 0"/>
      <joint type="slide" axis="0 0 1"/> <joint type="ball"/>
        <geom type="ellipsoid" size=".3 .1 .1" mass="12"/> </body>
    <body name="buoy" pos="0 3 1.5"> <freejoint/> <geom size=".1" mass="2"/> </body>
    <body name="post" pos="3 0 0"> <geom size=".1"/>
      <body name="boom" pos="0 0 .2"> <joint name="b" axis="0 1 0" damping="1"/>
        <geom type="capsule" size=".05" fromto="0 0 0 0 0 .8" mass="6"/>
        <body name="jib" pos="0 0 .8"> <joint name="j" axis="1 0 0"/>
          <geom type="capsule" size=".04" fromto="0 0 0 .5 0 0" mass="3"/> </body> </body> </body>
    <body name="target" mocap="true" pos="5 0 0"> <geom size=".1" contype="0" conaffinity="0"/>
      </body>
  </worldbody>
  <equality> <connect body1="eel" body2="buoy" anchor="0 0 1.5"/>
    <joint joint1="j" joint2="b" polycoef="0 .3 0 0 0"/>
  </equality>
  <tendon> <spatial name="line" stiffness="20" damping="2" springlength=".5"> <site site="eye"/>
    <site site="tip"/>
    </spatial> <fixed name="pair" armature=".05"> <joint joint="y" coef="1"/>
      <joint joint="p" coef=".5"/> </fixed>
  </tendon>
  <actuator> <position joint="b" kp="60" dampratio="1"/> <velocity joint="s" kv="5"/>
    <motor tendon="pair"/>
    <motor name="screw" site="eye" gear=".6 0 .8 0 0 0"/>
      <general joint="j" dyntype="integrator" gear=".2"/>
  </actuator>
  <keyframe> <key name="bent" ctrl=".5 .1 .3 .8 .1"/> </keyframe>
</mujoco>
"""


def full(seed: int, size: float) -> BodyHydrodynamics:
    """Everything at once: full matrices, drag, two strips."""
    rng = np.random.default_rng(seed)
    L, turn = rng.normal(size=(6, 6)), rng.normal(size=(6, 6))
    return BodyHydrodynamics(
        volume=0.004 * size,
        center_of_buoyancy=0.05 * rng.normal(size=3),
        added_mass=0.3 * size * L @ L.T,
        linear_damping=2.0 * np.eye(6) + 0.5 * (turn - turn.T),
        quadratic_damping=rng.uniform(0.0, 3.0, 6),
        strips=(
            water.StripDrag(
                start=np.zeros(3),
                end=rng.normal(size=3),
                normal=3.0,
                tangential=1.0,
                stations=seed % 8 + 1,
            ),
            water.StripDrag(start=rng.normal(size=3), end=np.zeros(3), normal=2.0),
        )[: seed % 3],
    )


def world(integrator: str = "IMPLICITFAST") -> mujoco.MjSpec:
    spec = mujoco.MjSpec.from_string(WORLD)
    spec.option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}")
    sizes = {
        "hull": 20.0,
        "frame": 0.5,
        "upper": 1.0,
        "rail": 1.0,
        "wrist": 0.5,
        "eel": 3.0,
        "buoy": 1.0,
    }
    sizes |= {"post": 1.0, "boom": 1.0, "jib": 1.0, "target": 1.0}
    water.attach(
        spec, {name: full(i, size) for i, (name, size) in enumerate(sizes.items())}, 1010.0
    )
    water.set_current(spec, [0.2, -0.1, 0.05], [0.05, 0.02, -0.03], [0.1, 0.05, 0.0])
    figures: dict[str, Any] = {
        "dead_band": 0.1,
        "time_constant": 0.1,
        "inflow_loss": 30.0,
        "slew_rate": 4.0,
        "torque_per_thrust": 0.02,
    }
    thrusters.attach(spec, {"screw": Thruster(forward=90.0, reverse=70.0, **figures)})
    return spec


def run(model: mujoco.MjModel, steps: int = 400) -> Array:
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    path = np.empty((steps, model.nq + model.nv + model.na))
    for k in range(steps):
        mujoco.mj_step(model, data)
        path[k] = np.concatenate([data.qpos, data.qvel, data.act])
    hydrodynamics.check_motion(model, data)
    assert np.all(np.isfinite(path))
    assert np.max(np.abs(path[-1, model.nq :])) > 0.1
    if model.na:
        assert data.actuator_force[model.actuator("screw").id] > 0.5  # [N]
    return path


@pytest.mark.parametrize("persistent", [False, True])
def test_batch_is_one_by_one_whatever_its_threads(persistent):
    model = hydrodynamics.compile(world())
    starts = 0.2 * np.random.default_rng(0).normal(size=(5, model.nv))
    alone = []
    for start in starts:
        data = mujoco.MjData(model)
        data.qvel = start
        data.ctrl[3] = start[0]
        mujoco.mj_step(model, data, 200)
        alone.append(np.concatenate([data.qpos, data.qvel, data.act]))
    for threads in (1, 2, 3):
        batch = mujoco.batch.Batch(model, nsim=len(starts), nthread=threads, persistent=persistent)
        qpos, qvel, act = batch.bind("qpos"), batch.bind("qvel"), batch.bind("act")
        qvel[:], batch.bind("ctrl")[:, 3] = starts, starts[:, 0]
        batch.step(nstep=200)
        assert np.array_equal(np.hstack([qpos, qvel, act]), alone)


def test_batch_takes_a_current_and_a_body_of_its_own_for_each(within):
    """`expand` gives simulations their own wind and their own rows of coefficients: terminal speeds
    tell.
    """
    spec = mujoco.MjSpec.from_string(
        '<mujoco><option timestep="0.002"/><worldbody>'
        '<body name="ball"><freejoint/><geom size=".1" mass="4"/></body></worldbody></mujoco>'
    )
    body = BodyHydrodynamics(
        volume=4.0 / water.SEA_WATER, linear_damping=np.array([40.0] * 3 + [1.0] * 3)
    )
    water.attach(spec, {"ball": body})
    batch = mujoco.batch.Batch(hydrodynamics.compile(spec), nsim=3, nthread=2)
    batch.expand("opt.wind")[:] = [[0.3, 0.0, 0.0], [0.0, -0.2, 0.0], [0.0, 0.0, 0.0]]
    batch.expand("body_user")[2, 1, water.LAYOUT.volume] += 0.001
    batch.step(nstep=3000)
    expected = [
        [0.3, 0.0, 0.0],
        [0.0, -0.2, 0.0],
        [0.0, 0.0, water.SEA_WATER * 0.001 * 9.81 / 40.0],
    ]
    within("terminal speed [m/s]", batch.bind("qvel")[:, :3] - expected, 1e-14)  # measured 1e-15


def test_copies_and_files_of_a_model_run_alike(tmp_path: Path):
    model = hydrodynamics.compile(world())
    path = run(model)
    mujoco.mj_saveModel(model, str(tmp_path / "wet.mjb"))
    again = mujoco.MjModel.from_binary_path(str(tmp_path / "wet.mjb"))
    for other in (copy.deepcopy(model), copy.copy(model), pickle.loads(pickle.dumps(model)), again):
        assert hydrodynamics.check_installed(other)
        assert np.array_equal(run(other), path)
    spec = world()
    hydrodynamics.compile(spec)
    assert np.array_equal(run(hydrodynamics.compile(spec)), path)
    assert np.array_equal(run(hydrodynamics.compile(world().copy())), path)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_every_integrator_goes_to_the_same_motion(integrator, within):
    """At a tenth of the step all agree with RK4 to their order; and islands or none change nothing
    but rounding.
    """
    model = hydrodynamics.compile(world(integrator))
    alone = run(model, 100)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ISLAND
    within("without islands", run(model, 100) - alone, 3e-15)  # measured 3e-16
    ends = []
    for name in (integrator, "RK4"):
        fine = hydrodynamics.compile(world(name))
        fine.opt.timestep = 2e-4
        ends.append(run(fine, 500)[-1])
    within("after 0.1 s [m, m/s]", ends[0] - ends[1], 2e-3)  # measured 2e-4, of first order


def test_model_compiled_plainly_runs_wet_and_is_told_of(within):
    """Only the contact weights are those of the dry mass: free of contact it is the same motion."""
    spec, other = world(), world()
    for description in (spec, other):
        description.option.disableflags = mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        description.actuators[0].biasprm[
            2
        ] = -1.0  # its damping ratio is worked out from the inertia
    plain = spec.compile()
    within("path", run(plain, 100) - run(hydrodynamics.compile(other), 100), 1e-15)  # measured 0
    with pytest.warns(RuntimeWarning, match="contact weights of its dry mass: compile it by"):
        assert not hydrodynamics.check_installed(plain)
    hydrodynamics.set_constants(plain)
    assert hydrodynamics.check_installed(plain)
    data = mujoco.MjData(plain)
    mujoco.mj_setConst(plain, data)
    with pytest.warns(RuntimeWarning, match="after mj_setConst"):
        assert not hydrodynamics.check_installed(plain)


def test_mjcf_keeps_the_water_to_six_digits(within):
    """Coefficients, density and steady current; also of strips whose added mass is only just
    semidefinite.
    """
    spec = world()
    water.set_current(spec, [0.2, -0.1, 0.05])
    tiny = BodyHydrodynamics(volume=2e-4, quadratic_damping=np.array([3e-4] * 3 + [1e-6] * 3))
    water.attach(spec, {"boom": water.cylinder(0.05, [0, 0, 0], [0.3, 0.4, 0.7]), "jib": tiny})
    model = hydrodynamics.compile(spec)
    text = spec.to_xml()
    again = mujoco.MjSpec.from_string(text)
    assert water.density_of(again) == 1010.0
    here, read_back = water.attached(spec), water.attached(again)
    assert list(here) == list(read_back)
    for name, body in here.items():
        scale = max(np.max(np.abs(body.added_mass)), 1e-300)
        # 3e-6
        within(
            f"added mass of {name}", (read_back[name].added_mass - body.added_mass) / scale, 1e-5
        )
    loaded = hydrodynamics.compile(again)
    # 5e-6
    within(
        "rows",
        (loaded.body_user - model.body_user) / np.maximum(np.abs(model.body_user), 1e-6),
        5e-5,
    )
    start = [
        mujoco.MjData(variant) for variant in (model, loaded, mujoco.MjModel.from_xml_string(text))
    ]
    for source, data in zip(
        (model, loaded, mujoco.MjModel.from_xml_string(text)), start, strict=True
    ):
        mujoco.mj_forward(source, data)
    scale = np.max(np.abs(start[0].qfrc_passive))
    # 4e-8
    within("forces, compiled by us", (start[1].qfrc_passive - start[0].qfrc_passive) / scale, 4e-7)
    within("forces, loaded plainly", (start[2].qfrc_passive - start[0].qfrc_passive) / scale, 4e-7)


def test_attached_specs_bring_their_water(within):
    """A wet arm attached to a dry scene, twice, by prefixes, moves as it does alone; so do its
    servos.
    """
    arm = """<mujoco><worldbody><body name="link"><joint name="j" axis="0 1 0"/>
      <geom type="capsule" size=".04" fromto="0 0 0 .4 0 0" mass="3"/></body></worldbody>
      <actuator><motor name="spare" joint="j"/>
        <position name="servo" joint="j" kp="30" dampratio=".8"/></actuator>
      </mujoco>"""

    def wet() -> mujoco.MjSpec:
        spec = mujoco.MjSpec.from_string(arm)
        water.attach(spec, {"link": water.cylinder(0.04, [0, 0, 0], [0.4, 0, 0])}, 1000.0)
        return spec

    scene = mujoco.MjSpec()
    for k in range(2):
        scene.attach(wet(), prefix=f"arm{k}/", frame=scene.worldbody.add_frame(pos=[0, 2 * k, 0]))
    scene.delete(scene.actuator("arm0/spare"))
    both = hydrodynamics.compile(scene)
    alone = hydrodynamics.compile(wet())
    ends = []
    for model in (both, alone):
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, 200)
        ends.append(data.qpos.copy())
    assert abs(ends[1][0]) > 0.05
    within("angle", ends[0] - ends[1][0], 1e-14)
    within("damping", both.actuator_biasprm[[0, 2], 2] - alone.actuator_biasprm[1, 2], 1e-14)


def test_welded_child_is_part_of_its_parent(within):
    """Coefficients on a child without joints, or the same moved to the parent's frame."""
    model = """<mujoco><worldbody>
      <body name="hull"><freejoint/><geom type="box" size=".3 .2 .1" mass="20"/>
      <body name="tank" pos=".3 -.2 .1" euler="20 30 40"><geom size=".05" mass="1"/></body>
      </body></worldbody></mujoco>"""
    rng = np.random.default_rng(4)
    L = rng.normal(size=(6, 6))
    A = L @ L.T
    D = np.diag(rng.uniform(1.0, 3.0, 6))
    c = np.array([0.1, 0.0, 0.2])
    motions = []
    for welded in (True, False):
        spec = mujoco.MjSpec.from_string(model)
        if welded:
            body = BodyHydrodynamics(
                volume=0.03, center_of_buoyancy=c, added_mass=A, linear_damping=D
            )
            water.attach(spec, {"tank": body})
        else:
            data = mujoco.MjData(plain := spec.copy().compile())
            mujoco.mj_kinematics(plain, data)
            R = data.xmat[2].reshape(3, 3)
            p = data.xpos[2]
            moved = BodyHydrodynamics(
                volume=0.03,
                center_of_buoyancy=p + R @ c,
                added_mass=water.moved_added_mass(A, R, p),
                linear_damping=water.moved_added_mass(D, R, p),
            )
            water.attach(spec, {"hull": moved})
        compiled = hydrodynamics.compile(spec)
        data = mujoco.MjData(compiled)
        data.qvel = rng.normal(size=6) if welded else motions[0][0]
        speed = data.qvel.copy()
        mujoco.mj_forward(compiled, data)
        motions.append((speed, data.qacc.copy()))
    error = (motions[0][1] - motions[1][1]) / np.max(np.abs(motions[0][1]))
    within("acceleration, relative", error, 3e-15)  # measured 3e-16


def test_flex_beside_and_under_water(within):
    """Bodies of a flex with coefficients sink as single spheres do; a dry flex beside them is left
    alone.
    """
    grid = """<flexcomp name="{}" type="grid" dim="2" count="3 3 1" spacing=".2 .2 .2"
      radius=".01" mass="1.8" pos="0 0 {}"><edge equality="true"/></flexcomp>"""
    spec = mujoco.MjSpec.from_string(
        f"<mujoco><worldbody>{grid.format('wet', 1)}{grid.format('dry', 3)}</worldbody></mujoco>"
    )
    body = water.sphere(0.02)
    water.attach(
        spec, {child.name: body for child in spec.bodies[1:] if child.name.startswith("wet")}
    )
    model = hydrodynamics.compile(spec)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    displaced = water.SEA_WATER * body.volume
    assert model.nflex == 2
    wet = np.array([model.body(int(i)).name.startswith("wet") for i in model.dof_bodyid[2::3]])
    assert wet.sum() == 9
    # measured 1e-15
    within("wet", data.qacc[2::3][wet] + 9.81 * (0.2 - displaced) / (0.2 + 0.5 * displaced), 1e-14)
    within("dry", data.qacc[2::3][~wet] + 9.81, 1e-14)


def test_current_that_changes_carries_a_drifting_body_along(within):
    """A neutral body without drag, in gusts: added mass and pressure gradient alone give it the
    water's speed.
    """
    spec = mujoco.MjSpec.from_string(
        '<mujoco><option timestep="0.002"/><worldbody><body name="e"><freejoint/>'
        '<geom type="ellipsoid" size=".3 .2 .1" density="1000"/></body></worldbody></mujoco>'
    )
    water.attach(
        spec,
        {"e": water.ellipsoid([0.3, 0.2, 0.1], drag_coefficient=0.0, water_density=1000.0)},
        1000.0,
    )
    model = hydrodynamics.compile(spec)
    data = mujoco.MjData(model)
    flow = Current([0.2, -0.1, 0.0], gust=0.1, time_constant=0.5, rng=np.random.default_rng(7))
    slot = model.body_user[0, water.LAYOUT.current_acceleration :][:3]
    velocity, _ = flow.step()
    data.qvel[:3] = velocity
    before = velocity.copy()
    for _ in range(1000):
        model.opt.wind = velocity
        velocity, acceleration = flow.step()
        slot[:] = acceleration
        mujoco.mj_step(model, data)
    assert np.linalg.norm(velocity - before) > 0.05
    within("speed through the water [m/s]", data.qvel[:3] - velocity, 1e-14)  # measured 1e-15


def test_shear_is_felt_at_each_bodys_height(within):
    """A post in a sheared current: each link drags with the water of its own height."""
    spec = mujoco.MjSpec.from_string(
        """<mujoco><worldbody>
        <body name="low"><joint type="slide" axis="1 0 0"/><geom size=".1" mass="1"/></body>
        <body name="high" pos="0 0 4"><joint type="slide" axis="1 0 0"/><geom size=".1" mass="1"/>
          </body>
        </worldbody></mujoco>"""
    )
    body = BodyHydrodynamics(volume=0.0, linear_damping=np.full(6, 3.0))
    water.attach(spec, {"low": body, "high": body})
    water.set_current(spec, [0.1, 0.0, 0.0], shear=[0.05, 0.0, 0.0])
    model = hydrodynamics.compile(spec)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    within("acceleration", data.qacc - 3.0 * np.array([0.1, 0.3]), 2e-15)  # measured 2e-16


def test_options_that_came_later_are_told_of():
    model = hydrodynamics.compile(world())
    assert hydrodynamics.check_installed(model)
    model.opt.density = 1000.0
    with pytest.warns(
        RuntimeWarning,
        match=r"cannot be run with density 1000.0 \(MuJoCo's own "
        r"fluid would act too\)",
    ):
        assert not hydrodynamics.check_installed(model)


def test_a_simulation_that_blew_up_is_told_of():
    """Far above the speed at which the step was judged, explicit drag overshoots; MuJoCo alone
    would only reset.
    """
    spec = mujoco.MjSpec.from_string(
        '<mujoco><option timestep="0.002"/><worldbody>'
        '<body name="ball"><freejoint/><geom size=".1" mass="4"/></body></worldbody></mujoco>'
    )
    water.attach(
        spec,
        {
            "ball": BodyHydrodynamics(
                volume=0.004, quadratic_damping=np.array([60.0] * 3 + [0.0] * 3)
            )
        },
    )
    model = hydrodynamics.compile(spec)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 10)
    hydrodynamics.check_motion(model, data)
    data.qvel[0] = 1e3
    mujoco.mj_step(model, data, 50)
    with pytest.raises(
        hydrodynamics.HydrodynamicsError,
        match=r"became unstable .* \(body 'ball'\) .* timestep "
        r"0.002 s",
    ):
        hydrodynamics.check_motion(model, data)
