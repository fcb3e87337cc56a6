"""Station keeping under pushes at the tool: cases with model errors and ablations, one run, and the
table.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from experiments.vehicles import pushing
from experiments.vehicles.pushing import PushCase, holdable_directions
from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.controllers.hull.allocation import AXES, Allocation
from uuv.experiment import Row, Summary, Table
from uuv.models.vehicle import Vehicle
from uuv.own_vehicle import vehicle_spec
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, spread_directions

# [rad] of the default arm, stretched out
POSTURES = {
    "ahead": (0.0, 0.2, 0.0, 0.0, 0.0, 0.0),
    "aside": (1.57, 0.4, 0.0, 0.0, 0.0, 0.0),
    "down": (0.0, 1.4, 0.1, 0.1, 0.0, 0.0),
}


MEASURED = (
    "excursion",
    "tilt",
    "turn",
    "saturated",
    "force_error",
    "current_error",
    "command_rate",
)
_COLUMNS = (
    "case",
    "excursion [mm]",
    "tilt [deg]",
    "turn [deg]",
    "saturated [%]",
    "force error [N]",
    "current error [mm/s]",
    "command rate [1/s]",
)


@dataclass(frozen=True, eq=False)
class NamedPush:
    """One row of the table; a case of the study."""

    name: str
    case: PushCase


def flow(speed: float) -> tuple[float, float, float]:
    """Current (3,) [m/s] of a given speed in W, horizontal, at 30 deg from x."""
    return (speed * float(np.cos(np.pi / 6)), speed * float(np.sin(np.pi / 6)), 0.0)


def push_case(directions: int, force: float, posture: str, gust: float, seed: int) -> PushCase:
    """Base case of the tables, with the directions in which the drives can hold the push.

    Args:
        directions: Number of directions, spread over the sphere.
        force: [N] of the push.
        posture: Posture of the arm, of POSTURES.
        gust: [m/s] standard deviation per axis.
        seed: Seed of sensor noise and gusts.

    Returns:
        The case.

    Raises:
        ConfigurationError: The drives bear the push in none of the directions.
    """
    own = vehicle_spec("uuv_puma").compile()
    q, spread = np.array(POSTURES[posture]), spread_directions(directions)
    held = holdable_directions(Vehicle.of(own), ArmDynamics(own), q, spread, force)
    if not held.any():
        raise ConfigurationError(
            f"--force {force}: the arm's drives bear it in none of the directions"
        )
    return PushCase(
        directions_B=spread[held], q=q, force=force, gust=gust, current_W=flow(0.2), seed=seed
    )


def envelope(case: PushCase, currents: Sequence[float]) -> Iterator[NamedPush]:
    """Yields the case for each current [m/s], with and without compensation."""
    for speed in currents:
        for compensation in (True, False):
            name = f"{speed:.1f} m/s" if compensation else f"{speed:.1f} m/s, no compensation"
            yield NamedPush(name, replace(case, current_W=flow(speed), compensation=compensation))


def ablation(case: PushCase) -> Iterator[NamedPush]:
    """Yields the case for the nominal controller, each ablation and each model error."""
    case = replace(case, settle=8.0, push=3.0, rest=1.5)
    yield NamedPush("as it is: lag 0.15 s, dead band 5 %, coefficients 15 % wrong", case)
    yield NamedPush("no lead", replace(case, response=1e6))
    yield NamedPush("no compensation", replace(case, compensation=False))
    for lag in (0.0, 0.3):
        yield NamedPush(f"lag {lag} s", replace(case, lag=lag))
    yield NamedPush("lag 0.3 s, no lead", replace(case, lag=0.3, response=1e6))
    for error in (-0.5, 0.5):
        yield NamedPush(f"lag believed {100 * error:+.0f} % wrong", replace(case, lag_error=error))
    for band in (0.0, 0.1):
        yield NamedPush(f"dead band {100 * band:.0f} %", replace(case, dead_band=band))
    for error in (-0.3, 0.3):
        yield NamedPush(
            f"coefficients {100 * error:+.0f} % wrong", replace(case, water_error=error)
        )


def lost(case: PushCase) -> Iterator[NamedPush]:
    """Yields the case for each thruster lost, unnoticed and known after 0.5 s."""
    own = Vehicle.of(vehicle_spec(case.vehicle).compile())
    once = replace(case, directions_B=case.directions_B[:1], settle=8.0, push=4.0, rest=8.0)
    for thruster, name in enumerate(own.thruster_names):
        yield NamedPush(f"{name} lost, unnoticed", replace(once, lost=thruster))
        yield NamedPush(
            f"{name} lost, known after 0.5 s", replace(once, lost=thruster, noticed=0.5)
        )


def run(named: NamedPush) -> Row:
    """Figures of a case, one entry for each push, in SI units."""
    pushed = pushing.run(named.case)
    return {"case": named.name, **{name: getattr(pushed, name) for name in MEASURED}}


def line(row: Row) -> str:
    """Line about a case, which shows the progress of a long study."""
    return f"{row['case']}: {' | '.join(cells_of(row))}"


def summarise(rows: list[Row], title: str, more: Sequence[Table]) -> Summary:
    """Table of all cases.

    Args:
        rows: Rows of all cases.
        title: Title of the table.
        more: Tables that stand before it.
    """
    cells = [(row["case"], *cells_of(row)) for row in rows]
    table = Table(title=f"{title}: median, 95 %, largest", columns=_COLUMNS, rows=cells)
    return Summary(metrics={"cases": rows}, tables=[*more, table])


def cells_of(row: Row) -> list[str]:
    """Formatted cells of a row: median, 95 % and largest values over the pushes, and means."""
    of = {name: np.array(row[name]) for name in MEASURED}

    def spread(values: Array) -> str:
        return ", ".join(
            f"{value:.1f}" for value in (np.median(values), np.quantile(values, 0.95), values.max())
        )

    return [
        spread(1e3 * of["excursion"]),
        spread(np.degrees(of["tilt"])),
        spread(np.degrees(of["turn"])),
        f"{100.0 * of['saturated'].mean():.1f}",
        f"{of['force_error'].mean():.0f}",
        f"{1e3 * np.sqrt(np.mean(of['current_error'] ** 2)):.0f}",
        f"{of['command_rate']:.2f}",
    ]


def authority_table() -> Table:
    """Table of the greatest wrench along each axis, with all thrusters and without each one."""
    vehicle = Vehicle.of(vehicle_spec("uuv_puma").compile())
    allocation = Allocation(vehicle)
    cells = []
    for name in (None, *vehicle.thruster_names):
        left = allocation if name is None else allocation.without(name)
        rows = [*left.authority(), left.authority(spoiling=["yaw"])[0]]
        cells.append((name or "none", *(f"{low:.0f}, {high:.0f}" for low, high in rows)))
    return Table(
        title="Greatest wrench along one axis, all others zero [N, N m]",
        columns=("lost", *AXES, "surge, yaw free"),
        rows=cells,
    )
