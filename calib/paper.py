"""Run of [Yukhimets 2023]: three Levenberg-Marquardt steps (eq. 17) on all parameters, no prior.

Criterion (7) falls to zero with the arm shrunk to a point, so the run gives a useful result only
because it stops early. It is included for comparison. Parameters are in mm and degrees, as in the
paper. The paper does not state mu, eta and delta. Here mu starts at `MU`, falls tenfold after a
success and rises tenfold after a failure; with 0 < eta < 1, as printed, it would rise after a
success.
"""

import numpy as np

from uuv.calib.fit import Fit, Problem, linearised
from uuv.sim.interfaces.spatial import Array

STEPS = 3  # Levenberg-Marquardt steps, as published
MU = 1e3  # [mm^2] initial damping, chosen for this project
ETA = 10.0  # factor by which the damping falls on success and rises on failure
WARNING = (
    "method 'paper': the minimum of criterion (7) is an arm shrunk to a point, and three steps "
    "stop before it only by accident; scale and 8 or 10 other directions of the result are "
    "meaningless; use method 'map'"
)
_WIDE = 100.0  # [mm, deg] prior deviation for the covariance only, so wide that it has no effect


def paper_run(problem: Problem) -> Fit:
    """Three steps of eq. (17) on the pairs of eq. (9), in mm and degrees [Yukhimets 2023]."""
    units = np.array(
        [np.deg2rad(1.0) if unit == "rad" else 1e-3 for unit in problem.parameters.units]
    )

    data = problem.data
    counts = np.diff([*data.starts, len(data.q)])
    # m sum |x - c|^2 = sum over pairs, likewise G'G
    pairs = np.sqrt(np.repeat(counts, counts)).astype(np.float64)

    full = problem.mean.copy()
    mu = MU
    residuals, rows = _pair_rows(problem, full, pairs, units)
    history = [float(residuals @ residuals) * 1e-6]

    for _ in range(STEPS):
        while True:
            step = -np.linalg.solve(rows.T @ rows + mu * np.eye(len(units)), rows.T @ residuals)
            trial = full.copy()
            trial[problem.index] += step * units
            new_residuals, new_rows = _pair_rows(problem, trial, pairs, units)

            if new_residuals @ new_residuals < residuals @ residuals:
                full = trial
                residuals = new_residuals
                rows = new_rows
                mu /= ETA
                break
            mu *= ETA
            if mu > MU * 1e12:
                break

        history.append(float(residuals @ residuals) * 1e-6)

    square = history[-1] / max(float(counts.mean()), 1.0)
    noise = max(np.sqrt(square / max(data.degrees - len(units), 1.0)), 1e-9)
    return problem.summary(full, noise, units * _WIDE, history, False)


def _pair_rows(problem: Problem, full: Array, pairs: Array, units: Array) -> tuple[Array, Array]:
    """Residuals [mm] and derivatives by parameters in mm and degrees, weighted so that their
    squares sum to eq. (7).
    """
    _, r, rows, _, _ = linearised(problem.arm, full, problem.data, problem.parameters)

    weight = 1e3 * np.repeat(pairs, 3)
    return r * weight, rows * weight[:, None] * units
