"""Turns of valves by a lever and by a T-bar: angle, moment and the hull, over random valves.

A case draws the moment at which the valve breaks away, and the lever's radius; the set moment is
a half more. Each valve is also turned where it is stuck. Of what should turn, the angle is judged;
of what is stuck, the time in which it is named after it stands against the set moment.
"""

from uuv.start import run_scenario  # isort: skip

from dataclasses import dataclass
from math import degrees

from uuv import jobs
from uuv.assembly import assemble
from uuv.experiment import Page, Row, column, experiment, stat
from uuv.runner import run
from uuv.sim.interfaces.errors import UuvError
from uuv.sim.interfaces.messages import WorkState
from uuv.sim.interfaces.spatial import one_of
from uuv.sim.interfaces.streams import Streams

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
    mean: float | None = column("mean moment", "N m", digits=1, default=None)
    peak: float | None = column("peak", "N m", digits=1, default=None)
    share: float | None = column("peak over the set moment", digits=2, default=None)
    error: float | None = column("moment, RMS error", "%", digits=1, factor=100.0, default=None)
    angle: float | None = column("angle error", "deg", digits=2, factor=degrees(1.0), default=None)
    excursion: float | None = column("hull moved", "mm", digits=1, factor=1e3, default=None)
    named: float | None = column("stuck, named after", "s", digits=2, default=None)


@experiment(
    "turns", seeds=25, vary={"kind": KINDS}, paired=True, quick={"runs": 1, "kind": KINDS[:1]}
)
def turns(case: TurnCase) -> TurnRow:
    """Turns one valve."""
    # The valve.
    streams = Streams(case.seed)
    handle = case.kind.split()[-1]
    lever = handle == "lever"
    torque = float(streams["torque"].uniform(*(LEVER if lever else BAR)))
    radius = float(streams["radius"].uniform(*RADIUS))
    moment = OVER * torque

    # The turn.
    scenario = jobs.turn_valve(
        handle=handle,
        torque=torque,
        moment=moment,
        radius=radius,
        seed=case.seed,
        stuck=case.kind.startswith("stuck"),
    )
    try:
        done = run(assemble(scenario))
    except UuvError as error:
        return TurnRow(ended="refused", note=str(error), moment=moment)

    # How it ended.
    metrics = done.assessment.metrics
    figures = metrics["moment"]
    final = done.recording.final
    peak = figures["max_n_m"]
    named = metrics["named_s"]

    return TurnRow(
        ended="done" if final.state is WorkState.DONE else str(final.abort or "late"),
        note=final.note,
        moment=moment,
        mean=figures["mean_n_m"],
        peak=peak,
        share=None if peak is None else peak / moment,
        error=figures["error_rms"],
        angle=metrics["angle"]["error_rad"] if named is None else None,
        excursion=metrics["hull"]["excursion_max_m"],
        named=named,
    )


def _ended_as_it_should(row: Row) -> bool:
    """True if a valve that turns was turned, and a stuck one was named."""
    return row["ended"] == ("valve stuck" if row["kind"].startswith("stuck") else "done")


def _is_refused(row: Row) -> bool:
    """True if the set moment is beyond what tool, arm or thrusters can give."""
    return row["ended"] == "refused"


turns.page = Page().table(
    "Turns",
    by="kind",
    columns=[
        stat("count", "kind", "valves"),
        stat("count", _ended_as_it_should, "turned, or named as stuck"),
        stat("count", _is_refused, "refused at the door"),
        stat("largest", "angle"),
        stat("largest", "error"),
        stat("largest", "share"),
        stat("largest", "excursion"),
        stat("largest", "named"),
    ],
)


if __name__ == "__main__":
    run_scenario(turns.main)
