"""Verdicts on calibrations of simulated arms: wrong inputs refused, right ones accepted.

Each arm has errors of manufacture and touches three points. Every kind of wrong input is made of
the touches of each arm. A wrong input counts as accepted wrongly if it is accepted, the arm differs
from that of the right input, and no line of the verdict says that such touches cannot tell it.
"""

from uuv.start import run_scenario  # isort: skip

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from experiments.calibration.verdict import (
    KINDS,
    RIGHT_LENGTHS,
    VerdictRow,
    verdict_of,
    verdict_page,
)
from experiments.calibration.wrong_inputs import Input
from uuv.arm_identification.calibration_case import nominal
from uuv.arm_identification.simulated_touches import simulated
from uuv.calib.simulation import HAND_NOISE
from uuv.experiment import experiment
from uuv.experiment.options import at_least

ARMS = (
    "panda",
    "gen3",
    "iiwa7",
    "xarm7",
    "ur10e",
    "ur5",
    "irb140",
    "jaco",
    "general6r",
    "stanford",
)


@dataclass(frozen=True, kw_only=True)
class JudgedArms:
    """Which arms, and what is wrong with their input."""

    kind: str
    """Input: right, or a kind of wrong one."""
    wrong_arms: int = 10
    """Number of arms whose inputs are made wrong."""
    right_arms: int = 20
    """Number of arms whose right inputs are judged."""
    seed: int = 100
    """Seed of the first arm."""

    def __post_init__(self) -> None:
        at_least(self, wrong_arms=0, right_arms=0)


@dataclass(frozen=True, kw_only=True)
class VerdictCase:
    """One input of one simulated arm."""

    kind: str
    arm: str
    pin: str
    seed: int


def cases(arms: JudgedArms) -> Iterator[VerdictCase]:
    """The input of each arm."""
    count = arms.right_arms if arms.kind in RIGHT_LENGTHS else arms.wrong_arms

    for k in range(count):
        yield VerdictCase(
            kind=arms.kind,
            arm=ARMS[k % len(ARMS)],
            pin="straight" if k % 2 else "off-axis",
            seed=arms.seed + k,
        )


@experiment(
    "calibration_verdicts",
    vary={"kind": KINDS},
    cases=cases,
    quick={"wrong_arms": 1, "right_arms": 1},
)
def calibration_verdicts(case: VerdictCase) -> VerdictRow:
    """Calibrates one arm from one input."""
    right = _touched(case.arm, case.pin, case.seed)
    return verdict_of(case.kind, f"{case.arm} {case.seed}, {case.pin} pin", right, ())


@lru_cache(maxsize=4)
def _touched(arm: str, pin: str, seed: int) -> Input:
    """What a simulated arm touched, as it is."""
    source = nominal(arm, Path(), None, None)
    case = simulated(
        source,
        points=3,
        touches=21,
        noise=HAND_NOISE,
        pin=pin,
        known=True,
        errors=seed,
        rng=np.random.default_rng(seed),
    )
    pairs = tuple((f"p{i}", f"p{j}", length) for i, j, length, _ in case.distances)
    return Input(source=source, series=case.touches.series, distances=pairs)


calibration_verdicts.page = verdict_page()

if __name__ == "__main__":
    run_scenario(calibration_verdicts.main)
