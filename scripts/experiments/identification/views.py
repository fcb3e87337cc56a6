"""Views until an object is accepted that is mostly hidden, by the order in which they are taken.

Spheres hide 20 to 45 %, or 72 to 85 %, of the object's image in the first view. If that view is not
accepted, further ones are taken from the six other places, 15, 30 and 45 deg aside to both sides,
until one is accepted. Orders: fixed, nearest first, as the tasks do without a proposal; widest,
farthest first; chosen, by `uuv.perception.finding.next_view`.
"""

from uuv.start import run_scenario  # isort: skip

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from experiments.identification.scene_cases import identified, surface_of
from uuv.clouds.frames import CAMERAS
from uuv.clouds.scene_kinds import NAMES, draw
from uuv.experiment import Page, column, experiment, stat
from uuv.perception.finding.next_view import ranked_views, views_around
from uuv.perception.registration.identification import Identification
from uuv.sim.interfaces.spatial import Array, inverse

Order = Literal["fixed", "widest", "chosen"]
ORDERS: tuple[Order, ...] = ("fixed", "widest", "chosen")
KINDS = ("hidden", "hidden_most")  # in the others one view suffices, or none does
MOST = 7  # views: the first one, and all six others


@dataclass(frozen=True, kw_only=True)
class ViewCase:
    """One scene for one sensor."""

    sensor: str
    """Name of the sensor."""
    object: str
    """Name of the object."""
    kind: str
    """How much of the object is hidden."""
    seed: int


@dataclass(frozen=True, kw_only=True)
class ViewRow:
    """Views until accepted, in each order; None if the first view sufficed."""

    first: bool = column("the first view sufficed")
    right: bool | None = column("and rightly", default=None)
    looks: Mapping[str, int | None] | None = column("views", by="order", default=None)
    pose_right: Mapping[str, bool] | None = column("pose right", by="order", default=None)


@experiment(
    "views", seeds=200, vary={"sensor": CAMERAS, "object": NAMES, "kind": KINDS}, quick={"runs": 6}
)
def looks_needed(case: ViewCase) -> ViewRow:
    """Takes views of a scene in each order until one is accepted."""
    scene = draw(case.object, case.kind, case.seed, case.sensor)
    start = identified(scene, surface_of(case.object))
    if start.accepted:
        return ViewRow(first=True, right=scene.is_found(start.X_sensor_target))

    # The views are turned about the place where the object was expected: the first one may have
    # found it elsewhere.
    views = views_around(scene.approach, scene.X_CT[:3, 2])
    taken = {order: _views_taken(case, start, views, order) for order in ORDERS}
    return ViewRow(
        first=False,
        looks={order: count for order, (count, _) in taken.items()},
        pose_right={order: right for order, (_, right) in taken.items()},
    )


def _views_taken(
    case: ViewCase, start: Identification, views: list[Array], order: Order
) -> tuple[int | None, bool]:
    """Number of views until one is accepted, the first one counted, and whether its pose is right;
    None and False if none is.
    """
    left, last, X_CS = list(range(len(views))), start, np.eye(4)
    while left:
        pick = left[-1] if order == "widest" else left[0]
        if order == "chosen":
            ranked = ranked_views(last, [inverse(X_CS) @ views[i] for i in left])
            pick = left[ranked[0]] if ranked else left[0]

        left.remove(pick)
        X_CS = views[pick]
        scene = draw(case.object, case.kind, case.seed, case.sensor, X_CS, pick + 1)
        last = identified(scene, surface_of(case.object))
        if last.accepted:
            return 1 + len(views) - len(left), scene.is_found(last.X_sensor_target)
    return None, False


looks_needed.page = (
    Page()
    .share("first")
    .table(
        "Views until accepted, of scenes whose first view did not suffice",
        by="order",
        columns=[
            stat("mean", "looks", f"mean, never accepted as {MOST + 1}", none=MOST + 1),
            stat("share", lambda row: row["looks"] == 2, "second view sufficed"),
            stat("share", lambda row: (row["looks"] or MOST) <= 3, "within three views"),
            stat("share", lambda row: row["looks"] is None, "never accepted"),
            stat("count", lambda row: row["looks"] and not row["pose_right"], "accepted wrongly"),
        ],
    )
    .histogram("looks", "Views until accepted", by="order", none="never")
)

if __name__ == "__main__":
    run_scenario(looks_needed.main)
