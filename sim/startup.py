"""What every scenario does around its own work: finds out that the rooms are ours, and ends in one line and a code."""

import contextlib
import io
import math
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import NoReturn, TypeVar

from sim.interfaces.errors import ConfigurationError, UuvError, one_line

ROOMS = ("models", "sim", "perception", "controllers", "calib")
BAD_INPUT = 2  # exit code
INTERRUPTED = 130  # exit code, as of a shell: 128 + SIGINT

Options = TypeVar("Options")


@dataclass(kw_only=True)
class ScenarioOptions:
    """What every scenario can be asked."""

    seed: int = 0
    """Seed of everything random: where the object lies, the noise of the sensors, the gusts."""
    current: tuple[float, float, float] = (0.15, 0.0, 0.0)
    """Steady current [m/s], world axes; gusts come on top."""
    gust: float = 0.03
    """Standard deviation of the gusts [m/s] per axis."""
    out: Path | None = None
    """Folder for metrics.json, run.rrd and report.html; runs/<scenario> by default."""
    view: bool = False
    """Open the Rerun viewer while the run goes on."""
    quick: bool = False
    """A shorter job, for a first look within a minute."""
    record: bool = True
    """Write run.rrd and report.html (--no-record: the figures alone, faster)."""

    def folder(self, scenario: str) -> Path:
        """The folder for results, made if need be. Raises ConfigurationError where it cannot be."""
        return made_folder(self.out if self.out is not None else Path("runs") / scenario)


def made_folder(folder: Path) -> Path:
    """`folder` itself, there from now on. Raises ConfigurationError where it cannot be."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError(f"--out {folder}: cannot be made a folder ({error.strerror})") from error
    return folder


def check() -> None:
    """Exit with one line if a module of a room's name, from elsewhere, comes before ours on the path."""
    home = Path(__file__).resolve().parents[1]
    for room in ROOMS:
        found = find_spec(room)
        origin = Path(found.origin or "") if found else Path()
        if origin.resolve().parent != home / room:
            raise _refusal(f"{origin} hides the room {home / room}; rename it or take it off PYTHONPATH")


def parse(kind: type[Options], args: Sequence[str] | None = None) -> Options:
    """`args` (default: the command line) as a `kind` by tyro; a mistake in them ends in one line and exit code 2."""
    import tyro  # here, so that `sim` runs without it

    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            options = tyro.cli(kind, args=args)
    except SystemExit as stop:
        if stop.code != BAD_INPUT:
            raise  # --help
        # tyro draws a box, in colour on a terminal: title, what is wrong, a rule, help.
        rows = (row.strip(" │|") for row in re.sub(r"\x1b\[[0-9;]*m", "", said.getvalue()).splitlines()[1:])
        parts = re.split(r"^[─-]{8,}$", "\n".join(rows), flags=re.MULTILINE)
        mistake = next((part for part in parts if part.strip()), "bad options")
        raise _refusal(f"{mistake.strip().rstrip('.')} (--help lists the options)") from None
    for name, value in vars(options).items():
        if name.endswith("seed") and value < 0:
            raise _refusal(f"--{name.replace('_', '-')}: must not be negative, got {value}")
        for number in value if isinstance(value, tuple) else (value,):
            if isinstance(number, float) and not math.isfinite(number):
                raise _refusal(f"--{name.replace('_', '-')}: must be finite, got {number}")
    return options


def run_scenario(main: Callable[[], int | None]) -> NoReturn:
    """Run `main` and exit with the code that it returns; with one line and code 2 on any UuvError, 130 on Ctrl-C."""
    check()
    try:
        code = main()
    except UuvError as error:
        raise _refusal(str(error)) from None
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        raise SystemExit(INTERRUPTED) from None
    raise SystemExit(code or 0)


def _refusal(reason: str) -> SystemExit:
    print(f"error: {one_line(' '.join(reason.split()))}", file=sys.stderr)
    return SystemExit(BAD_INPUT)
