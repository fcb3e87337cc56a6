"""The calibration as a user runs it: what it leaves behind, and what it says of bad files, in one
line.
"""

import json
import os
import re
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from jsonschema import validate

from uuv.arm_identification.touching import touch, touching_scenario
from uuv.calib import Arm, simulation
from uuv.calib.arm_files import read_arm
from uuv.calib.touch_files import read_touches, write_touches
from uuv.models.arms import published_arms
from uuv.scenario import VehicleSetup
from uuv.site import OpenWater, Site

# A clone of github.com/platonics-delft/kinematics_calibration: touches of real arms.
REAL = os.environ.get("UUV_REAL_TOUCHES", "")
JOINTS = tuple(f"joint{k}" for k in range(1, 7))


@pytest.fixture
def calibrate(verb):
    return partial(verb, "calibrate")


@pytest.fixture(scope="module")
def touched() -> tuple[Arm, list[np.ndarray]]:
    """A UR10e with errors, and touches of it."""
    rng = np.random.default_rng(5)
    nominal = published_arms.load("ur10e")
    true = simulation.wrong_arm(nominal, {"theta": 2e-3, "a": 1e-3, "alpha": 2e-3}, rng)
    return true, simulation.touch(true, (0.06, 0.0, 0.15), rng, touches=12)


def test_a_clamped_arm_that_is_not_as_believed_seats_the_ball(within):
    """Two touches of one nest: the readings that a calibration by contact is made of."""
    still = Site(object=OpenWater(), current=(0.0, 0.0, 0.0), gust=0.0)
    session, own = touch(
        touching_scenario(
            VehicleSetup(vehicle="uuv_puma", arm_errors=0),
            still,
            hovering=False,
            nests=1,
            touches=2,
            seed=0,
        )
    )
    (q,) = session.series
    assert session.missed == 0
    assert np.abs(q[1] - q[0]).max() > 0.1
    # Measured: 5.1 um on one processor, below 5 on another
    within("seat of the ball [m]", session.tip_spread, 1e-5)
    within("hull [m]", session.hull_motion, 1e-6)
    believed = [own.chain().forward(each)[:3, 3] for each in q]
    assert np.linalg.norm(believed[1] - believed[0]) > 1e-4


@pytest.mark.long(
    guarded_by="tests/integration/test_calibrate_arm.py::test_a_clamped_arm_that_is_not_as_believed_seats_the_ball"
)
def test_touching_by_contact_finds_the_arm(calibrate, tmp_path, within):
    """A ball in nests of three balls, the hull clamped: only the encoders' steps stand between arm
    and truth.
    """
    run = calibrate(
        "--arm", "uuv_puma", "--touching", "clamped", "--quick", "--no-record", "--out", tmp_path
    )
    assert run.returncode == 0, run.stdout + run.stderr
    metrics = json.loads((tmp_path / "metrics.json").read_text(encoding="utf-8"))
    assert metrics["contact"]["missed"] == 0
    assert metrics["tracker"]["nominal"] > 5e-4
    within("moves of the flange [m]", metrics["tracker"]["identified"], 2.5e-4)  # 2.6e-5
    within("seat of the ball [m]", metrics["contact"]["seat_spread_m"], 5e-6)  # 4.6e-7


def test_files_of_a_run_are_the_arm_that_it_found(calibrate, root, tmp_path, touched, within):
    true, series = touched
    folder = write_touches(
        tmp_path / "in", ["a", "b", "c"], [np.degrees(q) for q in series[:3]], JOINTS
    )
    out = tmp_path / "out"
    run = calibrate("--arm", "ur10e", "--touches", folder, "--out", out)
    assert run.returncode == 0, run.stdout + run.stderr
    assert "degrees" in run.stdout
    assert "18 of 27" in run.stdout
    metrics = json.loads((out / "metrics.json").read_text())
    validate(
        metrics, json.loads((root / "calib" / "schemas" / "calibration.schema.json").read_text())
    )
    assert metrics["accepted"]
    assert metrics["touches"]["count"] == 36
    assert metrics["fit"]["cost_m2"] < 0.05 * metrics["fit"]["cost_nominal_m2"]
    q = np.vstack(series)
    tips = {}
    for name in ("arm.yaml", "dh.csv", "arm.urdf", "arm.mjcf.xml"):
        source = read_arm(out / name)
        tcp = read_arm(out / "arm.yaml").tcp if name in ("arm.yaml", "dh.csv") else np.zeros(3)
        tips[name] = source.arm.tips(q, tcp)
        within(f"{name} [m]", tips[name] - tips["arm.yaml"], 1e-9)  # 1e-11: twelve digits
    spread = [
        float(np.linalg.norm(p - p.mean(axis=0), axis=1).max())
        for p in np.split(tips["arm.yaml"], 3)
    ]
    assert max(spread) < 1e-3
    page = (out / "report.html").read_text()
    assert "scale" in page
    assert page.count("<img") == 3
    # Only lengths that touching sees may be compared with the truth: shape, up to scale.
    error = read_arm(out / "arm.yaml").arm.table[2, 3] - true.table[2, 3]
    within("alpha3 [rad]", error, 1.5e-3)  # 1.5e-4


def test_what_one_point_leaves_open_is_stated_with_the_verdict(calibrate, tmp_path, touched):
    """The size of the arm, and held-out touches that scatter more than the fitted ones."""
    true, series = touched
    folder = write_touches(tmp_path / "in", ["a"], series[:1], JOINTS)
    held = write_touches(tmp_path / "held", ["b"], series[1:2], JOINTS)
    out = tmp_path / "out"
    run = calibrate("--touches", folder, "--held-out", held, "--out", out, "--no-record")
    assert run.returncode == 0, run.stdout + run.stderr
    metrics = json.loads((out / "metrics.json").read_text(encoding="utf-8"))

    size, scatter = metrics["remarks"]
    assert run.stdout.index("accepted") < run.stdout.index("undetermined: the size of the arm")
    assert "from one point without a known distance" in size
    assert "a second point 0.89 m away" in size
    share = float(size.split("up to ")[1].split(" %")[0]) / 100.0
    lengths = read_arm(out / "arm.yaml").arm.table[[1, 2], 2] / true.table[[1, 2], 2]
    assert 1e-3 < share < 5e-3
    assert np.all(np.abs(lengths - 1.0) < share)

    row = metrics["held_out_m"]["b"]
    assert 0.0 < row["identified"] < row["at_most"]
    assert f"at most {1e3 * row['at_most']:.3g} mm" in scatter
    assert f"{1e3 * row['identified']:.3g} mm RMS against" in scatter

    # Only parameters whose interval excludes nominal are called significantly changed.
    table = run.stdout.split("largest significant changes")[1].split("not observable")[0]
    listed = re.findall(r"([+-][0-9.]+) . ± ([0-9.]+)", table)
    assert listed
    assert all(abs(float(change)) > float(half) for change, half in listed)


def rows(*values: str) -> str:
    return "\n".join(values) + "\n"


GOOD = "0.1,-1.2,1.3,-0.4,0.5,0.6"
BAD = {
    "empty": ("", "the file is empty"),
    "nan": (rows(GOOD, "0.1,nan,1,1,1,1"), "must be finite"),
    "width": (rows("0.1,0.2,0.3"), "each of the arm's 6 joints, got 3"),
    "seven": (rows("4.19e-01,1.2,-0.2,-0.9,0.7,1.5,0.8"), "each of the arm's 6 joints, got 7"),
    "one": (rows(GOOD), "at least three times in different poses"),
    "equal": (rows(GOOD, GOOD, GOOD), "at least three times in different poses"),
    "mixed": (rows(GOOD), "looks like degrees"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_files_end_in_one_line(calibrate, tmp_path, name):
    text, words = BAD[name]
    folder = tmp_path / name
    folder.mkdir()
    (folder / "p.csv").write_text(text)
    if name == "mixed":
        (folder / "z.csv").write_text(rows("10,20,30,40,50,60"))
    run = calibrate("--touches", folder, "--out", tmp_path / "out")
    assert run.returncode == 2
    assert run.stderr.count("\n") == 1
    assert words in run.stderr


def test_joints_that_bend_under_payloads_are_found(calibrate, root, tmp_path, within):
    """One payload for each point.

    Without compliances the fit takes the sag for geometry; the tracker sees both.
    """
    bent = ("--true-compliance", "5e-5", "--payload", "0", "5", "10", "--no-record")
    metrics = {}
    for name, more in (("rigid", ()), ("elastic", ("--compliance",))):
        run = calibrate(*bent, *more, "--out", tmp_path / name)
        metrics[name] = json.loads((tmp_path / name / "metrics.json").read_text(encoding="utf-8"))
        assert run.returncode == 0, run.stdout + run.stderr
    validate(
        metrics["elastic"],
        json.loads((root / "calib" / "schemas" / "calibration.schema.json").read_text()),
    )
    rigid, elastic = (metrics[name]["tracker"]["identified"] for name in ("rigid", "elastic"))
    assert rigid > 5.0 * elastic  # measured 0.89 and 0.069 mm
    within("moves of the flange [m]", elastic, 1.2e-4)
    assert (
        metrics["rigid"]["pairs"]["identified_mean_m"]
        > 5.0 * metrics["elastic"]["pairs"]["identified_mean_m"]
    )
    compliance = np.array(metrics["elastic"]["fit"]["compliance_rad_nm"])
    within("compliances of shoulder and elbow", compliance[1:3] / 5e-5 - 1.0, 0.1)  # 0.03


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--compliance", "--payload", "1"), "--payload: must have 3 values, got 1"),
        (("--payload", "0", "5", "10"), "--payload and --link-mass: only with --compliance"),
        (
            ("--touches", "README.md", "--true-gears", "0.001"),
            "--touches or --true-compliance, --true-gears",
        ),
        (
            ("--touching", "clamped", "--arm", "uuv_puma", "--true-seating", "1e-4"),
            "not with touching by contact",
        ),
        (("--true-seating", "1"), "--true-seating [m]"),
        (
            ("--flow", "CylinderWake"),
            "--flow: only with --touching hovering, for the hull is fixed otherwise",
        ),
        (("--compliance", "--method", "paper"), "--compliance and --method paper"),
    ],
)
def test_loads_that_cannot_be_are_one_line(calibrate, tmp_path, options, said):
    run = calibrate(*options, "--no-record", "--out", tmp_path / "out")
    assert (run.returncode, said in run.stderr) == (2, True), run.stderr


def test_outlier_is_left_out(calibrate, tmp_path, touched):
    series = [q.copy() for q in touched[1]]
    series[1][3, 2] += 0.025  # 20 mm and more at the tip
    folder = write_touches(tmp_path / "in", ["a", "b", "c"], series, JOINTS)
    run = calibrate("--touches", folder, "--out", tmp_path / "out", "--no-record")
    assert run.returncode == 0, run.stdout + run.stderr
    assert json.loads((tmp_path / "out" / "metrics.json").read_text())["touches"]["left_out"] >= 1
    assert "series 2, touch 4" in run.stdout


def test_planned_touches_can_be_read_and_tell_more_than_random_ones(calibrate, tmp_path):
    run = calibrate("--arm", "uuv_puma", "--plan", 12, "--out", tmp_path / "out")
    assert run.returncode == 0, run.stdout + run.stderr
    assert "planned touches [deg]" in run.stdout
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())
    expected = metrics["plan"]["expected_error_m"]
    # measured 0.29 to 0.44 on five seeds
    assert expected["planned"] < 0.8 * expected["random_median"]
    assert expected["random_median"] < expected["before"]
    read = read_touches(tmp_path / "out" / "plan.csv", joint_types="r" * 6, joint_names=JOINTS)
    assert read.count == 12
    arm = read_arm(next((tmp_path / "out").glob("*.xml"))).arm
    places = {point["name"]: point["position_m"] for point in metrics["plan"]["points"]}
    for name, q in zip(read.names, read.series, strict=True):
        assert arm.tips(q, np.zeros(3)) == pytest.approx(
            np.tile(places[name], (len(q), 1)), abs=1e-6
        )


def test_a_plan_goes_on_from_the_touches_so_far(calibrate, tmp_path, touched):
    """Of the points that were touched: each planned posture brings the identified tip to its
    point.
    """
    folder = write_touches(tmp_path / "in", ["a", "b", "c"], [q[:4] for q in touched[1]], JOINTS)
    run = calibrate("--plan", 6, "--touches", folder, "--out", tmp_path / "out")
    assert run.returncode == 0, run.stdout + run.stderr
    figures = json.loads((tmp_path / "out" / "metrics.json").read_text())["plan"]
    assert figures["expected_error_m"]["planned"] < figures["expected_error_m"]["before"]
    assert [point["so_far"] for point in figures["points"]] == [4, 4, 4]
    true = touched[0]
    places = {point["name"]: point["position_m"] for point in figures["points"]}
    read = read_touches(tmp_path / "out" / "plan.csv", joint_types="r" * 6, joint_names=JOINTS)
    for name, q in zip(read.names, read.series, strict=True):
        mine = true.tips(q, np.array([0.06, 0.0, 0.15]))
        # the true arm comes near, before it is jogged
        assert np.abs(mine - places[name]).max() < 0.01


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--plan", 0), "--plan: must be a whole number in 1..200, got 0"),
        (
            ("--plan", 5, "--touching", "clamped"),
            ("--plan and --touching: give only one of the two"),
        ),
    ],
)
def test_a_plan_that_cannot_be_is_one_line(calibrate, tmp_path, options, said):
    run = calibrate(*options, "--out", tmp_path / "out")
    assert run.returncode == 2
    assert run.stderr == f"error: {said}\n"


@pytest.mark.skipif(
    not REAL, reason="UUV_REAL_TOUCHES names no clone with the touches of real arms"
)
def test_real_arm(calibrate, tmp_path):
    dataset = Path(REAL) / "data" / "panda_3"
    held = [
        path for path in sorted(dataset.iterdir()) if path.is_dir() and path.name != "frontleft"
    ]
    run = calibrate(
        "--arm",
        "panda",
        "--touches",
        dataset / "frontleft",
        "--held-out",
        *held,
        "--distance",
        "hole_0",
        "hole_1",
        0.05,
        "--out",
        tmp_path,
        "--no-record",
    )
    assert run.returncode == 0, run.stdout + run.stderr
    errors = json.loads((tmp_path / "metrics.json").read_text())["held_out_m"]
    pairs = np.array([[pair["nominal"], pair["identified"]] for pair in errors.values()])
    assert len(pairs) == 10
    assert np.median(pairs[:, 0]) > 1e-3
    assert np.median(pairs[:, 1]) < 0.3e-3  # measured 0.24 mm
