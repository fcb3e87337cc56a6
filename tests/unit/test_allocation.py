"""Allocation against the thrusters of the plant, and against the optimality conditions of bounded least squares."""

from dataclasses import replace

import numpy as np
import pytest

import models
from controllers.allocation import Allocation
from models.vehicle import Vehicle
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array
from sim.thrusters import Thrusters

WEIGHTS = np.array([1.0, 1.0, 1.0, 4.0, 4.0, 0.5])  # as stated: attitude first, yaw last


@pytest.fixture(scope="module")
def vehicle() -> Vehicle:
    return Vehicle.of(models.load("uuv_puma").compile())


def given(vehicle: Vehicle, command: Array) -> Array:
    """Steady thrust (m,) of the plant's own thrusters in still water."""
    table = vehicle.thruster_table.copy()
    table[:, 3] = 0.0  # no lag
    plant = Thrusters(table, vehicle.thruster_wrench, 0.002)
    plant.step(command, np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3))
    return plant.thrust


def test_exact_while_no_bound_is_met(vehicle, within):
    allocation, rng = Allocation(vehicle), np.random.default_rng(1)
    for _ in range(200):
        wrench_B = rng.normal(size=6) * [60.0, 60.0, 60.0, 10.0, 10.0, 10.0]
        command = allocation.command(allocation.thrust(wrench_B))
        assert np.abs(command).max() < 1.0
        within("wrench [N, N m]", vehicle.thruster_wrench @ given(vehicle, command) - wrench_B, 3e-12)  # measured 3e-13


def test_command_inverts_the_static_curve_for_both_signs(vehicle, within):
    allocation = Allocation(vehicle)
    for thrust in (-215.0, -40.0, -0.5, -1e-9, 0.0, 1e-9, 0.5, 40.0, 295.0):
        wanted = np.full(6, thrust)
        within("thrust [N]", given(vehicle, allocation.command(wanted)) - wanted, 6e-13)  # measured 6e-14
    assert not allocation.command(np.zeros(6)).any()
    assert np.abs(allocation.command(np.full(6, 1e4))).max() == 1.0


def test_saturated_thrusts_are_the_best_within_bounds(vehicle):
    """Kuhn and Tucker: the gradient vanishes for a free thruster and points out of the box for one at its bound."""
    allocation, rng = Allocation(vehicle), np.random.default_rng(2)
    high, low = 0.98 * vehicle.thruster_table[:, 0], -0.98 * vehicle.thruster_table[:, 1]
    A = WEIGHTS[:, None] * vehicle.thruster_wrench
    saturated = 0
    for _ in range(100):
        wrench_B = rng.normal(size=6) * [600.0, 600.0, 900.0, 200.0, 300.0, 200.0]
        thrust = allocation.thrust(wrench_B)
        assert np.all(thrust <= high + 1e-9)
        assert np.all(thrust >= low - 1e-9)
        at_high, at_low = thrust > high - 1e-6, thrust < low + 1e-6
        saturated += bool(at_high.any() or at_low.any())
        slope = A.T @ (A @ thrust - WEIGHTS * wrench_B) / np.linalg.norm(A.T @ (WEIGHTS * wrench_B))
        assert np.all(np.abs(slope[~at_high & ~at_low]) < 1e-7)
        assert np.all(slope[at_high] <= 1e-7)
        assert np.all(slope[at_low] >= -1e-7)
    assert saturated > 50


def test_a_lost_thruster_is_refused(vehicle):
    with pytest.raises(ConfigurationError, match="5 thrusters do not span"):
        Allocation(replace(vehicle, thruster_wrench=vehicle.thruster_wrench[:, :5]))
