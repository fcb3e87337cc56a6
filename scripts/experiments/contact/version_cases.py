"""The main job in several versions: the default methods, and those of the papers in their place."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from uuv.assembly import assemble
from uuv.experiment import Row, Summary, Table
from uuv.jobs import clean_barrel
from uuv.runner import run as run_job
from uuv.sim.interfaces.errors import UuvError

VERSIONS: Mapping[str, Mapping[str, Any]] = {  # options of the job, by the name of the version
    "defaults": {},
    "force law": {"published": ("force-law",)},
    "normal force law": {"published": ("normal-force-law",)},
    "tip force": {"published": ("tip-force",)},
    "identification": {"published": ("identification",)},
    "IK plain": {"ik": "plain"},
    "IK jacobian_free": {"ik": "jacobian_free"},
}
PATHS = ("longitudinal", "transverse")
_COLUMNS = (
    "version",
    "path",
    "accepted",
    "force RMS, peak [N]",
    "tangential, mean [N]",
    "path peak [mm]",
    "identified [mm]",
    "tilt [deg]",
    "lost [s]",
    "time [s]",
)
_FIGURES = {
    "force_rms": ("contact", "force_error_rms_n"),
    "force_peak": ("contact", "force_error_max_n"),
    "tangential": ("contact", "tangential_mean_n"),
    "lost": ("contact", "lost_s"),
    "path_peak": ("tool", "path_deviation_max_m"),
    "tilt": ("tool", "tilt_max_rad"),
    "identified": ("identification", "position_error_m"),
}


@dataclass(frozen=True, kw_only=True)
class VersionCase:
    """One run of the main job."""

    version: str  # a key of VERSIONS
    path: str
    seed: int
    quick: bool = False


def run(case: VersionCase) -> Row:
    """Figures of the run in SI units, None where it ended before it gave one; `ended` says why it
    was not accepted.
    """
    row: Row = {"version": case.version, "path": case.path, "seed": case.seed, "accepted": False}
    row |= dict.fromkeys((*_FIGURES, "wall_s"))
    try:
        scenario = clean_barrel(
            path=case.path, seed=case.seed, quick=case.quick, **VERSIONS[case.version]
        )
        outcome = run_job(assemble(scenario, full=False))
    except UuvError as error:
        return row | {"ended": str(error)}
    metrics = outcome.assessment.metrics
    row |= {name: metrics[group][figure] for name, (group, figure) in _FIGURES.items()}
    row |= {"accepted": metrics["accepted"], "ended": "; ".join(metrics["failed"])}
    return row | {"wall_s": metrics["timings"]["wall_s"]}


def summarise(rows: list[Row]) -> Summary:
    """Largest figures of each version on each path."""
    parts = {(row["version"], row["path"]): [] for row in rows}
    for row in rows:
        parts[row["version"], row["path"]].append(row)
    figures = [_worst(version, path, part) for (version, path), part in parts.items()]
    lines = [
        f"{row['version']}, {row['path']}, seed {row['seed']}: {row['ended']}"
        for row in rows
        if not row["accepted"]
    ]
    return Summary(
        metrics={"versions": figures, "runs": rows},
        tables=[
            Table(
                title="Largest of all seeds",
                columns=_COLUMNS,
                rows=[*map(_cells, figures)],
                labels=2,
            )
        ],
        lines=lines,
    )


def _worst(version: str, path: str, rows: list[Row]) -> dict[str, Any]:
    """The largest of each figure over the runs that gave it, and how many of them were accepted."""
    known = {
        name: [row[name] for row in rows if row[name] is not None] for name in (*_FIGURES, "wall_s")
    }
    largest = {name: max(values) if values else None for name, values in known.items()}
    accepted = sum(row["accepted"] for row in rows)
    return {"version": version, "path": path, "runs": len(rows), "accepted": accepted, **largest}


def _cells(figures: Mapping[str, Any]) -> tuple[str, ...]:
    def shown(name: str, scale: float = 1.0, digits: int = 2) -> str:
        return "–" if figures[name] is None else f"{scale * figures[name]:.{digits}f}"

    return (
        figures["version"],
        figures["path"],
        f"{figures['accepted']} of {figures['runs']}",
        f"{shown('force_rms')}, {shown('force_peak', digits=1)}",
        shown("tangential", digits=1),
        shown("path_peak", 1e3, 1),
        shown("identified", 1e3, 1),
        shown("tilt", float(np.degrees(1.0)), 1),
        shown("lost"),
        shown("wall_s", digits=1),
    )
