"""Sampling the seabed as a user runs it: a core, and clouds and files over which the vehicle does
not descend.
"""

import json
from types import SimpleNamespace

import jsonschema
import numpy as np
import pytest

from untyped import untyped
from uuv.perception.seabed.seabed_finder import SeabedFinder
from uuv.sim import hydrodynamics
from uuv.sim.evaluation.seabed_metrics import SeabedBounds, schema
from uuv.sim.interfaces.messages import GroundPlane, SonarScan, StateEstimate

BOUNDS = SeabedBounds()


@pytest.fixture(scope="module", autouse=True)
def _compiled():
    """The notice of a first start is said here, before the runs whose words are tested."""
    hydrodynamics.install()


def test_a_core_is_taken_and_its_log_tells_all_of_it(script, tmp_path):
    done = script("sample_seabed", "--out", tmp_path, "--seed", 3, "--quick")
    assert done.returncode == 0, done.stdout + done.stderr
    metrics = json.loads((tmp_path / "metrics.json").read_text("utf-8"))
    jsonschema.validate(metrics, schema())
    assert metrics["run"]["state"] == "done"
    assert metrics["core"]["push_error_share"] <= BOUNDS.push
    assert metrics["core"]["pull_max_n"] > 0.5  # it was in the soil, and came out
    assert metrics["hull"]["rise_max_m"] <= BOUNDS.rise
    assert metrics["hull"]["ground_gap_m"] > 0.3
    shown = entities(tmp_path / "run.rrd")
    assert shown >= {
        "/world/scene/world/shape",
        "/world/found/coarse_plane",
        "/world/clouds/scan",
        "/world/found/seabed",
        "/world/clouds/targets",
        "/world/vehicle/hull",
        "/world/vehicle/link3",
        "/world/vehicle/pad",
        "/world/arrows/contact",
        "/world/arrows/arm_on_hull",
        "/series/force",
        "/series/thrust",
        "/state/now",
    }


def entities(file):
    """Names of all that a log shows."""
    from rerun.chunk import RrdReader

    return {chunk.entity_path for chunk in RrdReader(file).stream().to_chunks()}


def flat(rng, points=4000):
    """A seabed 2.5 m below the hull, in hull axes."""
    return np.column_stack([rng.uniform(-1.5, 1.5, (points, 2)), np.full(points, -2.5)])


def layers(rng):
    cloud = flat(rng)
    cloud[:, 2] += 0.4 * (rng.random(len(cloud)) < 0.5)
    return cloud


def holed(rng):
    """Nothing within 0.3 m of the place that the target stands over."""
    cloud = flat(rng)
    return cloud[np.hypot(cloud[:, 0] - 0.5, cloud[:, 1]) > 0.3]


def line(rng):
    cloud = flat(rng)
    cloud[:, 1] = 0.3 * cloud[:, 0]
    return cloud


def not_numbers(rng):
    cloud = flat(rng)
    cloud[::50, 1] = np.nan
    return cloud


ANOTHER_CLOUD = pytest.mark.long(
    guarded_by="tests/unit/perception/seabed/test_terrain.py::test_bad_clouds_are_refused_in_one_line"
)


@pytest.mark.parametrize(
    ("cloud", "said"),
    [
        (layers, "two surfaces, one above the other"),
        pytest.param(holed, "target B_1: a hole in the cloud lies under it", marks=ANOTHER_CLOUD),
        pytest.param(line, "all 4000 points lie in a line", marks=ANOTHER_CLOUD),
        pytest.param(not_numbers, "80 of 4000 points are not finite numbers", marks=ANOTHER_CLOUD),
    ],
)
def test_over_a_bad_cloud_it_does_not_descend(script, tmp_path, cloud, said):
    np.savetxt(tmp_path / "cloud.txt", cloud(np.random.default_rng(0)))
    done = script(
        "sample_seabed", "--no-record", "--out", tmp_path / "out", "--cloud", tmp_path / "cloud.txt"
    )
    assert done.returncode == 2, done.stdout + done.stderr
    assert done.stderr.count("\n") == 1
    assert said in done.stderr
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text("utf-8"))
    jsonschema.validate(metrics, schema())
    assert metrics["run"]["state"] == "abort"
    assert metrics["hull"]["ground_gap_m"] > 2.0  # it is 2.5 m up, its underside 0.4 m lower


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "the file is empty"),
        ("# x y z\n", "the text has no points"),
        ("0 0 -2.5\n1 0 -2.5 7\n", "line 2: expected 3"),
    ],
    ids=["empty", "comments alone", "wrong columns"],
)
def test_a_file_that_is_no_cloud_is_refused_before_anything_moves(script, tmp_path, text, said):
    (tmp_path / "cloud.txt").write_text(text, "utf-8")
    done = script(
        "sample_seabed", "--no-record", "--out", tmp_path / "out", "--cloud", tmp_path / "cloud.txt"
    )
    assert done.returncode == 2, done.stdout + done.stderr
    assert done.stderr.count("\n") == 1
    assert said in done.stderr
    assert not (tmp_path / "out" / "metrics.json").exists()


def test_the_story_of_a_drag_has_its_profile_with_both_axes():
    """The finder's state and an estimate with a plane, as in a run, to a log that notes what it is
    shown.
    """
    from uuv.tasks.seabed_sampling import SeabedRecorder

    rng = np.random.default_rng(2)
    finder = SeabedFinder([[-0.2, 0.0, -1.5], [0.2, 0.1, -1.5]], cloud_W=flat(rng))
    zero = np.zeros(3)
    plane = GroundPlane(
        time=0.0, p_W=zero, normal_W=np.array([0.0, 0.0, 1.0]), scatter=0.0, beams=4, silent=()
    )
    estimate = StateEstimate(
        time=0.0,
        X_WB=np.eye(4),
        v_WB_B=zero,
        w_WB_B=zero,
        a_WB_B=zero,
        q=zero,
        qd=zero,
        tau=zero,
        ground=plane,
    )
    scan = SonarScan(time=0.0, points=np.zeros((1, 1, 3)), X_BS=np.eye(4))
    finder_state, _ = finder.step(finder.init(), estimate, scan)
    shown: dict[str, np.ndarray] = {}
    log = SimpleNamespace(
        log_cloud=lambda name, points, *_, **__: shown.update({name: points}),
        log_mesh=lambda name, vertices, *_: shown.update({name: vertices}),
        log_arrows=lambda name, _, vectors, *__: shown.update({name: vectors}),
    )
    recorder = SimpleNamespace(add_cloud=lambda *_: None)
    moment = SimpleNamespace(
        frame=scan, found=finder_state, estimate=estimate, truth=SimpleNamespace(time=0.0)
    )
    SeabedRecorder(untyped(recorder), untyped(log)).observe(untyped(moment))
    assert shown.keys() == {"scan", "coarse_plane", "seabed", "targets", "profile_a", "profile_n"}
    assert len(shown["profile_a"]) == len(shown["profile_n"]) > 2
    assert np.allclose(np.einsum("ij,ij->i", shown["profile_a"], shown["profile_n"]), 0.0)


def test_without_a_plane_from_the_doppler_log_it_does_not_come_near(script, tmp_path):
    done = script("sample_seabed", "--no-record", "--out", tmp_path, "--dead-beams", 1, 4)
    assert done.returncode == 2, done.stdout + done.stderr
    assert done.stderr.count("\n") == 1
    assert (
        "2 of the Doppler log's beams have an echo, but at least 3, not in a line, are needed, "
        "silent: 1, 4" in done.stderr
    )
    metrics = json.loads((tmp_path / "metrics.json").read_text("utf-8"))
    assert metrics["hull"]["ground_gap_m"] > 2.5  # it starts 3.3 m up or higher


@pytest.mark.parametrize(
    ("options", "said"),
    [
        pytest.param(["--push", "100"], "at most half the limit", id="push"),
        pytest.param(["--depth", "-5"], "depth: must be > 0", id="depth"),
        pytest.param(["--cloud", "nowhere.txt"], "there is no such file", id="no cloud"),
        pytest.param(
            ["--vehicle", "bluerov2_heavy"], "geom 'pad' (may be in contact)", id="no tool"
        ),
        pytest.param(["--dead-beams", "7"], "dead beams must be 1 to 4", id="no such beam"),
    ],
)
def test_bad_input_is_one_line_and_code_2(script, tmp_path, options, said):
    done = script("sample_seabed", "--no-record", "--out", tmp_path, *options)
    assert done.returncode == 2, done.stdout + done.stderr
    assert done.stderr.startswith("error: ")
    assert done.stderr.count("\n") == 1
    assert said in done.stderr
