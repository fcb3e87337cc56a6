"""Station keeping under pushes at the tool, at full reach and in many directions, with ablations.

Pushes are external forces at the tip; the drives are stiff. The figures of a case are over its
pushes. Envelope: excursion of the hull with and without compensation, by current. Ablation: errors
of lag, dead band and coefficients, and the thruster lead. Lost: each thruster stops during a push;
two seconds later the push ends, and the hull keeps station on the remaining thrusters.
"""

from uuv.start import run_scenario  # isort: skip

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from experiments.vehicles import pushing
from experiments.vehicles.pushed_hover import authority_table, flow, push_case
from experiments.vehicles.pushing import PushCase
from uuv.experiment import Page, Row, Table, column, experiment, stat
from uuv.experiment.options import at_least
from uuv.models.vehicle import Vehicle
from uuv.own_vehicle import vehicle_spec

USUAL_CURRENT = 0.2  # [m/s]
DEGREES = math.degrees(1.0)


@dataclass(frozen=True, kw_only=True)
class Pushes:
    """Which pushes."""

    table: str
    """Quantity that is varied."""
    directions: int = 14
    """Number of directions of the push, spread over the sphere, the six axes first."""
    force: float = 90.0
    """Force of the push [N]."""
    currents: tuple[float, ...] = (0.0, 0.2, 0.4)
    """Speeds of the current [m/s] in the envelope, at 30 degrees from ahead."""
    posture: Literal["ahead", "aside", "down"] = "ahead"
    """Posture of the arm, stretched out."""
    gust: float = 0.03
    """Standard deviation of the gusts [m/s] per axis."""
    seed: int = 0
    """Seed of sensor noise and gusts."""

    def __post_init__(self) -> None:
        at_least(self, directions=1)


@dataclass(frozen=True, kw_only=True)
class HoverCase:
    """One vehicle and controller in one current, pushed in all directions one after the other."""

    table: str
    variant: str
    current: float
    """Speed of the current [m/s]."""
    directions: int
    force: float
    """Force of the push [N]."""
    posture: str
    gust: float
    """Standard deviation of the gusts [m/s]."""
    seed: int


@dataclass(frozen=True, kw_only=True)
class HoverRow:
    """Figures of a case, one entry for each push."""

    excursion: Sequence[float] = column("excursion", "mm", digits=1, factor=1e3)
    tilt: Sequence[float] = column("tilt", "deg", digits=1, factor=DEGREES)
    turn: Sequence[float] = column("turn", "deg", digits=1, factor=DEGREES)
    saturated: Sequence[float] = column("saturated", "%", digits=1, factor=100.0)
    force_error: Sequence[float] = column("force error", "N", digits=0)
    current_error: Sequence[Sequence[float]] = column("current error", "mm/s", digits=0, factor=1e3)
    command_rate: float = column("command rate", "1/s", digits=2)


def variants(table: str, push: PushCase) -> dict[str, PushCase]:
    """Cases of a table by the name of what is varied.

    Args:
        table: Of TABLES.
        push: Case with the nominal vehicle and controller.
    """
    return TABLES[table](push)


def envelope(push: PushCase) -> dict[str, PushCase]:
    """With and without compensation."""
    return {"compensation": push, "no compensation": replace(push, compensation=False)}


def ablation(push: PushCase) -> dict[str, PushCase]:
    """The nominal controller, each ablation and each model error."""
    push = replace(push, settle=8.0, push=3.0, rest=1.5)
    return {
        "as it is: lag 0.15 s, dead band 5 %, coefficients 15 % wrong": push,
        "no lead": replace(push, response=1e6),
        "no compensation": replace(push, compensation=False),
        "lag 0.0 s": replace(push, lag=0.0),
        "lag 0.3 s": replace(push, lag=0.3),
        "lag 0.3 s, no lead": replace(push, lag=0.3, response=1e6),
        "lag believed -50 % wrong": replace(push, lag_error=-0.5),
        "lag believed +50 % wrong": replace(push, lag_error=0.5),
        "dead band 0 %": replace(push, dead_band=0.0),
        "dead band 10 %": replace(push, dead_band=0.1),
        "coefficients -30 % wrong": replace(push, water_error=-0.3),
        "coefficients +30 % wrong": replace(push, water_error=0.3),
    }


def lost(push: PushCase) -> dict[str, PushCase]:
    """Each thruster lost, unnoticed and known after 0.5 s."""
    vehicle = Vehicle.of(vehicle_spec(push.vehicle).compile())
    push = replace(push, directions_B=push.directions_B[:1], settle=8.0, push=4.0, rest=8.0)

    named = {}
    for thruster, name in enumerate(vehicle.thruster_names):
        named[f"{name} lost, unnoticed"] = replace(push, lost=thruster)
        named[f"{name} lost, known after 0.5 s"] = replace(push, lost=thruster, noticed=0.5)
    return named


TABLES = {"envelope": envelope, "ablation": ablation, "lost": lost}


def cases(pushes: Pushes) -> Iterator[HoverCase]:
    """Cases of one table, those of the envelope for each current."""
    shared = {
        "table": pushes.table,
        "directions": pushes.directions,
        "force": pushes.force,
        "posture": pushes.posture,
        "gust": pushes.gust,
        "seed": pushes.seed,
    }

    for speed in pushes.currents if pushes.table == "envelope" else (USUAL_CURRENT,):
        nominal = HoverCase(variant="", current=speed, **shared)
        # the names need no more than the nominal case
        for variant in variants(pushes.table, _push(nominal)):
            yield replace(nominal, variant=variant)


def _push(case: HoverCase) -> PushCase:
    """Pushes of a case with the nominal vehicle and controller."""
    push = push_case(case.directions, case.force, case.posture, case.gust, case.seed)

    return replace(push, current_W=flow(case.current))


@experiment(
    "hover",
    vary={"table": tuple(TABLES)},
    cases=cases,
    quick={"table": ("envelope",), "currents": (0.2,)},
)
def hover(case: HoverCase) -> HoverRow:
    """Simulates the pushes of a case."""
    figures = pushing.run(variants(case.table, _push(case))[case.variant])
    return HoverRow(
        excursion=figures.excursion.tolist(),
        tilt=figures.tilt.tolist(),
        turn=figures.turn.tolist(),
        saturated=figures.saturated.tolist(),
        force_error=figures.force_error.tolist(),
        current_error=figures.current_error.tolist(),
        command_rate=figures.command_rate,
    )


def authority(rows: list[Row]) -> list[Table]:
    """Wrench that the thrusters are capable of, beside the cases in which one is lost."""
    return [authority_table()] if any(row["table"] == "lost" for row in rows) else []


FIGURES = [
    stat("spread", "excursion", "excursion"),
    stat("spread", "tilt", "tilt"),
    stat("spread", "turn", "turn"),
    stat("mean", "saturated", "saturated"),
    stat("mean", "force_error", "force error"),
    stat("rms", "current_error", "current error"),
    stat("mean", "command_rate", "command rate"),
]

hover.page = Page()
for name in TABLES:
    hover.page.table(
        f"Pushes at full reach, {name}: median, 95 %, largest; others are means",
        by=("current", "variant"),
        columns=FIGURES,
        where=lambda row, name=name: row["table"] == name,
    )
hover.page.add(authority)
hover.line = lambda row: (
    f"{row['current']} m/s, {row['variant']}: "
    + " | ".join(figure.bound_to(hover.columns, "line").cell([row]) for figure in FIGURES)
)

if __name__ == "__main__":
    run_scenario(hover.main)
