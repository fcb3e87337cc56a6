"""Looks needed until an object is accepted, by the order in which further views are taken.

fixed: nearest first, as the tasks do without a proposal; widest: farthest first; chosen: by
`uuv.perception.finding.next_view`.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from experiments.identification.decision_rates import surface_of
from uuv.clouds.object_scenes import ObjectScene
from uuv.clouds.scene_kinds import draw
from uuv.experiment import Row, Summary, Table
from uuv.perception.finding.next_view import ranked_views, views_around
from uuv.perception.registration.identification import Identification, identify
from uuv.sim.interfaces.spatial import inverse

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ORDERS = ("fixed", "widest", "chosen")
MOST = 7  # looks: the first view, and all six others
KINDS = ("hidden", "hidden_most")  # in the others one look suffices, or none does


@dataclass(frozen=True)
class ViewCase:
    """One scene for one sensor; a case of the study."""

    name: str
    kind: str
    sensor: str
    seed: int


def run(task: ViewCase) -> Row:
    """Number of looks in each order; no row if the first look suffices."""
    first = draw(task.name, task.kind, task.seed, task.sensor)
    start = _identified(task, first)
    row: Row = {"object": task.name, "kind": task.kind, "sensor": task.sensor, "seed": task.seed}
    if start.accepted:
        return {**row, "first": True, "right": first.is_found(start.X_sensor_target)}
    # The views are turned about the place where the object was expected: the first look may have
    # found it elsewhere.
    views = views_around(first.approach, first.X_CT[:3, 2])
    looks = {}
    for order in ORDERS:
        left, found, X_CS, count, right = list(range(len(views))), start, np.eye(4), 1, False
        while left:
            pick = left[-1] if order == "widest" else left[0]
            if order == "chosen":
                ranked = ranked_views(found, [inverse(X_CS) @ views[i] for i in left])
                pick = left[ranked[0]] if ranked else left[0]
            left.remove(pick)
            count, X_CS = count + 1, views[pick]
            scene = draw(task.name, task.kind, task.seed, task.sensor, X_CS, pick + 1)
            found = _identified(task, scene)
            if found.accepted:
                right = scene.is_found(found.X_sensor_target)
                break
        looks[order] = {"looks": count if found.accepted else None, "right": right}
    return {
        **row,
        "first": False,
        **{f"{order}_{key}": value for order in ORDERS for key, value in looks[order].items()},
    }


def _identified(task: ViewCase, scene: ObjectScene) -> Identification:
    return identify(
        scene.scan,
        surface_of(task.name),
        scene.approach,
        scene.orientation,
        sensor=scene.sensor.model,
    )


def summarise(rows: list[Row]) -> Summary:
    """Looks needed in each order, over the scenes whose first look did not suffice."""
    rows = sorted(rows, key=lambda row: row["seed"])
    hard = [row for row in rows if not row["first"]]
    metrics = {
        "scenes": len(rows),
        "first look sufficed": len(rows) - len(hard),
        **{order: _figures(hard, order) for order in ORDERS},
    }
    shown = [(order, *(f"{value:.3g}" for value in metrics[order].values())) for order in ORDERS]
    return Summary(
        metrics=metrics,
        tables=[
            Table(
                title=f"Looks until accepted, over {len(hard)} scenes whose first look did not "
                "suffice",
                columns=("order", *metrics[ORDERS[0]]),
                rows=shown,
            )
        ],
        lines=[f"{len(hard)} of {len(rows)} scenes needed a further look"],
        pictures=_pictures(hard),
    )


def _figures(rows: list[Row], order: str) -> dict[str, float]:
    looks = [row[f"{order}_looks"] for row in rows]
    capped = [MOST + 1 if count is None else count for count in looks]
    count = max(1, len(rows))
    return {
        "mean looks": float(np.mean(capped)) if capped else 0.0,
        "second look sufficed [%]": 100.0 * sum(look == 2 for look in looks) / count,
        "within three looks [%]": 100.0
        * sum(look is not None and look <= 3 for look in looks)
        / count,
        "never accepted [%]": 100.0 * sum(look is None for look in looks) / count,
        "accepted wrongly": float(
            sum(row[f"{order}_looks"] is not None and not row[f"{order}_right"] for row in rows)
        ),
    }


def _pictures(rows: list[Row]) -> Iterator[tuple[str, str, "Figure"]]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 3.0), layout="constrained")
    axes = figure.subplots()
    bins = np.arange(2, MOST + 2)
    for i, order in enumerate(ORDERS):
        counts = [sum(row[f"{order}_looks"] == look for row in rows) for look in bins[:-1]]
        counts.append(sum(row[f"{order}_looks"] is None for row in rows))
        axes.bar(bins + 0.27 * (i - 1), counts, width=0.27, label=order)
    axes.set_xticks(bins, [*map(str, bins[:-1]), "never"])
    axes.set_xlabel("looks until accepted")
    axes.set_ylabel("scenes")
    axes.legend()
    yield "Looks", "Of scenes whose first look did not suffice.", figure
