"""Result of a vehicle's check: parts, figures, findings with a code, and a verdict per job."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any, Literal

from uuv.models.files.gazebo.entries import ReadEntry

# note: computed, or worth knowing; doubt: likely wrong; fault: jobs are refused
Level = Literal["note", "doubt", "fault"]
PartState = Literal["there", "computed", "missing"]


@dataclass(frozen=True, slots=True, kw_only=True)
class VehiclePart:
    """One part of the contract."""

    name: str
    use: str
    state: PartState
    said: str = ""  # how it was computed


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleFigure:
    """One figure of the vehicle, in words."""

    name: str
    said: str


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleFinding:
    """Something that is wrong, or likely wrong."""

    code: str
    level: Level
    said: str  # a sentence with the figure and its bound
    figure: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class JobVerdict:
    """Verdict on whether a job is feasible, with the decisive figure."""

    job: str
    promised: bool
    code: str  # deciding cause: parts, water, thrust, force, reach, view, hover, current, ok
    said: str
    figure: float | None = None
    share: float | None = None  # of the drawn poses at which it can begin and be carried through
    remedy: str = ""  # option with which a refused job is feasible, as it is typed


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleCheck:
    """Result of the check of a vehicle."""

    vehicle: str
    parts: tuple[VehiclePart, ...] = ()
    # hydrodynamic data and thrusters of its file: read, guessed or left out
    file: tuple[ReadEntry, ...] = ()
    figures: tuple[VehicleFigure, ...] = ()
    findings: tuple[VehicleFinding, ...] = ()
    jobs: tuple[JobVerdict, ...] = ()

    @property
    def sound(self) -> bool:
        """True if every requested job is promised and there is no fault."""
        return all(job.promised for job in self.jobs) and not any(
            finding.level == "fault" for finding in self.findings
        )

    def found(self, code: str) -> VehicleFinding | None:
        """The first finding with that code."""
        return next((finding for finding in self.findings if finding.code == code), None)

    def verdict(self, job: str) -> JobVerdict:
        """Verdict of a job. Raises KeyError for a job that was not requested."""
        return {job.job: job for job in self.jobs}[job]

    def lines(self) -> Iterator[str]:
        """One line for each finding: its code and its sentence."""
        for finding in self.findings:
            yield f"{finding.code}: {finding.said}"

    def as_dict(self) -> dict[str, Any]:
        """The result in JSON types."""
        return asdict(self) | {"sound": self.sound}
