"""Water identification: the replay against the plant, a fit of a simulated log, and the door of the
command.
"""

import hashlib
import json
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest
import yaml
from rich.console import Console

from uuv import models
from uuv.calib.water.logs import ATTITUDE, POSITION, RATE, Channel, WaterLog, write_log
from uuv.calib.water.named_fit import values_of
from uuv.calib.water.results import write_vehicle
from uuv.own_vehicle import vehicle_spec
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import Command
from uuv.sim.plant.plant import Plant
from uuv.sim.water.current import Current
from uuv.water_identification.command import run, sha256_of
from uuv.water_identification.log_residuals import LogReplay, identify
from uuv.water_identification.manoeuvres import Manoeuvre, menu, simulated, survey
from uuv.water_identification.options import WaterOptions
from uuv.water_identification.settings import FitSettings
from uuv.water_identification.vehicle_replay import ReplayVehicle


@pytest.fixture(scope="module")
def rov() -> ReplayVehicle:
    return ReplayVehicle(models.load("bluerov2_heavy"))


def nominal(own: ReplayVehicle) -> dict[str, float]:
    return values_of(own.water.parameters, np.zeros(len(own.water.parameters)))


def test_the_replay_moves_as_the_plant(rov):
    """Steps of 50 ms with mean thrusts against the plant's of 2 ms: 5 s under thrust, in a current,
    from rest.
    """
    model = hydrodynamics.compile(models.load("bluerov2_heavy"))
    rov.water.write(model, nominal(rov))
    hydrodynamics.set_constants(model)
    plant = Plant(model, current=Current((0.1, 0.05, 0.0)))
    pushed = np.array([0.4, 0.3, -0.4, -0.4, 0.15, 0.15, 0.12, 0.15])
    rows, commands = [], []
    for k in range(2501):
        truth = plant.observe()
        command = pushed if k >= 250 else np.zeros(8)
        if k % 25 == 0:
            rows.append(np.concatenate([truth.p_WB, truth.v_WB_W, truth.w_WB_B]))
            commands.append(command)
        plant.step(
            Command(time=truth.time, joint_torque=np.zeros(0), thrusters=command, scan=False)
        )
    exact, time = np.array(rows), np.arange(len(rows)) / 20.0
    log = WaterLog(
        name="log",
        time=time,
        channels={POSITION: Channel(time=time, values=exact[:, :3])},
        commands={name: np.array(commands)[:, i] for i, name in enumerate(rov.names)},
        thrusts={},
        joints={},
    )
    replay = LogReplay(rov, log, FitSettings(window=5.0))
    start = np.eye(13)[3:4]
    flow = np.tile([0.1, 0.05, 0.0], (replay.script.rows, 1))
    rows_of_replay = rov.run(nominal(rov), replay.script, start, flow)
    replayed = np.array(
        [np.interp(time[:-2], replay.time, column) for column in rows_of_replay.T]
    ).T
    exact = exact[:-2]
    assert np.abs(exact[-1, :3]).max() > 0.5
    # Steps of the replay are longer than the plant's; the rates differ most just after the
    # thrusters are switched on.
    assert np.abs(replayed[:, :3] - exact[:, :3]).max() < 5e-3  # measured 2.5e-3 m
    assert np.abs(replayed[:, 7:] - exact[:, 3:]).max() < 2e-2  # measured 1.1e-2 m/s, rad/s


def test_a_driven_arm_moves_the_hull_as_momentum_has_it():
    """The arm swings from rest without drag: linear momentum of vehicle and water stays zero in
    still water.
    """
    vehicle = ReplayVehicle(models.load("bluerov2_heavy_alpha5"))
    values = {
        name: 1e-12 if "damping" in name else value for name, value in nominal(vehicle).items()
    } | {"arm drag": 1e-9}
    values |= {"net buoyancy": 0.0}
    swung = Manoeuvre(name="swing", wrench=np.zeros((81, 6)), joints=_quarter_turn(vehicle, 81))
    log = simulated(vehicle, values, swung, name="swing")
    here = mujoco.MjData(vehicle.model)
    vehicle.write(values)
    momentum = []
    for k in (20, 40, 60):
        here.qpos[:3], here.qpos[3:7] = (
            log.channels[POSITION].values[k],
            log.channels[ATTITUDE].values[k][[3, 0, 1, 2]],
        )
        here.qpos[7:] = [log.joints[name][k] for name in vehicle.joints]
        speeds = [
            (log.joints[name][k + 1] - log.joints[name][k - 1]) / 0.1 for name in vehicle.joints
        ]
        around = log.channels[POSITION].values
        here.qvel[:3] = (around[k + 1] - around[k - 1]) / 0.1
        here.qvel[3:6], here.qvel[6:] = log.channels[RATE].values[k], speeds
        mujoco.mj_forward(vehicle.model, here)
        product = np.zeros(vehicle.model.nv)
        mujoco.mj_mulM(vehicle.model, here, product, here.qvel)
        still = np.zeros(vehicle.model.nv)
        mujoco.mj_mulM(vehicle.model, here, still, np.concatenate([np.zeros(6), here.qvel[6:]]))
        momentum.append((np.linalg.norm(product[:3]), np.linalg.norm(still[:3])))
    for left, of_arm in momentum:
        assert left < 0.05 * max(of_arm, 0.02)


def test_a_simulated_log_tells_the_vehicle(rov):
    """Ten seconds of a vehicle drawn from the prior: errors as the intervals say, and most is
    told.
    """
    rng = np.random.default_rng(5)
    n = len(rov.water.parameters)
    truth = 0.7 * rng.standard_normal(n)
    flown = survey(rov, nominal(rov), 10.0, rng)
    log = simulated(rov, values_of(rov.water.parameters, truth), flown, rng=rng)
    fit, residuals = identify(rov, [log], FitSettings(gust=1e-3, window=5.0))
    errors = (fit.named.deviations[:n] - truth) / fit.sigmas[:n]
    assert np.sqrt(np.mean(errors**2)) < 2.0
    assert np.abs(errors).max() < 4.5
    assert np.mean(fit.named.told[:n]) > 0.7
    assert all(0.8 < factor < 1.6 for factor in fit.widened.values())
    assert residuals.local == [21] * 2


def test_windows_keep_out_of_gaps(rov):
    rng = np.random.default_rng(1)
    log = simulated(rov, nominal(rov), survey(rov, nominal(rov), 16.0, rng), rng=rng)
    keep = (log.time < 6.0) | (log.time > 8.0)
    holed = WaterLog(
        name="log",
        time=log.time[keep],
        channels={
            kind: Channel(time=c.time[keep], values=c.values[keep])
            for kind, c in log.channels.items()
        },
        commands={name: values[keep] for name, values in log.commands.items()},
        thrusts={},
        joints={},
    )
    windows = LogReplay(rov, holed, FitSettings(window=4.0)).windows
    assert all(b <= 6.0 or a > 7.9 for a, b in windows)
    assert len(windows) == 3


def test_thrusterless_vehicles_push_by_wrench():
    vehicle = ReplayVehicle(models.load("phoenix_smart3s"))
    assert vehicle.names[0] == "wrench_surge"
    assert {"surge steps", "roll release", "arm swing", "hover in a current"} <= {
        m.name for m in menu(vehicle, nominal(vehicle))
    }


@pytest.fixture
def dive(rov, tmp_path):
    """A log at rest, thrusters off."""
    still = Manoeuvre(name="still", wrench=np.zeros((121, 6)), joints=np.zeros((121, 0)))
    log = simulated(rov, nominal(rov), still, rng=np.random.default_rng(0))
    write_log(tmp_path / "dive.csv", log)
    return tmp_path / "dive.csv"


def refused(tmp_path, said: str, **given: Any) -> None:
    with pytest.raises(ConfigurationError, match=said):
        run(WaterOptions(out=tmp_path / "out", **given), Console(quiet=True))
    assert not (tmp_path / "out").exists()


def test_the_door_of_the_command(dive, tmp_path):
    refused(tmp_path, "no thruster is commanded", log=(dive,))
    refused(tmp_path, "there is no such file", log=(tmp_path / "none.csv",))
    refused(tmp_path, "unknown vehicle", vehicle="bluerov9")
    refused(tmp_path, "--window", log=(dive,), window=0.1)
    refused(tmp_path, "--noise", log=(dive,), noise=(("speed", 1.0),))
    refused(tmp_path, "--prior", log=(dive,), prior=(("mass", 1.0),))
    refused(tmp_path, "--water-density", log=(dive,), water_density=-1.0)
    refused(tmp_path, "--aim trim: needs --plan", log=(dive,), aim=("trim",))
    refused(tmp_path, "--aim: allowed added mass", log=(dive,), plan=True, aim=("speed",))
    text = dive.read_text().splitlines()
    (tmp_path / "short.csv").write_text("\n".join(text[:20]))
    refused(tmp_path, "must last at least 4 s", log=(tmp_path / "short.csv",))


def test_two_logs_of_one_name_are_two(rov, tmp_path):
    """From the files to the page: both logs keep their current, sensors that begin late count from
    there.
    """
    rng, flown = np.random.default_rng(2), survey(rov, nominal(rov), 4.5, np.random.default_rng(2))
    for day, late in (("day1", 0.0), ("day2", 0.4)):
        log = simulated(rov, nominal(rov), flown, rng=rng)
        rows = {
            kind: Channel(time=c.time[c.time >= late], values=c.values[c.time >= late])
            for kind, c in log.channels.items()
        }
        (tmp_path / day).mkdir()
        write_log(tmp_path / day / "dive.csv", replace(log, channels=rows))
    logs = (tmp_path / "day1" / "dive.csv", tmp_path / "day2" / "dive.csv")
    options = WaterOptions(log=logs, window=2.0, out=tmp_path / "out")
    assert run(options, Console(quiet=True)) == 0
    written = yaml.safe_load((tmp_path / "out" / "fit.yaml").read_text())
    assert set(written["logs"]) == {str(log) for log in logs}
    widened = json.loads((tmp_path / "out" / "metrics.json").read_text())["noise_over_stated"]
    assert {name.rpartition(":")[0] for name in widened} == {"log dive.csv (1)", "log dive.csv (2)"}
    assert (tmp_path / "out" / "report.html").is_file()


def test_columns_that_stand_alone_are_refused(rov, tmp_path):
    log = simulated(rov, nominal(rov), survey(rov, nominal(rov), 10.0, np.random.default_rng(3)))
    first = rov.names[0]
    half = replace(
        log, commands={name: command for name, command in log.commands.items() if name != first}
    )
    write_log(tmp_path / "half.csv", half)
    refused(
        tmp_path,
        f"thruster {first} has no column, although others have one",
        log=(tmp_path / "half.csv",),
    )
    write_log(tmp_path / "place.csv", replace(log, channels={POSITION: log.channels[POSITION]}))
    refused(tmp_path, "x y z must be accompanied by qx qy qz qw", log=(tmp_path / "place.csv",))
    pushed = ReplayVehicle(models.load("phoenix_smart3s"))
    fraction = replace(log, commands={pushed.names[0]: np.ones(len(log.time))}, joints={})
    with pytest.raises(
        ConfigurationError,
        match=r"wrench_surge has no thrust curve .* give "
        r"thrust\.wrench_surge",
    ):
        LogReplay(pushed, fraction, FitSettings())


def test_a_fitted_vehicle_is_a_vehicle(rov, tmp_path):
    """Coefficients and gains that were written beside the MJCF are read again, to the last
    digit.
    """
    values = nominal(rov) | {"added mass sway": 9.0, "gain of 3": 1.2, "net buoyancy": 2.0}
    spec = models.load("bluerov2_heavy")
    mjcf, _ = write_vehicle(tmp_path, "fitted", spec, spec.copy().compile(), rov.water, values)
    again = ReplayVehicle(vehicle_spec(mjcf))
    identified = nominal(again)
    assert identified["added mass sway"] == 9.0
    assert identified["net buoyancy"] == pytest.approx(2.0, abs=1e-9)
    assert again.vehicle.thruster_table[2, 0] == pytest.approx(
        1.2 * rov.vehicle.thruster_table[2, 0], rel=1e-12
    )


def _quarter_turn(own: ReplayVehicle, count: int) -> np.ndarray:
    s = np.linspace(0.0, 1.0, count)[:, None]
    return own.vehicle.q_home + 0.6 * (own.vehicle.q_ready - own.vehicle.q_home) * (
        s * s * (3.0 - 2.0 * s)
    )


def test_a_hull_that_is_drawn_turned_is_pushed_along_its_own_axes(within):
    spec = models.load("bluerov2_heavy")
    spec.body("hull").quat = [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]
    turned = ReplayVehicle(spec)
    within("wrenches", turned.wrench - turned.vehicle.thruster_wrench, 1e-9)


def test_the_hash_of_a_bag_is_that_of_its_files(tmp_path):
    for name, content in (("one", b"1"), ("other", b"2")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "metadata.yaml").write_bytes(b"same")
        (tmp_path / name / "dive.mcap").write_bytes(content)
    assert sha256_of(tmp_path / "one") != sha256_of(tmp_path / "other")
    expected = hashlib.sha256(b"1same").hexdigest()
    assert sha256_of(tmp_path / "one") == expected

    # Of a run only the tables count.
    (tmp_path / "one" / "series_loop.parquet").write_bytes(b"table")
    assert sha256_of(tmp_path / "one") == hashlib.sha256(b"table").hexdigest()
