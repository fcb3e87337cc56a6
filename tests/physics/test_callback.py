"""The callback serves every model and thread of the process alike, and MuJoCo's own tools see the
wet inertia.
"""

import mujoco
import mujoco.rollout
import numpy as np
import pytest

from uuv.models import hydrodynamics as water
from uuv.models.hydrodynamics import BodyHydrodynamics
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import HydrodynamicsError
from uuv.sim.interfaces.spatial import Array

ARM = """
<mujoco>
  <option timestep="0.002" integrator="{integrator}"/>
  <worldbody>
    <geom type="plane" size="5 5 1" pos="0 0 -.4"/>
    <body name="hull"> <freejoint/> <geom type="box" size=".5 .3 .2" mass="{mass}"/>
      <site name="eye"/>
      <body name="upper" pos=".5 0 0">
        <joint name="j" axis="0 1 0" damping="1" armature=".1" range="-30 30"/>
        <geom type="capsule" size=".04 .2" pos="0 0 -.25" mass="6"/>
        <body name="tool" pos="0 0 -.5"> <geom size=".05" mass="1"/> <site name="tip"/> </body>
      </body>
    </body>
    <body name="dock" pos="3 0 0"> <geom size=".1"/> </body>
    <body name="ghost" mocap="true" pos="4 0 0"> <geom size=".1"/> </body>
    <body name="dry" pos="5 0 1"> <freejoint/> <geom size=".1"/> </body>
  </worldbody>
  <tendon> <spatial name="t"> <site site="eye"/> <site site="tip"/> </spatial>
    <fixed name="f"> <joint joint="j" coef="2"/> </fixed> </tendon>
  <actuator> <position joint="j" kp="20" dampratio="1" gear="2"/> <motor tendon="t"/>
    <position tendon="f" kp="5" dampratio=".7"/> </actuator>
</mujoco>
"""


def spec_of(
    mass: float = 200.0, integrator: str = "implicitfast", coefficients: bool = True
) -> mujoco.MjSpec:
    spec = mujoco.MjSpec.from_string(ARM.format(mass=mass, integrator=integrator))
    if coefficients:
        link = water.cylinder(0.04, [0, 0, 0], [0, 0, -0.5])
        solid = water.sphere(0.1)
        bodies = {
            "hull": water.box([1.0, 0.6, 0.4]),
            "upper": link,
            "tool": solid,
            "dock": solid,
            "ghost": solid,
        }
        water.attach(spec, bodies)
    return spec


def run(model: mujoco.MjModel, steps: int = 300) -> Array:
    data = mujoco.MjData(model)
    data.qvel[:7] = [0.3, 0.2, -0.5, 0.4, 0.3, -0.2, 1.0]
    path = []
    for _ in range(steps):
        mujoco.mj_step(model, data)
        path.append(np.concatenate([data.qpos, data.qvel]))
    return np.array(path)


@pytest.mark.check("three models stepped in turn", "each alone, bit by bit")
def test_two_models_do_not_disturb_each_other(within):
    wet = hydrodynamics.compile(spec_of())
    other = hydrodynamics.compile(spec_of(mass=150.0))
    dry = hydrodynamics.compile(spec_of(coefficients=False))
    alone = [run(model) for model in (wet, other, dry)]
    states = [mujoco.MjData(model) for model in (wet, other, dry)]
    apart = 0.0
    for data in states:
        data.qvel[:7] = [0.3, 0.2, -0.5, 0.4, 0.3, -0.2, 1.0]
    for step in range(300):
        for model, data, path in zip((wet, other, dry), states, alone, strict=True):
            mujoco.mj_step(model, data)
            apart = max(
                apart, float(np.max(np.abs(np.concatenate([data.qpos, data.qvel]) - path[step])))
            )
    within("difference", apart, 0.0)
    assert not np.allclose(alone[0], alone[1])


@pytest.mark.check("model without coefficients", "plain MuJoCo, bit by bit")
def test_model_without_coefficients_moves_as_in_plain_mujoco(within):
    model = hydrodynamics.compile(spec_of(coefficients=False))
    with_callback = run(model)
    hydrodynamics.uninstall()
    within("difference", with_callback - run(model), 0.0)


@pytest.mark.check("repeated runs, one and two threads", "equal bit by bit")
def test_runs_repeat_bit_by_bit_on_any_number_of_threads(within):
    model = hydrodynamics.compile(spec_of())
    data = mujoco.MjData(model)
    start = np.zeros((6, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    for i in range(len(start)):
        data.qvel[:] = 0.1 * i
        mujoco.mj_getState(model, data, start[i], mujoco.mjtState.mjSTATE_FULLPHYSICS)
    runs = []
    for threads in (1, 2):
        workers = [mujoco.MjData(model) for _ in range(threads)]
        with mujoco.rollout.Rollout(nthread=threads) as rollout:
            states, _ = rollout.rollout(model, workers, start, nstep=200)
        runs.append(states.copy())
    assert np.ptp(runs[0]) > 0.1
    within("difference of 1 and 2 threads", runs[0] - runs[1], 0.0)
    within("difference of two runs", run(model) - run(model), 0.0)


@pytest.mark.check("constraint islands", "one problem")
def test_islands_are_solved_apart_as_they_are_together(within):
    """Two wet vehicles on the floor, far apart: two islands, or one problem."""
    spec = spec_of()
    spec.attach(spec_of(), prefix="other_", frame=spec.worldbody.add_frame(pos=[0, 8, 0]))
    water.attach(spec, {})
    model = hydrodynamics.compile(spec)
    model.opt.tolerance = 0.0
    paths = []
    most = 0
    for flag in (0, mujoco.mjtDisableBit.mjDSBL_ISLAND):
        model.opt.disableflags = int(flag)
        data = mujoco.MjData(model)
        path = []
        for _ in range(400):
            mujoco.mj_step(model, data)
            most = max(most, data.nisland)
            path.append(data.qpos.copy())
        paths.append(np.array(path))
    assert most >= 2
    within("position [m, -]", paths[0] - paths[1], 1e-15)  # measured 1e-16


@pytest.mark.check("mj_inverse, in contact", "forward dynamics")
@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
@pytest.mark.parametrize("flag", ["none", "invdiscrete"])
def test_inverse_dynamics_agrees_with_forward(integrator, flag, within):
    """With a contact, a limit, damping and armature; from a state alone, as a user would call
    it.
    """
    model = hydrodynamics.compile(spec_of(integrator=integrator))
    data = mujoco.MjData(model)
    data.qvel[:7] = [0.3, 0.2, -0.5, 0.4, 0.3, -0.2, 1.0]
    data.qfrc_applied[:7] = [3.0, -2.0, 1.0, 0.5, -1.0, 2.0, 5.0]
    contacts = 0
    for _ in range(300):
        mujoco.mj_step(model, data)
        contacts += data.ncon
    assert contacts > 0
    mujoco.mj_forward(model, data)
    qacc = data.qacc.copy()
    if flag == "invdiscrete":
        model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_INVDISCRETE
        before = data.qvel.copy()
        stepped = mujoco.MjData(model)
        stepped.qpos, stepped.qvel, stepped.qfrc_applied = data.qpos, data.qvel, data.qfrc_applied
        mujoco.mj_step(model, stepped)
        qacc = (stepped.qvel - before) / model.opt.timestep
    fresh = mujoco.MjData(model)
    fresh.qpos = data.qpos
    fresh.qvel = data.qvel
    fresh.qacc = qacc
    mujoco.mj_inverse(model, fresh)
    expected = data.qfrc_applied + data.qfrc_actuator
    within("generalised force [N, N m]", fresh.qfrc_inverse - expected, 2e-10)  # measured 2e-11


def test_passive_forces_again_without_a_new_inertia(within):
    """mj_forwardSkip and finite differences call the callback twice for one inertia; the added mass
    counts once.
    """
    model = hydrodynamics.compile(spec_of())
    data = mujoco.MjData(model)
    data.qvel[:] = 0.1
    mujoco.mj_forward(model, data)
    once, qacc = data.M.copy(), data.qacc.copy()
    mujoco.mj_forwardSkip(model, data, mujoco.mjtStage.mjSTAGE_POS, 0)
    assert np.array_equal(data.M, once)
    within("qacc", data.qacc - qacc, 1e-12)
    nx = 2 * model.nv + model.na
    nv = model.nv
    h = 1e-6
    A = np.zeros((nx, nx))
    mujoco.mjd_transitionFD(model, data, h, True, A, None, None, None)
    for i in range(nv):
        ends = []
        for sign in (1.0, -1.0):
            perturbed = mujoco.MjData(model)
            perturbed.qpos, perturbed.qvel = data.qpos, data.qvel
            perturbed.qvel[i] += sign * h
            mujoco.mj_step(model, perturbed)
            ends.append(perturbed.qvel.copy())
        within("transition", A[nv : 2 * nv, nv + i] - (ends[0] - ends[1]) / (2.0 * h), 1e-6)


def test_inertia_is_factored_as_mujoco_factors_it(within):
    model = hydrodynamics.compile(spec_of())
    data = mujoco.MjData(model)
    data.qvel[:] = 0.1
    mujoco.mj_forward(model, data)
    ours = data.qLD.copy(), data.qLDiagInv.copy()
    mujoco.mj_factorM(model, data)
    within("L", ours[0] - data.qLD, 1e-13)
    within("1/D, relative", ours[1] / data.qLDiagInv - 1.0, 1e-13)


def test_static_and_mocap_bodies_feel_nothing(within):
    """The dock and the ghost carry coefficients; nothing can move them, and the dry ball falls
    freely.
    """
    model = hydrodynamics.compile(spec_of())
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    within("acceleration of the dry ball", data.qacc[-6:] - [0, 0, -9.81, 0, 0, 0], 1e-14)


def test_without_coefficients_the_weights_are_those_of_mujoco(within):
    """All that `compile` recomputes, with zero added mass, is what MuJoCo computes itself."""
    plain = spec_of(coefficients=False)
    for body in plain.bodies[1:]:
        body.simple = 0
    expected = plain.compile()
    spec = spec_of(coefficients=False)
    water.attach(
        spec, {name: BodyHydrodynamics(volume=0.1) for name in ("hull", "upper", "tool", "dry")}
    )
    model = hydrodynamics.compile(spec)
    weights = ["body_invweight0", "dof_invweight0", "tendon_invweight0"]
    for name in [*weights, "dof_M0", "actuator_acc0", "actuator_biasprm"]:
        want = getattr(expected, name)
        within(name, (getattr(model, name) - want) / np.maximum(np.abs(want), 1e-3), 1e-12)
    within("meaninertia", model.stat.meaninertia / expected.stat.meaninertia - 1.0, 1e-12)


def test_says_when_a_model_was_compiled_without_its_water():
    with pytest.warns(RuntimeWarning, match="contact weights of its dry mass"):
        assert not hydrodynamics.check_installed(spec_of().compile())


def test_says_when_a_wet_model_would_move_dry():
    wet = hydrodynamics.compile(spec_of())
    dry = hydrodynamics.compile(spec_of(coefficients=False))
    assert hydrodynamics.check_installed(wet)
    hydrodynamics.uninstall()
    assert hydrodynamics.check_installed(dry)
    with pytest.warns(RuntimeWarning, match="moves dry"):
        assert not hydrodynamics.check_installed(wet)


def test_does_not_push_aside_another_callback():
    hydrodynamics.uninstall()
    mujoco.set_mjcb_passive(lambda _model, _data: None)
    try:
        with pytest.raises(HydrodynamicsError, match="another passive callback"):
            hydrodynamics.install()
        hydrodynamics.uninstall()
        assert mujoco.get_mjcb_passive() is not None
    finally:
        mujoco.set_mjcb_passive(None)
    hydrodynamics.install()
    hydrodynamics.install()
    assert hydrodynamics.is_installed()
