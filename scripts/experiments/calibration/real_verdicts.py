"""Verdicts on calibrations of real arms: wrong inputs refused, right ones accepted.

Data: a folder an arm, in it a folder a position, in it a file for each socket. Right inputs are all
positions, each left out, and each alone; wrong ones are made of one position. The meaning of
columns is that of verdicts.py.
"""

from uuv.start import run_scenario  # isort: skip

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

from experiments.calibration.touch_folders import arm_folders, positions_of, sockets_in_rows
from experiments.calibration.verdict import VerdictRow, verdict_of, verdict_page
from experiments.calibration.wrong_inputs import WRONG, Input
from uuv.arm_identification.calibration_case import nominal
from uuv.experiment import experiment

SOCKET_DISTANCE = 0.05  # [m] of consecutive sockets of a position


@dataclass(frozen=True, kw_only=True)
class RealInputs:
    """Which touches."""

    data: Path
    """Folder of the arms' folders."""
    robots: tuple[str, ...] = ()
    """Names of arms' folders; default: all."""
    arm: str = "panda"
    """Published arm that touched."""


@dataclass(frozen=True, kw_only=True)
class RealVerdictCase:
    """One input of one real arm."""

    folder: str
    arm: str
    kind: str
    positions: tuple[str, ...]
    """Positions that are trained on."""
    held_out: tuple[str, ...] = ()
    """Positions that are predicted."""


def cases(inputs: RealInputs) -> Iterator[RealVerdictCase]:
    """Right inputs of each arm, then the wrong ones."""
    for folder in arm_folders(inputs.data, inputs.robots):
        names = positions_of(folder)
        whole = RealVerdictCase(folder=str(folder), arm=inputs.arm, kind="right", positions=names)

        yield whole
        for name in names:
            rest = tuple(other for other in names if other != name)
            yield replace(whole, positions=rest, held_out=(name,))
            yield replace(whole, positions=(name,), held_out=rest)
            yield replace(whole, positions=(name,), kind="right, length 0.2 % off")

        # the front position in the middle, else the first
        central = [name for name in names if "front" in name and "cent" in name]
        for kind in WRONG:
            yield replace(whole, positions=(*central, *names)[:1], kind=kind)


@experiment("calibration_real_verdicts", cases=cases)
def calibration_real_verdicts(case: RealVerdictCase) -> VerdictRow:
    """Calibrates one arm from one input."""
    right = _touched(case.folder, case.arm, case.positions)
    held_out = _touched(case.folder, case.arm, case.held_out).series if case.held_out else ()
    return verdict_of(case.kind, Path(case.folder).name, right, held_out)


@lru_cache(maxsize=4)
def _touched(folder: str, arm: str, positions: tuple[str, ...]) -> Input:
    """What a real arm touched, as it is."""
    source = nominal(arm, Path(), None, None)
    series, pairs = sockets_in_rows(Path(folder), positions, source.arm, SOCKET_DISTANCE)
    return Input(
        source=source,
        series=tuple(series),
        distances=tuple((f"p{i}", f"p{j}", length) for i, j, length in pairs),
    )


calibration_real_verdicts.page = verdict_page()

if __name__ == "__main__":
    run_scenario(calibration_real_verdicts.main)
