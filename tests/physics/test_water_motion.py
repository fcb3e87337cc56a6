"""A simulation has a current of its own in its data; without one it has that of its model."""

import copy
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import mujoco
import mujoco.batch
import mujoco.rollout
import numpy as np
import pytest

from uuv.models import hydrodynamics as water
from uuv.models.hydrodynamics import LAYOUT
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError, HydrodynamicsError
from uuv.sim.interfaces.messages import Command
from uuv.sim.interfaces.spatial import Array, exp_so3, quat_wxyz_from_rotation
from uuv.sim.plant.plant import Plant
from uuv.sim.plant.reaction_wrench import wrench
from uuv.sim.water.current import Current
from uuv.sim.water.water_motion import FLOW

WORLD = """
<mujoco>
  <size nuserdata="{users}"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="hull" pos=".1 .2 -2"> <freejoint/> <geom type="box" size=".5 .3 .2" mass="120"/>
      <body name="upper" pos=".5 0 0"> <joint name="j" axis="0 1 0" damping="1"/>
        <geom type="capsule" size=".04 .2" pos="0 0 -.25" mass="6"/> </body>
    </body>
  </worldbody>
</mujoco>
"""
WORLDS, STEPS = 64, 60
INTEGRATION, USERDATA = mujoco.mjtState.mjSTATE_INTEGRATION, mujoco.mjtState.mjSTATE_USERDATA
BY_MODEL = [0.2, -0.1, 0.05], [0.05, 0.02, -0.03], [0.1, 0.05, 0.0]


def spec_of(users: int = 3) -> mujoco.MjSpec:
    """Vehicle with a link, turned; the model's own current has an acceleration and a shear."""
    spec = mujoco.MjSpec.from_string(WORLD.format(users=users))
    spec.body("hull").quat = quat_wxyz_from_rotation(exp_so3([0.3, -0.2, 0.5]))
    link = water.cylinder(0.04, [0, 0, 0], [0, 0, -0.5])
    water.attach(spec, {"hull": water.box([1.0, 0.6, 0.4]), "upper": link})
    water.set_current(spec, *BY_MODEL)
    return spec


@pytest.fixture(scope="module")
def currents() -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(64)
    velocity, acceleration, shear = rng.normal(size=(3, WORLDS, 3))
    return 0.4 * velocity, 0.2 * acceleration, 0.1 * shear


@pytest.fixture(scope="module")
def alone(currents: tuple[Array, Array, Array]) -> Array:
    """Positions and velocities of 64 runs, each of one model that has its current in the model."""
    hydrodynamics.install()
    ends = []
    spec = spec_of()
    for velocity, acceleration, shear in zip(*currents, strict=True):
        water.set_current(spec, velocity, acceleration, shear)
        ends.append(state_after(hydrodynamics.compile(spec)))
    ends = np.array(ends)
    assert np.ptp(ends, axis=0).min() > 1e-4  # no current moves the vehicle like another
    return ends


def state_after(model: mujoco.MjModel, data: Any = None, *, steps: int = STEPS) -> Array:
    data = mujoco.MjData(model) if data is None else data
    mujoco.mj_step(model, data, steps)
    return np.concatenate([data.qpos, data.qvel])


def test_64_currents_in_turn_are_64_models(currents, alone):
    model = hydrodynamics.compile(spec_of())
    for k, end in enumerate(alone):
        data = mujoco.MjData(model)
        hydrodynamics.set_current(model, data, *(numbers[k] for numbers in currents))
        assert np.array_equal(state_after(model, data), end)


@pytest.mark.parametrize("threads", [1, 2])
def test_64_currents_in_one_batch_are_64_runs(threads, currents, alone):
    model = hydrodynamics.compile(spec_of())
    batch = mujoco.batch.Batch(model, nsim=WORLDS, nthread=threads)
    userdata = batch.bind("userdata")
    userdata[:, :3] = 7.0  # the user's own
    hydrodynamics.set_current(model, batch, *currents)
    batch.step(nstep=STEPS)
    assert np.array_equal(np.hstack([batch.bind("qpos"), batch.bind("qvel")]), alone)
    assert np.all(userdata[:, :3] == 7.0)
    np.testing.assert_array_equal(hydrodynamics.current(model, userdata), currents)


@pytest.mark.parametrize("threads", [1, 2])
def test_64_currents_in_one_rollout_are_64_runs(threads, currents, alone):
    """Its start state leaves `userdata` out, so they come with the controls."""
    model = hydrodynamics.compile(spec_of())
    start = np.zeros((WORLDS, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    data = mujoco.MjData(model)
    mujoco.mj_getState(model, data, start[0], mujoco.mjtState.mjSTATE_FULLPHYSICS)
    control = np.zeros((WORLDS, STEPS, model.nuserdata))
    hydrodynamics.set_current(model, control, *(numbers[:, None] for numbers in currents))
    workers = [mujoco.MjData(model) for _ in range(threads)]
    with mujoco.rollout.Rollout(nthread=threads) as rollout:
        starts = np.tile(start[0], (WORLDS, 1))
        states, _ = rollout.rollout(
            model, workers, starts, control=control, control_spec=int(USERDATA)
        )
    assert np.array_equal(states[:, -1, 1:], alone)


def test_a_rollout_without_it_takes_the_current_of_its_worker(currents, alone):
    model = hydrodynamics.compile(spec_of())
    worker = mujoco.MjData(model)
    start = np.zeros((1, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    mujoco.mj_getState(model, worker, start[0], mujoco.mjtState.mjSTATE_FULLPHYSICS)
    hydrodynamics.set_current(model, worker, *(numbers[5] for numbers in currents))
    states, _ = mujoco.rollout.rollout(model, worker, start, nstep=STEPS)
    assert np.array_equal(states[0, -1, 1:], alone[5])


def test_copies_carry_it_and_a_reset_ends_it(currents, alone):
    model = hydrodynamics.compile(spec_of())
    data, other, plain = (mujoco.MjData(model) for _ in range(3))
    hydrodynamics.set_current(model, data, *(numbers[9] for numbers in currents))
    mujoco.mj_copyData(other, model, data)
    assert np.array_equal(state_after(model, other), alone[9])
    mujoco.mj_copyState(model, data, plain, int(INTEGRATION))
    assert np.array_equal(state_after(model, plain), alone[9])
    for again in (copy.copy(data), copy.deepcopy(data), pickle.loads(pickle.dumps(data))):
        assert np.array_equal(state_after(model, again), alone[9])

    # Back to the default, which is the model's.
    mujoco.mj_resetData(model, data)
    np.testing.assert_array_equal(hydrodynamics.current(model, data), BY_MODEL)
    assert np.array_equal(state_after(model, data), state_after(model))
    assert not np.array_equal(state_after(model), alone[9])


def test_files_and_copies_of_a_model_have_the_place(tmp_path: Path, currents, alone):
    """MJCF keeps none; a spec read from it gets a place again, behind the user's numbers."""
    spec = spec_of()
    model = hydrodynamics.compile(spec)
    assert model.nuserdata == 3 + FLOW.size
    mujoco.mj_saveModel(model, str(tmp_path / "wet.mjb"))
    loaded = mujoco.MjModel.from_binary_path(str(tmp_path / "wet.mjb"))
    for again in (loaded, copy.deepcopy(model), pickle.loads(pickle.dumps(model))):
        data = mujoco.MjData(again)
        hydrodynamics.set_current(again, data, *(numbers[3] for numbers in currents))
        assert np.array_equal(state_after(again, data), alone[3])

    assert spec.nuserdata == 3
    again = hydrodynamics.compile(mujoco.MjSpec.from_string(spec.to_xml()))
    assert again.nuserdata == 3 + FLOW.size
    data = mujoco.MjData(again)
    hydrodynamics.set_current(again, data, *(numbers[3] for numbers in currents))
    end = state_after(again, data)
    np.testing.assert_allclose(end, alone[3], rtol=0.0, atol=1e-4)  # six digits


def test_an_mjb_holds_the_place_in_a_new_process(tmp_path: Path, currents, alone):
    model = hydrodynamics.compile(spec_of())
    path = tmp_path / "wet.mjb"
    mujoco.mj_saveModel(model, str(path))
    code = f"""
import mujoco
from uuv.sim import hydrodynamics
model = mujoco.MjModel.from_binary_path({str(path)!r})
data = mujoco.MjData(model)
hydrodynamics.set_current(model, data, *{[numbers[3].tolist() for numbers in currents]!r})
mujoco.mj_step(model, data, {STEPS})
print(data.qpos.tobytes().hex(), data.qvel.tobytes().hex())
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    numbers = np.frombuffer(bytes.fromhex(run.stdout.replace(" ", "").strip()))
    assert np.array_equal(numbers, alone[3])


@pytest.mark.parametrize("users", [0, 1, 40])
def test_the_users_numbers_stay_his(users, currents, alone):
    """A vehicle in a scene of the user's, whose own code writes all of its `userdata`."""
    scene = mujoco.MjSpec()
    vehicle = spec_of(users)
    scene.nuserdata = users
    vehicle.option.wind = np.zeros(3)
    scene.option.timestep = vehicle.option.timestep
    scene.option.integrator = vehicle.option.integrator
    scene.attach(vehicle, prefix="own_", frame=scene.worldbody.add_frame())
    for model in (hydrodynamics.compile(scene), hydrodynamics.compile(scene)):
        assert (scene.nuserdata, model.nuserdata) == (users, users + FLOW.size)
        data = mujoco.MjData(model)
        data.userdata[:users] = 620264.0
        hydrodynamics.set_current(model, data, *(numbers[7] for numbers in currents))
        assert np.array_equal(state_after(model, data), alone[7])
        assert np.all(data.userdata[:users] == 620264.0)


def test_a_place_that_the_user_has_taken_meanwhile_is_not_used():
    """As in a model compiled by MuJoCo from a spec with more numbers, to which rows were copied."""
    model = hydrodynamics.compile(spec_of(3))
    other = spec_of(30).compile()
    other.body_user[:] = model.body_user
    data = mujoco.MjData(other)
    data.userdata[:] = FLOW.uniform
    np.testing.assert_array_equal(hydrodynamics.current(other, data), BY_MODEL)
    assert np.array_equal(state_after(other, data), state_after(other))
    with pytest.raises(ConfigurationError, match=r"keeps no current in its data; .*compile\(\)"):
        hydrodynamics.set_current(other, data, [0.1, 0.0, 0.0])


def test_numbers_of_something_else_in_its_place_are_said():
    model = hydrodynamics.compile(spec_of())
    data = mujoco.MjData(model)
    data.userdata[:] = 1.0
    mujoco.mj_step(model, data, 3)
    message = r"data.userdata has no current from index 3 on; use set_current"
    with pytest.raises(HydrodynamicsError, match=message):
        hydrodynamics.check_motion(model, data)
    assert np.array_equal(data.qpos, state_after(model, steps=3)[: model.nq])  # the model's current


def test_what_is_no_current_is_refused_and_changes_nothing(currents):
    model = hydrodynamics.compile(spec_of())
    data = mujoco.MjData(model)
    dry = mujoco.MjModel.from_xml_string(WORLD.format(users=3))
    hydrodynamics.set_current(model, data, *(numbers[1] for numbers in currents))
    before = data.userdata.copy()
    many = np.zeros((4, model.nuserdata))
    zero = np.zeros(3)
    refused = hydrodynamics.set_current
    for call, message in (
        (lambda: refused(model, data, [0.1, 0.2]), r"velocity_W \[m/s\]: expected .*, got \(2,\)"),
        (lambda: refused(model, data, 0.1), r"expected shape \(3,\), got \(\)"),
        (lambda: refused(model, data, np.ones((2, 3))), r"expected shape \(3,\), got \(2, 3\)"),
        (lambda: refused(model, many, np.ones((2, 3))), r"expected shape \(4, 3\), got \(2, 3\)"),
        (lambda: refused(model, data, zero, [0, np.nan, 0]), r"acceleration_W .*must be finite"),
        (lambda: refused(model, data, zero, shear=[0, 1e20, 0]), r"shear .*at most 1e\+15"),
        (lambda: refused(model, data, "fast"), r"velocity_W"),
        (lambda: refused(dry, mujoco.MjData(dry), zero), "with hydrodynamics"),
        (lambda: refused(model, mujoco.MjData(dry), zero), r"with 13 numbers of userdata, got 3"),
        (lambda: refused(model, [0.0] * 13, zero), r"expected an MjData or an array of userdata"),
        (lambda: hydrodynamics.current(dry, mujoco.MjData(dry)), "with hydrodynamics"),
    ):
        with pytest.raises(ConfigurationError, match=message):
            call()
    assert np.array_equal(data.userdata, before)


def test_the_reaction_feels_the_current_of_the_simulation(currents):
    """The wrench on the hull, in a model with that current and in one that has it in its data."""
    spec = spec_of()
    model = hydrodynamics.compile(spec)
    water.set_current(spec, *(numbers[2] for numbers in currents))
    expected, measured = [], []
    for variant, wrenches in ((hydrodynamics.compile(spec), expected), (model, measured)):
        data = mujoco.MjData(variant)
        data.qvel[:] = np.arange(1.0, 8.0) / 7.0
        if variant is model:
            hydrodynamics.set_current(model, data, *(numbers[2] for numbers in currents))
        mujoco.mj_forward(variant, data)
        wrenches.append(wrench(variant, data, "upper", frame="hull"))
    assert np.array_equal(measured, expected)
    assert np.linalg.norm(measured) > 1.0


# ---------------------------------------------------------------------------------------- plant


def still() -> Command:
    return Command(time=0.0, joint_torque=np.zeros(0), thrusters=np.zeros(0), scan=False)


def plant_over(model: mujoco.MjModel, velocity: Array) -> Plant:
    return Plant(model, current=Current(velocity, gust=0.1, rng=np.random.default_rng(4)))


def test_two_plants_share_one_model(currents):
    """Each in gusts of its own, stepped in turn: as each alone. The model does not change."""
    spec = spec_of()
    spec.delete(spec.body("upper"))
    model = hydrodynamics.compile(spec)
    numbers = model.opt.wind.copy(), model.body_user.copy()
    both = [plant_over(model, velocity) for velocity in currents[0][:2]]
    apart = [plant_over(hydrodynamics.compile(spec), velocity) for velocity in currents[0][:2]]
    for _ in range(40):
        for plant in (*both, *apart):
            plant.observe()
            plant.step(still())
    for shared, other in zip(both, apart, strict=True):
        assert np.array_equal(shared.data.qvel, other.data.qvel)
        motion = hydrodynamics.current(model, shared.data)
        assert np.array_equal(motion.velocity_W, shared.truth.current_W)
        assert np.array_equal(motion.shear, BY_MODEL[2])  # of the model, as all plants have it
    assert np.abs(both[0].data.qvel - both[1].data.qvel).max() > 1e-3
    assert np.array_equal(numbers[0], model.opt.wind)
    assert np.array_equal(numbers[1], model.body_user)


def own_current(plant: Plant) -> None:
    hydrodynamics.set_current(plant.model, plant.data, [0.0, 0.0, 0.3])


def wind(plant: Plant) -> None:
    plant.model.opt.wind[1] = 0.4


def shear(plant: Plant) -> None:
    plant.model.body_user[0, LAYOUT.current_shear] = 0.4


@pytest.mark.parametrize(
    ("write", "said"),
    [
        (own_current, r"the current in its data is \["),
        (wind, r"opt.wind is \[0.2, 0.4, 0.05\] m/s, .*no effect"),
        (shear, r"its shear \[0.4, 0.05, 0.0\] 1/s, .*no effect"),
    ],
)
def test_water_that_something_else_writes_into_a_run_is_refused(write, said, currents):
    spec = spec_of()
    spec.delete(spec.body("upper"))
    plant = plant_over(hydrodynamics.compile(spec), currents[0][0])
    plant.observe()
    plant.step(still())
    plant.observe()
    write(plant)
    with pytest.raises(ConfigurationError, match=said + ".*`on_water`.*site.flow"):
        plant.step(still())
    with pytest.raises(ConfigurationError, match=said):
        plant.ready()


def test_data_that_are_reset_within_a_run_are_refused(currents):
    spec = spec_of()
    spec.delete(spec.body("upper"))
    plant = plant_over(hydrodynamics.compile(spec), currents[0][0])
    for _ in range(3):
        plant.observe()
        plant.step(still())
    mujoco.mj_resetData(plant.model, plant.data)
    with pytest.raises(ConfigurationError, match=r"its data were reset .* reset\(\) or start\(\)"):
        plant.observe()
    plant.reset(current=Current([0.1, 0.0, 0.0]))
    plant.observe()
    plant.step(still())


def test_a_model_of_mujocos_own_fluid_has_its_current_there():
    """No coefficients: the plant writes `opt.wind`, which MuJoCo's own drag reads."""
    spec = mujoco.MjSpec.from_string(WORLD.format(users=0))
    spec.delete(spec.body("upper"))
    spec.option.density = 1000.0
    plant = Plant(hydrodynamics.compile(spec), current=Current([0.4, 0.0, 0.0]))
    for _ in range(20):
        plant.observe()
        plant.step(still())
    assert plant.model.opt.wind.tolist() == [0.4, 0.0, 0.0]
    assert plant.data.qvel[0] > 1e-4


def test_a_wet_model_that_mujoco_compiled_has_its_current_in_the_model():
    spec = spec_of()
    spec.delete(spec.body("upper"))
    plain = spec.compile()
    hydrodynamics.set_constants(plain)
    plant = Plant(plain, current=Current([0.4, 0.1, 0.0]))
    for _ in range(20):
        plant.observe()
        plant.step(still())
    assert plain.opt.wind.tolist() == [0.4, 0.1, 0.0]
