"""The most informative next manoeuvre of those that a vehicle can fly."""

from collections.abc import Mapping, Sequence

import numpy as np

from uuv.calib.water.named_fit import NamedParameter, values_of
from uuv.calib.water.planning import Planned, information, planned
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array
from uuv.water_identification.log_residuals import OWN, WaterResiduals
from uuv.water_identification.manoeuvres import Manoeuvre, menu, simulated
from uuv.water_identification.settings import FitSettings
from uuv.water_identification.vehicle_replay import ReplayVehicle


def information_of(
    replay: ReplayVehicle,
    deviations: Array,
    manoeuvre: Manoeuvre,
    settings: FitSettings,
    channels: Sequence[str],
) -> Array:
    """Information (n, n) about the vehicle's parameters that a log of a manoeuvre would contain.

    Args:
        replay: The vehicle.
        deviations: (n,) Deviations of its parameters in this manoeuvre.
        manoeuvre: Manoeuvre of the vehicle.
        settings: Settings of the comparison with its log.
        channels: Channels of the log.
    """
    parameters = replay.water.parameters
    log = simulated(
        replay, values_of(parameters, deviations), manoeuvre, name=manoeuvre.name, channels=channels
    )

    # The manoeuvre's own parameters, such as gusts, are fitted and marginalised as for a log.
    try:
        residuals = WaterResiduals(replay, [log], settings)
    except ConfigurationError:  # nothing moves
        return np.zeros((len(parameters), len(parameters)))
    x = np.concatenate([deviations, np.zeros(len(residuals.parameters) - len(parameters))])
    return information(residuals.slopes(x, [np.zeros(OWN)] * len(residuals.local)), len(parameters))


def next_manoeuvres(
    replay: ReplayVehicle,
    deviations: Array,
    known: Array,
    settings: FitSettings,
    *,
    channels: Sequence[str],
    aim: Sequence[str] = (),
) -> tuple[list[Planned], Mapping[str, Manoeuvre]]:
    """All manoeuvres in order of their information, and each by its name.

    Args:
        replay: The vehicle.
        deviations: (n,) Present estimates of its parameters' deviations.
        known: Covariance (n, n) of these estimates.
        settings: Settings of the comparison with logs, with the noise that the intervals allow for.
        channels: Channels of the next log.
        aim: Groups of parameters that count; empty: all.

    Raises:
        ConfigurationError: There is no such group.
    """
    parameters: Sequence[NamedParameter] = replay.water.parameters
    flown = {
        manoeuvre.name: manoeuvre for manoeuvre in menu(replay, values_of(parameters, deviations))
    }
    planned(known, {}, parameters, aim)  # refuses an unknown group before anything is simulated

    added = {
        name: information_of(replay, deviations, manoeuvre, settings, channels)
        for name, manoeuvre in flown.items()
    }
    return planned(known, added, parameters, aim), flown
