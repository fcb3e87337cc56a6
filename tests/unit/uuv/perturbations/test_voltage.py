"""Battery of a scenario, and a voltage that the controller believes and the plant has not."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from uuv import models
from uuv.components.contact_parts import believed_and_built
from uuv.inputs import check_inputs
from uuv.jobs import clean_barrel
from uuv.models.water import battery_feed, thrusters
from uuv.models.water.battery import Battery
from uuv.perturbations.perturbation import perturb
from uuv.perturbations.vehicle import BelievedVoltage, ThrusterSpread
from uuv.scenario import Scenario
from uuv.scenario_file import read_scenario, write_scenario
from uuv.sim.interfaces.errors import ConfigurationError

ROV = "bluerov2_heavy_alpha5"


def scenario(battery: Battery | None = None) -> Scenario:
    job = clean_barrel(vehicle=ROV, tool="small_pad", forces=(8.0,))
    return replace(job, vehicle=replace(job.vehicle, battery=battery))


def full_thrusts(spec: mujoco.MjSpec) -> np.ndarray:
    """Full thrust [N] ahead of each thruster."""
    table = thrusters.read(spec.compile())[1]
    return np.array([thrusters.unpack(row).forward for row in table])


def test_a_battery_is_an_option_and_a_table_of_the_file(tmp_path: Path) -> None:
    assert clean_barrel(vehicle=ROV, battery=14.8).vehicle.battery == Battery(voltage=14.8)
    whole = scenario(Battery(voltage=14.8, capacity_Ah=10.0, resistance_ohm=0.1, empty_voltage=13))
    for setup in (whole, scenario()):
        write_scenario(setup, tmp_path / "job.toml")
        assert read_scenario(tmp_path / "job.toml") == setup


def test_believed_and_built_vehicle_have_the_battery() -> None:
    job = scenario(Battery(voltage=14.8))
    for spec in believed_and_built(job.vehicle, job.belief, job.task)[:2]:
        assert battery_feed.numbers_of(spec.compile()).tolist() == [14.8, 14.8, 64800.0, 0.04]
        assert full_thrusts(spec) == pytest.approx(thrusters.t200(voltage=14.8).forward)


def test_a_battery_needs_tables_of_the_current() -> None:
    job = clean_barrel(battery=14.8)
    with pytest.raises(ConfigurationError, match="has no table of its current"):
        check_inputs(job)
    with pytest.raises(
        ConfigurationError, match="must be 10 to 20, the range of the measurements, got 24"
    ):
        check_inputs(scenario(Battery(voltage=24.0)))


@pytest.mark.parametrize("battery", [None, Battery(voltage=16.0, empty_voltage=15.0)])
def test_the_true_voltage_is_less_than_the_believed_one(battery: Battery | None) -> None:
    spec = models.load("bluerov2_heavy")
    if battery is not None:
        battery_feed.attach(spec, battery)
    believed = full_thrusts(spec)
    assert perturb(spec, [BelievedVoltage(error=2.0)]) == {"voltage_error": 2.0}

    assert full_thrusts(spec) == pytest.approx(thrusters.t200(voltage=14.0).forward)
    assert np.all(full_thrusts(spec) < 0.9 * believed)
    numbers = battery_feed.numbers_of(spec.compile())
    assert numbers[:2].tolist() == ([0.0, 0.0] if battery is None else [14.0, 13.0])


def test_no_error_changes_nothing() -> None:
    spec = models.load("bluerov2_heavy")
    before = spec.compile().actuator_user
    assert perturb(spec, [BelievedVoltage()]) == {}
    assert np.array_equal(spec.compile().actuator_user, before)


def test_a_voltage_beyond_the_tables_is_refused() -> None:
    spec = models.load("bluerov2_heavy")
    with pytest.raises(ConfigurationError, match="BelievedVoltage error 8 V: voltage"):
        BelievedVoltage(error=8.0).check_inputs(spec)
    with pytest.raises(ConfigurationError, match="it has no sheets"):
        BelievedVoltage(error=1.0).check_inputs(models.load("uuv_puma"))


def test_a_spread_of_the_thrust_holds_at_every_voltage() -> None:
    spec = models.load("bluerov2_heavy")
    perturb(spec, [ThrusterSpread(gain=0.2), BelievedVoltage(error=2.0)], 5)
    ahead = thrusters.t200(voltage=14.0).forward
    ratios = full_thrusts(spec) / ahead
    assert np.all((ratios > 0.8) & (ratios < 1.2))
    assert np.ptp(ratios) > 0.05
