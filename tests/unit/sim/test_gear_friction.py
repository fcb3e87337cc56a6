"""Friction in the gears: what holds, what breaks away, Stribeck's curve, and what the torque
sensors see of it.
"""

import mujoco
import numpy as np
import pytest

from uuv import models
from uuv.controllers.arm.joint_servo import track_gear_friction
from uuv.models.arms import gear_friction
from uuv.models.arms.gear_friction import GearFriction
from uuv.models.vehicle import Vehicle
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import Command
from uuv.sim.plant.plant import Plant
from uuv.sim.sensors import proprioception
from uuv.sim.water.current import Current

JOINT = "joint1"  # about the vertical: no weight


@pytest.fixture(scope="module")
def plant() -> Plant:
    return Plant(hydrodynamics.compile(models.load("uuv_puma")), current=Current([0.0, 0.0, 0.0]))


def drive(plant: Plant, torque: float, seconds: float) -> None:
    tau = np.zeros(plant.vehicle.joints.size)
    tau[0] = torque
    for _ in range(round(seconds / plant.timestep)):
        time = plant.observe().time
        plant.step(Command(time=time, joint_torque=tau, thrusters=np.zeros(6), scan=False))


def test_a_joint_holds_up_to_its_stiction_and_slides_against_less(plant, within):
    dry = plant.vehicle.dry_friction
    plant.reset(current=Current([0.0, 0.0, 0.0]))
    truth = plant.truth
    drive(plant, 0.99 * dry.stiction[0], 0.5)
    within("creep of a held joint [rad/s]", truth.qd[0], 5e-5)  # measured 5e-6
    # measured 2e-3
    within("what holds it [N m]", truth.tau_friction[0] + 0.99 * dry.stiction[0], 2e-2)
    drive(plant, 1.05 * dry.stiction[0], 0.5)
    assert truth.qd[0] > 3.0 * dry.stribeck_speed[0]
    within("sliding [N m]", truth.tau_friction[0] + dry.coulomb[0], 1e-2)  # measured 1e-3
    drive(plant, -1.05 * dry.stiction[0], 1.5)
    assert truth.qd[0] < -3.0 * dry.stribeck_speed[0]
    within("sliding back [N m]", truth.tau_friction[0] - dry.coulomb[0], 1e-2)


def test_it_slides_along_the_curve_of_stribeck(plant, within):
    """Friction of every step against the curve at the speed that it began with."""
    dry = plant.vehicle.dry_friction
    truth = plant.truth
    plant.reset(current=Current([0.0, 0.0, 0.0]))
    drive(plant, 1.02 * dry.stiction[0], 0.01)
    worst = 0.0
    speeds = []
    for _ in range(400):
        before = truth.qd.copy()
        drive(plant, 1.02 * dry.stiction[0], plant.timestep)
        worst = max(worst, abs(truth.tau_friction[0] + dry.bound(before)[0]))
        speeds.append(before[0] / dry.stribeck_speed[0])
    assert min(speeds) < 0.3
    assert max(speeds) > 2.0
    within("off the curve [N m]", worst, 1e-2)


def test_sensors_on_the_gear_outputs_do_not_see_it(plant, within):
    """What passes is what the drive gives less rotor and friction: nothing, at a held joint without
    load.
    """
    plant.reset(current=Current([0.0, 0.0, 0.0]))
    sensor = proprioception.JointTorqueSensors(noise=0.0, bias=0.0)
    state = sensor.init(np.random.default_rng(1))
    drive(plant, 0.9 * plant.vehicle.dry_friction.stiction[0], 2.0)
    tau = sensor.step(state, plant.truth)[1].tau
    within("torque behind a held gear [N m]", tau[0], 0.5)
    assert plant.truth.tau_drive[0] > 5.0


def test_drives_learn_what_the_gears_take(plant, within):
    """A held joint and one that slides, from motor torque and sensor alone."""
    plant.reset(current=Current([0.0, 0.0, 0.0]))
    sensor = proprioception.JointTorqueSensors(noise=0.0, bias=0.0)
    vehicle = plant.vehicle
    state = sensor.init(np.random.default_rng(1))
    n = plant.vehicle.joints.size
    for torque in (5.0, 9.0):
        friction = np.zeros(n)
        for _ in range(500):
            drive(plant, torque, plant.timestep)
            tau = sensor.step(state, plant.truth)[1].tau
            motor = np.array([torque, *np.zeros(n - 1)])
            gears = (
                vehicle.armature,
                vehicle.joint_damping,
                1.5 * vehicle.dry_friction.stiction,
                0.5,
            )
            track_gear_friction(motor, tau, plant.truth.qd, plant.truth.qdd, gears, friction)
        within("friction [N m]", friction + plant.truth.tau_friction, 0.1)
    gears = (vehicle.armature, vehicle.joint_damping, vehicle.dry_friction.stiction, 0.5)
    track_gear_friction(np.full(n, 1e3), np.zeros(n), np.zeros(n), np.zeros(n), gears, friction)
    # and no more, whatever a sensor says
    assert friction.tolist() == vehicle.dry_friction.stiction.tolist()


def test_a_plant_leaves_the_curve_in_its_model(plant):
    bounds = plant.model.dof_frictionloss.copy()
    drive(plant, 20.0, 0.2)
    assert np.array_equal(plant.model.dof_frictionloss, bounds)
    assert (
        Vehicle.of(plant.model).dry_friction.stiction.tolist()
        == plant.vehicle.dry_friction.stiction.tolist()
    )
    assert (
        Vehicle.of(plant.model).dry_friction.coulomb.tolist()
        == plant.vehicle.dry_friction.coulomb.tolist()
    )


def test_it_rides_through_a_file_and_a_plain_frictionloss_is_coulomb_alone():
    spec = models.load("uuv_puma")
    again = mujoco.MjSpec.from_string(spec.to_xml())
    expected, dry = (
        Vehicle.of(spec.compile()).dry_friction,
        Vehicle.of(again.compile()).dry_friction,
    )
    assert dry.coulomb == pytest.approx(expected.coulomb, rel=1e-5)
    assert dry.stiction == pytest.approx(expected.stiction, rel=1e-5)
    spec.joint(JOINT).frictionloss = 3.0
    dry = Vehicle.of(spec.compile()).dry_friction
    assert (dry.coulomb[0], dry.stiction[0]) == (3.0, 3.0)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"coulomb": -1.0}, "coulomb: must be finite and >= 0"),
        ({"stiction": np.nan}, "stiction: must be finite"),
        ({"stiction": 1.0}, "stiction: must be at least coulomb"),
        ({"stribeck_speed": 0.0}, "stribeck_speed and coulomb must be > 0"),
    ],
)
def test_figures_that_cannot_be(change, said):
    with pytest.raises(ConfigurationError, match=said):
        GearFriction(**({"coulomb": 2.0, "stiction": 3.0, "stribeck_speed": 0.03} | change))


def test_joints_that_cannot_carry_it():
    spec = models.load("uuv_puma")
    gear = GearFriction(coulomb=2.0, stiction=3.0, stribeck_speed=0.03)
    with pytest.raises(
        ConfigurationError,
        match=r"'nowhere': there is no joint of that name; the joints are .*'joint1'",
    ):
        gear_friction.attach(spec, {"nowhere": gear})
    spec.joint(JOINT).userdata = [1.0, 2.0, 3.0, 4.0]
    with pytest.raises(ConfigurationError, match="holds other data already"):
        gear_friction.attach(spec, {JOINT: gear})
