"""Errors of the camera on the arm, from rendered pictures of textured objects, and the model fitted
to them.

Each run is one key picture and three after it, over range, texture, turbidity, silt and motion. The
page has the fitted model and its check by groups; store_arm_camera.py stores the model in the
package, from which the simulated sensor takes it.
"""

from uuv.start import run_scenario  # isort: skip

from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from experiments.navigation.arm_camera_errors import KeyCase, KeyRow, aligned_pictures
from experiments.navigation.arm_camera_fit import Pair, figures_of, fit, pairs_of, to_toml
from uuv.experiment import Page, Row, Table, experiment

COLUMNS = (
    "group",
    "pairs",
    "lost",
    "across [mm]",
    "along view [mm]",
    "stated across",
    "observed",
    "NEES / n",
    ">99 %",
)
SMOOTH = ("barrel", "pile")  # objects whose shape does not tell all motion
GROUPS: Mapping[str, Callable[[Pair], bool]] = {
    "all": lambda _: True,
    "textured, no silt": lambda pair: pair.row["contrast"] >= 0.1 and pair.view.condition[2] == 0.0,
    "faint texture": lambda pair: 0.0 < pair.row["contrast"] < 0.1,
    "silt over a quarter or more": lambda pair: pair.view.condition[2] >= 0.25,
    "attenuation above 1 / m": lambda pair: pair.row["attenuation"] > 1.0,
    "farther than 0.2 m": lambda pair: pair.row["range"] > 0.2,
    "plain barrel or pile": lambda pair: (
        pair.row["contrast"] == 0.0 and pair.row["object"] in SMOOTH
    ),
    "plain, other": lambda pair: pair.row["contrast"] == 0.0 and pair.row["object"] not in SMOOTH,
}


@experiment("fit_arm_camera", seeds=700, quick={"runs": 60})
def fit_arm_camera(case: KeyCase) -> KeyRow:
    """Renders the pictures of a case and aligns them."""
    return aligned_pictures(case)


def fitted_model(rows: list[Row]) -> list[Any]:
    """The fitted model, and its check against the pairs by groups."""
    if not rows:
        return []
    pairs = pairs_of(rows)
    model = fit(pairs)
    parameters = np.concatenate([model.texture, model.shape])

    cells = [
        (name, *figures_of([pair for pair in pairs if belongs(pair)], parameters))
        for name, belongs in GROUPS.items()
    ]
    table = Table(
        title="Errors of rendered pairs, camera axes, against the fitted model",
        columns=COLUMNS,
        rows=cells,
        caption="RMS of pairs that were not lost, in observed directions; stated: median of the "
        "model. NEES / n: squared error over the model's covariance by observed direction, "
        "outliers left out.",
    )
    return [table, to_toml(model), {"model": asdict(model), "pairs": len(pairs)}]


fit_arm_camera.page = Page().add(fitted_model)

if __name__ == "__main__":
    run_scenario(fit_arm_camera.main)
