"""Parts of the studies of contact: substeps of a stiff surface, signals, and answers to steps."""

import signal
from dataclasses import replace
from importlib import import_module
from io import StringIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

from short_recording import DT, recording
from uuv import assemble, jobs
from uuv import run as run_of
from uuv.perturbations.pad import Pad
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.runs.command_line import Interrupted, RunOptions
from uuv.sim.runs.terminal import PlainConsole


def test_a_stiff_surface_costs_substeps_of_the_plant_and_no_steps_of_the_loop():
    scenario = replace(jobs.clean_barrel(quick=True), perturbations=(Pad(stiffness=3e5),))
    built = assemble(scenario)
    assert built.plant.timestep == pytest.approx(DT, rel=1e-12)
    assert built.plant.substeps > 4
    recording = run_of(built, longest=0.01).recording
    assert len(recording["contact_most"].time) == 5
    assert recording.timestep == built.plant.timestep
    assert recording.substeps == built.plant.substeps


# -- signals ---------------------------------------------------------------------------------------


def test_a_signal_ends_a_run_after_a_whole_step_and_a_second_one_at_once():
    stop = import_module("uuv.runner").SignalStop()
    stop.observe("first")
    assert stop.last is None
    stop.ask(signal.SIGTERM)
    with pytest.raises(Interrupted) as ended:
        stop.observe("second")
    assert (stop.last, ended.value.code) == ("second", 143)
    with pytest.raises(Interrupted) as at_once:
        stop.ask(signal.SIGINT)
    assert at_once.value.code == 130


def test_a_signal_after_the_run_costs_nothing_of_it(tmp_path, monkeypatch):
    """It comes while the run is judged: the figures are written all the same, and the exit code
    says so.
    """
    whole_run = import_module("uuv.command")

    class Judged:
        accepted = True
        failed = ()
        metrics: ClassVar = {
            "run": {"simulated_s": 1.0},
            "timings": {"wall_s": 1.0, "real_time_factor": 1.0},
        }

        def made_by(self, _made_by: Any) -> Any:
            return self

        def extended(self, **_entries: Any) -> Any:
            return self

        def write(self, file: Path) -> None:
            file.write_text("{}")

    def assessed(*_: Any) -> Judged:
        signal.raise_signal(signal.SIGTERM)
        return Judged()

    for name in ("rehearse", "run_through"):  # the run itself is not what this is about
        monkeypatch.setattr(
            whole_run, name, lambda *_, **__: SimpleNamespace(part_by_part="", slow_parts=())
        )
    monkeypatch.setattr(whole_run, "assessed", assessed)
    monkeypatch.setattr(whole_run, "results_table", lambda _: "")
    output = StringIO()
    monkeypatch.setattr(whole_run, "PlainConsole", lambda: PlainConsole(file=output))
    with pytest.raises(Interrupted) as ended:
        whole_run.command(
            jobs.clean_barrel(quick=True), RunOptions(record=False, out=tmp_path / "out"), 0.0
        )
    assert ended.value.code == 143
    assert {"metrics.json", "scenario.toml"} <= {file.name for file in (tmp_path / "out").iterdir()}
    assert "written to" in output.getvalue()


# -- step response ---------------------------------------------------------------------------------


def test_step_figures_of_a_second_order_answer(within):
    """Overshoot exp(-pi z / sqrt(1 - z^2)); a first-order answer rises in T ln 9 and settles in T
    ln 20.
    """
    steps = import_module("experiments.contact.force_steps")
    t = np.maximum(steps.times(), 0.0)
    z, w = 0.5, 12.0
    damped = w * np.sqrt(1.0 - z * z)
    second = 1.0 - np.exp(-z * w * t) * (np.cos(damped * t) + z * w / damped * np.sin(damped * t))
    figures = steps.figures(60.0 + 30.0 * second, 60.0, 90.0)
    within("overshoot", figures["overshoot"] - np.exp(-np.pi * z / np.sqrt(1.0 - z * z)), 1e-3)
    first = steps.figures(60.0 + 30.0 * (1.0 - np.exp(-t / 0.1)), 60.0, 90.0)
    within("rise [s]", first["rise_s"] - 0.1 * np.log(9.0), 2.0 * steps.SAMPLE)
    within("settling [s]", first["settling_s"] - 0.1 * np.log(20.0), 2.0 * steps.SAMPLE)
    assert first["overshoot"] == 0.0


def test_steps_up_are_cut_out_of_a_run():
    steps = import_module("experiments.contact.force_steps")
    ticks = round(1.0 / DT)
    level = np.repeat([60.0, 60.0, 90.0, 90.0, 90.0, 60.0, 60.0, 60.0, 90.0, 90.0], ticks)
    ramp = np.clip(np.interp(np.arange(len(level)), np.arange(len(level)), level), 60.0, 90.0)
    run = recording([WorkState.WORK] * 10, ramp, ramp + 1.0)
    cut = steps.steps_up(run, 60.0, 90.0)
    assert cut["set"].shape == (1, len(steps.times()))  # the last is not seen to its end
    assert cut["true"][0, 0] == 61.0
    assert cut["true"][0, -1] == 91.0
