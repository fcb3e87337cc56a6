"""The reader of vehicles: a name, a function, MJCF, URDF, xacro, SDF, or a spec.

    file = read("rov.urdf")  # with its rov.water.yaml and rov.parts.yaml
    file.spec                # under the names of the file

Nothing is renamed or computed here.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from xml.etree.ElementTree import Element

import mujoco

from uuv import models
from uuv.models import hydrodynamics
from uuv.models.files import notes, sidecar
from uuv.models.files.gazebo.blocks import content_of_urdf
from uuv.models.files.gazebo.entries import ReadEntry
from uuv.models.files.gazebo.sdf import SdfModel, parse_sdf
from uuv.models.files.gazebo.sdf_vehicle import spec_of_sdf
from uuv.models.files.mjcf_files import read_mjcf
from uuv.models.files.parts_file import PARTS_SUFFIX, MappedThruster, PartsMap, read_parts
from uuv.models.files.urdf import UrdfRobot, robot_of
from uuv.models.files.urdf_joints import speeds
from uuv.models.files.urdf_vehicle import spec_of_urdf
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.interfaces.files import bytes_of, existing_file
from uuv.sim.interfaces.spatial import shown

WET = ".wet"  # ends the stem of what `uuv wet` makes of a file, whose mapping it shares
_HEAD = 20_000  # [bytes] within which a file has its root element
_TAKE_TOOL = ("uuv_puma",)  # names whose maker takes the tool, and trims the vehicle with it


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VehicleFile:
    """A vehicle as described by its file: under its own names, with its water and its mapping."""

    name: str  # with which messages begin
    spec: mujoco.MjSpec
    notes: tuple[str, ...] = ()  # lines about what was left out
    bare: bool = False  # its format, URDF or SDF, has neither free joints nor motors
    has_tool: bool = False  # it was made with the tool that was asked for
    parts: PartsMap | None = None  # its mapping to the contract; None: it has none
    parts_name: str = ""  # with which messages about the mapping begin
    entries: tuple[ReadEntry, ...] = ()  # water and thrusters of the file, and where they are from
    thrusters: tuple[MappedThruster, ...] = ()  # of the file, where the mapping has none
    speeds: Mapping[str, float] = field(default_factory=dict)  # [rad/s] or [m/s] of its joints
    trim: float | None = None  # [m] metacentric height to which the hull is to be ballasted


def read(
    vehicle: str | Path | mujoco.MjSpec,
    *,
    parts: str | Path | None = None,
    water: str | Path | None = None,
    tool: str | None = None,
) -> VehicleFile:
    """Read a vehicle, with its water under the names of its file.

    An MJCF's coefficients are in its user data, in custom elements, or in a sidecar
    (`uuv.models.files.sidecar`); those of a URDF or SDF in plugins of Gazebo, or in a sidecar.

    Args:
        vehicle: a name of `uuv.models.available()`, MODULE:FUNCTION, a file, MJCF, URDF, xacro or
            SDF, or a spec, which is left as it is.
        parts: mapping of its names (`uuv.models.files.parts_file`); None: `NAME.parts.yaml`
            beside its file, if there is one, for NAME.wet.xml too.
        water: sidecar of the file; None: `NAME.water.yaml` beside it, if there is one.
        tool: that a named vehicle is made with, if its maker takes one and it is not mapped.

    Raises:
        ConfigurationError: neither a name nor a file, or a file that cannot be read.
    """
    if not isinstance(vehicle, str | Path | mujoco.MjSpec):
        raise ConfigurationError(f"vehicle: expected a name or a file, got {shown(vehicle)}")

    # Its mapping first: it may have arguments of xacro.
    is_file = isinstance(vehicle, str | Path) and not check_name(str(vehicle))
    if is_file and parts is None:
        parts = _parts_beside(existing_file(vehicle, "vehicle"))
    mapping = None if parts is None else read_parts(parts)

    if isinstance(vehicle, mujoco.MjSpec):
        file = _of_spec(vehicle)
    elif is_file:
        path = existing_file(vehicle, "vehicle")
        file = _of_file(path, water, {} if mapping is None else mapping.xacro)
        water = None  # it is attached
    else:
        file = _of_name(str(vehicle), tool if parts is None else None)

    if water is not None:
        raise ConfigurationError(f"{file.name}: has its own water, so a water file is refused")

    if mapping is None:
        return replace(file, parts_name=file.name)
    name = f"parts {shown(str(parts))}"
    return replace(file, parts=mapping, parts_name=name, trim=mapping.trim)


def check_name(vehicle: str) -> bool:
    """Refuse a text that is neither a known name nor the name of a file; returns True for a name.

    Raises:
        ConfigurationError: there is no such vehicle; the message lists those there are.
    """
    names = models.available()
    if ":" in vehicle or vehicle in names:
        return True
    if Path(vehicle).suffix:
        return False

    raise ConfigurationError(
        f"unknown vehicle {shown(vehicle)}; there are {', '.join(names)}, or a file, MJCF, URDF, "
        f"xacro or SDF{did_you_mean(vehicle, names)}"
    )


def _of_spec(spec: mujoco.MjSpec) -> VehicleFile:
    return VehicleFile(name=f"vehicle {shown(spec.modelname)}", spec=spec.copy())


def _of_name(name: str, tool: str | None) -> VehicleFile:
    takes = tool is not None and name in _TAKE_TOOL
    spec = models.VEHICLES.load(name, tool=tool) if takes else models.load(name)
    return VehicleFile(name=f"vehicle {shown(name)}", spec=spec, has_tool=takes)


def _of_file(file: Path, water: str | Path | None, arguments: Mapping[str, str]) -> VehicleFile:
    """A vehicle from a file: SDF, URDF or xacro, otherwise MJCF."""
    name = f"vehicle {shown(str(file))}"
    if b"<sdf" in bytes_of(file, "vehicle")[:_HEAD]:
        return _of_sdf(file, parse_sdf(file, name), water)

    robot = robot_of(file, name, arguments)
    return _of_mjcf(file, water) if robot is None else _of_urdf(file, robot, water)


def _of_sdf(file: Path, model: SdfModel, water: str | Path | None) -> VehicleFile:
    spec, lines, content = spec_of_sdf(model, file.resolve().parent)
    sidecar.attach_beside(spec, file, water, content.tree())
    elements = Element("robot")
    elements.extend(joint.element for joint in model.joints.values())

    return VehicleFile(
        name=model.name,
        spec=spec,
        notes=tuple(lines),
        bare=True,
        entries=tuple(content.entries),
        thrusters=tuple(content.thrusters),
        speeds=speeds(elements, model.name),
    )


def _of_urdf(file: Path, robot: UrdfRobot, water: str | Path | None) -> VehicleFile:
    content = content_of_urdf(robot.xml, robot.name)
    spec, lines = spec_of_urdf(robot, file.resolve().parent)
    sidecar.attach_beside(spec, file, water, content.tree())

    return VehicleFile(
        name=robot.name,
        spec=spec,
        notes=tuple(lines),
        bare=True,
        entries=tuple(content.entries),
        thrusters=tuple(content.thrusters),
        speeds=robot.speeds,
    )


def _parts_beside(file: Path) -> Path | None:
    """The mapping that lies beside a vehicle's file; None: there is none."""
    names = (file.stem, file.stem.removesuffix(WET))
    beside = (file.with_name(name + PARTS_SUFFIX) for name in names)
    return next((mapping for mapping in beside if mapping.is_file()), None)


def _of_mjcf(file: Path, water: str | Path | None) -> VehicleFile:
    spec, _ = read_mjcf(file, "vehicle")
    notes.forget(spec)  # lines about computed parts of an earlier state, saved with it
    sidecar.attach_beside(spec, file, water)

    if hydrodynamics.attached(spec):
        hydrodynamics.attach(spec, {})  # MJCF keeps user data of bodies but not of the world
    return VehicleFile(name=f"vehicle {shown(str(file))}", spec=spec)
