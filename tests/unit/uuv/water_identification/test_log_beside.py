"""A log beside its simulation: equal where the log is one, off by what another vehicle differs."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuv import models
from uuv.calib.water.logs import FORCE, Channel, write_log
from uuv.cli.past.past_runs import main
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.water_identification.log_beside import LogBeside
from uuv.water_identification.manoeuvres import Manoeuvre, simulated
from uuv.water_identification.options import log_at
from uuv.water_identification.replayed_parts import ranges_of
from uuv.water_identification.vehicle_replay import ReplayVehicle

ROV = "bluerov2_heavy_benzon2022"


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight seconds of a vehicle that is pushed and turned, as a CSV file."""
    own = ReplayVehicle(models.load(ROV))
    values = {parameter.name: parameter.nominal for parameter in own.water.parameters}
    time = np.arange(161) * 0.05
    wrench = np.zeros((161, 6))
    wrench[:, 0] = 20.0 * np.sin(2.0 * time)
    wrench[:, 2] = 15.0
    wrench[:, 5] = 2.0 * np.cos(1.5 * time)
    push = Manoeuvre(name="push", wrench=wrench, joints=np.zeros((161, 0)))
    file = tmp_path_factory.mktemp("logs") / "dive.csv"
    write_log(file, simulated(own, values, push, name="dive"))
    return file


def test_a_log_of_the_model_itself_lies_on_its_simulation(log: Path) -> None:
    """And that of a vehicle with other drag does not."""
    same = {q.name: q for q in LogBeside.of(log, models.load(ROV), window=4.0).quantities}
    other = {
        q.name: q
        for q in LogBeside.of(log, models.load("bluerov2_heavy_wu2018"), window=4.0).quantities
    }
    assert {"roll", "pitch", "yaw", "wz", "x", "z"} <= set(same)
    for name in ("yaw", "x", "z"):
        assert same[name].motion > 0.05
        # The velocity at the start of a window is that of the samples about it.
        assert same[name].rms < 0.1 * same[name].motion, name  # measured 0.044
        assert other[name].rms > 2.0 * same[name].rms, name
    assert same["yaw"].unit == "deg"
    off = np.abs(same["x"].simulated - same["x"].measured)
    assert np.sqrt(np.mean(off**2)) == pytest.approx(same["x"].rms)
    assert same["x"].largest == max(off)


def test_the_command_prints_a_table_and_draws(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture = tmp_path / "dive.png"
    args = ["--log", str(log), "--vehicle", ROV, "--picture", str(picture), "--window", "4"]
    assert main("replay", args) == 0
    assert "dive.csv against bluerov2_heavy_benzon2022, 2 windows" in capsys.readouterr().out
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert main("replay", [*args, "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["quantities"]["yaw"]["unit"] == "deg"


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["--log", "no.csv", "--vehicle", ROV], "--log no.csv: there is no such file"),
        (["run", "--log", "no.csv"], "RUN 'run' and --log: give only one"),
        ([], "RUN: missing"),
        (["--log", __file__], "--vehicle: missing; log test_log_beside.py states no motor frame"),
        (["--log", __file__, "--window", "0"], r"window \[s\]: must be finite, >= 1"),
    ],
)
def test_what_is_missing_is_said_in_one_line(args: list[str], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        main("replay", args)


def changed(log: Path, folder: Path, **changes: Any) -> Path:
    """The log with other channels or thrusts, as a file."""
    own = ReplayVehicle(models.load(ROV))
    read = log_at(log, own.vehicle, own.names, ranges_of(own.vehicle))
    write_log(folder / "changed.csv", replace(read, **changes))
    return folder / "changed.csv"


def test_a_window_that_runs_away_is_left_out_and_counted(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = ReplayVehicle(models.load(ROV))
    time = np.arange(161) * 0.05
    mad = 9e4  # [N], more than any thruster has
    off = dict.fromkeys(own.names, np.zeros(161))
    late = off | {own.names[0]: np.where(time > 4.5, mad, 0.0)}
    file = changed(log, tmp_path, commands={}, thrusts=late)
    assert main("replay", ["--log", str(file), "--vehicle", ROV, "--window", "4", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert (content["windows"], content["diverged"]) == (2, 1)
    assert all(np.isfinite(row["rms"]) for row in content["quantities"].values())

    always = changed(log, tmp_path, commands={}, thrusts=off | {own.names[0]: np.full(161, mad)})
    with pytest.raises(ConfigurationError, match="runs away in all 2 windows"):
        main("replay", ["--log", str(always), "--vehicle", ROV, "--window", "4"])


def test_accelerations_alone_leave_nothing_to_compare(log: Path, tmp_path: Path) -> None:
    force = Channel(time=np.linspace(0.0, 8.0, 161), values=np.tile([0.0, 0.0, 9.81], (161, 1)))
    file = changed(log, tmp_path, channels={FORCE: force})
    with pytest.raises(ConfigurationError, match="must have one of qx qy qz qw, depth, vx vy vz"):
        main("replay", ["--log", str(file), "--vehicle", ROV, "--window", "4"])
