"""Pool trials: read with one clear error where they are wrong; the fit finds again what a replay
was made of.
"""

import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from experiments.water.pool import validation
from experiments.water.pool.pool_vehicle import HULLS, NOMINAL, PARAMETERS, pool_model
from experiments.water.pool.replay import Residuals, replay, score_of
from experiments.water.pool.trials import PoolTrial, names_in, read_trial, read_trials
from experiments.water.pool.validation import FITTED, medians, read_fitted, scores
from untyped import untyped
from uuv.calib.water.named_fit import NamedParameter, fit_named, values_of
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array

REAL = Path(os.environ.get("UUV_POOL_TRIALS", "../shared/data/pool"))


def made(name: str, seed: int, deviations: Array) -> PoolTrial:
    """A trial of the simulated vehicle with other parameters than the nominal ones."""
    rng = np.random.default_rng(seed)
    times = np.arange(0.0, 6.0, 0.1)
    fine = np.arange(0.0, 6.0, 0.01)
    swing = np.sin(np.outer(fine, rng.uniform(0.3, 0.9, 4)) + rng.uniform(0.0, 6.0, 4))
    joints = np.array([0.0, 1.6, 1.8, 0.0]) + [0.9, 0.5, 0.5, 0.8] * swing
    values = values_of(PARAMETERS, deviations)
    still = PoolTrial(
        name=name,
        group=name.partition("-")[0],
        times=times,
        joint_times=fine,
        joints=joints,
        R_start=np.eye(3),
        w_start=np.zeros(3),
        v_start=np.zeros(3),
        attitude=np.zeros((len(times), 3)),
        position=np.zeros((len(times), 3)),
    )
    motion = replay(pool_model("benzon2022", values), still, values)
    noise = rng.normal(0.0, np.radians(0.1), motion.attitude.shape)
    return PoolTrial(
        **{
            **{
                field: getattr(still, field)
                for field in ("name", "group", "times", "joint_times", "joints")
            },
            **{field: getattr(still, field) for field in ("R_start", "w_start", "v_start")},
            "attitude": motion.attitude + noise,
            "position": motion.position,
        }
    )


@pytest.mark.long
def test_the_fit_finds_the_vehicle_that_made_the_trials():
    index = {parameter.name: i for i, parameter in enumerate(PARAMETERS)}
    true = np.zeros(len(PARAMETERS))
    (
        true[index["center of mass z"]],
        true[index["net buoyancy"]],
        true[index["center of mass y"]],
    ) = -0.4, 0.6, 0.2
    trials = [made(f"traj{group}-0", group, true) for group in (1, 2)]
    fit = fit_named(Residuals("benzon2022", trials), PARAMETERS, rounds=5)
    fitted = fit.values
    assert fitted["center of mass z"] == pytest.approx(-0.008, abs=0.002)
    assert fitted["net buoyancy"] == pytest.approx(0.9, abs=0.15)
    assert fitted["center of mass y"] - fitted["center of buoyancy y"] == pytest.approx(
        0.004, abs=0.001
    )
    before, after = (medians(scores("benzon2022", trials, values)) for values in (NOMINAL, fitted))
    assert after["roll_rms_deg"] < 0.2 < before["roll_rms_deg"]
    assert fit.told[index["center of mass z"]] > 0.9


def test_a_fit_by_names():
    """A straight line with noise: the posterior of conjugate normals."""
    slope = NamedParameter(name="slope", unit="1", nominal=1.0, sigma=2.0)
    gain = NamedParameter(name="gain", unit="1", nominal=2.0, sigma=0.5, factor=True)
    x = np.linspace(0.0, 1.0, 50)
    y = 3.0 * x + np.log(2.5)

    def residuals(deviations: Array) -> Array:
        values = values_of((slope, gain), deviations)
        return (values["slope"] * x + np.log(values["gain"]) - y) / 1e-3

    fit = fit_named(residuals, (slope, gain))
    assert fit.values["slope"] == pytest.approx(3.0, abs=1e-5)
    assert fit.values["gain"] == pytest.approx(2.5, abs=1e-5)
    design = np.column_stack([2.0 * x, np.full(50, 0.5)]) / 1e-3
    np.testing.assert_allclose(
        fit.covariance, np.linalg.inv(design.T @ design + np.eye(2)), rtol=1e-3
    )
    with pytest.raises(ConfigurationError, match="not finite at the start"):
        fit_named(lambda _: np.array([np.nan]), (slope,))
    with pytest.raises(ConfigurationError, match="a factor must be > 0"):
        NamedParameter(name="gain", unit="1", nominal=0.0, sigma=0.5, factor=True)


def write(folder: Path, **changes: str) -> None:
    """A trial of 8 s in files, with single lines replaced."""
    t = np.arange(0.0, 8.0, 0.05)
    files = {
        "joint_states": (
            "time_secs,axis_a_pos,axis_b_pos,axis_c_pos,axis_d_pos,axis_e_pos",
            [t, *(0.1 * t,) * 5],
        ),
        "imu": (
            "time_secs,x_ori,y_ori,z_ori,w_ori,x_angvel,y_angvel,z_angvel",
            [
                t,
                *Rotation.from_euler("ZYX", np.outer(0.01 * t, [1.0, 2.0, 3.0])).as_quat().T,
                *(0.0 * t,) * 3,
            ],
        ),
        "mocap": (
            "time_secs,x_pose,y_pose,z_pose,roll,pitch,yaw",
            [t, 0.0 * t, 0.0 * t, 0.02 * t, *(0.0 * t,) * 3],
        ),
    }
    for kind, (head, columns) in files.items():
        rows = [",".join(f"{value:.6f}" for value in row) for row in np.column_stack(columns)]
        text = "\n".join([head, *rows])
        (folder / f"traj9-0_{kind}.csv").write_text(changes.get(kind, text))


def test_reads_angles_in_our_joints_and_the_start(tmp_path: Path, within):
    write(tmp_path)
    trial = read_trial(tmp_path, "traj9-0")
    assert names_in(tmp_path) == ("traj9-0",)
    assert trial.group == "traj9"
    within("joint 1", trial.joints[:, 0] + (0.1 * trial.joint_times - 3.07), 1e-6)
    within("joint 4", trial.joints[:, 3] - (0.1 * trial.joint_times - 2.879), 1e-6)
    within("yaw", trial.attitude[:, 2] - 0.01 * trial.times, 1e-5)
    within("roll", trial.attitude[:, 0] - 0.03 * trial.times, 1e-5)
    within("rise", trial.position[:, 2] - 0.02 * (trial.times - 0.25), 1e-3)
    within("velocity", trial.v_start - [0.0, 0.0, 0.02], 1e-9)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"imu": "time_secs,x_ori\n0,1\n"}, "expected ten rows"),
        ({"imu": "a,b\n" + "\n".join(f"{k},1" for k in range(20))}, "lacks the column 'time_secs'"),
        (
            {"mocap": "time_secs,x_pose\n" + "\n".join("0,1" for _ in range(20))},
            "its times must increase",
        ),
        (
            {"mocap": "time_secs,x_pose\n" + "\n".join(f"{k},nan" for k in range(20))},
            "lacks the column 'y_pose'",
        ),
        (
            {
                "joint_states": "time_secs,axis_e_pos\n"
                + "\n".join(f"{0.01 * k},1" for k in range(20))
            },
            "in common",
        ),
        ({"imu": "words\nand more\n" * 9}, "cannot be read"),
    ],
)
def test_refuses_a_trial(tmp_path: Path, changes: dict[str, str], message: str):
    write(tmp_path, **changes)
    with pytest.raises(ConfigurationError, match=message):
        read_trial(tmp_path, "traj9-0")


def test_refuses_other_folders_and_hulls(tmp_path: Path):
    with pytest.raises(ConfigurationError, match="holds no pool trials"):
        names_in(tmp_path)
    with pytest.raises(ConfigurationError, match=r"there is no traj1-0_joint_states\.csv"):
        read_trial(tmp_path, "traj1-0")
    with pytest.raises(ConfigurationError, match="unknown hull 'barge'; there are benzon2022"):
        pool_model("barge", NOMINAL)
    for hull in HULLS:
        assert pool_model(hull, NOMINAL).nu == 4


def test_reads_fitted_parameters(tmp_path: Path):
    hull, values = read_fitted(FITTED)
    assert hull == "wu2018"
    assert set(values) == set(NOMINAL)
    assert pool_model(hull, values).nu == 4
    (tmp_path / "other.json").write_text("{}")
    with pytest.raises(ConfigurationError, match="is no file of fitted parameters"):
        read_fitted(tmp_path / "other.json")


def test_spread_and_left_out_scores_are_those_of_the_fits_without_a_group(monkeypatch):
    """Fits of 1, 2 and 6 without each of three groups: the jackknife's error is sqrt(2 / 3 (4 + 1 +
    9)).
    """
    rise_errors = {"traj1": 1.0, "traj2": 2.0, "traj3": 6.0}
    n = len(PARAMETERS)

    def fit(_hull, trials, **_):
        (out,) = set(rise_errors) - {trial.group for trial in trials} or {None}
        return SimpleNamespace(
            deviations=np.full(n, 0.5 if out is None else rise_errors[out]), values={}
        )

    monkeypatch.setattr(validation, "fit", fit)
    monkeypatch.setattr(validation, "values_of", lambda _, deviations: float(deviations[0]))
    monkeypatch.setattr(
        validation, "scores", lambda _, members, values: [(m.group, values) for m in members]
    )
    report = validation.validate(
        "wu2018", untyped([SimpleNamespace(group=group) for group in rise_errors for _ in range(2)])
    )
    assert report.spread == pytest.approx(np.full(n, np.sqrt(2.0 / 3.0 * 14.0)))
    assert report.left_out == tuple(
        (group, value) for group, value in rise_errors.items() for _ in range(2)
    )
    least = PARAMETERS[0].value(0.5 - 1.959964 * np.sqrt(28.0 / 3.0))
    assert report.interval(0)[0] == pytest.approx(least)


@pytest.mark.long
@pytest.mark.skipif(
    not REAL.is_dir(), reason="the pool trials are not here: UUV_POOL_TRIALS names their folder"
)
def test_the_pool():
    """Fitted to half of the trajectory numbers, judged on the others; the bars are those of the
    whole study.
    """
    trials = read_trials(REAL)
    groups = sorted({trial.group for trial in trials})
    fitted_trials = [trial for trial in trials if trial.group in groups[::2]]
    rest = [trial for trial in trials if trial.group in groups[1::2]]
    fit = fit_named(Residuals("benzon2022", fitted_trials), PARAMETERS)
    model = pool_model("benzon2022", fit.values)
    scored = medians([score_of(trial, replay(model, trial, fit.values)) for trial in rest])
    assert scored["roll_rms_deg"] < 1.0
    assert scored["pitch_rms_deg"] < 1.2
    assert scored["roll_correlation"] > 0.97
    assert scored["pitch_correlation"] > 0.95
    assert scored["rise_error_m"] < 0.15
