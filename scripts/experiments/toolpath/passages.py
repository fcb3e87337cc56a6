"""A path through the lock of the wrist, by the default method, from three places of the hull.

The places are files in `places/` beside this file. The path leads around the side of the barrel,
where the tool axis comes to lie across the plane of the arm. From one place the tool keeps its path
within 3 mm and 5 deg by computation, from the others it does not: the work is refused before
contact, and run unchecked as well.

Accepted: what is not refused keeps every bound of the job, and no refused work does.
"""

from uuv.start import run_scenario  # isort: skip

import math
from dataclasses import dataclass, replace
from pathlib import Path

from uuv.experiment import Page, Row, column, experiment, stat
from uuv.experiment.columns import metric_at
from uuv.runner import run
from uuv.scenario_file import read_scenario
from uuv.sim.interfaces.errors import UuvError
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.spatial import one_of

PLACES = Path(__file__).with_name("places")
NAMES = ("through", "beside", "far_beside")
_REASON = 240  # characters


@dataclass(frozen=True, kw_only=True)
class PassageCase:
    """The path from one place."""

    place: str
    """Place of the hull, a file in places/."""
    unchecked: bool
    """Work also where the computation refuses it."""
    seed: int = 0
    """Seed of the run."""

    def __post_init__(self) -> None:
        one_of(self.place, NAMES, "--place")


@dataclass(frozen=True, kw_only=True)
class PassageRow:
    """Outcome of the run; None: it ended before the work."""

    refused: bool = column("refused before contact")
    accepted: bool = column("accepted")
    reason: str = column("why not", default="")
    deviation: float | None = column(
        "path deviation, peak", "mm", digits=1, factor=1e3, default=None
    )
    tilt: float | None = column(
        "tool tilt, peak", "deg", digits=1, factor=math.degrees(1.0), default=None
    )
    force_peak: float | None = column("force error, peak", "N", digits=1, default=None)


@experiment(
    "passages",
    seeds=3,
    vary={"place": NAMES, "unchecked": (False, True)},
    paired=True,
    quick={"place": ("beside",), "unchecked": (False,), "runs": 1},
)
def passages(case: PassageCase) -> PassageRow:
    """Runs the job from the place."""
    scenario = read_scenario(PLACES / f"{case.place}.toml")
    vehicle = replace(scenario.vehicle, unchecked=case.unchecked)
    try:
        done = run(replace(scenario, vehicle=vehicle, seed=case.seed))
    except UuvError as error:
        return PassageRow(refused=True, accepted=False, reason=str(error)[:_REASON])

    metrics = done.assessment.metrics
    touched = any(event.state is WorkState.APPROACH for event in done.recording.events)
    return PassageRow(
        refused=not touched,
        accepted=done.assessment.accepted,
        reason="; ".join(done.assessment.failed)[:_REASON],
        deviation=metric_at(metrics, "tool.path_deviation_max_m"),
        tilt=metric_at(metrics, "tool.tilt_max_rad"),
        force_peak=metric_at(metrics, "contact.force_error_max_n"),
    )


def _right(row: Row) -> bool:
    return bool(row["accepted"]) if row["place"] == NAMES[0] else not row["accepted"]


passages.page = (
    Page()
    .table(
        "Path through the wrist's lock",
        by=("place", "unchecked"),
        columns=[
            stat("share", "refused", "refused before contact"),
            stat("share", "accepted", "accepted"),
            stat("largest", "deviation", "path deviation, peak, largest"),
            stat("largest", "tilt", "tool tilt, peak, largest"),
            stat("largest", "force_peak", "force error, peak, largest"),
        ],
    )
    .accept(stat("share", _right, "carried out or rightly refused"), least=1.0)
)

if __name__ == "__main__":
    run_scenario(passages.main)
