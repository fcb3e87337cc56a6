"""The manoeuvre that tells most next, of those that a vehicle can fly."""

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
    """Information (n, n) on the vehicle's parameters that a log of a manoeuvre would hold.

    Args:
        replay: The vehicle.
        deviations: (n,) of its parameters, at which it flies.
        manoeuvre: What it does.
        settings: How its log would be compared.
        channels: That it would hold.
    """
    parameters = replay.water.parameters
    log = simulated(
        replay, values_of(parameters, deviations), manoeuvre, name=manoeuvre.name, channels=channels
    )

    # The manoeuvre's own numbers, such as gusts, are fitted and marginalised as in a log.
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
    """All manoeuvres in order, and each by its name.

    Args:
        replay: The vehicle.
        deviations: (n,) of its parameters as they are believed now.
        known: Covariance (n, n) of them.
        settings: How logs are compared; its noise is that which the intervals allow for.
        channels: That the next log will hold.
        aim: Groups of parameters that matter; none: all.

    Raises:
        ConfigurationError: There is no such group.
    """
    parameters: Sequence[NamedParameter] = replay.water.parameters
    flown = {
        manoeuvre.name: manoeuvre for manoeuvre in menu(replay, values_of(parameters, deviations))
    }
    planned(known, {}, parameters, aim)  # refuses the aim before anything is flown

    added = {
        name: information_of(replay, deviations, manoeuvre, settings, channels)
        for name, manoeuvre in flown.items()
    }
    return planned(known, added, parameters, aim), flown
