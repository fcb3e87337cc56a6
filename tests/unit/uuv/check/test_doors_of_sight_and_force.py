"""Force without sensors, and the range of a scan, refused before a job begins."""

import numpy as np
import pytest

from uuv.check.hidden_force import HiddenForce
from uuv.check.preflight import preflight
from uuv.check.range_error import RangeError
from uuv.jobs import clean_barrel
from uuv.models.objects import targets
from uuv.own_vehicle import OwnVehicle, vehicle_spec
from uuv.sim.evaluation.bounds import Bounds
from uuv.sim.interfaces.errors import ConfigurationError


def test_motors_that_friction_blinds_are_refused() -> None:
    """And run unchecked with the same line; an arm without dry friction hides nothing."""
    puma = OwnVehicle.of(vehicle_spec("uuv_puma", tool="pad"))
    job = clean_barrel(force_from="motors")
    said = (
        r"force_from motors: dry friction .* hides up to \d+ N .* mostly joint2 \(allowed 9.0 N\)"
    )
    with pytest.raises(ConfigurationError, match=said):
        preflight(job, puma)

    before = preflight(clean_barrel(force_from="motors", unchecked=True), puma)
    assert len(before.refused) == 1
    assert "dry friction" in before.refused[0]
    assert not preflight(clean_barrel(), puma).refused


def test_hidden_force_is_the_worst_of_all_frictions() -> None:
    """Of all corners of the friction's box one explains the largest force along the tool."""
    puma = OwnVehicle.of(vehicle_spec("uuv_puma", tool="pad"))
    vehicle = puma.vehicle
    X, J = puma.chain().kinematics(np.array(vehicle.q_ready))
    J_G = X[:3, :3].T @ J[:3]
    stiction = vehicle.dry_friction.stiction
    weights = np.hypot(0.4, 0.6 * stiction)

    corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * 6)).reshape(6, -1) * stiction[:, None]
    felt = np.linalg.lstsq((J_G / weights).T, corners / weights[:, None], rcond=None)[0][2]
    hidden = HiddenForce.of(puma)
    # measured 0.4 %: the prior of the estimate
    assert hidden.most == pytest.approx(np.abs(felt).max(), rel=0.02)
    assert 0.0 < hidden.rms < hidden.most


def test_a_scan_from_too_far_is_refused() -> None:
    puma = OwnVehicle.of(vehicle_spec("uuv_puma", tool="pad"))
    with pytest.raises(
        ConfigurationError,
        match=r"task.range: at 4 m .* \(allowed 5.0 mm\): scan it from at most 3",
    ):
        preflight(clean_barrel(range=4.0), puma)
    assert not preflight(clean_barrel(range=3.0), puma).refused
    assert preflight(clean_barrel(range=4.0, unchecked=True), puma).refused


def test_error_of_range_is_that_of_mean_readings() -> None:
    """Against drawn readings of a plate: correlated over blocks of a noise length's edge."""
    error = RangeError.of(targets.barrel())
    rng = np.random.default_rng(0)
    sensor = error.sensor
    blocks = int(error.area * (sensor.focal / 4.0) ** 2 / sensor.noise_length**2)
    means = rng.normal(0.0, float(sensor.sigma(4.0)), (2000, blocks)).mean(axis=1)
    turned = rng.normal(0.0, 3e-4 * 4.0, 2000)
    # measured 0.7 %: 2000 draws
    assert error.at(4.0) == pytest.approx(2.0 * np.std(means + turned), rel=0.06)
    assert error.at(2.0) < 0.3 * error.at(4.0)
    assert error.refusal(2.0, Bounds()) == ""
