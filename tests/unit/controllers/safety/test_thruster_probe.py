"""The probe of a thruster: a wave along it is told from its loss, and from a part of it, also where
it is saturated.
"""

import numpy as np
import pytest

from uuv import models
from uuv.controllers.safety.thruster_probe import ThrusterProbe, is_lost
from uuv.controllers.tuning import FaultLimits
from uuv.models.vehicle import Vehicle
from uuv.models.water.thruster_curves import thrust_in_flow
from uuv.models.water.thrusters import INFLOW_LOSS, SLEW_RATE, TIME_CONSTANT, curves

LIMITS = FaultLimits()
TABLE = Vehicle.of(models.load("uuv_puma").compile()).thruster_table
SWAY, DT = 2, 0.02  # index, [s]


def probed(
    lost: float, wave: float, frequency: float, wanted: float, inflow: float = 0.0
) -> tuple[float, float]:
    """Share that a probe states, and how long it took [s].

    Args:
        lost: share of the thrust that is missing.
        wave: [N] amplitude of a disturbance along the thruster.
        frequency: [Hz] of it.
        wanted: [-] command of the controller.
        inflow: [m/s] along the thrust.
    """
    curve = curves(TABLE)
    lag = TABLE[:, [TIME_CONSTANT, SLEW_RATE]]
    loss = TABLE[:, INFLOW_LOSS]
    probe = ThrusterProbe(curve, lag, loss, LIMITS)
    still = np.full(len(TABLE), wanted)
    state = probe.begin(SWAY, 0.0, still, still)
    speed = wanted
    sent = wanted
    filtered = 0.0
    rng = np.random.default_rng(4)
    filtered = -lost * thrust_in_flow(curve[SWAY], loss[SWAY], inflow, wanted)
    for step in range(1, 1000):
        time = DT * step
        speed = sent + (speed - sent) * np.exp(-DT / lag[SWAY, 0])
        thrust = thrust_in_flow(curve[SWAY], loss[SWAY], inflow, speed)
        filtered += DT / LIMITS.hull_time * (-lost * thrust - filtered)
        missing = filtered + wave * np.sin(2.0 * np.pi * frequency * time) + rng.normal(0.0, 1.0)
        share = probe.step(state, time, DT, wanted, inflow, thrust, missing)
        if share is not None:
            return share, time
        sent = float(probe.sent(state, still)[SWAY])
    raise AssertionError("the probe never ends")


@pytest.mark.parametrize("wanted", [0.0, 0.3, 1.0, -1.0])
@pytest.mark.parametrize(("wave", "frequency"), [(0.0, 0.1), (60.0, 0.15), (200.0, 0.3)])
def test_a_loss_is_told_from_a_wave(wave: float, frequency: float, wanted: float, within):
    for lost in (0.0, 1.0):
        share, time = probed(lost, wave, frequency, wanted)
        within("share", share - lost, 0.25)  # measured 0.21 in the largest wave
        assert is_lost(share) == bool(lost)
        assert time < 4.0


@pytest.mark.parametrize("inflow", [-0.5, 0.5])
@pytest.mark.parametrize("wanted", [0.1, 0.4, -0.4])
def test_it_tells_the_whole_loss_in_a_current(wanted: float, inflow: float, within):
    """With the doublet as it would be in still water the share is 0.8 to 1.5, or not to be
    known.
    """
    for lost in (0.0, 1.0):
        share, _ = probed(lost, 0.0, 0.1, wanted, inflow)
        within("share", share - lost, 0.03)  # measured 0.013


def test_what_cannot_be_known_is_not_said():
    """A disturbance at the doublet's own frequency, far larger than it."""
    share, _ = probed(0.0, 2000.0, 1.0 / LIMITS.probe_time, 0.2)
    assert np.isnan(share)
