"""Options that all studies share, and their checks."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from uuv.experiment.engines import EngineName
from uuv.sim.interfaces.errors import ConfigurationError


class PoolOptions(Protocol):
    """Options of a command that `Study.carry_out` reads."""

    engine: EngineName
    workers: int
    out: Path | None
    anew: bool


@dataclass(kw_only=True)
class HarnessOptions:
    """Options of the harness of studies and campaigns."""

    engine: EngineName = "processes"
    """processes: of this machine. ray: a Ray cluster, that of RAY_ADDRESS or one started here
    (extra cluster).
    """
    workers: int = 0
    """Number of processes; 0: one for each core, 1: this one. Results do not depend on it."""
    out: Path | None = None
    """Folder for rows, metrics.json and report.html, by default runs/<study>; a study that was
    interrupted is resumed there.
    """
    anew: bool = False
    """Delete the runs in that folder."""

    def __post_init__(self) -> None:
        at_least(self, workers=0, **({"runs": 1} if hasattr(self, "runs") else {}))


@dataclass(kw_only=True)
class StudyOptions(HarnessOptions):
    """Options of every study; each adds its number of runs."""

    seed: int = 0
    """Seed of the study."""


def at_least(options: Any, **least: int) -> None:
    """Check options by name against their smallest values; None is allowed.

    Raises:
        ConfigurationError: An option is too small.
    """
    for name, bound in least.items():
        number = getattr(options, name)
        if number is not None and not number >= bound:
            raise ConfigurationError(
                f"--{name.replace('_', '-')}: must be at least {bound}, got {number}"
            )
