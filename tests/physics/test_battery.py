"""A battery against closed forms: sag, charge and energy at a current that is known."""

import mujoco
import numpy as np
import pytest

from uuv.models import hydrodynamics
from uuv.models.water import battery_feed, thrusters
from uuv.models.water.battery import Battery
from uuv.models.water.thruster_sheets import Sheet
from uuv.models.water.thrusters import Thruster
from uuv.sim import hydrodynamics as water
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import Command
from uuv.sim.plant.compiled_step import advance, observe
from uuv.sim.plant.plant import Plant
from uuv.sim.plant.supply import CHARGE, CURRENT, ENERGY, VOLTAGE
from uuv.sim.water.current import Current

COMMAND = (-1.0, -0.1, 0.1, 1.0)
AMPERES = 6.0  # [A] at full command, at any voltage


def constant() -> Thruster:
    """Thruster whose current at full command is that of every voltage; 1 N/V."""
    sheets = tuple(
        Sheet(
            voltage=volts,
            command=COMMAND,
            thrust=(-volts, 0.0, 0.0, volts),
            current=(AMPERES, 0.0, 0.0, AMPERES),
        )
        for volts in (8.0, 20.0)
    )
    curve = COMMAND, (-15.0, 0.0, 0.0, 15.0)
    return Thruster(forward=15.0, reverse=15.0, table=curve, sheets=sheets, voltage=15.0)


def plant(battery: Battery | None, thruster: Thruster, count: int = 2) -> Plant:
    """A box with thrusters ahead, tilted in the world and off its own axes."""
    hull = '<body name="hull" pos="1 2 -3"><freejoint/><geom type="box" size=".3 .2 .1"/></body>'
    spec = mujoco.MjSpec.from_string(f"<mujoco><worldbody>{hull}</worldbody></mujoco>")
    hydrodynamics.attach(spec, {"hull": hydrodynamics.box((0.6, 0.4, 0.2))})
    for k in range(count):
        spec.body("hull").add_site(name=f"t{k}", pos=[0.1, 0.1 * k - 0.05, 0.02])
        site = mujoco.mjtTrn.mjTRN_SITE
        spec.add_actuator(name=f"t{k}", trntype=site, target=f"t{k}", gear=[1, 0.3, 0.1, 0, 0, 0])
        gear = np.array([1.0, 0.3, 0.1]) / np.linalg.norm([1.0, 0.3, 0.1])
        spec.actuator(f"t{k}").gear[:3] = gear
    thrusters.attach(spec, {f"t{k}": thruster for k in range(count)})
    if battery is not None:
        battery_feed.attach(spec, battery)
    return Plant(water.compile(spec), current=Current([0.1, 0.0, 0.0]))


def run(rov: Plant, command: list[float], steps: int) -> None:
    sent = Command(time=0.0, joint_torque=np.zeros(0), thrusters=np.array(command), scan=False)
    for _ in range(steps):
        rov.observe()
        rov.step(sent)


def test_a_constant_current_discharges_by_hand(within) -> None:
    battery = Battery(voltage=16.0, capacity_Ah=0.1, resistance_ohm=0.1, empty_voltage=12.0)
    rov = plant(battery, constant())
    run(rov, [1.0, 1.0], 2001)  # no current in the first step: the propellers stand
    seconds = 2000 * rov.timestep
    amperes = 2.0 * AMPERES
    share = amperes * seconds / 360.0
    force = 16.0 - 4.0 * share

    within("current", rov.supply.state[CURRENT] - amperes, 1e-11)
    within("charge", rov.supply.state[CHARGE] - amperes * seconds, 1e-9)
    within("voltage", rov.supply.state[VOLTAGE] - (force - 0.1 * amperes), 1e-3)
    energy = amperes * seconds * ((16.0 + force) / 2.0 - 0.1 * amperes)
    within("energy", rov.supply.state[ENERGY] / energy - 1.0, 1e-4)

    # 1 N/V, at the voltage of the last step.
    within("thrust", rov.truth.thrust - rov.supply.state[VOLTAGE], 1e-9)


def test_an_empty_battery_stops_the_thrusters() -> None:
    rov = plant(Battery(voltage=16.0, capacity_Ah=2.0 * AMPERES / 3600.0), constant())
    run(rov, [1.0, 1.0], round(0.9 / rov.timestep))
    assert np.all(rov.truth.thrust > 14.0)
    run(rov, [1.0, 1.0], round(0.3 / rov.timestep))
    assert rov.supply.state[[VOLTAGE, CURRENT]].tolist() == [0.0, 0.0]
    assert rov.truth.thrust.tolist() == [0.0, 0.0]


def test_the_sag_couples_the_thrusters() -> None:
    battery = Battery(voltage=16.0, resistance_ohm=0.05)
    alone = plant(battery, thrusters.t200(time_constant=0.0))
    run(alone, [0.8, 0.0], 500)
    both = plant(battery, thrusters.t200(time_constant=0.0))
    run(both, [0.8, 1.0], 500)

    t200 = thrusters.t200(time_constant=0.0)
    for rov, commands in ((alone, [0.8, 0.0]), (both, [0.8, 1.0])):
        volts = float(rov.supply.state[VOLTAGE])
        pulses = 1500.0 + 400.0 * np.array(commands)
        amperes = float(t200.current(pulses, volts).sum())
        assert volts == pytest.approx(16.0 - 0.05 * amperes, abs=1e-6)
    assert both.supply.state[VOLTAGE] < alone.supply.state[VOLTAGE] - 0.9
    assert both.truth.thrust[0] < 0.95 * alone.truth.thrust[0]


def test_without_a_battery_the_voltage_is_constant() -> None:
    rov = plant(None, thrusters.t200(time_constant=0.0))
    run(rov, [0.5, -0.5], 501)
    power = thrusters.t200().power([1700.0, 1300.0]).sum()
    assert np.isnan(rov.supply.state[VOLTAGE])
    assert rov.supply.state[ENERGY] == pytest.approx(500 * rov.timestep * power, rel=1e-9)


def test_nothing_is_known_without_tables() -> None:
    rov = plant(None, Thruster(forward=10.0, reverse=8.0))
    run(rov, [0.5, 0.5], 3)
    assert np.isnan(rov.supply.state).all()


def test_compiled_steps_and_a_resumed_run_have_the_same_bits() -> None:
    battery = Battery(voltage=15.0, capacity_Ah=0.02, resistance_ohm=0.06, empty_voltage=13.0)
    by_python = plant(battery, thrusters.t200())
    run(by_python, [0.7, -0.4], 400)

    compiled = plant(battery, thrusters.t200())
    record = compiled.record()

    def go_on(steps: int) -> None:
        for _ in range(steps):
            compiled.ready()
            observe(record)
            advance(record, np.zeros(0), np.array([0.7, -0.4]))

    go_on(150)
    saved = compiled.save()
    saved_arrays = [np.array(array) for array in saved.arrays]
    go_on(250)
    assert compiled.supply.state.tobytes() == by_python.supply.state.tobytes()
    assert compiled.data.qpos.tobytes() == by_python.data.qpos.tobytes()

    resumed = plant(battery, thrusters.t200())
    state = type(saved)(
        data=saved.data, arrays=tuple(saved_arrays), tick=saved.tick, current=saved.current
    )
    resumed.resume(state)
    run(resumed, [0.7, -0.4], 250)
    assert resumed.supply.state.tobytes() == by_python.supply.state.tobytes()
    assert resumed.data.qpos.tobytes() == by_python.data.qpos.tobytes()


def test_a_plant_begins_again_with_a_full_battery() -> None:
    rov = plant(Battery(voltage=15.0, resistance_ohm=0.06), thrusters.t200())
    rows = np.array(rov.model.actuator_user)
    run(rov, [0.7, -0.4], 200)
    assert not np.array_equal(rov.model.actuator_user, rows)
    rov.reset(current=Current([0.1, 0.0, 0.0]))
    assert rov.supply.state[[VOLTAGE, CHARGE]].tolist() == [15.0, 0.0]
    np.testing.assert_allclose(rov.model.actuator_user, rows, rtol=1e-12, atol=1e-12)


def test_a_second_plant_of_a_model_is_as_the_first() -> None:
    rov = plant(Battery(voltage=15.0, resistance_ohm=0.06), thrusters.t200())
    run(rov, [0.7, -0.4], 200)
    again = Plant(rov.model, current=Current([0.1, 0.0, 0.0]))
    assert np.array_equal(again.vehicle.thruster_table, rov.vehicle.thruster_table)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Battery(voltage=0.0), "vehicle.battery.voltage [V]: must be positive and finite"),
        (
            lambda: Battery(voltage=16.0, capacity_Ah=-1.0),
            "vehicle.battery.capacity_Ah: must be positive",
        ),
        (
            lambda: Battery(voltage=16.0, resistance_ohm=np.nan),
            "vehicle.battery.resistance_ohm: must be",
        ),
        (
            lambda: Battery(voltage=16.0, empty_voltage=17.0),
            "vehicle.battery.empty_voltage [V]: must be",
        ),
        (lambda: plant(Battery(voltage=22.0), thrusters.t200()), "must be 10 to 20"),
        (
            lambda: plant(Battery(voltage=16.0), Thruster(forward=1.0, reverse=1.0)),
            "has no table of its current over the voltage",
        ),
        (lambda: plant(Battery(voltage=16.0), thrusters.t200(), count=0), "has no thrusters"),
    ],
)
def test_a_battery_that_cannot_be_is_refused_in_one_line(make, message: str) -> None:
    with pytest.raises(ConfigurationError) as refusal:
        make()
    assert message in str(refusal.value)
    assert "\n" not in str(refusal.value)
