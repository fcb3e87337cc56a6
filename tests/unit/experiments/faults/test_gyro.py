"""Steps of a gyro's bias: which count as named, and what the page says of them."""

from typing import Any

import numpy as np
import pytest

from experiments.faults.gyro import GyroStep, gyro_steps
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import FaultKind


def step(kind: FaultKind, part: str, delay: float, **changed: Any) -> dict[str, Any]:
    """A row of a step of 0.03 rad/s about x, by default downwards."""
    case = {"path": "longitudinal", "axis": "x", "size": 0.03, "sign": -1, "seed": 1}
    outcome = {"kind": kind.value, "part": part, "delay": delay}
    return {**case, **outcome, "force": 95.0, "deviation": 0.0021, "left": "", **changed}


def test_a_gyro_is_named_by_its_kind_and_its_axis():
    """Of four steps one is named as another axis, and one as the attitude; the last is left."""
    rows = [
        step(FaultKind.GYRO, "x", 0.4),
        step(FaultKind.GYRO, "y", 3.0),
        step(FaultKind.ATTITUDE, "", 2.0),
        step(FaultKind.GYRO, "x", 0.7, sign=1, force=131.0, left="estimate"),
    ]
    (table,) = gyro_steps.summary(rows).tables
    ((size, share, *cells),) = table.rows
    assert size == "0.03"
    assert share.startswith("50.0 (")
    assert share.endswith(" of 4")
    assert cells == ["0.70", "131", "2.1", "1"]


@pytest.mark.parametrize("size", [0.0, -0.1, np.nan, np.inf])
def test_a_step_of_no_size_is_refused(size: float):
    with pytest.raises(
        ConfigurationError, match=f"--size: must be positive and finite, got {size}"
    ):
        GyroStep(path="longitudinal", axis="x", size=size, sign=1, seed=0)


def test_cases_of_a_path_and_a_seed_follow_each_other():
    """They branch from one run, which a process keeps until the next begins."""
    cases = gyro_steps.space.cases(gyro_steps.options_with({}))
    runs = [(case.seed, case.path) for case in cases]
    assert len(cases) == 180
    assert runs == sorted(runs)
