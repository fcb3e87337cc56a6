"""Compiled stages of the plant against `Plant.observe` and `Plant.step`, bit by bit."""

from dataclasses import replace

import mujoco
import numba
import numpy as np
import pytest

from untyped import untyped
from uuv import models
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError, HydrodynamicsError
from uuv.sim.interfaces.messages import Command
from uuv.sim.interfaces.spatial import Array
from uuv.sim.native.native_memory import call_physics
from uuv.sim.plant import compiled_step, faults
from uuv.sim.plant.moved_object import MovedObjectPlant, swing
from uuv.sim.plant.plant import Plant
from uuv.sim.plant.readout import DATA, MODEL, STEP1, STEP2
from uuv.sim.plant.truth import Truth
from uuv.sim.water.current import _BLOCK, Current

STEPS = 200
REST = Command(time=0.0, joint_torque=np.zeros(6), thrusters=np.zeros(6), scan=False)
NUMBERS = ("time", "contact_normal", "contact_least", "contact_most", "collision", "saturated")
ARRAYS = (
    *(
        "xpos",
        "xmat",
        "v_WB_W",
        "w_WB_B",
        "acceleration",
        "q",
        "qd",
        "qdd",
        "tau_drive",
        "tau_friction",
    ),
    *("propeller_speed", "thrust", "current_W", "p_pad", "contact_force_W"),
)


@pytest.fixture(scope="module")
def pressed() -> mujoco.MjModel:
    """The pad just above a plate."""
    spec = models.load("uuv_puma")
    plain = spec.compile()
    data = mujoco.MjData(plain)
    mujoco.mj_resetDataKeyframe(plain, data, 0)
    mujoco.mj_kinematics(plain, data)
    below = data.geom_xpos[plain.geom("pad").id] - [0.0, 0.0, 0.1 + plain.geom("pad").rbound[0]]
    spec.worldbody.add_geom(
        name="plate", type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1, 0.1, 0.1], pos=below
    )
    return hydrodynamics.compile(spec)


def plant_of(model: mujoco.MjModel, substeps: int, gust: float) -> Plant:
    step = substeps * float(model.opt.timestep)
    rng = np.random.default_rng(5)
    return Plant(
        model,
        current=Current((0.1, -0.05, -0.2), gust=gust, timestep=step, rng=rng),
        substeps=substeps,
    )


def state_of(truth: Truth) -> dict[str, Array]:
    return {name: np.array(getattr(truth, name)) for name in NUMBERS + ARRAYS}


def commands() -> tuple[Array, Array]:
    """Torques (STEPS, 6) and thruster commands (STEPS, 6) that also saturate."""
    rng = np.random.default_rng(2)
    return rng.uniform(-8.0, 8.0, (STEPS, 6)), np.clip(
        rng.uniform(-1.4, 1.4, (STEPS, 6)), -1.0, 1.0
    )


@numba.njit(nogil=True)
def several(plant, torques, thrusters, first, end):
    """Ticks from `first` up to `end`; the tick at which Python must check, or `end`."""
    for i in range(first, end):
        if compiled_step.observe(plant):
            return i
        if not compiled_step.advance(plant, torques[i], thrusters[i]):
            return -1
    return end


@pytest.mark.parametrize(("substeps", "gust"), [(1, 0.0), (1, 0.05), (4, 0.05)])
def test_both_ways_give_the_same_bits(pressed, substeps, gust):
    """Blocks of steps in turn with single ones of Python; over a refill of the gusts, and in
    contact.
    """
    torques, thrusters = commands()
    first = plant_of(pressed, substeps, gust)
    other = plant_of(pressed.__copy__(), substeps, gust)
    skipped = _BLOCK - 120 if gust else 0  # rows of gusts
    for plant in (first, other):
        for _ in range(skipped):
            plant._water.current.step()
    states = []
    touched = False
    for i in range(STEPS):
        first.observe()
        states.append(state_of(first.truth))
        first.step(replace(REST, joint_torque=torques[i], thrusters=thrusters[i]))
        touched |= first.truth.contact_normal > 0.0
    assert touched
    assert other.spans() == ""
    record = other.record()
    tick = 0
    while tick < STEPS:
        other.observe()
        for name, array in state_of(other.truth).items():
            assert np.array_equal(array, states[tick][name], equal_nan=True), (tick, name)
        other.step(replace(REST, joint_torque=torques[tick], thrusters=thrusters[tick]))
        tick += 1
        if tick > 2:  # the first two times are checked in Python
            end = min(STEPS, tick + 9, tick + other.ready())
            assert several(record, torques, thrusters, tick, end) == end
            other.publish()
            tick = end
    for plant in (first, other):
        plant.observe()
    last = state_of(first.truth)
    assert all(
        np.array_equal(entry, last[name], equal_nan=True)
        for name, entry in state_of(other.truth).items()
    )


def swaying(model: mujoco.MjModel) -> Plant:
    return Plant(model, current=Current((0.1, 0.0, 0.0), profile=lambda t: (1.0 + 0.2 * t, 0.2)))


def in_a_field(model: mujoco.MjModel) -> Plant:
    class Sheared:
        def velocity(self, p_W, time):
            return np.array([0.02 * p_W[1] + 0.1 * time, 0.0, 0.01 * p_W[0]])

    return Plant(model, current=Current((0.1, 0.0, 0.0)).with_flow(untyped(Sheared())))


def with_faults(model: mujoco.MjModel) -> faults.FaultyPlant:
    weak = faults.ThrusterFault(0, faults.Onset(at=0.1), share=0.4)
    stuck = faults.ThrusterFault(3, faults.Onset(at=0.15), stuck=True)
    return faults.FaultyPlant(Plant(model, current=Current(np.zeros(3))), [weak, stuck])


def with_a_swinging_object(model: mujoco.MjModel) -> MovedObjectPlant:
    return MovedObjectPlant(plant_of(model, 1, 0.02), "plate", swing([0.0, 0.0, 0.004], 5.0))


@pytest.fixture(scope="module")
def loose() -> mujoco.MjModel:
    """The pad just above a plate on a free joint."""
    spec = models.load("uuv_puma")
    plate = spec.worldbody.add_body(name="plate", pos=[1.2, 0.0, -0.6])
    plate.add_freejoint()
    plate.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.1, 0.1, 0.1])
    return hydrodynamics.compile(spec)


@pytest.mark.parametrize("make", [swaying, in_a_field, with_faults, with_a_swinging_object])
def test_what_is_in_python_is_called_at_every_compiled_step(loose, make):
    torques, thrusters = commands()
    first_plant = make(loose)
    other = make(loose.__copy__())
    inner = [plant if isinstance(plant, Plant) else plant.plant for plant in (first_plant, other)]
    for i in range(STEPS):
        first_plant.observe()
        first_plant.step(replace(REST, joint_torque=torques[i], thrusters=thrusters[i]))

    assert other.spans() == ""
    for i in range(3):  # the first times are checked in Python
        other.observe()
        other.step(replace(REST, joint_torque=torques[i], thrusters=thrusters[i]))
    assert inner[1].ready() >= STEPS
    assert several(other.record(), torques, thrusters, 3, STEPS) == STEPS
    inner[1].publish()
    for plant in (first_plant, other):
        plant.observe()
    first, second = (state_of(plant.truth) for plant in inner)
    assert all(np.array_equal(first[name], array, equal_nan=True) for name, array in second.items())


def test_what_a_hook_raises_is_raised_at_the_next_check(pressed):
    plant = swaying(pressed)
    record = plant.record()
    plant._water.write = untyped(lambda *_: 1 / 0)
    plant.observe()
    compiled_step.advance(record, np.zeros(6), np.zeros(6))
    assert compiled_step.observe(record)
    with pytest.raises(ZeroDivisionError):
        plant.check()


def test_mujoco_called_by_address_is_mujoco(pressed):
    plant = plant_of(pressed, 1, 0.0)
    data = mujoco.MjData(pressed)
    plant.observe()
    data.qpos[:], data.qvel[:] = plant.data.qpos, plant.data.qvel
    data.userdata[:] = plant.data.userdata
    mujoco.mj_step1(pressed, data)
    places = plant.record().readout.places
    for _ in range(50):
        _both(places)
        mujoco.mj_step2(pressed, data)
        mujoco.mj_step1(pressed, data)
    assert data.time == plant.data.time
    for name in ("qpos", "qvel", "qacc", "qfrc_passive", "M", "efc_force"):
        assert np.array_equal(getattr(data, name), getattr(plant.data, name)), name


@numba.njit
def _both(places):
    call_physics(places[STEP2], places[MODEL], places[DATA])
    call_physics(places[STEP1], places[MODEL], places[DATA])


def test_a_command_that_is_not_finite_changes_nothing(pressed):
    plant = plant_of(pressed, 1, 0.0)
    plant.observe()
    record = plant.record()
    before = plant.data.qpos.copy()
    assert not compiled_step.advance(
        record, np.zeros(6), np.array([0.0, np.nan, 0.0, 0.0, 0.0, 0.0])
    )
    assert not compiled_step.advance(record, np.full(6, np.inf), np.zeros(6))
    assert np.array_equal(plant.data.qpos, before)
    assert not plant.truth.propeller_speed.any()


def test_a_simulation_that_diverged_is_noticed(pressed):
    plant = plant_of(pressed, 1, 0.0)
    for _ in range(3):
        plant.observe()
        plant.step(REST)
    plant.data.qvel[0] = 1e12
    assert compiled_step.observe(plant.record())
    with pytest.raises(HydrodynamicsError, match="unstable"):
        plant.check()


def test_a_step_without_the_water_is_noticed(pressed):
    plant = plant_of(pressed, 1, 0.0)
    for _ in range(3):
        plant.observe()
        plant.step(REST)
    hydrodynamics.uninstall()
    try:
        assert compiled_step.observe(plant.record())
        with pytest.raises(HydrodynamicsError, match="hydrodynamics"):
            plant.check()
    finally:
        hydrodynamics.install()


def test_the_compiled_step_ends_what_observe_began(pressed):
    plant = plant_of(pressed, 1, 0.0)
    plant.observe()
    compiled_step.advance(plant.record(), np.zeros(6), np.zeros(6))
    with pytest.raises(ConfigurationError, match="observe"):
        plant.step(REST)


def test_plants_with_parts_in_python_say_so(pressed):
    still = Current(np.zeros(3))
    measured = Plant(pressed, current=still, reaction_ticks=5)
    assert (measured.spans(), measured.ready()) == ("", 0)
    measured.observe()
    measured.step(Command(time=0.0, joint_torque=np.zeros(6), thrusters=np.zeros(6), scan=False))
    assert measured.ready() == 4
