"""Validation by pool trials: a fit to all trajectory numbers but one, judged on the one left out,
each in turn.
"""

from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import minimize_scalar

from experiments.water.pool.pool_vehicle import NOMINAL, PARAMETERS, pool_model
from experiments.water.pool.replay import Residuals, TrialScore, replay, score_of
from experiments.water.pool.trials import PoolTrial
from uuv.calib.water.named_fit import NamedFit, fit_named, values_of
from uuv.sim.evaluation.intervals import SIGMAS
from uuv.sim.interfaces.documents import json_of
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, shown

BUOYANCIES = (-0.5, 2.5)  # [N] among which that of a trajectory number is sought
# parameters fitted to the 24 trials of docs/pool.md
FITTED = Path(__file__).with_name("wu2018.json")
_IN_WORKER: dict[str, Residuals] = {}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Validation:
    """Result: one parameter set from all trials, its intervals, and the scores."""

    hull: str
    fit: NamedFit  # to all trials
    # (n,) standard errors of the deviations, from the fits that leave a trajectory number out
    spread: Array
    untuned: tuple[TrialScore, ...]
    left_out: tuple[TrialScore, ...]  # each trial by the fit that did not see its trajectory number

    def interval(self, index: int) -> tuple[float, float]:
        """95 % interval of a parameter, by the jackknife over trajectory numbers."""
        each, x, half = (
            PARAMETERS[index],
            float(self.fit.deviations[index]),
            SIGMAS * float(self.spread[index]),
        )
        return each.value(x - half), each.value(x + half)


def groups_of(trials: Sequence[PoolTrial]) -> dict[str, list[PoolTrial]]:
    """Trials by trajectory number."""
    groups: dict[str, list[PoolTrial]] = {}

    for trial in trials:
        groups.setdefault(trial.group, []).append(trial)
    return groups


def scores(
    hull: str, trials: Iterable[PoolTrial], values: Mapping[str, float]
) -> tuple[TrialScore, ...]:
    """Scores of trials by one parameter set."""
    model = pool_model(hull, values)
    return tuple(score_of(trial, replay(model, trial, values)) for trial in trials)


def buoyancy_by_group(
    hull: str, trials: Sequence[PoolTrial], values: Mapping[str, float]
) -> dict[str, float]:
    """Net buoyancy [N] of each trajectory number by its rises, all else as in `values`."""
    buoyancies = {}
    for name, members in groups_of(trials).items():

        def missed(buoyancy: float, members: list[PoolTrial] = members) -> float:
            trial_values = {**values, "net buoyancy": buoyancy}
            return float(
                np.sum([score.rise_error**2 for score in scores(hull, members, trial_values)])
            )

        buoyancies[name] = float(
            minimize_scalar(missed, bounds=BUOYANCIES, method="bounded", options={"xatol": 5e-3}).x
        )

    return buoyancies


def with_own_buoyancy(
    hull: str,
    trials: Sequence[PoolTrial],
    values: Mapping[str, float],
    buoyancies: Mapping[str, float],
) -> tuple[TrialScore, ...]:
    """Scores of trials, each with the net buoyancy of its trajectory number."""
    collected: list[TrialScore] = []

    for name, members in groups_of(trials).items():
        collected += scores(hull, members, {**values, "net buoyancy": buoyancies[name]})
    return tuple(collected)


def read_fitted(file: Path) -> tuple[str, dict[str, float]]:
    """Hull and parameter values of a pool.json, or of the file that comes with the package.

    Raises:
        ConfigurationError: It cannot be read, or lacks a parameter.
    """
    try:
        tables = json_of(file, "--fitted")
        values = {
            parameter.name: float(tables["parameters"][parameter.name]["fitted"])
            for parameter in PARAMETERS
        }
        hull = str(tables["hull"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigurationError(
            f"--fitted {shown(str(file))}: is no file of fitted parameters: {error!r}"
        ) from error
    return hull, values


def medians(of: Sequence[TrialScore]) -> dict[str, float]:
    """Median of each figure over trials."""
    return {
        "roll_rms_deg": float(np.degrees(np.median([score.rms[0] for score in of]))),
        "pitch_rms_deg": float(np.degrees(np.median([score.rms[1] for score in of]))),
        "roll_correlation": float(np.median([score.correlation[0] for score in of])),
        "pitch_correlation": float(np.median([score.correlation[1] for score in of])),
        "roll_amplitude": float(np.median([score.amplitude[0] for score in of])),
        "pitch_amplitude": float(np.median([score.amplitude[1] for score in of])),
        "rise_error_m": float(np.median([abs(score.rise_error) for score in of])),
        "drift_error_m": float(np.median([score.drift_error for score in of])),
    }


def validate(
    hull: str, trials: Sequence[PoolTrial], *, workers: int = 1, leave_out: bool = True
) -> Validation:
    """Fit and judge.

    Args:
        hull: One of `experiments.water.pool.pool_vehicle.HULLS`.
        trials: All trials.
        workers: Processes.
        leave_out: Fit again without each trajectory number; False: the scores are those of the fit
            to all.

    Returns:
        The result.
    """
    whole = fit(hull, trials, workers=workers)
    untuned = scores(hull, trials, NOMINAL)

    groups = groups_of(trials)
    if not leave_out or len(groups) < 2:
        return Validation(
            hull=hull,
            fit=whole,
            spread=np.full(len(PARAMETERS), np.nan),
            untuned=untuned,
            left_out=scores(hull, trials, whole.values),
        )

    # Each trajectory number is judged by a fit without it.
    found, without = [], []
    for name, members in groups.items():
        rest = [trial for trial in trials if trial.group != name]
        fitted = fit(hull, rest, workers=workers, start=whole.deviations)

        without.append(fitted.deviations)
        found += scores(hull, members, values_of(PARAMETERS, fitted.deviations))

    # Jackknife over the trajectory numbers.
    apart = np.array(without) - np.mean(without, axis=0)
    spread = np.sqrt((len(groups) - 1) / len(groups) * np.sum(apart**2, axis=0))

    return Validation(hull=hull, fit=whole, spread=spread, untuned=untuned, left_out=tuple(found))


def fit(
    hull: str, trials: Sequence[PoolTrial], *, workers: int = 1, start: Array | None = None
) -> NamedFit:
    """Parameters of the vehicle from trials; `start` (n,) are deviations to begin with."""
    residuals = Residuals(hull, trials)

    if workers == 1:
        return fit_named(residuals, PARAMETERS, start=start)

    with ProcessPoolExecutor(workers, initializer=_begin, initargs=(residuals,)) as pool:
        return fit_named(
            residuals,
            PARAMETERS,
            start=start,
            mapped=lambda _, points: pool.map(_residuals, points),
        )


def _begin(residuals: Residuals) -> None:
    _IN_WORKER["residuals"] = residuals


def _residuals(deviations: Array) -> Array:
    return _IN_WORKER["residuals"](deviations)
