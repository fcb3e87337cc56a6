"""Plugs moved from one receptacle into another: seat, forces and the hull, over random plugs.

A case draws the friction of the seat, the mass of the plug and the clearance of the receptacles. A
stuck plug does not come out; the time in which it is named after it stands against the set pull is
judged. Debris in the other receptacle is a jam.
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

FRICTION = (8.0, 28.0)  # [N] at which a plug breaks away
MASS = (0.4, 1.2)  # [kg] of a plug
CLEARANCE = (1.5, 3.0)  # [mm] radial
SPEED = 0.1  # [m/s] of the current
KINDS = ("plug", "stuck plug", "debris")
_ENDS = {"plug": "done", "stuck plug": "stuck", "debris": "jammed"}


@dataclass(frozen=True, kw_only=True)
class PlugCase:
    """One plug."""

    kind: str
    """Plug, stuck plug, or debris in the other receptacle."""
    seed: int

    def __post_init__(self) -> None:
        """Raise ConfigurationError for a kind that there is not."""
        one_of(self.kind, KINDS, "--kind")


@dataclass(frozen=True, kw_only=True)
class PlugRow:
    """How the move ended."""

    ended: str = column("ended")
    note: str = column("note")
    seated: bool = column("seated")
    friction: float = column("friction of the seat", "N", digits=1)
    mass: float = column("mass", "kg", digits=2)
    clearance: float = column("clearance", "mm", digits=2)
    pull: float | None = column("pull, peak", "N", digits=1, default=None)
    push: float | None = column("push, peak", "N", digits=1, default=None)
    side: float | None = column("side force, peak", "N", digits=1, default=None)
    grip: float | None = column("grip, peak", "N", digits=1, default=None)
    short: float | None = column("above the seat", "mm", digits=2, factor=1e3, default=None)
    aside: float | None = column("beside the axis", "mm", digits=2, factor=1e3, default=None)
    tilt: float | None = column("tilt", "deg", digits=2, factor=degrees(1.0), default=None)
    searched: float | None = column("searched", "s", digits=1, default=None)
    excursion: float | None = column("hull moved", "mm", digits=1, factor=1e3, default=None)
    collided: bool = column("collision", default=False)
    named: float | None = column("stuck, named after", "s", digits=2, default=None)


@experiment("plugs", seeds=50, vary={"kind": KINDS}, paired=True, quick={"runs": 1})
def plugs(case: PlugCase) -> PlugRow:
    """Moves one plug."""
    # The plug.
    streams = Streams(case.seed)
    friction = float(streams["friction"].uniform(*FRICTION))
    mass = float(streams["mass"].uniform(*MASS))
    clearance = float(streams["clearance"].uniform(*CLEARANCE))

    # The move.
    scenario = jobs.move_plug(
        friction=friction,
        mass=mass,
        clearance=clearance,
        seed=case.seed,
        current=(SPEED, 0.0, 0.0),
        stuck=case.kind == "stuck plug",
        debris=case.kind == "debris",
    )
    try:
        done = run(assemble(scenario))
    except UuvError as error:
        return PlugRow(
            ended="refused",
            note=str(error),
            seated=False,
            friction=friction,
            mass=mass,
            clearance=clearance,
        )

    # How it ended.
    metrics = done.assessment.metrics
    force = metrics["force"]
    seat = metrics["seat"]
    final = done.recording.final
    out = seat if case.kind == "plug" else dict.fromkeys(seat)
    return PlugRow(
        ended="done" if final.state is WorkState.DONE else str(final.abort or "late"),
        note=final.note,
        seated=bool(seat["seated"]),
        friction=friction,
        mass=mass,
        clearance=clearance,
        pull=force["pull_max_n"],
        push=force["push_max_n"],
        side=force["side_max_n"],
        grip=force["grip_max_n"],
        short=out["short_m"],
        aside=out["aside_m"],
        tilt=out["tilt_rad"],
        searched=metrics["searched_s"],
        excursion=metrics["hull"]["excursion_max_m"],
        collided=bool(done.recording["collision"].scalar.any()),
        named=metrics["named_s"],
    )


def _ended_as_it_should(row: Row) -> bool:
    """True if a plug that comes out was seated, and a stuck one or a jam was named."""
    return row["ended"] == _ENDS[row["kind"]] and (row["seated"] or row["kind"] != "plug")


def _is_refused(row: Row) -> bool:
    """True if the set forces are beyond what jaws, arm or thrusters can give."""
    return row["ended"] == "refused"


plugs.page = Page().table(
    "Plugs",
    by="kind",
    columns=[
        stat("count", "kind", "plugs"),
        stat("count", _ended_as_it_should, "seated, or named as stuck or jammed"),
        stat("count", _is_refused, "refused at the door"),
        stat("count", "collided"),
        stat("largest", "pull"),
        stat("largest", "push"),
        stat("largest", "side"),
        stat("largest", "short"),
        stat("largest", "aside"),
        stat("largest", "excursion"),
        stat("largest", "named"),
    ],
)


if __name__ == "__main__":
    run_scenario(plugs.main)
