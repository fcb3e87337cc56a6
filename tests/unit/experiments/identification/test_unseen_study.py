"""What the study of unseen objects says of rows made by hand: found, accepted, false accepts, and
its covariances.
"""

from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from experiments.identification.unseen import study
from uuv.perception.registration.pose_check import Decision


def row(
    found: bool, decision: Decision, content: str = "present", **changed: Any
) -> dict[str, Any]:
    """A scene 2 mm and 1 deg off, identified in 0.2 s."""
    told = {
        "found": found,
        "decision": decision,
        "content": content,
        "nees": None,
        "nees_degrees": 6,
    }
    return {
        **told,
        "position_m": 0.002,
        "angle_deg": 1.0,
        "identify_s": 0.2,
        "mirror_share": 0.0,
        **changed,
    }


def test_shares_are_of_the_scenes_and_of_those_found():
    """Three of four found, two of them accepted; one wrong pose is accepted too.

    Errors are those of found poses.
    """
    rows = [
        row(True, Decision.ACCEPT, position_m=0.001),
        row(True, Decision.ACCEPT, position_m=0.003),
        row(True, Decision.RESCAN),
        row(False, Decision.ACCEPT, position_m=0.5, identify_s=1.0),
    ]
    told = study.figures_of(rows)
    assert (told["found_percent"], told["accepted_of_found_percent"]) == (
        75.0,
        pytest.approx(200.0 / 3.0),
    )
    assert (told["false_accepts"], told["median_mm"], told["median_deg"]) == (
        1,
        pytest.approx(2.0),
        1.0,
    )
    assert (told["identify_ms"], told["identify_p95_ms"]) == (
        pytest.approx(200.0),
        pytest.approx(880.0),
    )
    assert study.confusion(rows) == {
        f"{study._TITLES['present']}, found": {"accept": 2, "rescan": 1, "refuse": 0},
        f"{study._TITLES['present']}, not found": {"accept": 1, "rescan": 0, "refuse": 0},
    }


@pytest.mark.parametrize("degrees", [5, 6])
def test_errors_are_covered_by_their_own_degrees_of_freedom(degrees: int):
    """40 errors at the middles of 40 equal shares of the distribution: 38 lie within 95 %; the
    median is that of it.
    """
    errors = chi2.ppf((np.arange(40) + 0.5) / 40.0, degrees)
    rows = [row(True, Decision.ACCEPT, nees=float(error), nees_degrees=degrees) for error in errors]
    told = study.consistency([*rows, row(False, Decision.REFUSE)])
    assert (told["poses"], told["covered_percent"]) == (40, 95.0)
    assert told["nees_median"] == pytest.approx(1.0, rel=0.01)
    assert told["nees_mean"] == pytest.approx(errors.mean() / degrees)
