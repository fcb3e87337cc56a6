"""Input of an arm calibration: nominal arm, touches from the user's files, and loads."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from uuv import models
from uuv.arm_identification.calibration_options import check_arm
from uuv.arm_identification.touching import Session
from uuv.calib.arm_files import ArmSource, read_arm
from uuv.calib.loads import Loads
from uuv.calib.simulation import EccentricGears, Sag, true_joints
from uuv.calib.touch_files import Touches, read_touches
from uuv.calib.verdicts.doubts import coincide
from uuv.components.deck_calibration import LENGTH_ERROR
from uuv.models.arms import published_arms
from uuv.models.arms.serial_arm import SerialArm
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import GRAVITY, Array, finite_number


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrueArm:
    """The true arm of a simulation. The calibration receives only its touches."""

    arm: SerialArm
    tcp: Array  # (3,) [m]
    hangs: bool  # z of the arm's base points down
    sag: Sag | None = None  # elastic joints, without payload
    gears: EccentricGears | None = None

    def stands_at(self, q: Array) -> Array:
        """True joint values (N, n) [rad] when the encoders read `q`."""
        return true_joints(self.arm, q, sag=self.sag, gears=self.gears)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CalibrationCase:
    """Input of a calibration, and the data to evaluate it with."""

    title: str
    source: ArmSource  # nominal arm
    touches: Touches
    distances: tuple[tuple[int, int, float, float], ...] = ()
    held_out: Touches | None = None
    truth: TrueArm | None = None
    session: Session | None = None  # touching by contact
    # loads under which the joints bend; None: compliances are not identified
    loads: Loads | None = None
    # (4, 4) arm base on a hull that moved during the touches; None: fixed base
    X_BA: Array | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Loading:
    """Weights on the arm from the command line. The base of the arm is upright or hangs from a
    vehicle.
    """

    # [kg] masses of the links; empty: spread evenly along the links
    link_masses: tuple[float, ...] = ()
    payload: tuple[float, ...] = ()  # [kg] payloads at the tool, one for each point; empty: none

    def on(self, source: ArmSource, points: int) -> Loads:
        """Loads on the arm of `source` during the touches of `points` points.

        Raises:
            ConfigurationError: The number of masses differs from that of the links, or the number
                of payloads from that of the points.
        """
        n = len(source.arm.joint_types)
        for option, masses, count in (
            ("--link-mass", self.link_masses, n),
            ("--payload", self.payload, points),
        ):
            if masses and len(masses) != count:
                raise ConfigurationError(f"{option}: must have {count} values, got {len(masses)}")
            for mass in masses:
                finite_number(mass, f"{option} [kg]", least=0.0, most=1e4)

        # the z axis of a vehicle's arm points down
        down = GRAVITY if source.kind == "mjcf" else -GRAVITY
        return Loads(
            link_masses=self.link_masses or None,
            payload_mass=list(self.payload) or 0.0,
            gravity=(0.0, 0.0, down),
        )


def nominal(name: str, folder: Path, base: str | None, tip: str | None) -> ArmSource:
    """The nominal arm called `name`: a published arm, the arm of a vehicle, or a file.

    Args:
        name: Name or path.
        folder: Folder to which a vehicle's MJCF is written.
        base: Base link or body of a URDF or MJCF.
        tip: Tip link or site of a URDF or MJCF.

    Raises:
        ConfigurationError: The name is unknown, or the file is unusable.
    """
    check_arm(name)

    # A name is tried first, then a file.
    if name in published_arms.available():
        return ArmSource(
            path=Path(name),
            kind="dh",
            arm=published_arms.load(name),
            base="base",
            tip="flange",
            sha256="",
        )

    if name in models.available():
        file = folder / f"{name}.xml"
        file.write_text(models.load(name).to_xml(), encoding="utf-8")
        return read_arm(file, base=base, tip=tip)

    return read_arm(name, base=base, tip=tip)


UNLOADED = Loading()


def from_files(
    source: ArmSource,
    touches: Sequence[Path],
    held_out: Sequence[Path],
    units: Literal["auto", "rad", "deg"],
    distances: Sequence[tuple[str, str, float]],
    limits: Literal["arm", "encoders"] = "arm",
) -> CalibrationCase:
    """Calibration case from the user's own touches.

    Args:
        source: Nominal arm.
        touches: CSV files, or folders of them.
        held_out: Touches for validation only.
        units: Unit of the angles.
        distances: Known distances: point, point, [m].
        limits: "encoders": the touches may be beyond the limits of the arm.

    Raises:
        ConfigurationError: A file is unusable, `distances` names an unknown point, or touches are
            beyond the limits and, in addition, do not coincide.
    """
    arm = source.arm
    how = {
        "joint_types": arm.joint_types,
        "joint_names": arm.joint_names,
        "units": units,
        "limits": arm.limits,
    }

    read = read_touches(touches, **how, beyond="note")
    rest = read_touches(held_out, **how, beyond="note") if held_out else None
    notes = [*source.notes, *read.notes, *(rest.notes if rest else ())]
    for measured in filter(None, (read, rest)):
        notes += _beyond(arm, measured, limits)

    # Known distances between points, by their indices.
    pairs = []
    for first, second, length in distances:
        for name in (first, second):
            if name not in read.names:
                raise ConfigurationError(
                    f"--distance: no point {name!r}; there are {', '.join(read.names)}"
                )
        pairs.append((read.names.index(first), read.names.index(second), length, LENGTH_ERROR))

    return CalibrationCase(
        title=f"Calibration of {source.path.name}",
        source=source,
        touches=read,
        distances=tuple(pairs),
        held_out=rest,
        notes=tuple(notes),
    )


def _beyond(arm: SerialArm, read: Touches, limits: Literal["arm", "encoders"]) -> list[str]:
    """Notes on touches beyond the arm's limits; if the touches coincide, the limits are wrong.

    Raises:
        ConfigurationError: The touches do not coincide, and the option to trust the encoders is not
            set.
    """
    if not read.beyond:
        return []
    if limits == "arm" and not coincide(arm, list(read.series)):
        raise ConfigurationError(
            f"{read.beyond[0]}; check the unit and order of the joint values. If they are right, "
            "give --limits encoders"
        )

    return [
        f"{line}: encoder readings are used; the limits of the arm may be too narrow"
        for line in read.beyond
    ]
