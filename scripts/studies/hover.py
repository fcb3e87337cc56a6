"""Study: station keeping under pushes at the tool, at full reach and in many directions, with ablations.

`envelope`: excursion of the hull with and without compensation, by current. `ablation`: errors of lag, dead band and
coefficients, and the thruster lead. `lost`: each thruster stops during a push; two seconds later the push ends, and the
hull keeps station on the remaining thrusters. Pushes are external forces at the tip; the drives are stiff.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from rich.console import Console
from rich.table import Table

from controllers.arm.inverse_dynamics import ArmDynamics
from controllers.hull.allocation import AXES, Allocation
from models.site import scenes
from models.vehicle import Vehicle
from scenarios.pushing import PushCase, PushFigures, holdable_directions, run, sphere
from scenarios.start import parse, run_scenario
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import Array

POSTURES = {
    "ahead": (0.0, 0.2, 0.0, 0.0, 0.0, 0.0),
    "aside": (1.57, 0.4, 0.0, 0.0, 0.0, 0.0),
    "down": (0.0, 1.4, 0.1, 0.1, 0.0, 0.0),
}  # [rad] of the default arm, stretched out


@dataclass
class Options:
    """Pushes at full reach."""

    table: Literal["envelope", "ablation", "lost"] = "envelope"
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


def flow(speed: float) -> tuple[float, float, float]:
    """Current (3,) [m/s] of a given speed in W, horizontal, at 30 deg from x."""
    return (speed * float(np.cos(np.pi / 6)), speed * float(np.sin(np.pi / 6)), 0.0)


def case_of(options: Options) -> PushCase:
    """Base case of the tables, with the directions in which the drives can hold the push.

    Raises:
        ConfigurationError: There is no such direction.
    """
    if options.directions < 1:
        raise ConfigurationError(f"--directions: must be >= 1, got {options.directions}")
    own = scenes.vehicle_spec("uuv_puma").compile()
    q, directions = np.array(POSTURES[options.posture]), sphere(options.directions)
    held = holdable_directions(Vehicle.of(own), ArmDynamics(own), q, directions, options.force)
    if not held.any():
        raise ConfigurationError(f"--force {options.force}: the arm's drives bear it in none of the directions")
    return PushCase(
        directions_B=directions[held],
        q=q,
        force=options.force,
        gust=options.gust,
        current_W=flow(0.2),
        seed=options.seed,
    )


def figures(pushed: PushFigures) -> list[str]:
    """Formatted cells of a row: median, 95 % and largest values over the pushes, and means."""

    def spread(values: Array) -> str:
        return ", ".join(f"{value:.1f}" for value in (np.median(values), np.quantile(values, 0.95), values.max()))

    return [
        spread(1e3 * pushed.excursion),
        spread(np.degrees(pushed.tilt)),
        spread(np.degrees(pushed.turn)),
        f"{100.0 * pushed.saturated.mean():.1f}",
        f"{pushed.force_error.mean():.0f}",
        f"{1e3 * np.sqrt(np.mean(pushed.current_error**2)):.0f}",
        f"{pushed.command_rate:.2f}",
    ]


def envelope(options: Options, case: PushCase) -> Iterable[tuple[str, PushCase]]:
    """Yields title and case for each current, with and without compensation."""
    for speed in options.currents:
        for compensation in (True, False):
            name = f"{speed:.1f} m/s" if compensation else f"{speed:.1f} m/s, no compensation"
            yield name, replace(case, current_W=flow(speed), compensation=compensation)


def ablation(_: Options, case: PushCase) -> Iterable[tuple[str, PushCase]]:
    """Yields title and case for the nominal controller, each ablation and each model error."""
    case = replace(case, settle=8.0, push=3.0, rest=1.5)
    yield "as it is: lag 0.15 s, dead band 5 %, coefficients 15 % wrong", case
    yield "no lead", replace(case, response=1e6)
    yield "no compensation", replace(case, compensation=False)
    for lag in (0.0, 0.3):
        yield f"lag {lag} s", replace(case, lag=lag)
    yield "lag 0.3 s, no lead", replace(case, lag=0.3, response=1e6)
    for error in (-0.5, 0.5):
        yield f"lag believed {100 * error:+.0f} % wrong", replace(case, lag_error=error)
    for band in (0.0, 0.1):
        yield f"dead band {100 * band:.0f} %", replace(case, dead_band=band)
    for error in (-0.3, 0.3):
        yield f"coefficients {100 * error:+.0f} % wrong", replace(case, water_error=error)


def lost(_: Options, case: PushCase) -> Iterable[tuple[str, PushCase]]:
    """Yields title and case for each thruster lost, unnoticed and known after 0.5 s."""
    own = Vehicle.of(scenes.vehicle_spec(case.vehicle).compile())
    once = replace(case, directions_B=case.directions_B[:1], settle=8.0, push=4.0, rest=8.0)
    for thruster, name in enumerate(own.thruster_names):
        yield f"{name} lost, unnoticed", replace(once, lost=thruster)
        yield f"{name} lost, known after 0.5 s", replace(once, lost=thruster, noticed=0.5)


def authority_table(console: Console) -> None:
    """Prints the greatest wrench along each axis, with all thrusters and without each one."""
    vehicle = Vehicle.of(scenes.vehicle_spec("uuv_puma").compile())
    allocation = Allocation(vehicle)
    table = Table(title="Greatest wrench along one axis, all others zero [N, N m]")
    for column in ("lost", *AXES, "surge, yaw free"):
        table.add_column(column)
    for name in (None, *vehicle.thruster_names):
        left = allocation if name is None else allocation.without(name)
        rows = [*left.authority(), left.authority(spoiling=["yaw"])[0]]
        table.add_row(name or "none", *(f"{low:.0f}, {high:.0f}" for low, high in rows))
    console.print(table)


def main() -> int:
    """Runs the cases, prints their table and returns the exit code."""
    options = parse(Options)
    case, console = case_of(options), Console()
    if options.table == "lost":
        authority_table(console)
    title = f"Push of {options.force:.0f} N in {len(case.directions_B)} directions, arm {options.posture}"
    table = Table(title=f"{title}: median, 95 %, largest")
    for column in (
        "case",
        "excursion [mm]",
        "tilt [deg]",
        "turn [deg]",
        "saturated [%]",
        "force error [N]",
        "current error [mm/s]",
        "command rate [1/s]",
    ):
        table.add_column(column)
    for name, varied in {"envelope": envelope, "ablation": ablation, "lost": lost}[options.table](options, case):
        row = figures(run(varied))
        table.add_row(name, *row)
        console.print(f"{name}: {' | '.join(row)}", highlight=False)  # shows the progress of a long study
    console.print(table)
    return 0


if __name__ == "__main__":
    run_scenario(main)
