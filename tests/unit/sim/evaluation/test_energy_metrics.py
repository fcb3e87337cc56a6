"""Energy of a run in its metrics: where the current is known, and only there."""

from dataclasses import replace

import jsonschema
import numpy as np
import pytest

import short_recording
from uuv.outcome import NoFigures
from uuv.sim.evaluation.assessment import Assessment
from uuv.sim.evaluation.energy_metrics import energy_figures
from uuv.sim.evaluation.run_metrics import run_schema
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.loop.recording import Recording


def recording(*supply: float) -> Recording:
    """A run of one second whose supply ended so: V, A, C, J, V, s."""
    ticks = round(1.0 / short_recording.DT)
    ended = short_recording.recording([WorkState.DONE], collision=np.zeros(ticks))
    return replace(ended, supply=np.array(supply))


def written(of: Recording) -> dict:
    assessment = Assessment.of(of, NoFigures(), [], seed=3, wall_s=1.0)
    jsonschema.validate(assessment.metrics, run_schema(NoFigures, "run", "A run"))
    return dict(assessment.metrics)


def test_energy_with_a_battery() -> None:
    run = recording(14.1, 5.0, 7200.0, 36000.0, 12.5, 0.25)
    energy = written(run)["energy"]
    assert energy == {
        "thrusters_j": 36000.0,
        "thrusters_wh": 10.0,
        "charge_ah": 2.0,
        "mean_power_w": 36000.0 / run.duration,
        "battery": {"voltage_v": 14.1, "voltage_least_v": 12.5, "below_tables_s": 0.25},
    }

    # Listed in terminal and report, without a bound.
    checks = Assessment.of(run, NoFigures(), [], seed=3, wall_s=1.0).checks
    listed = {check.name: (check.value, check.bound) for check in checks if check.bound is None}
    assert listed == {
        "energy of the thrusters": (10.0, None),
        "least voltage": (12.5, None),
        "voltage below the thrusters' tables": (0.25, None),
    }


def test_energy_at_constant_voltage_has_no_battery() -> None:
    energy = written(recording(np.nan, 5.0, 7200.0, 36000.0, np.nan, 0.0))["energy"]
    assert energy["thrusters_wh"] == 10.0
    assert energy["battery"] is None


@pytest.mark.parametrize("supply", [(), (np.nan,) * 6])
def test_nothing_is_said_where_no_current_was_measured(supply: tuple[float, ...]) -> None:
    run = recording(*supply)
    assert energy_figures(run) is None
    assert "energy" not in written(run)
