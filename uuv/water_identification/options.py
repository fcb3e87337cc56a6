"""Options of the identification of a vehicle's hydrodynamics, and checks of its inputs before
compiling.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from uuv.calib.water.logs import CHANNELS, WaterLog, check_log, log_of, read_log
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import finite_number, one_of, whole_number
from uuv.sim.runs.command_line import ResultOptions
from uuv.water_identification.settings import NOISE, FitSettings

if TYPE_CHECKING:  # not needed for a help text
    from uuv.models.vehicle import Vehicle

COMMAND = "identify_water"  # name in the results


@dataclass(kw_only=True)
class WaterOptions(ResultOptions):
    """Identify added mass, damping, trim and thrust of a vehicle from logs."""

    groups: ClassVar[Mapping[str, str]] = {"comparison": "window rate noise current gust mount"}

    vehicle: str = "bluerov2_heavy"
    """Name of `uuv list vehicle`, an MJCF or URDF file, or MODULE:FUNCTION; its water is the
    prior.
    """
    log: tuple[Path, ...] = ()
    """Logs, CSV or Parquet, .BIN, .tlog, .mcap or ROS bags, or folders of recorded runs; none: a
    survey is simulated, or planned with --plan.
    """
    water_density: float | None = None
    """Density of the water [kg/m^3]; default: the vehicle's."""
    plan: bool = False
    """Also name the most informative next manoeuvre; without a log, the first one."""
    aim: tuple[str, ...] = ()
    """Groups of parameters that the plan is for: "added mass", trim, thrusters, ...; default:
    all.
    """
    prior: tuple[tuple[str, float], ...] = ()
    """Other prior standard deviations: NAME VALUE, repeatable; of a factor that of its
    logarithm.
    """
    window: float = 6.0
    """Length of the windows into which a log is cut [s]."""
    rate: float = 20.0
    """Rate to which samples are averaged [Hz]."""
    noise: tuple[tuple[str, float], ...] = ()
    """Standard deviation of a channel's samples: NAME VALUE, repeatable; default: see the
    documentation.
    """
    current: float = 0.1
    """Prior standard deviation of a log's steady current [m/s], each axis."""
    gust: float = 0.02
    """Standard deviation of a window's current about it [m/s]."""
    mount: float = 0.01
    """Standard deviation of the attitude sensor's roll and pitch on the hull [rad]; 0: it is
    exact.
    """
    seconds: float = 60.0
    """Length of a simulated survey [s]."""
    seed: int = 0
    """Seed of a simulated vehicle, its survey, gusts and noise."""
    workers: int = 1
    """Threads."""


def check_inputs(options: WaterOptions) -> None:
    """Refuse options out of bounds, an unknown vehicle, and logs that cannot be read.

    Raises:
        UuvError: The message names the option, the allowed values and the given one.
    """
    from uuv import inputs
    from uuv.logs.kinds import is_vehicle_log
    from uuv.models.vehicle import Vehicle
    from uuv.scenario import VehicleSetup
    from uuv.water_identification.replayed_parts import pushed_parts, ranges_of

    settings_of(options)
    check_aim(options)

    for path in options.log:
        if not path.is_dir() and not is_vehicle_log(path):
            check_log(path)

    model = inputs.check_vehicle(VehicleSetup(vehicle=options.vehicle)).compile()
    vehicle = Vehicle.of(model)
    logs_of(options, vehicle, tuple(pushed_parts(model, vehicle).values()), ranges_of(vehicle))


def check_aim(options: WaterOptions) -> None:
    """Refuse groups of a plan that is not wanted, and unknown ones.

    Raises:
        ConfigurationError: Which group, and what is allowed.
    """
    from uuv.calib.water.parameters import GROUPS  # imports MuJoCo, which a help text needs not

    if options.aim and not options.plan:
        raise ConfigurationError(f"--aim {' '.join(options.aim)}: needs --plan")
    for group in options.aim:
        one_of(group, GROUPS, "--aim")


def settings_of(options: WaterOptions) -> FitSettings:
    """Settings of the comparison.

    Raises:
        ConfigurationError: A number is out of bounds, or a channel is unknown.
    """
    noise = dict(NOISE)
    for name, sigma in options.noise:
        noise[one_of(name, tuple(CHANNELS), "--noise")] = finite_number(
            sigma, f"--noise {name}", above=0.0
        )

    return FitSettings(
        window=finite_number(options.window, "--window [s]", least=1.0, most=60.0),
        rate=finite_number(options.rate, "--rate [Hz]", least=1.0, most=200.0),
        noise=noise,
        current=finite_number(options.current, "--current [m/s]", above=0.0, most=3.0),
        gust=finite_number(options.gust, "--gust [m/s]", above=0.0, most=1.0),
        mount=finite_number(options.mount, "--mount [rad]", least=0.0, most=0.5),
        workers=whole_number(options.workers, "--workers", least=1, most=64),
    )


def logs_of(
    options: WaterOptions,
    vehicle: "Vehicle",
    thrusters: Sequence[str],
    joints: Mapping[str, tuple[float, float]],
) -> list[WaterLog]:
    """The logs on the command line, for a vehicle with these thrusters and joint ranges [rad].

    Raises:
        UuvError: A file cannot be read, or is not a log.
    """
    logs = [log_at(path, vehicle, thrusters, joints) for path in options.log]
    names = [log.name for log in logs]  # name of the file; another folder may contain the same name
    return [
        replace(log, name=f"{log.name} ({i})") if names.count(log.name) > 1 else log
        for i, log in enumerate(logs, 1)
    ]


def log_at(
    path: Path,
    vehicle: "Vehicle",
    thrusters: Sequence[str],
    joints: Mapping[str, tuple[float, float]],
) -> WaterLog:
    """A log of any kind: of an autopilot or a ROS recorder, CSV, Parquet, or a run's folder.

    Args:
        path: File or folder.
        vehicle: Its model: servo outputs are matched with its thrusters.
        thrusters: Names of what drives it.
        joints: Ranges [rad] of its joints by name.

    Raises:
        UuvError: It cannot be read, or does not fit the vehicle.
    """
    from uuv.logs.kinds import is_vehicle_log
    from uuv.water_identification.vehicle_logs import read_as_water_log

    if is_vehicle_log(path):
        return read_as_water_log(path, vehicle, thrusters=thrusters, joints=joints)
    if path.is_dir():
        return _of_run(path, thrusters, joints)
    return read_log(path, thrusters=thrusters, joints=joints)


def _of_run(
    folder: Path, thrusters: Sequence[str], joints: Mapping[str, tuple[float, float]]
) -> WaterLog:
    """Log of a recorded run at the rate of its slower table, with the poses at those times."""
    from uuv.sim.reporting.series_tables import LOOP, SLOW, PastRun

    past = PastRun.of(folder)
    time = past.column("time", SLOW)
    names = [f"p_WB.{axis}" for axis in "xyz"] + [f"quat_WB_wxyz.{part}" for part in "wxyz"]
    columns = {
        name: np.interp(time, past.column("time", LOOP), past.column(name, LOOP)) for name in names
    }

    columns |= {
        name: past.column(name, SLOW)
        for name in past.units(SLOW)
        if name.startswith(("q.", "thrust."))
    }

    return log_of(
        f"run {folder.name}", {"time": time, **columns}, thrusters=thrusters, joints=joints
    )
