"""Fit of the error model of the camera on the arm to rendered pairs of pictures."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy import optimize, stats

from uuv.experiment import Row
from uuv.sim.interfaces.documents import toml_text
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array
from uuv.sim.sensors.arm_camera import LEAST_SEEN, OBSERVED, WEAKEST, ErrorModel, Prediction

GATE = 27.9  # [-] chi-square with 3 degrees of freedom, as navigation's
CONDITION = ("constant", "shift over width", "share hidden by silt", "ln gradient over noise")


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """One rendered pair as the fit needs it."""

    key: int  # number of its key picture
    lost: bool
    error: Array
    stated: Array
    view: Prediction
    row: Row


def pairs_of(rows: list[Row]) -> list[Pair]:
    """All pairs of the rows whose view has enough surface for a track."""
    pairs = []
    for row in rows:
        for i in range(len(row["seen"])):
            if row["seen"][i] < LEAST_SEEN:
                continue

            view = Prediction(
                texture=np.reshape(row["texture"][i], (6, 6)),
                shape=np.reshape(row["shape"][i], (6, 6)),
                condition=np.array(row["condition"][i]),
                seen=row["seen"][i],
                range=row["range"],
            )
            pairs.append(
                Pair(
                    row["seed"],
                    row["lost"][i],
                    np.array(row["error"][i]),
                    np.reshape(row["stated"][i], (3, 3)),
                    view,
                    row,
                )
            )
    return pairs


def fit(pairs: list[Pair]) -> ErrorModel:
    """Maximum-likelihood fit of the error model; pairs beyond the gate count as outliers and not
    for the variance.

    Raises:
        ConfigurationError: No pair was aligned, or none observes all directions.
    """
    located = [pair for pair in pairs if not pair.lost]
    if not located:
        raise ConfigurationError(f"fit: none of {len(pairs)} pairs was aligned; more are needed")
    lost = _fit_lost(pairs)

    start = np.zeros(8)
    used = located
    for _ in range(3):  # outliers are those of the fit without them
        start = np.asarray(optimize.minimize(_deviance, start, args=(used,), method="L-BFGS-B").x)
        used = [pair for pair in located if squared(pair, start)[0] <= GATE]

    # Outliers: their share, and how much larger they are.
    squares = [squared(pair, start)[0] for pair in located]
    outliers = [square for square in squares if square > GATE]
    factor = np.sqrt(np.median(outliers) / 3.0) if outliers else 1.0

    # The part of the error that the pairs of one key share, and the mean error.
    common = _common_share(used, start)
    sound = [pair.error for pair in used if squared(pair, start)[1] == 3]
    if not sound:
        raise ConfigurationError(
            f"fit: none of {len(located)} aligned pairs observes all directions; more are needed"
        )
    return ErrorModel(
        texture=_rounded(start[:4]),
        shape=_rounded(start[4:]),
        lost=_rounded(lost),
        common=round(common, 3),
        outliers=round(len(outliers) / max(len(located), 1), 4),
        outlier_factor=round(float(factor), 2),
        bias=_rounded(np.mean(sound, axis=0), 7),
        pairs=len(pairs),
    )


def _common_share(pairs: list[Pair], parameters: Array) -> float:
    """Correlation of the whitened errors of two pairs of one key."""
    whitened = [_whitened(pair, parameters) for pair in pairs]
    products = [
        float(whitened[i] @ whitened[k])
        for i, pair in enumerate(pairs)
        for k, other in enumerate(pairs)
        if pair.key == other.key and i != k
    ]
    squares = [float(error @ error) for error in whitened]
    return float(np.clip(np.mean(products) / np.mean(squares), 0.0, 1.0)) if products else 0.0


def _rounded(values: Array, digits: int = 3) -> Any:
    return tuple(round(float(parameter), digits) for parameter in values)


def _information(pair: Pair, parameters: Array) -> Array:
    x = pair.view.condition
    return pair.view.information(
        float(np.exp(parameters[:4] @ x)), float(np.exp(parameters[4:] @ x))
    )


def squared(pair: Pair, parameters: Array) -> tuple[float, int]:
    """Squared error over the fitted covariance, and the number of observed directions."""
    L = _information(pair, parameters)
    return float(pair.error @ L @ pair.error), int((np.linalg.eigvalsh(L) > OBSERVED).sum())


def _whitened(pair: Pair, parameters: Array) -> Array:
    eigenvalues, axes = np.linalg.eigh(_information(pair, parameters))
    return axes @ (np.sqrt(np.maximum(eigenvalues, 0.0)) * (axes.T @ pair.error))


def _deviance(parameters: Array, pairs: list[Pair]) -> float:
    """Twice the negative log likelihood, over the observed directions, with a weak prior."""
    total = float(np.sum(parameters**2)) / 4.0
    for pair in pairs:
        eigenvalues, axes = np.linalg.eigh(_information(pair, parameters))
        observed = eigenvalues > OBSERVED
        along = axes.T @ pair.error
        total += float(
            np.sum(along[observed] ** 2 * eigenvalues[observed] - np.log(eigenvalues[observed]))
        )
        # of one given up: that at the bound
        total += (1.0 + 2.0 * np.log(WEAKEST)) * int((~observed).sum())
    return total


def _fit_lost(pairs: list[Pair]) -> Array:
    """Logistic regression of lost pictures, with a weak prior."""
    X = np.array([pair.view.condition for pair in pairs])
    y = np.array([pair.lost for pair in pairs], dtype=np.float64)

    def loss(b: Array) -> float:
        a = X @ b
        return float(np.sum(np.logaddexp(0.0, a) - y * a) + 0.02 * b @ b)

    return np.asarray(optimize.minimize(loss, np.array([-3.0, 0.0, 0.0, 0.0])).x)


def figures_of(group: list[Pair], parameters: Array) -> tuple[str, ...]:
    """Cells of the table for a group of pairs, against the model with the fitted parameters."""
    located = [pair for pair in group if not pair.lost]
    if not located:
        return (str(len(group)), *("",) * 7)

    across: list[Array] = []
    along: list[float] = []
    stated: list[float] = []
    nees = 0.0
    dof = count = beyond = 0
    for pair in located:
        # the error in the observed directions
        L = _information(pair, parameters)
        eigenvalues, axes = np.linalg.eigh(L)
        observed = eigenvalues > OBSERVED
        n = int(observed.sum())
        error = (axes * observed) @ axes.T @ pair.error
        count += n
        across.append(error[:2])
        along.append(error[2])
        if n == 3:
            stated.append(np.sqrt(0.5 * np.trace(np.linalg.inv(L)[:2, :2])))

        # against the covariance
        square = float(pair.error @ L @ pair.error)
        if square <= GATE:
            nees += square
            dof += n
        beyond += n > 0 and square > stats.chi2.ppf(0.99, n)

    return (
        str(len(group)),
        f"{(len(group) - len(located)) / len(group):.1%}",
        f"{1e3 * np.sqrt(np.mean(np.square(across))):.3f}",
        f"{1e3 * np.sqrt(np.mean(np.square(along))):.3f}",
        f"{1e3 * np.median(stated):.3f}" if stated else "-",
        f"{count / len(located):.2f} of 3",
        f"{nees / dof:.2f}" if dof else "-",
        f"{beyond / len(located):.1%}",
    )


def to_toml(model: ErrorModel) -> str:
    """Text of the package's table."""
    heading = (
        "Errors of the camera on the arm, fitted to rendered pairs by\n"
        "    ./uvw run scripts/experiments/navigation/fit_arm_camera.py\n"
        "    ./uvw run scripts/experiments/navigation/store_arm_camera.py\n"
        f"texture, shape, lost: factors of {', '.join(CONDITION)} (sim/sensors/arm_camera.py)"
    )
    return toml_text(asdict(model), heading)
