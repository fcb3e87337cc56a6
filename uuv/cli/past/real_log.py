"""`uuv replay --log FILE`: compares a real vehicle's log with a simulation driven by its pulses."""

from pathlib import Path
from typing import TYPE_CHECKING

from uuv.cli.json_output import print_json
from uuv.logs.picture_file import check_picture
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import finite_number

if TYPE_CHECKING:  # a help text does without
    from uuv.water_identification.log_beside import LogBeside

_WINDOW = (1.0, 3600.0)  # [s] that is allowed


def replay_log(
    file: Path, vehicle: str | None, window: float, picture: Path | None, *, as_json: bool
) -> int:
    """Simulates the log, prints the table and writes the picture; returns the exit code.

    Args:
        file: The log.
        vehicle: A name or file; None: the usual one of the log's motor frame.
        window: [s] after which the simulation begins anew at the measured state.
        picture: PNG to write.
        as_json: Print JSON.

    Raises:
        UuvError: The log cannot be read, or does not fit the vehicle.
    """
    finite_number(window, "window [s]", least=_WINDOW[0], most=_WINDOW[1])
    if not file.exists():
        raise ConfigurationError(f"--log {file}: there is no such file")
    if picture is not None:
        check_picture(picture)

    name = vehicle or _usual_vehicle(file)
    from uuv.own_vehicle import vehicle_spec
    from uuv.water_identification.log_beside import LogBeside  # and compiled, after the check

    beside = LogBeside.of(file, vehicle_spec(name), window)
    if picture is not None:
        beside.write_picture(picture)
    if as_json:
        print_json(_content(beside))
    else:
        _print(beside, name)
    return 0


def _usual_vehicle(file: Path) -> str:
    """The vehicle that usually has the motor frame of a log.

    Raises:
        ConfigurationError: The log states none.
    """
    from uuv.logs.ardusub_frames import USUAL_VEHICLES
    from uuv.logs.kinds import is_vehicle_log
    from uuv.logs.readers import read_vehicle_log

    frame = read_vehicle_log(file).frame if is_vehicle_log(file) else ""
    if frame not in USUAL_VEHICLES:
        raise ConfigurationError(f"--vehicle: missing; log {file.name} states no motor frame")
    return USUAL_VEHICLES[frame]


def _content(beside: "LogBeside") -> dict[str, object]:
    return {
        "log": beside.name,
        "windows": beside.windows,
        "diverged": beside.diverged,
        "quantities": {
            quantity.name: {
                "unit": quantity.unit,
                "samples": len(quantity.time),
                "rms": quantity.rms,
                "largest": quantity.largest,
                "motion": quantity.motion,
            }
            for quantity in beside.quantities
        },
    }


def _print(beside: "LogBeside", vehicle: str) -> None:
    from rich.table import Table

    from uuv.sim.runs.terminal import console

    out = console()
    out.print(
        f"{beside.name} against {vehicle}, {beside.windows} windows; simulated minus measured:"
    )
    table = Table("quantity", "unit", "samples", "RMS", "largest", "motion in a window")
    for quantity in beside.quantities:
        figures = (quantity.rms, quantity.largest, quantity.motion)
        table.add_row(
            quantity.name,
            quantity.unit,
            str(len(quantity.time)),
            *(f"{figure:.3g}" for figure in figures),
        )
    out.print(table)
    if beside.diverged:
        out.print(f"left out: {beside.diverged} windows in which the simulation runs away")
