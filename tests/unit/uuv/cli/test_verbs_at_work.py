"""Every verb that prints figures prints one JSON document and nothing else, by the door that a user
takes.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from driving_rows import rows_of, text_of
from uuv.cli import validate
from uuv.cli.main import VERBS
from uuv.models.site.seabed import seabed
from uuv.sim.runs.run_folder import claimed_folder

CUBE = """
v -.3 -.2 -.1
v .3 -.2 -.1
v .3 .2 -.1
v -.3 .2 -.1
v -.3 -.2 .1
v .3 -.2 .1
v .3 .2 .1
v -.3 .2 .1
f 1 3 2
f 1 4 3
f 5 6 7
f 5 7 8
f 1 2 6
f 1 6 5
f 2 3 7
f 2 7 6
f 3 4 8
f 3 8 7
f 4 1 5
f 4 5 8
"""


@pytest.fixture
def document(verb):
    """What a verb prints with --json; that must be all."""

    def printed(*words: object, code: int = 0) -> Any:
        ran = verb(*words, "--json")
        assert ran.returncode == code, ran.stderr
        return json.loads(ran.stdout)

    return printed


def test_list_models_and_doctor(document):
    assert "barrel" in document("list", "objects")["object"]
    assert document("models", "uuv_puma")["uuv_puma"]["thrusters"] == 6
    assert document("doctor", "--kernels")["folder"]


def test_wet(document, tmp_path: Path):
    (tmp_path / "hull.obj").write_text(CUBE)
    (hull,) = document("wet", tmp_path / "hull.obj", "--panels", 400)["files"]
    assert Path(hull).is_file()


def test_calibrate(document, tmp_path: Path):
    metrics = document("calibrate", "--no-record", "--seed", 3, "--out", tmp_path / "out")
    assert metrics == json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert metrics["provenance"]["scenario"] == "calibrate"


def test_identify_object(document, tmp_path: Path):
    metrics = document(
        "identify", "object", "--object", "starfish", "--seed", 2, "--out", tmp_path / "out"
    )
    assert (metrics["decision"], len(metrics["center_m"])) == ("accept", 3)


def test_plan_seabed(document, tmp_path: Path):
    rng = np.random.default_rng(4)
    ground = seabed("ripples", rng, half=1.0)
    xy = rng.uniform(-1.0, 1.0, (4000, 2))
    np.savetxt(tmp_path / "cloud.txt", np.column_stack([xy, ground.height(xy)]))
    (tmp_path / "targets.txt").write_text("z 0 0 1\n-0.4 0 1\n0.4 0.1 1\n", "utf-8")
    clouds = ("--cloud", tmp_path / "cloud.txt", "--targets", tmp_path / "targets.txt")
    plan = document("plan-seabed", *clouds, "--out", tmp_path / "out")
    for target in plan["targets"]:
        foot = np.array(target["A_m"])
        assert abs(foot[2] - ground.height(foot)) < 0.03
    assert (tmp_path / "out" / "path.csv").is_file()


def test_validate_without_a_checkout_is_told(verb, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(validate, "_WORK", tmp_path / "scripts" / "validate_physics.py")
    ran = verb("validate")
    assert (ran.returncode, ran.stderr.count("\n")) == (2, 1)
    assert (
        "validate: works only in a checkout, since the checks are tests of the project"
        in ran.stderr
    )


def test_driving_prints_json_alone(document, tmp_path):
    file = tmp_path / "in.csv"
    file.write_text(text_of(rows_of([(0.1, {})], begin=0.0)))
    words = ("--inputs", file, "--no-record", "--out", tmp_path / "out")
    printed = document("drive", "open-water", "--quick", *words)
    assert printed == json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert printed["drive"]["pressed_s"] is None


@pytest.mark.parametrize("name", ["view", "picture", "report"])
def test_a_verb_of_past_runs_refuses_what_is_none(name: str, verb, tmp_path: Path):
    ran = verb(name, tmp_path)
    assert (ran.returncode, ran.stderr.count("\n")) == (2, 1)
    assert "must be a run, a folder with metrics.json" in ran.stderr


@pytest.mark.long(guarded_by="tests/unit/uuv/cli/test_verbs_at_work.py::test_plan_seabed")
@pytest.mark.parametrize(
    ("name", "given", "key"),
    [
        ("identify water", ("--plan",), "left"),
        ("identify friction", ("--quick", "--no-record"), "friction"),
        (
            "campaign",
            ("scripts/campaigns/contact_quick.toml", "--cases", 1, "--workers", 1),
            "outcomes",
        ),
        ("benchmark", ("--entry", "joint PD", "--cases", 1, "--workers", 1), "benchmark"),
        ("validate", (), "checks"),
    ],
)
def test_long_work(name: str, given: tuple[object, ...], key: str, verb, tmp_path: Path):
    ran = verb(*name.split(), *given, "--out", tmp_path / "out", "--json")
    assert ran.returncode in (0, 1), ran.stderr
    document_of = json.loads(ran.stdout)
    assert key in (document_of[0] if isinstance(document_of, list) else document_of)
    assert claimed_folder() == tmp_path / "out"
    assert name in VERBS
