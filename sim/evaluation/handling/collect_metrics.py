"""Metrics of a collection, from its recording and the true object.

The object counts as lifted from the first moment at which it has left its place by LIFTED while the
jaws hold it, and as put when the jaws let it go. Its slip is its largest motion in the tool's frame
between the two. The grip force is the true one of the first pad.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from uuv.sim.evaluation.assessment import Assessment
from uuv.sim.evaluation.requirement import Requirement
from uuv.sim.evaluation.run_metrics import run_schema
from uuv.sim.evaluation.schemas import metric, unmeasured
from uuv.sim.interfaces.messages import HeldLoad, WorkState
from uuv.sim.interfaces.spatial import Array

if TYPE_CHECKING:
    from uuv.sim.loop.recording import Recording

LIFTED = 0.02  # [m] over its place at which the object counts as lifted
_AFTER = 10.0  # [s] after the lift in which the hull's excursion counts
_MM = 1e3  # [mm/m]


@dataclass(frozen=True, slots=True, kw_only=True)
class CollectBounds:
    """Acceptance bounds of a collection."""

    put: float = 0.03  # [m] from the basket's middle, in the horizontal
    mass_share: float = 0.1  # of the true mass, of the identified one,
    mass: float = 0.05  # [kg] or this, whichever is more
    grip_share: float = 1.5  # of the set grip force, at the peak
    excursion: float = 0.05  # [m] of the hull after the lift
    slip: float = 0.01  # [m] of the object in the jaws


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrueCollection:
    """True object and basket, and the set grip force."""

    basket_W: Array  # (3,) [m] middle of the basket's floor
    center_T: Array  # (3,) [m] middle of the object in its frame
    half: float  # [m] half of the basket's inner side
    mass: float  # [kg] of the object
    weight: float  # [N] of the object in water
    grip: float  # [N] set force of each finger


@dataclass(frozen=True, slots=True, kw_only=True)
class PutMetrics:
    """Where the object ended."""

    lifted: bool
    in_basket: bool
    put_error_m: float | None = metric("From the basket's middle, in the horizontal, at the end.")


@dataclass(frozen=True, slots=True, kw_only=True)
class GripMetrics:
    """The grip from the closing of the jaws until they let go."""

    force_set_n: float | None
    force_mean_n: float | None = metric("True, of the first pad, from the lift on.")
    force_max_n: float | None = metric("Largest of a physics step, of the first pad.")
    slip_max_m: float | None = metric("Motion of the object in the tool's frame after the lift.")


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadMetrics:
    """The load after the lift."""

    weight_n: float | None = metric("True, in water.")
    weighed_n: float | None = metric("As the vehicle has weighed it; null if it did not.")
    mass_kg: float | None = metric("True mass.")
    identified_kg: float | None = metric("Mass as identified after the lift.")
    hull_excursion_max_m: float | None = metric("From its reference, within 10 s of the lift.")


@dataclass(frozen=True, slots=True, kw_only=True)
class CollectMetrics:
    """Metrics of a collection."""

    put: PutMetrics
    grip: GripMetrics
    load: LoadMetrics


def schema() -> dict[str, Any]:
    """JSON Schema of the metrics.json of a collection."""
    return run_schema(
        CollectMetrics, "Figures of a collection", "What the job collect writes to metrics.json"
    )


def assess_collection(
    recording: "Recording",
    truth: TrueCollection,
    *,
    seed: int,
    wall_s: float,
    weighed: HeldLoad | None = None,
    bounds: CollectBounds | None = None,
) -> Assessment:
    """All metrics of a run; one that could not be measured is None and counts as missed.

    Args:
        recording: The run.
        truth: True object and basket.
        seed: Seed of the run.
        wall_s: Wall time of the loop [s].
        weighed: The object as the vehicle has weighed it; None: it did not.
        bounds: Acceptance bounds; default: `CollectBounds()`.

    Returns:
        The assessment.
    """
    bounds = bounds or CollectBounds()
    held = carried(recording)
    put = _put(recording, truth, lifted=bool(held.any()))
    grip = _grip(recording, truth, held)
    load = LoadMetrics(
        weight_n=truth.weight,
        weighed_n=None if weighed is None else weighed.weight,
        mass_kg=truth.mass,
        identified_kg=None if weighed is None else weighed.mass,
        hull_excursion_max_m=_excursion(recording, held),
    )

    metrics = CollectMetrics(put=put, grip=grip, load=load)
    most = bounds.grip_share * truth.grip

    # What is asked for.
    error = None if weighed is None else abs(weighed.weight - truth.weight)
    mass_error = None if weighed is None else abs(weighed.mass - truth.mass)
    most_mass = max(bounds.mass, bounds.mass_share * truth.mass)
    checks = (
        Requirement("put, distance from the middle", put.put_error_m, bounds.put, "mm", _MM),
        Requirement("grip force, mean", grip.force_mean_n, None, "N"),
        Requirement("grip force, peak", grip.force_max_n, most, "N"),
        Requirement("object slips in the jaws", grip.slip_max_m, bounds.slip, "mm", _MM),
        Requirement("weight in water, error", error, None, "N"),
        Requirement("mass, error", mass_error, most_mass, "kg"),
        Requirement(
            "hull excursion after the lift", load.hull_excursion_max_m, bounds.excursion, "mm", _MM
        ),
    )
    others = () if put.in_basket else ("the object is not in the basket",)
    return Assessment.of(recording, metrics, checks, seed=seed, wall_s=wall_s, others=others)


def carried(recording: "Recording") -> np.ndarray:
    """Mask (N,) of the steps in which the lifted object is in the jaws, at work."""
    if "p_WT" not in recording:
        return np.zeros(len(recording["state"].time), dtype=bool)

    height = recording["p_WT"].value[:, 2]
    work = recording.within(WorkState.WORK)
    pressed = recording["contact_normal"].scalar > 0.0
    return work & pressed & (height > height[0] + LIFTED)


def _put(recording: "Recording", truth: TrueCollection, *, lifted: bool) -> PutMetrics:
    if "p_WT" not in recording or not lifted:
        return unmeasured(PutMetrics, lifted=lifted, in_basket=False)

    center = _centers(recording, truth)[-1]
    off = center - truth.basket_W
    inside = bool(np.all(np.abs(off[:2]) < truth.half))
    return PutMetrics(lifted=True, in_basket=inside, put_error_m=float(np.hypot(off[0], off[1])))


def _grip(recording: "Recording", truth: TrueCollection, held: np.ndarray) -> GripMetrics:
    if not held.any():
        return unmeasured(GripMetrics, force_set_n=truth.grip)

    closing = recording.within(WorkState.PRESS) | held
    place_G = _in_tool(recording, truth)[held]

    return GripMetrics(
        force_set_n=truth.grip,
        force_mean_n=float(recording["contact_normal"].scalar[held].mean()),
        force_max_n=float(recording["contact_most"].scalar[closing].max()),
        slip_max_m=float(np.linalg.norm(place_G - place_G[0], axis=1).max()),
    )


def _excursion(recording: "Recording", held: np.ndarray) -> float | None:
    if not held.any():
        return None

    first = int(np.flatnonzero(held)[0])
    upto = first + round(_AFTER / recording.timestep)
    off = recording["p_WB"].value[first:upto] - recording["p_WB_reference"].value[first:upto]
    return float(np.linalg.norm(off, axis=1).max())


def _centers(recording: "Recording", truth: TrueCollection) -> Array:
    """Middle (N, 3) [m] of the object in W."""
    R_WT = _rotations(recording["quat_WT_wxyz"].value)
    return recording["p_WT"].value + R_WT @ truth.center_T


def _in_tool(recording: "Recording", truth: TrueCollection) -> Array:
    """Middle (N, 3) [m] of the object from the tip, in tool axes."""
    away = _centers(recording, truth) - recording["p_pad"].value
    x = recording["tool_x"].value
    z = recording["tool_axis"].value
    axes = np.stack([x, np.cross(z, x), z], axis=1)
    return np.einsum("nij,nj->ni", axes, away)


def _rotations(quat_wxyz: Array) -> Array:
    """Rotations (N, 3, 3) of unit quaternions (N, 4)."""
    w, x, y, z = quat_wxyz.T
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.moveaxis(np.array(rows), 2, 0)
