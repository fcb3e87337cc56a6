"""Eleven paths through and beside singular configurations, passed by each recipe [Danilov 2021,
figs. 6, 7].

    ./uvw run scripts/experiments/papers/singular_crossings.py

Each path is a straight line of the tool without turning, through a tip pose at which the wrist is
singular, or up to 20 mm beside it. That of the European Robotic Arm (ERA) is the published one; on
the others the wrist has to spin. The tool is off its path where it is more than 0.1 mm or 1 mrad
away.

The recipes: without passing; those of the paper, joints 5 and 6 kept within +-80 deg, or joint 1
held near the singularity; and those of `uuv.controllers.ik.tracking`.

Writes metrics.json. Exit code 0: no recipe but "without" exceeds the speed limit, and the default
one leaves the paths for the least share.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from experiments.papers.track_singularity import lock
from uuv.controllers.mkps import Chain, Track, track
from uuv.models.arms import published_arms
from uuv.models.arms.published_arms import PublishedArm
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, pose
from uuv.sim.runs.provenance import provenance
from uuv.sim.runs.saving import write_json
from uuv.start import new_folder, parse, run_scenario

RECIPES: dict[str, dict[str, Any]] = {  # options of `track`; `narrow` limits joints 5 and 6
    "without": {"passing": "off"},
    "paper, 5 and 6 within 80 deg": {"passing": "limit", "narrow": True},
    "paper, joint 1 held": {"passing": "hold", "hold_joint": 0},
    "limit (default)": {"passing": "limit"},
    "hold": {"passing": "hold"},
    "auto": {"passing": "auto"},
}
WITHOUT, DEFAULT = "without", "limit (default)"
# [rad] singular joint values, joint 5 at zero; and which directions of `fast_first` lead along and
# across
WRISTS = {
    "puma560": (np.array([0.3, -0.6, 0.5, 0.5, 0.0, 0.2]), 0, 2),
    "ur5": (np.array([0.3, -1.2, 1.4, -0.6, 0.0, 0.2]), 1, 2),
}
BESIDE = (0.002, 0.005, 0.01, 0.02)  # [m]
BESIDE_ERA = (0.0, 0.01, 0.02)  # [m]
NEAR, OFF, TURNED = 0.02, 1e-4, 1e-3  # [rad] beside the singularity; [m], [rad] off the path
NARROW = np.deg2rad(80.0)


@dataclass
class Options:
    """Deviation and joint speeds on paths through singular configurations."""

    speed: float = 0.1
    """Speed of the tool [m/s]."""
    speed_limit: float = 2.0
    """Speed limit of every joint [rad/s]."""
    reach: float = 0.2
    """Length of each path before and after the singularity [m]."""
    period: float = 0.01
    """Time between poses [s]."""
    out: Path | None = None
    """Folder for metrics.json; default: a new one in runs/singular_crossings."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Crossing:
    """One path, and joint values at its first pose."""

    name: str
    arm: PublishedArm
    path: Array  # (N, 4, 4)
    q0: Array  # (n,) [rad]


def crossings(options: Options) -> Iterator[Crossing]:
    """Three paths of the ERA through gimbal lock, four of each of the others."""
    era = published_arms.load("era")
    q, y, z = lock(era), np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])

    for beside in BESIDE_ERA:
        yield crossing(
            f"era, {1e3 * beside:.0f} mm", era, q, lines(y, beside * z, 1.0, options), 0.4
        )

    for name, (q, along, across) in WRISTS.items():
        arm = published_arms.load(name)
        ways = fast_first(Chain.from_arm(arm), q)
        for beside in BESIDE:
            path = lines(ways[along], beside * ways[across], options.reach, options)
            yield crossing(f"{name}, {1e3 * beside:.0f} mm", arm, q, path, None)


def lines(along: Array, beside: Array, reach: float, options: Options) -> Array:
    """Points (N, 3) [m] of a straight line in direction `along`, `beside` (3,) [m] its middle."""
    steps = 2 * round(reach / (options.speed * options.period))
    return np.linspace(-reach, reach, steps + 1)[:, None] * along + beside


def crossing(name: str, arm: PublishedArm, q: Array, line: Array, slow: float | None) -> Crossing:
    """A crossing whose first joint values are found by tracking back from the middle.

    Args:
        name: As shown.
        arm: The arm.
        q: (n,) [rad] in the middle.
        line: (N, 3) [m] from the tip at `q`, without turning.
        slow: [rad/s] speed limit on the way back; None: none, from beside the singularity.

    Raises:
        ConfigurationError: The arm does not reach the beginning.
    """
    chain = Chain.from_arm(arm)
    X = chain.forward(q)
    path = np.array([pose(X[:3, :3], X[:3, 3] + offset) for offset in line])
    back = path[: len(path) // 2 + 1][::-1]

    # Back from the middle: beside the singularity, or through it with passing.
    if slow is None:
        run = track(chain, back, q + NEAR, 0.01, passing="off")
    else:
        run = track(chain, back, q, 0.01, passing="limit", speed_limits=slow)

    if not run.converged[-1]:
        raise ConfigurationError(f"{name}: the arm does not reach the beginning of the path")

    return Crossing(name=name, arm=arm, path=path[1:], q0=np.array(run.q[-1]))


def fast_first(chain: Chain, q: Array) -> Array:
    """Directions of the tool, rows of (3, 3), from the one that needs the fastest joints beside the
    singular `q`.
    """
    return np.linalg.svd(np.linalg.pinv(chain.jacobian(q + NEAR))[:, :3])[2]


def narrowed(arm: PublishedArm, q0: Array) -> PublishedArm:
    """`arm` with joints 5 and 6 within 80 deg, or as far as `q0` (n,) [rad] is out."""
    limits = np.array(arm.limits)
    for joint in (4, 5):
        most = max(NARROW, abs(float(q0[joint])))
        limits[joint] = np.clip(limits[joint], -most, most)

    return replace(arm, limits=limits)


def passed(crossing: Crossing, recipe: dict[str, Any], options: Options) -> Track:
    """One crossing by one recipe."""
    given = dict(recipe)
    arm = narrowed(crossing.arm, crossing.q0) if given.pop("narrow", False) else crossing.arm
    return track(
        Chain.from_arm(arm),
        crossing.path,
        crossing.q0,
        options.period,
        speed_limits=options.speed_limit,
        **given,
    )


def figures(run: Track) -> dict[str, float]:
    """Largest deviation, share of the path that was left, largest joint speed; SI units."""
    off = (run.position_error > OFF) | (run.orientation_error > TURNED)
    return {
        "position_error_m": float(run.position_error.max()),
        "orientation_error_rad": float(run.orientation_error.max()),
        "share_off": float(off.mean()),
        "joint_speed_rad_s": float(np.abs(run.qd).max()),
    }


def main() -> int:
    """Runs all crossings by all recipes and shows the worst and the mean of each."""
    options, console = parse(Options), Console()
    folder = new_folder("singular_crossings", options.out)
    given = list(crossings(options))

    told = {
        name: {one.name: figures(passed(one, recipe, options)) for one in given}
        for name, recipe in RECIPES.items()
    }

    table = Table(title=f"{len(given)} crossings: the worst (the mean)", title_justify="left")
    for heading in ("", "deviation mm", "deg", "share off the path %", "joint speed rad/s"):
        table.add_column(heading, justify="right" if heading else "left")

    keys = {
        "position_error_m": 1e3,
        "orientation_error_rad": 180.0 / np.pi,
        "share_off": 100.0,
        "joint_speed_rad_s": 1.0,
    }

    means = {
        name: {key: float(np.mean([run[key] for run in runs.values()])) for key in keys}
        for name, runs in told.items()
    }
    worst = {
        name: {key: max(run[key] for run in runs.values()) for key in keys}
        for name, runs in told.items()
    }

    for name in told:
        cells = (
            f"{factor * worst[name][key]:.3g} ({factor * means[name][key]:.3g})"
            for key, factor in keys.items()
        )
        table.add_row(name, *cells)

    console.print(table)

    # The recipes that pass keep the speed limit, and the default one leaves the path least.
    limit = options.speed_limit * (1.0 + 1e-9)
    slow = all(
        run["joint_speed_rad_s"] <= limit
        for name in told
        if name != WITHOUT
        for run in told[name].values()
    )
    least = min(means[name]["share_off"] for name in told if name != WITHOUT)
    accepted = slow and means[DEFAULT]["share_off"] <= least

    metrics = {
        "crossings": told,
        "worst": worst,
        "mean": means,
        "accepted": accepted,
        "provenance": provenance("singular_crossings", options),
    }

    write_json(folder / "metrics.json", metrics)
    console.print("[green]accepted[/green]" if accepted else "[red]not accepted[/red]")
    console.print(f"written to {folder}/", highlight=False)
    return 0 if accepted else 1


if __name__ == "__main__":
    run_scenario(main)
