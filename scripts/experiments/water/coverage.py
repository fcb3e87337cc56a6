"""Study on simulated logs of vehicles drawn from the prior: do the intervals cover, does a plan
keep its word?
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from uuv.calib.water.named_fit import values_of
from uuv.calib.water.parameters import GROUPS, group_of
from uuv.own_vehicle import vehicle_spec
from uuv.sim.interfaces.spatial import Array
from uuv.sim.interfaces.streams import Streams
from uuv.water_identification.log_residuals import identify
from uuv.water_identification.manoeuvres import simulated, survey
from uuv.water_identification.next_manoeuvre import next_manoeuvres
from uuv.water_identification.settings import FitSettings
from uuv.water_identification.vehicle_replay import ReplayVehicle

VEHICLES = ("uuv_puma", "bluerov2_heavy_benzon2022", "bluerov2_heavy_alpha5")
SECONDS = 30.0  # [s] of a log
GUST = 0.005  # [m/s] of the water, each axis: a calm basin


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Draw:
    """One simulated log and its fit."""

    vehicle: str
    seed: int
    names: tuple[str, ...]
    errors: Array  # (n,) estimate less truth, in the standard deviations that the fit states
    told: Array  # (n,) share of the prior variance that the log took away
    quantile: float  # standard deviations of half an interval
    seconds: float  # of processor time for the fit


def draw(vehicle: str, seed: int, seconds: float = SECONDS, gust: float = GUST) -> Draw:
    """Draw a vehicle from the prior, fly it through a survey in gusts, and identify it from its
    noisy log.
    """
    own = _replay(vehicle)

    streams = Streams(seed)
    parameters = own.water.parameters
    truth = streams["water"].standard_normal(len(parameters))
    believed = values_of(parameters, np.zeros(len(parameters)))

    flown = survey(own, believed, seconds, streams["survey"])
    log = simulated(own, values_of(parameters, truth), flown, rng=streams["log"], gust=gust)

    began = time.process_time()
    fit, _ = identify(own, [log], FitSettings(gust=gust))
    spent = time.process_time() - began

    n = len(parameters)
    return Draw(
        vehicle=vehicle,
        seed=seed,
        names=tuple(each.name for each in parameters),
        errors=(fit.named.deviations[:n] - truth) / fit.sigmas[:n],
        told=fit.named.told[:n],
        quantile=fit.quantile,
        seconds=spent,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class KeptWord:
    """A planned manoeuvre that was then flown."""

    vehicle: str
    seed: int
    manoeuvre: str
    predicted: float  # factor by which intervals shrink, geometric mean over the parameters
    found: float
    worst: float  # the same of the manoeuvre at the end of the list, predicted


def kept_word(vehicle: str, seed: int, seconds: float = SECONDS, gust: float = GUST) -> KeptWord:
    """Identify from surge and yaw, plan the next manoeuvre, fly it, and identify from both logs."""
    own, settings = _replay(vehicle), FitSettings(gust=gust)

    streams = Streams(seed)
    parameters = own.water.parameters
    n = len(parameters)

    # The first log, and the manoeuvre that would tell most after it.
    truth = values_of(parameters, streams["water"].standard_normal(n))
    flown = survey(own, values_of(parameters, np.zeros(n)), seconds, streams["survey"], axes=(0, 5))
    first = simulated(own, truth, flown, name="first", rng=streams["log"], gust=gust)
    fit, _ = identify(own, [first], settings)
    ranked, manoeuvres = next_manoeuvres(
        own,
        fit.named.deviations[:n],
        fit.named.covariance[:n, :n],
        settings,
        channels=tuple(first.channels),
    )

    second = simulated(
        own, truth, manoeuvres[ranked[0].name], name="second", rng=streams["second log"], gust=gust
    )
    both, _ = identify(own, [first, second], settings)

    return KeptWord(
        vehicle=vehicle,
        seed=seed,
        manoeuvre=ranked[0].name,
        predicted=ranked[0].sharper(),
        found=float(np.exp(np.mean(np.log(fit.sigmas[:n] / both.sigmas[:n])))),
        worst=ranked[-1].sharper(),
    )


def coverage(draws: Sequence[Draw]) -> dict[str, tuple[float, float, float]]:
    """Share of intervals that cover, root mean square of the errors, and share told, by group and
    for "all".
    """
    group = np.array([group_of(name) for name in draws[0].names])
    quantile = np.array([[each.quantile] for each in draws])

    errors, told = (
        np.array([each.errors for each in draws]),
        np.array([each.told for each in draws]),
    )

    masks = {name: group == name for name in GROUPS if np.any(group == name)} | {
        "all": np.ones(len(group), dtype=bool)
    }

    return {
        name: (
            float(np.mean((np.abs(errors) < quantile)[:, mask])),
            float(np.sqrt(np.mean(errors[:, mask] ** 2))),
            float(np.mean(told[:, mask])),
        )
        for name, mask in masks.items()
    }


@cache
def _replay(vehicle: str) -> ReplayVehicle:
    return ReplayVehicle(vehicle_spec(vehicle))
