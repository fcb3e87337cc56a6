"""Files of drawn cases: exact to the last digit, and refused in one line."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.contact.grip import GripCase, grip
from experiments.faults.false_alarms import false_alarms
from experiments.faults.faults import faults
from experiments.identification.unseen.scenes import build
from experiments.identification.unseen.unseen import unseen
from uuv.campaigns.campaign import read_campaign, read_drawn
from uuv.experiment.declaration import Experiment
from uuv.experiment.drawn_cases import DrawnCase, made_cases, read_cases, write_cases
from uuv.sim.interfaces.errors import ConfigurationError

RANGE = 1.2531538239071238  # [m] from the camera to the object in the first kept scene
EXPERIMENTS = Path("scripts", "experiments")


def test_numbers_come_back_to_the_last_digit(tmp_path: Path, rng: np.random.Generator):
    values = {"site.gust": rng.random(), "site.current": rng.normal(size=3).tolist(), "seed": 7}
    cases = tuple(DrawnCase(case=number, values=values) for number in (4, 2))
    write_cases(tmp_path / "cases.json", "pushes", cases)
    assert read_cases(tmp_path / "cases.json", "pushes") == cases


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"experiment": "faults"}, "cases.json': experiment: allowed pushes, got 'faults'"),
        ({"cases": []}, "cases.json': cases: must have at least one entry"),
        ({"cases": [{"case": 3, "values": {}}] * 2}, "cases.json': case 3 is in it 2 times"),
        ({"cases": [{"case": -1, "values": {}}]}, "case.*must be at least 0, got -1"),
        ({"cases": [{"case": 1}]}, "values is missing"),
        ({"runs": []}, "runs"),
    ],
)
def test_a_file_that_cannot_be_run_is_refused_in_one_line(tmp_path: Path, changed, message):
    good = {"experiment": "pushes", "cases": [{"case": 0, "values": {}}]}
    (tmp_path / "cases.json").write_text(json.dumps(good | changed))
    with pytest.raises(ConfigurationError, match=message) as caught:
        read_cases(tmp_path / "cases.json", "pushes")
    assert "\n" not in str(caught.value)


@dataclass(frozen=True, kw_only=True)
class PushCase:
    """A case whose fields are what is drawn."""

    force: float
    side: str = "left"


def test_cases_are_made_of_their_values(tmp_path: Path):
    cases = [PushCase(force=0.1 + 0.2), PushCase(force=3.0, side="right")]
    drawn = [DrawnCase(case=k, values=asdict(case)) for k, case in enumerate(cases)]
    write_cases(tmp_path / "cases.json", "pushes", drawn)
    assert made_cases(tmp_path / "cases.json", "pushes", PushCase) == cases

    drawn[1] = DrawnCase(case=1, values={"force": "strong"})
    write_cases(tmp_path / "cases.json", "pushes", drawn)
    with pytest.raises(ConfigurationError, match=r"cases.json': case 1: force"):
        made_cases(tmp_path / "cases.json", "pushes", PushCase)


def test_a_word_that_an_experiment_does_not_vary_is_refused(tmp_path: Path):
    file = tmp_path / "cases.json"
    levels = {"side": ("left", "right"), "force": (1.0, 2.0), "of another class": ("a",)}
    write_cases(file, "pushes", [DrawnCase(case=0, values={"force": 0.3, "side": "right"})])
    assert len(made_cases(file, "pushes", PushCase, levels)) == 1  # a number may be any

    write_cases(file, "pushes", [DrawnCase(case=4, values={"force": 1.0, "side": "rihgt"})])
    with pytest.raises(ConfigurationError, match="case 4: side: allowed left, right") as caught:
        made_cases(file, "pushes", PushCase, levels)
    assert "did you mean right?" in str(caught.value)


def test_an_experiment_refuses_drawn_words_that_it_does_not_vary(tmp_path: Path):
    values = asdict(GripCase(trial="hold", shape="cone", setting="computed", vehicle="uuv_puma"))
    write_cases(tmp_path / "cases.json", "grip", [DrawnCase(case=2, values=values)])
    with pytest.raises(ConfigurationError, match="case 2: shape: allowed box, cylinder, sphere"):
        grip.study(grip.options_with({"drawn": tmp_path / "cases.json"}))


def drawn(experiment: Experiment, file: Path) -> Sequence[Any]:
    """Cases of an experiment in a file."""
    return experiment.study(experiment.options_with({"drawn": file})).cases


def test_the_cases_that_the_project_keeps_can_be_run(root: Path):
    home = root / EXPERIMENTS
    contact = read_campaign(root / "scripts" / "campaigns" / "contact.toml")
    assert len(read_drawn(home / "contact" / "drawn_cases.json", contact)) == 60
    assert len(drawn(faults, home / "faults" / "drawn_cases.json")) == 40
    sound = drawn(false_alarms, home / "faults" / "drawn_false_alarms.json")
    assert len({case.scenario().seed for case in sound}) == 40

    scenes = drawn(unseen, home / "identification" / "unseen" / "drawn_cases.json")
    assert len({(scene.content, scene.index, scene.member) for scene in scenes}) == 19
    clean = build(scenes[0])
    assert clean.range_m == pytest.approx(RANGE, abs=1e-12)
