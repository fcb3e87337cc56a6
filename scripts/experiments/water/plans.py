"""Planned manoeuvres of the identification of water: what they were predicted to tell, and told.

A vehicle drawn from the prior is identified from a log of surge and yaw alone. The manoeuvre that
the plan names is flown, and the vehicle identified from both logs. Figures are factors by which the
intervals shrink, geometric means over all parameters.
"""

from uuv.start import run_scenario  # isort: skip

from dataclasses import dataclass

import numpy as np

from experiments.water.coverage import VEHICLES, DrawCase, replay_vehicle
from uuv.calib.water.named_fit import values_of
from uuv.experiment import Page, column, experiment, stat
from uuv.sim.interfaces.streams import Streams
from uuv.water_identification.log_residuals import identify
from uuv.water_identification.manoeuvres import simulated, survey
from uuv.water_identification.next_manoeuvre import next_manoeuvres
from uuv.water_identification.settings import FitSettings

AXES = (0, 5)  # surge and yaw, of the first log


@dataclass(frozen=True, kw_only=True)
class PlanRow:
    """The manoeuvre that was named, and how much sharper the intervals became by it."""

    manoeuvre: str = column("manoeuvre named")
    predicted: float = column("predicted", digits=2)
    achieved: float = column("achieved", digits=2)
    last: float = column("last of the list, predicted", digits=2)


@experiment(
    "water_plans",
    seeds=2,
    vary={"vehicle": VEHICLES},
    paired=True,
    quick={"runs": 1, "vehicle": ("bluerov2_heavy_benzon2022",)},
)
def water_plans(case: DrawCase) -> PlanRow:
    """Plans the second manoeuvre of a drawn vehicle, and flies it."""
    vehicle, settings = replay_vehicle(case.vehicle), FitSettings(gust=case.gust)
    parameters = vehicle.water.parameters
    n = len(parameters)

    # The first log, and the manoeuvre that would tell most after it.
    streams = Streams(case.seed)
    truth = values_of(parameters, streams["water"].standard_normal(n))
    nominal = values_of(parameters, np.zeros(n))
    flown = survey(vehicle, nominal, case.duration, streams["survey"], axes=AXES)
    first = simulated(vehicle, truth, flown, name="first", rng=streams["log"], gust=case.gust)
    fit, _ = identify(vehicle, [first], settings)
    ranked, manoeuvres = next_manoeuvres(
        vehicle,
        fit.named.deviations[:n],
        fit.named.covariance[:n, :n],
        settings,
        channels=tuple(first.channels),
    )

    # That manoeuvre, and a fit to both logs.
    second = simulated(
        vehicle,
        truth,
        manoeuvres[ranked[0].name],
        name="second",
        rng=streams["second log"],
        gust=case.gust,
    )
    both, _ = identify(vehicle, [first, second], settings)
    return PlanRow(
        manoeuvre=ranked[0].name,
        predicted=ranked[0].sharper(),
        achieved=float(np.exp(np.mean(np.log(fit.sigmas[:n] / both.sigmas[:n])))),
        last=ranked[-1].sharper(),
    )


water_plans.page = (
    Page()
    .table(
        "Intervals sharper by the planned manoeuvre, factor",
        by=("vehicle", "seed"),
        columns=["manoeuvre", "predicted", "achieved", "last"],
    )
    .table(
        "Achieved over predicted",
        by="vehicle",
        columns=[
            stat(kind, lambda row: row["achieved"] / row["predicted"], kind, digits=2)
            for kind in ("least", "median", "largest")
        ],
    )
)

if __name__ == "__main__":
    run_scenario(water_plans.main)
