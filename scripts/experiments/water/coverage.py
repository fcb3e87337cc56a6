"""Coverage of the intervals of identified water, on logs of simulated vehicles.

A draw is a vehicle from the prior. It flies a survey of 30 s, sines on all axes, the arm swinging,
in gusts of 5 mm/s, and is identified from its noisy log. "Told" is the share of the prior variance
that the log took away. Errors of one draw go together, so a share of covering intervals is known
less well than its number of intervals says.
"""

from uuv.start import run_scenario  # isort: skip

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from uuv.calib.water.named_fit import values_of
from uuv.calib.water.parameters import GROUPS, group_of
from uuv.experiment import Page, Row, column, experiment, stat
from uuv.own_vehicle import vehicle_spec
from uuv.sim.evaluation.intervals import SIGMAS
from uuv.sim.interfaces.spatial import finite_number
from uuv.sim.interfaces.streams import Streams
from uuv.water_identification.log_residuals import identify
from uuv.water_identification.manoeuvres import simulated, survey
from uuv.water_identification.settings import FitSettings
from uuv.water_identification.vehicle_replay import ReplayVehicle

VEHICLES = ("uuv_puma", "bluerov2_heavy_benzon2022", "bluerov2_heavy_alpha5")
ALL = "all"  # parameters, of whatever group
LEAST = 4  # parameters that are named as covered least


@dataclass(frozen=True, kw_only=True)
class DrawCase:
    """One vehicle drawn from the prior."""

    vehicle: str
    """Name of the vehicle."""
    duration: float = 30.0
    """Duration of the log [s]."""
    gust: float = 0.005
    """Standard deviation of the gusts [m/s] per axis: a calm basin."""
    seed: int

    def __post_init__(self) -> None:
        finite_number(self.duration, "--duration", above=0.0)
        finite_number(self.gust, "--gust", least=0.0)


@dataclass(frozen=True, kw_only=True)
class DrawRow:
    """Errors of the fit, by parameter."""

    error: Mapping[str, float] = column("error over stated deviation", by="parameter")
    told: Mapping[str, float] = column("told", "%", digits=0, factor=100.0, by="parameter")
    quantile: float = column("half an interval over the deviation")
    seconds: float = column("fit", "s", digits=1, tolerance=None)


@experiment("water_coverage", seeds=100, vary={"vehicle": VEHICLES}, paired=True, quick={"runs": 1})
def water_coverage(case: DrawCase) -> DrawRow:
    """Draws a vehicle, flies it, and identifies it."""
    vehicle = replay_vehicle(case.vehicle)
    parameters = vehicle.water.parameters
    n = len(parameters)

    streams = Streams(case.seed)
    truth = streams["water"].standard_normal(n)
    flown = survey(vehicle, values_of(parameters, np.zeros(n)), case.duration, streams["survey"])
    log = simulated(
        vehicle, values_of(parameters, truth), flown, rng=streams["log"], gust=case.gust
    )

    begun = time.process_time()
    fit, _ = identify(vehicle, [log], FitSettings(gust=case.gust))
    seconds = time.process_time() - begun

    names = [parameter.name for parameter in parameters]
    errors = (fit.named.deviations[:n] - truth) / fit.sigmas[:n]
    return DrawRow(
        error=dict(zip(names, errors.tolist(), strict=True)),
        told=dict(zip(names, fit.named.told[:n].tolist(), strict=True)),
        quantile=fit.quantile,
        seconds=seconds,
    )


@cache
def replay_vehicle(name: str) -> ReplayVehicle:
    """The vehicle as it is replayed, made once in a process."""
    return ReplayVehicle(vehicle_spec(name))


def _covers(group: str) -> Callable[[Row], list[bool]]:
    """Function of a row: whether each interval of a group covers the truth."""
    return lambda row: [
        abs(error) < row["quantile"] for error in _of_group(row["error"], group).values()
    ]


def _told(group: str) -> Callable[[Row], list[float]]:
    return lambda row: list(_of_group(row["told"], group).values())


def _of_group(values: Mapping[str, Any], group: str) -> dict[str, Any]:
    """Those of a group of parameters, all of the group ALL."""
    return {name: value for name, value in values.items() if group in (ALL, group_of(name))}


def covered_least(rows: Sequence[Row]) -> str:
    """The parameters that are covered least in these rows, with their shares."""
    shares = {
        name: np.mean([abs(row["error"][name]) < row["quantile"] for row in rows])
        for name in rows[0]["error"]
    }
    least = sorted(shares, key=shares.__getitem__)[:LEAST]
    return "; ".join(f"{name} {100 * shares[name]:.0f} %" for name in least)


def _by_normal_intervals(row: Row) -> list[bool]:
    return [abs(error) < SIGMAS for error in row["error"].values()]


_PERCENT = {"unit": "%", "factor": 100.0}
water_coverage.page = (
    Page()
    .table(
        "95 % intervals that cover the truth [%]",
        by="vehicle",
        columns=[
            *(stat("mean", _covers(group), group, digits=1, factor=100.0) for group in GROUPS),
            stat("mean", _covers(ALL), ALL, digits=1, factor=100.0),
            stat("mean", _by_normal_intervals, "by normal intervals", digits=1, factor=100.0),
        ],
    )
    .table(
        "Share of the prior variance that is told [%]",
        by="vehicle",
        columns=[
            stat("mean", _told(group), group, digits=0, factor=100.0) for group in (*GROUPS, ALL)
        ],
    )
    .table(
        "Single parameters, draws and fits",
        by="vehicle",
        columns=[
            stat("group", len, "draws"),
            stat("group", covered_least, "parameters covered least"),
            stat("least", lambda row: np.mean(_covers(ALL)(row)), "worst draw", **_PERCENT),
            stat("rms", lambda row: list(row["error"].values()), "RMS error over stated"),
            stat("median", "seconds"),
            stat("largest", "seconds"),
        ],
    )
)

if __name__ == "__main__":
    run_scenario(water_coverage.main)
