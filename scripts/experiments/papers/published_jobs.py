"""The main job by methods of [Konoplin 2022] in place of the default ones, on several seeds.

The paper's text gives the force law three readings (`uuv.controllers.arm.published_force_law`), the
tip force a closed form of three joints, and offers a load observer as an equal source of the
contact force. Jobs run whatever the check before a start says of them (`uuv.check`). The path is
the short one of --quick, at the forces of the job: 60, 90 and 60 N along the barrel, 60 and 90 N
around it.

Accepted: the default method keeps every bound of the job on every path and seed.
"""

from uuv.start import run_scenario  # isort: skip

from dataclasses import dataclass, replace
from typing import Literal

from uuv import jobs
from uuv.check.hidden_force import HiddenForce
from uuv.experiment import Page, column, experiment, stat
from uuv.experiment.columns import metric_at
from uuv.own_vehicle import OwnVehicle, vehicle_spec
from uuv.runner import run
from uuv.scenario import Control, Scenario
from uuv.sim.interfaces.errors import UuvError
from uuv.sim.interfaces.spatial import one_of

DEFAULT = "default"
METHODS: dict[str, Control] = {
    DEFAULT: Control(),
    "force law, each component": Control(published=("force-law",)),
    "force law, normal component": Control(published=("normal-force-law",)),
    "force law by its text": Control(published=("force-length-law",)),
    "tip force, closed form": Control(published=("tip-force",)),
    "ICP, threshold on Q": Control(published=("identification",)),
    "load observer": Control(force_from="motors"),
}
PATHS = ("longitudinal", "transverse")
_REASON = 200  # characters


@dataclass(frozen=True, kw_only=True)
class PublishedJobCase:
    """One run."""

    method: str
    """Method in place of the default one."""
    path: Literal["longitudinal", "transverse"]
    """Path of the job."""
    seed: int = 0
    """Seed of the run."""

    def __post_init__(self) -> None:
        one_of(self.method, METHODS, "--method")


@dataclass(frozen=True, kw_only=True)
class PublishedJobRow:
    """Figures of the run; None: it ended before the work."""

    accepted: bool = column("accepted")
    reason: str = column("why not", default="")
    force_rms: float | None = column("force error, RMS", "N", digits=2, default=None)
    force_peak: float | None = column("force error, peak", "N", digits=1, default=None)
    felt_rms: float | None = column("felt less true force, RMS", "N", digits=2, default=None)
    deviation: float | None = column(
        "path deviation, peak", "mm", digits=1, factor=1e3, default=None
    )
    lost: float | None = column("contact lost", "s", digits=2, default=None)
    tangential: float | None = column("tangential force, mean", "N", digits=1, default=None)
    identified: float | None = column(
        "identification off, of the range", "%", digits=2, factor=100.0, default=None
    )
    # what dry friction of the gears hides from the motors by computation; None: sensors are read
    hidden_rms: float | None = column("hidden while joints slide, RMS", "N", digits=1, default=None)
    hidden_most: float | None = column("hidden at rest, most", "N", digits=0, default=None)


@experiment(
    "published_jobs",
    seeds=10,
    vary={"method": tuple(METHODS), "path": PATHS},
    paired=True,
    quick={
        "method": (DEFAULT, "force law, normal component", "load observer"),
        "path": ("longitudinal",),
        "runs": 1,
    },
)
def published_jobs(case: PublishedJobCase) -> PublishedJobRow:
    """Runs the main job."""
    scenario = jobs.clean_barrel(path=case.path, quick=True)
    scenario = replace(scenario, control=METHODS[case.method], seed=case.seed)
    hidden = _hidden(scenario)

    # Ended before the work, or done
    try:
        done = run(scenario)
    except UuvError as error:
        return PublishedJobRow(accepted=False, reason=str(error)[:_REASON], **hidden)

    # Error of the identification over its range
    metrics = done.assessment.metrics
    off = metric_at(metrics, "identification.position_error_m")
    range_m = metric_at(metrics, "identification.range_m")
    share = off / range_m if off is not None and range_m else None

    return PublishedJobRow(
        accepted=done.assessment.accepted,
        reason="; ".join(done.assessment.failed)[:_REASON],
        force_rms=metric_at(metrics, "contact.force_error_rms_n"),
        force_peak=metric_at(metrics, "contact.force_error_max_n"),
        felt_rms=metric_at(metrics, "force_estimate.normal_error_rms_n"),
        deviation=metric_at(metrics, "tool.path_deviation_max_m"),
        lost=metric_at(metrics, "contact.lost_s"),
        tangential=metric_at(metrics, "contact.tangential_mean_n"),
        identified=share,
        **hidden,
    )


def _hidden(scenario: Scenario) -> dict[str, float]:
    """Columns of the hidden force; none if the job reads torque sensors."""
    if scenario.control.force_from != "motors":
        return {}

    hidden = HiddenForce.of(OwnVehicle.of(vehicle_spec(scenario.vehicle.vehicle, tool="pad")))
    return {"hidden_rms": hidden.rms, "hidden_most": hidden.most}


published_jobs.page = (
    Page()
    .table(
        "Main job by method",
        by=("method", "path"),
        columns=[
            stat("share", "accepted", "accepted"),
            stat("mean", "force_rms", "force error, RMS, mean"),
            stat("largest", "force_peak", "force error, peak, largest"),
            stat("mean", "felt_rms", "felt less true force, RMS, mean"),
            stat("largest", "deviation", "path deviation, peak, largest"),
            stat("largest", "lost", "contact lost, longest"),
        ],
    )
    .table(
        "Identification and tangential force by method",
        by=("method", "path"),
        columns=[
            stat("largest", "identified", "identification off, of the range, largest"),
            stat("mean", "tangential", "tangential force, mean"),
        ],
    )
    .table(
        "Force that dry friction hides from the motors, by computation",
        columns=[
            stat("largest", "hidden_rms", "while joints slide, RMS"),
            stat("largest", "hidden_most", "at rest or reversing, most"),
        ],
        where=lambda row: row["hidden_rms"] is not None,
        by="method",
    )
    .accept(
        stat("share", "accepted", "accepted by default"),
        least=1.0,
        where=lambda row: row["method"] == DEFAULT,
    )
)

if __name__ == "__main__":
    run_scenario(published_jobs.main)
