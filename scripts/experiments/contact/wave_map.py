"""Contact work in regular waves: one run, and the map of frequency, direction and amplitude."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from uuv.assembly import assemble
from uuv.campaigns.contact_study import DAMAGED, KEPT, PathName, StudyBounds, classify, figures_of
from uuv.experiment import Row, Summary, Table
from uuv.jobs import clean_barrel
from uuv.runner import run
from uuv.sim.interfaces.messages import AbortCode

# of the water's motion against the hull's heading at the scan
DIRECTIONS = ("along", "across", "up", "oblique")
_OF = {
    "along": (1.0, 0.0, 0.0),
    "across": (0.0, 1.0, 0.0),
    "up": (0.0, 0.0, 1.0),
    "oblique": (0.6, 0.64, 0.48),
}
BLAMED = str(AbortCode.THRUSTER)


@dataclass(frozen=True, slots=True, kw_only=True)
class WaveTask:
    """One run; a case of the study."""

    amplitude: float  # [m/s] of the water's velocity
    frequency: float  # [Hz]
    direction: str  # a name in DIRECTIONS
    path: PathName
    seed: int
    quick: bool


def one_run(task: WaveTask) -> Row:
    """Row of a run: its outcome, and its figures."""
    scenario = clean_barrel(seed=task.seed, path=task.path, quick=task.quick)
    heading = assemble(scenario).X_WB[:3, :3] @ _OF[task.direction]
    wave = tuple((task.amplitude * heading).tolist())
    site = replace(scenario.site, wave=wave, wave_frequency=task.frequency)
    outcome = run(replace(scenario, site=site))
    figures = figures_of(outcome)
    ended = classify(outcome, figures, StudyBounds())
    return {
        "amplitude": task.amplitude,
        "frequency": task.frequency,
        "direction": task.direction,
        "path": task.path,
        "seed": task.seed,
        "class": ended["class"],
        "kind": ended["kind"],
        "detail": ended["detail"],
        "force_peak_n": figures["force_peak_n"],
        "force_over_set": figures["force_over_set"],
        "excursion_m": figures["hull_excursion_max_m"],
    }


def line(row: Row) -> str:
    """Line about a run that blames a thruster, or does damage; empty for others."""
    if row["kind"] != BLAMED and row["class"] != DAMAGED:
        return ""
    return (
        f"{_name(row)}, seed {row['seed']}, {row['path']}: {row['class']}, {row['kind']}: "
        f"{row['detail']}"
    )


def _name(row: Row) -> str:
    return f"{row['amplitude']:g} m/s at {row['frequency']:g} Hz {row['direction']}"


def summarise(rows: list[Row]) -> Summary:
    """Outcomes by wave: worked within the bounds, worked outside of them, broken off or refused,
    and for what.

    A sound thruster that is called lost fails the study.
    """
    amplitudes = sorted({row["amplitude"] for row in rows})
    columns = ("direction", "frequency [Hz]", *(f"{amplitude:g} m/s" for amplitude in amplitudes))
    told = [
        (
            direction,
            f"{frequency:g}",
            *(
                _cell(
                    [
                        row
                        for row in rows
                        if (row["direction"], row["frequency"], row["amplitude"]) == key
                    ]
                )
                for key in ((direction, frequency, amplitude) for amplitude in amplitudes)
            ),
        )
        for direction in dict.fromkeys(row["direction"] for row in rows)
        for frequency in sorted({row["frequency"] for row in rows})
    ]
    kinds = sorted({(row["class"], row["kind"]) for row in rows})
    ends = [
        (
            outcome,
            kind or "–",
            str(sum((row["class"], row["kind"]) == (outcome, kind) for row in rows)),
        )
        for outcome, kind in kinds
    ]
    blamed = [line(row) for row in rows if row["kind"] == BLAMED]
    return Summary(
        metrics={
            "runs": len(rows),
            "kept": sum(row["class"] == KEPT for row in rows),
            "blamed": len(blamed),
            "force_over_set": max((row["force_over_set"] or 0.0 for row in rows), default=0.0),
        },
        tables=[
            Table(
                title="Kept of all; peak force error [N], hull excursion [mm] of those that worked",
                columns=columns,
                rows=told,
                labels=2,
            ),
            Table(
                title="How the runs ended", columns=("outcome", "for", "runs"), rows=ends, labels=2
            ),
        ],
        failed=blamed,
    )


def _cell(rows: list[Row]) -> str:
    """Cell of the map: kept of all, and the median figures of those that worked."""
    median = partial(np.median, axis=0)
    worked = [
        (row["force_peak_n"], 1e3 * row["excursion_m"])
        for row in rows
        if row["force_peak_n"] is not None
    ]
    kept = f"{sum(row['class'] == KEPT for row in rows)}/{len(rows)}"
    if not worked:
        return kept
    force, excursion = median(np.array(worked, dtype=np.float64))
    return f"{kept}  {force:.1f}, {excursion:.0f}"
