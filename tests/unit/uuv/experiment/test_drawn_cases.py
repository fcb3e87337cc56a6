"""Files of drawn cases: exact to the last digit, and refused in one line."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pytest

from experiments.faults.false_alarms import SoundCase
from experiments.faults.faults import FaultCase
from experiments.identification.unseen.scenes import build
from experiments.identification.unseen.unseen import UnseenTrial
from uuv.campaigns.campaign import read_campaign, read_drawn
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
        ({"cases": []}, "cases.json': cases: at least one is needed"),
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


def test_the_cases_that_the_project_keeps_can_be_run(root: Path):
    home = root / EXPERIMENTS
    contact = read_campaign(root / "scripts" / "campaigns" / "contact.toml")
    assert len(read_drawn(home / "contact" / "drawn_cases.json", contact)) == 60
    assert len(made_cases(home / "faults" / "drawn_cases.json", "faults", FaultCase)) == 40
    sound = made_cases(home / "faults" / "drawn_false_alarms.json", "false_alarms", SoundCase)
    assert len({case.scenario().seed for case in sound}) == 40

    unseen = home / "identification" / "unseen" / "drawn_cases.json"
    scenes = made_cases(unseen, "unseen", UnseenTrial)
    assert len({(scene.content, scene.index, scene.member) for scene in scenes}) == 19
    clean = build(scenes[0])
    assert clean.range_m == pytest.approx(RANGE, abs=1e-12)
