"""Turns of valves by a lever and by a T-bar: angle, moment and the hull, over random valves.

A case draws the moment at which the valve breaks away, and the lever's radius; the set moment is
a half more. Each valve is also turned where it is stuck. Of what should turn, the angle is judged;
of what is stuck, the time in which it is named after it stands against the set moment.
"""

from uuv.start import run_scenario  # isort: skip

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import degrees

from uuv import jobs
from uuv.assembly import assemble
from uuv.experiment import Page, Row, column, experiment, stat
from uuv.runner import run
from uuv.sim.interfaces.errors import UuvError
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.spatial import one_of
from uuv.sim.interfaces.streams import Streams
from uuv.site import HandValve

LEVER = (7.0, 20.0)  # [N m] at which a valve with a lever breaks away
RADIUS = (0.25, 0.4)  # [m] of the lever
BAR = (2.5, 8.0)  # [N m] at which a valve with a T-bar breaks away
OVER = 1.5  # set moment over that
KINDS = ("lever", "bar", "stuck lever", "stuck bar")


@dataclass(frozen=True, kw_only=True)
class TurnCase:
    """One valve."""

    kind: str
    """Handle, and whether the valve is stuck."""
    seed: int

    def __post_init__(self) -> None:
        """Raise ConfigurationError for a kind that there is not."""
        one_of(self.kind, KINDS, "--kind")


@dataclass(frozen=True, kw_only=True)
class TurnRow:
    """How the turn ended."""

    ended: str = column("ended")
    note: str = column("note")
    moment: float = column("set moment", "N m", digits=1)
    mean: float | None = column("mean moment", "N m", digits=1)
    peak: float | None = column("peak", "N m", digits=1)
    share: float | None = column("peak over the set moment", digits=2)
    error: float | None = column("moment, RMS error", "%", digits=1, factor=100.0)
    angle: float | None = column("angle error", "deg", digits=2, factor=degrees(1.0))
    excursion: float | None = column("hull moved", "mm", digits=1, factor=1e3)
    named: float | None = column("stuck, named after", "s", digits=2)


def cases(case: TurnCase) -> Iterator[TurnCase]:
    """The case; every kind sees the same valves."""
    yield case


@experiment("turns", seeds=25, vary={"kind": KINDS}, paired=True, quick={"runs": 1})
def turns(case: TurnCase) -> TurnRow:
    """Turns one valve."""
    streams = Streams(case.seed, 71)
    handle = case.kind.split()[-1]
    lever = handle == "lever"
    torque = float(streams["torque"].uniform(*(LEVER if lever else BAR)))
    radius = float(streams["radius"].uniform(*RADIUS))
    scenario = jobs.turn_valve(
        handle=handle, torque=torque, moment=OVER * torque, seed=case.seed, stuck=len(case.kind) > 5
    )
    valve = scenario.site.object
    assert isinstance(valve, HandValve)
    site = replace(scenario.site, object=replace(valve, radius=radius))

    try:
        done = run(assemble(replace(scenario, site=site)))
    except UuvError as error:
        return TurnRow(
            ended="refused",
            note=str(error),
            moment=OVER * torque,
            **dict.fromkeys(
                ("mean", "peak", "share", "error", "angle", "excursion", "named"), None
            ),
        )
    metrics = done.assessment.metrics
    final = done.recording.final
    moment = metrics["moment"]
    peak = moment["max_n_m"]
    return TurnRow(
        ended="done" if final.state is WorkState.DONE else str(final.abort or "late"),
        note=final.note,
        moment=OVER * torque,
        mean=moment["mean_n_m"],
        peak=peak,
        share=None if peak is None else peak / (OVER * torque),
        error=moment["error_rms"],
        angle=None if metrics["named_s"] is not None else metrics["angle"]["error_rad"],
        excursion=metrics["hull"]["excursion_max_m"],
        named=metrics["named_s"],
    )


def _ended_as_it_should(row: Row) -> bool:
    """True if a valve that turns was turned, and a stuck one was named."""
    return row["ended"] == ("valve stuck" if row["kind"].startswith("stuck") else "done")


turns.page = Page().table(
    "Turns",
    by="kind",
    columns=[
        stat("count", "kind", "valves"),
        stat("count", _ended_as_it_should, "turned, or named as stuck"),
        stat("largest", "angle"),
        stat("largest", "error"),
        stat("largest", "share"),
        stat("largest", "excursion"),
        stat("largest", "named"),
    ],
)


if __name__ == "__main__":
    run_scenario(turns.main)
