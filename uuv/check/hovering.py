"""Verdict on station keeping: by statics if an axis has no thruster, otherwise by simulation."""

from dataclasses import dataclass, replace

import mujoco
import numpy as np

from uuv.check.findings import JobVerdict
from uuv.check.hover import HoverFigures, hover
from uuv.check.statics import Listing, listing_of
from uuv.controllers.hull.allocation import MOST_LIST
from uuv.controllers.tasks.hull_phases import RestLimits
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.errors import UuvError

DRIFT = 0.1  # [m] at most, of a vehicle that keeps station
TILT = float(np.radians(10.0))  # [rad] at most
SATURATED = 0.3  # share of the time at most at which a thruster may be at its limit

Current = tuple[float, float, float]  # [m/s] in world axes


def hover_verdict(name: str, model: mujoco.MjModel, current: Current) -> JobVerdict:
    """Verdict on station keeping in a steady current."""
    vehicle = Vehicle.of(model)
    listing = listing_of(model, vehicle, np.array(vehicle.q_home))
    if listing is not None and not listing.angle <= MOST_LIST:
        return listed(name, listing)
    hovered = _hovering(model, current)
    if isinstance(hovered, JobVerdict):
        return replace(hovered, job=name)
    verdict = _kept(name, hovered)
    return (
        verdict
        if listing is None
        else replace(verdict, said=f"{verdict.said}; {listing.in_words()}")
    )


def refused(job: str, code: str, message: str, figure: float | None = None) -> JobVerdict:
    """Refusal of a job."""
    return JobVerdict(job=job, promised=False, code=code, said=message, figure=figure)


def listed(name: str, listing: Listing) -> JobVerdict:
    """Refusal of a hull that lists too far."""
    reason = f"{listing.in_words()}, at most {np.degrees(MOST_LIST):.0f} deg"
    return refused(name, "list", reason, float(np.degrees(listing.angle)))


def _hovering(
    model: mujoco.MjModel, current: Current, until_rest: float = 0.0
) -> HoverFigures | JobVerdict:
    """Figures of station keeping, or a refusal if the vehicle cannot be controlled."""
    try:
        return hover(model, current, until_rest=until_rest)
    except UuvError as error:
        return JobVerdict(job="hover", promised=False, code="thrust", said=str(error))


def _kept(name: str, hovered: HoverFigures) -> JobVerdict:
    power = "" if hovered.power is None else f", {hovered.power:.0f} W"
    figures = (
        f"{1e3 * hovered.drift:.0f} mm position error, {np.degrees(hovered.tilt):.1f} deg, "
        f"{hovered.saturated:.0%} saturated{power}"
    )

    if hovered.said:
        return JobVerdict(
            job=name, promised=False, code="hover", said=hovered.said, figure=hovered.drift
        )

    bounds = ((hovered.drift, DRIFT), (hovered.tilt, TILT), (hovered.saturated, SATURATED))
    good = all(value <= most for value, most in bounds)
    text = (
        figures
        if good
        else (
            f"{figures}; limits {1e3 * DRIFT:.0f} mm, {np.degrees(TILT):.0f} deg, {SATURATED:.0%}"
        )
    )

    return JobVerdict(
        job=name, promised=good, code="ok" if good else "hover", said=text, figure=hovered.drift
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class RestVerdict:
    """Verdict on station keeping before a job of the arm."""

    refusal: JobVerdict | None = None  # of a vehicle that does not keep station, or come to rest
    swing: float = 0.0  # [m] largest motion of any point of the vehicle from its place


def rest_of(name: str, model: mujoco.MjModel, current: Current) -> RestVerdict:
    """Verdict on a vehicle's station keeping in a job's current."""
    limits = RestLimits()
    hovered = _hovering(model, current, limits.within)
    speed = float(np.linalg.norm(current))
    if isinstance(hovered, JobVerdict):
        return RestVerdict(refusal=_unsteady(name, speed, hovered))

    verdict = _kept(name, hovered)
    if not verdict.promised:
        return RestVerdict(refusal=_unsteady(name, speed, verdict), swing=hovered.swing)

    if hovered.rest >= limits.time:
        return RestVerdict(swing=hovered.swing)
    message = (
        f"in {speed:.2f} m/s the hover is not steady for {limits.time:g} s: {hovered.turn:.2g} "
        f"rad/s (limit {limits.turn:g}); minimum thrust or dead band of the thrusters?"
    )
    return RestVerdict(refusal=refused(name, "rest", message, hovered.turn), swing=hovered.swing)


def _unsteady(name: str, speed: float, verdict: JobVerdict) -> JobVerdict:
    message = f"no station keeping in {speed:.2f} m/s: {verdict.said}"
    return refused(name, verdict.code, message, verdict.figure)
