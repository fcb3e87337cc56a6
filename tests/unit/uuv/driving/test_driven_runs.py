"""Driven runs in the water: the doors, and an operator who presses and wipes with a delay."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from delayed_operator import operated
from driving_rows import rows_of, text_of
from uuv import jobs
from uuv.assembly import assemble
from uuv.controllers.driving.operator_inputs import OperatorInputs
from uuv.driving.driven_work import DrivenWork, drive_figures, way_across
from uuv.inputs import check_inputs
from uuv.runner import run
from uuv.scenario import INPUTS_FILE, KEYBOARD, Operator, Scenario
from uuv.scenario_file import read_scenario, write_scenario
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import WorkState
from uuv.tasks.surface_work import PlacedSurfaceWork


def driven(job: str, inputs: Path | str, delay: float = 0.0, **words: str) -> Scenario:
    operator = Operator(inputs=str(inputs), delay=delay)
    scenario = jobs.named(job)(**words)
    return replace(scenario, control=replace(scenario.control, operator=operator))


def test_an_operator_is_part_of_a_scenario_file(tmp_path: Path):
    scenario = driven("open-water", tmp_path / "in.csv", 0.3)
    write_scenario(scenario, tmp_path / "my.toml")
    assert read_scenario(tmp_path / "my.toml") == scenario


def test_bad_inputs_are_refused_at_the_door(tmp_path: Path):
    with pytest.raises(ConfigurationError, match=r"operator.delay \[s\].*got 2"):
        driven("open-water", "in.csv", 2.0)
    with pytest.raises(ConfigurationError, match=r"inputs .*none.csv"):
        check_inputs(driven("open-water", tmp_path / "none.csv"))
    with pytest.raises(ConfigurationError, match=r"keyboard is only allowed in .uuv drive."):
        check_inputs(driven("open-water", KEYBOARD))
    check_inputs(driven("open-water", KEYBOARD), live=True)


def test_a_hull_is_driven_in_open_water_and_its_inputs_are_kept(tmp_path: Path):
    ahead = {"surge": 0.1, "tool_z": 0.02}
    file = tmp_path / "in.csv"
    file.write_text(text_of(rows_of([(3.0, ahead), (2.0, {})])))
    result = run(driven("open-water", file, 0.3))
    assert result.assessment.accepted, result.assessment.failed

    # So far as was asked for, from where it started
    p_WB = result.recording["p_WB"].value
    assert p_WB[-1, 0] - p_WB[0, 0] == pytest.approx(0.3, abs=0.08)
    assert result.recording.final.note == "the inputs ended"
    assert result.assessment.metrics["drive"]["pressed_s"] is None

    result.assembly.placed.write_files(tmp_path)
    assert OperatorInputs.read(tmp_path / INPUTS_FILE).rows == OperatorInputs.read(file).rows


@pytest.mark.long(
    guarded_by="tests/unit/controllers/driving/test_driven_task.py::"
    "test_with_a_set_force_the_tool_comes_slowly_and_the_force_loop_takes_over"
)
@pytest.mark.parametrize("delay", [0.0, 0.3, 1.0])
def test_an_operator_presses_and_wipes_with_a_delay(delay: float):
    scenario = driven("clean-barrel", KEYBOARD, delay, sensor="survey")
    assembly = assemble(scenario)
    placed = assembly.placed
    assert isinstance(placed, DrivenWork)
    work = placed.work
    assert isinstance(work, PlacedSurfaceWork)

    # The middle of the path, as surveyed
    truth = work.truth
    p_T = np.asarray(truth.model.path(truth.path).p)
    p_W = (truth.X_WT[:3, :3] @ p_T[len(p_T) // 2]) + truth.X_WT[:3, 3]
    changed, operator = operated(assembly, p_W, delay)
    result = run(changed, observers=(operator,))

    figures = drive_figures(result.recording)
    assert result.recording.final.state is WorkState.DONE, result.recording.final.note
    assert not result.assessment.failed  # force error and peak within their bounds
    assert figures.force_error_rms_n is not None
    assert figures.force_peak_share is not None
    assert figures.wiped_m is not None
    assert figures.wiped_m > 0.2


def test_the_way_along_a_surface_is_that_across_the_tool_axis(within):
    """Neither the spring's way along it nor the steps where contact is lost."""
    axis = np.array([0.6, 0.0, -0.8])
    along = np.array([0.8, 0.0, 0.6])
    s = np.linspace(0.0, 0.3, 31)
    spring = 2e-3 * np.random.default_rng(2).normal(size=len(s))
    tip = s[:, None] * along + spring[:, None] * axis + [1.0, 2.0, 3.0]
    axes = np.tile(axis, (len(s), 1))
    touches = np.ones(len(s), dtype=bool)
    within("all of it [m]", way_across(tip, axes, touches) - 0.3, 1e-12)
    touches[10] = False
    within("less two steps [m]", way_across(tip, axes, touches) - 0.28, 1e-12)
