"""Options of the calibration of an arm, and checks of its inputs that need no compiled code."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import ClassVar, Literal

from uuv.catalogue import things
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.interfaces.options import about_of
from uuv.sim.runs.command_line import RunOptions
from uuv.sim.runs.run_folder import new_folder
from uuv.site import Site, flow_of

COMMAND = "calibrate"  # name in the results
Touching = Literal["noise", "clamped", "hovering"]


@dataclass(kw_only=True)
class TouchedSiteOptions(RunOptions):
    """Seed and water of a calibration."""

    groups: ClassVar[Mapping[str, str]] = {"water": "current flow gust wave wave_frequency"}
    abouts: ClassVar[Mapping[str, str]] = {field.name: about_of(field) for field in fields(Site)}

    seed: int = 0
    """Seed of everything random: workshop errors, the noise of hand and sensors, the gusts."""
    quick: bool = False
    """Fewer touches by contact; options that are given keep their values."""
    current: tuple[float, float, float] = Site.current
    flow: str | None = None
    gust: float = Site.gust
    wave: tuple[float, float, float] = Site.wave
    wave_frequency: float = Site.wave_frequency

    def folder(self, name: str) -> Path:
        """New folder for results.

        Raises:
            ConfigurationError: The folder is in use, or cannot be created.
        """
        return new_folder(name, self.out, self.seed)

    def site(self) -> Site:
        """Site with the water only; a calibration has no object."""
        flow = None if self.flow is None else flow_of(self.flow)
        water = Site(current=self.current, flow=flow, gust=self.gust)
        return replace(water, wave=self.wave, wave_frequency=self.wave_frequency)


@dataclass(kw_only=True)
class CalibrationOptions(TouchedSiteOptions):
    """Calibrate an arm by touching fixed points."""

    arm: str = "ur10e"
    """A published arm (ur10e, panda, ...), the arm of a vehicle (uuv_puma), or a file: .csv, .yaml,
    .urdf, .xml (MJCF).
    """
    touches: tuple[Path, ...] = ()
    """CSV files of touches or folders of them, one file for each point; none: touching is
    simulated.
    """
    held_out: tuple[Path, ...] = ()
    """Touches for validation only, not used by the fit."""
    distance: tuple[tuple[str, str, float], ...] = ()
    """Known distances between points: POINT POINT METRES, repeatable."""
    base: str | None = None
    """Base link or body of a URDF or MJCF."""
    tip: str | None = None
    """Tip link or site of a URDF or MJCF."""
    units: Literal["auto", "rad", "deg"] = "auto"
    """Unit of the angles in the touches."""
    limits: Literal["arm", "encoders"] = "arm"
    """Touches beyond the arm's joint limits: arm refuses those that do not coincide either,
    encoders uses all.
    """
    touching: Touching = "noise"
    """Simulated touching: noise (by hand), or by contact with the hull clamped or hovering."""
    points: int | None = None
    """Number of simulated points; default 3, by contact 4."""
    poses: int | None = None
    """Simulated touches of each point; default 21, by contact 10."""
    noise: float = 0.092e-3
    """Standard deviation of the simulated hand [m], along each axis."""
    pin: Literal["straight", "off-axis"] | None = None
    """Tool for simulated touches by hand.

    Default: straight for a vehicle, at its own tool; off-axis for other arms.
    """
    known_length: bool | None = None
    """Give the distance between the two farthest simulated points; default: yes, except for the
    UR10e [Yukhimets 2023].
    """
    arm_errors: int | None = None
    """Seed of the workshop errors; default: --seed."""
    free: tuple[str, ...] = ()
    """Free parameters: theta d a alpha beta tcp, or single ones such as a2; default: all."""
    prior: tuple[tuple[str, float], ...] = ()
    """Prior standard deviations about the nominal values [rad], [m]: NAME VALUE, repeatable;
    default: from the data.
    """
    compliance: bool = False
    """Also identify joint compliances, from the sag under the links' weight and --payload. The base
    is upright; that of a vehicle's arm hangs.
    """
    link_mass: tuple[float, ...] = ()
    """Masses of the links [kg]; default: spread evenly along the links, so that compliances are
    relative to that.
    """
    payload: tuple[float, ...] = ()
    """Payload at the tool [kg] during the touches of each point."""
    true_compliance: float = 0.0
    """Compliance of the simulated arm's joints [rad/(N m)]."""
    true_gears: float = 0.0
    """Eccentricity of the simulated arm's gears: spread of the amplitudes [rad]."""
    true_seating: float = 0.0
    """Seating errors of the ball in the simulated sockets: spread along each axis [m], repeats with
    the direction.
    """
    method: Literal["map", "paper"] = "map"
    """map: maximum a posteriori fit; paper: three iterations on all parameters [Yukhimets 2023]."""
    plan: int | None = None
    """Plan this number of touches instead: the most informative ones, after those of --touches or
    from the start.
    """

    def __post_init__(self) -> None:
        if self.flow is not None and self.touching != "hovering":
            raise ConfigurationError(
                "--flow: only with --touching hovering, for the hull is fixed otherwise"
            )


def check_inputs(options: CalibrationOptions) -> None:
    """Refuse an unknown arm, and files that contain neither touches nor an arm.

    Raises:
        ConfigurationError: The message names the option, the allowed values and the given one.
    """
    from uuv.calib.touch_files import check_touches

    check_touches((*options.touches, *options.held_out))
    check_arm(options.arm)
    if is_file(options.arm):
        from uuv.calib.arm_files import read_arm

        read_arm(options.arm, base=options.base, tip=options.tip)


def check_arm(name: str) -> None:
    """Refuse a name that is not the name of an arm. A file is only checked for a suffix.

    Published arms are recognised by the list of their names, because the import of their module
    compiles kernels.
    """
    from uuv import models

    known = (*(arm for arm, _ in things("arm")), *models.available())
    if name not in known and not is_file(name):
        raise ConfigurationError(
            f"--arm: must be one of {', '.join(known)}, or a file, got "
            f"{name!r}{did_you_mean(name, known)}"
        )


def is_file(name: str) -> bool:
    """True for a name with a suffix, such as arm.urdf."""
    return bool(Path(name).suffix)
