"""Common start and end of scenario scripts: options, import check, signals, errors, exit codes.

Exit codes: 0 done; 1 done, but out of bounds; 2 bad input; 70 an error of the program; 130 ended by
Ctrl-C; 143 ended by SIGTERM; 141 the reader of the output has closed the pipe.
"""

import contextlib
import io
import math
import os
import re
import signal
import sys
import sysconfig
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any, ClassVar, Literal, NoReturn, TypeVar, cast

from uuv.sim.interfaces.errors import UuvError, did_you_mean, one_line
from uuv.sim.interfaces.extras import missing
from uuv.sim.runs.process import (
    BAD_INPUT,
    children_kept_from_the_working_folder,
    quiet_pipe,
    reader_is_gone,
)
from uuv.sim.runs.run_folder import give_back

# packages of `uuv`, which are folders of a checkout
ROOMS = ("models", "sim", "perception", "controllers", "calib")
INTERNAL = 70  # exit code of an error of the program: EX_SOFTWARE of BSD's sysexits
# option of every script that prints the traceback of such an error; same as UUV_TRACEBACK=1
TRACEBACK = "--traceback"
_HOME = Path(__file__).resolve().parents[2]
# Matches a dotted key of a scenario file in a message, but not a part of a path, of a quoted value
# or of MODULE:NAME.
_KEY = re.compile(r"(?<![\w./\\'\"-])[a-z]\w*(?:\.[a-z]\w*)+(?!\w|[/\\(-]|[.:]\w)")
_OF_OUTPUT = ("json",)  # an option whose name ends the names of files, which are not keys

Options = TypeVar("Options")


@dataclass(kw_only=True)
class ResultOptions:
    """Where the results of a command go."""

    # title: names of the options
    groups: ClassVar[Mapping[str, str]] = {"output": "out record"}
    # key in a scenario file, by the option; other keys end with the option's name
    keys: ClassVar[Mapping[str, str]] = {}

    out: Path | None = None
    """New folder for metrics.json, run.rrd and report.html; runs/<scenario>/<time>-<seed> by
    default.
    """
    record: bool = True
    """Write run.rrd and report.html (--no-record: the figures alone, faster)."""


@dataclass(kw_only=True)
class RunOptions(ResultOptions):
    """Options of every run that change no figure."""

    groups: ClassVar[Mapping[str, str]] = {"output": "out view record log longest pace"}

    view: bool = False
    """Open the Rerun viewer while the run goes on."""
    log: Literal["mcap"] | None = None
    """mcap: write run.mcap too, while the run goes on, for the tools of ROS 2."""
    pace: float | None = None
    """Factor of real time to keep, such as 1; default: as fast as it goes."""
    longest: float | None = None
    """Limit of the simulated time [s]; default: 1.5 times what the job needs, and at least 400."""


# class of the options that this process read last, for the words of its command line
_typed: type[Any] = RunOptions


class Interrupted(KeyboardInterrupt):
    """Request to end the process, by SIGINT or SIGTERM; `signal` is its number."""

    def __init__(self, number: int = signal.SIGINT) -> None:
        super().__init__(number)
        self.signal = signal.Signals(number)

    @property
    def code(self) -> int:
        """Exit code by the convention of shells."""
        return 128 + self.signal


@contextlib.contextmanager
def signals(act: Callable[[int, FrameType | None], Any]) -> Iterator[None]:
    """Handle SIGINT and SIGTERM by `act`; signals that were ignored (nohup) stay ignored.

    To be called in the main thread only.
    """
    before: dict[int, Any] = {}
    try:
        for number in (signal.SIGINT, signal.SIGTERM):
            if signal.getsignal(number) is not signal.SIG_IGN:
                before[number] = signal.signal(number, act)
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def interrupt(number: int, _frame: FrameType | None = None) -> NoReturn:
    """Signal handler of scripts: raises Interrupted."""
    raise Interrupted(number)


def parse(kind: type[Options], args: Sequence[str] | None = None) -> Options:
    """Parse `args` (default: the command line) into a `kind` with tyro; a mistake ends with code 2.

    TRACEBACK is removed first: `run_scenario` evaluates it.
    """
    from uuv.sim.runs.option_groups import cli  # imported here, so that `sim` runs without tyro

    args = [arg for arg in (sys.argv[1:] if args is None else args) if arg != TRACEBACK]
    messages = io.StringIO()

    try:
        with contextlib.redirect_stderr(messages):
            options = cli(kind, args)
    except SystemExit as stop:
        if stop.code != BAD_INPUT:
            raise  # --help

        # tyro draws a box, in colour on a terminal: title, message, a horizontal rule, help.
        rows = (
            row.strip(" │|")
            for row in re.sub(r"\x1b\[[0-9;]*m", "", messages.getvalue()).splitlines()[1:]
        )
        parts = re.split(r"^[─-]{8,}$", "\n".join(rows), flags=re.MULTILINE)
        mistake = next((part for part in parts if part.strip()), "bad options")

        if mistake.strip().startswith("Missing from"):
            lacking = (
                entry.split()[0]
                for entry in mistake.partition(":")[2].split("(required)")
                if entry.split()
            )
            mistake = f"{', '.join(lacking)}: missing"

        unknown = re.search(r"Unrecognized options?: (--[\w-]+)", mistake)
        known = [f"--{option.name.replace('_', '-')}" for option in fields(cast(Any, kind))]
        suggestion = did_you_mean(unknown[1], known) if unknown else ""
        raise _refusal(
            f"{mistake.strip().rstrip('.')} (--help lists the options){suggestion}"
        ) from None

    global _typed
    _typed = kind

    for name, setting in vars(options).items():
        if name.endswith("seed") and setting is not None and setting < 0:
            raise _refusal(f"--{name.replace('_', '-')}: must not be negative, got {setting}")
        for number in setting if isinstance(setting, tuple) else (setting,):
            if isinstance(number, float) and not math.isfinite(number):
                raise _refusal(f"--{name.replace('_', '-')}: must be finite, got {number}")

    return options


def as_base(options: Any, base: type[Options]) -> Options:
    """The options of the base class `base`, taken from `options` of a class that inherits it."""
    return base(
        **{option.name: getattr(options, option.name) for option in fields(cast(Any, base))}
    )


def with_options(message: str, kind: type[Any]) -> str:
    """A message about keys of a scenario file, with the command-line option of each key put before
    it.

    Args:
        message: Such as "task.range [m]: must be positive". A message that begins with an option is
            left unchanged.
        kind: Class of the options.

    Returns:
        The message, in this example "--range (task.range) [m]: must be positive".
    """
    if message.startswith("--"):
        return message
    names = {field.name for field in fields(kind)}
    keys = {key: name for base in kind.__mro__ for name, key in vars(base).get("keys", {}).items()}
    known: set[str] = set()

    def named(match: re.Match[str]) -> str:
        key = match[0]
        name = keys.get(key, key.rpartition(".")[2])
        if name not in names or name in _OF_OUTPUT or (name in keys.values() and key not in keys):
            return key
        option = f"--{name.replace('_', '-')}"
        if key in known:
            return option
        known.add(key)
        return f"{option} ({key})"

    # An option that is in no scenario (of every run, or of a job) begins the message by its name.
    of_job = set(vars(kind).get("abouts", {})) - set(keys)
    bare = {field.name for field in fields(RunOptions)} | of_job
    head = re.match(r"[a-z]\w*(?= \[|:| \d)", message)
    text = _KEY.sub(named, message)
    if head and head[0] in names & bare:
        text = f"--{head[0].replace('_', '-')}{text[head.end() :]}"

    return text


def run_scenario(main: Callable[[], int | None]) -> NoReturn:
    """Run `main` and exit with its return code; an error ends in one line and an exit code.

    The code is 2 for a UuvError, an optional package that is not installed, and an error raised in
    a user's own module. It is 70 for any other error, whose place is printed, 130 for SIGINT, and
    143 for SIGTERM. A closed pipe ends the program without a message, with code 141.
    """
    with children_kept_from_the_working_folder(), quiet_pipe():
        _exit(main)


def _exit(main: Callable[[], int | None]) -> NoReturn:
    """Run `main` and exit with its return code, or with a code that `run_scenario` lists."""
    try:
        with signals(interrupt):
            code = main()

    # The run has requested an exit, or the reader of its output has closed the pipe.
    except (BrokenPipeError, SystemExit) as error:
        if reader_is_gone(error):
            give_back()
        elif isinstance(error, BrokenPipeError):
            raise _failure(error) from None
        raise

    # A mistake of the user, a package that is missing, or a request to end.
    except UuvError as error:
        give_back()
        raise _refusal(with_options(str(error), _typed)) from None
    except ImportError as error:
        give_back()
        absence = missing(error)
        raise (_failure(error) if absence is None else _refusal(str(absence))) from None
    except KeyboardInterrupt as stop:
        give_back()
        print("interrupted", file=sys.stderr)
        raise SystemExit(
            stop.code if isinstance(stop, Interrupted) else Interrupted().code
        ) from None

    # An error of the program, or of a user's own module.
    except Exception as error:
        give_back()
        raise _failure(error) from None
    raise SystemExit(code or 0)


def _failure(error: Exception) -> SystemExit:
    """Exit for an unexpected error, in one line, after its traceback if that was requested."""
    if TRACEBACK in sys.argv or os.environ.get("UUV_TRACEBACK"):
        traceback.print_exc()
    return _refusal(*_blame(error))


def _blame(error: Exception) -> tuple[str, int]:
    """Message and exit code of an unexpected error, of a user's own module or of the program."""
    failure = f"{type(error).__name__}: {' '.join(str(error).split())[:300]}"

    # A user's own module counts before the program that called it.
    places = list(_places(error.__traceback__))
    folders = [_HOME / name for name in ("uuv", *ROOMS, "scripts")]
    of_project = [
        frame for frame in places if any(frame[2].is_relative_to(folder) for folder in folders)
    ]
    of_user = [frame for frame in places if frame not in of_project and not is_installed(frame[2])]
    if of_user:
        frame, line, file = of_user[-1]
        module = frame.f_globals.get("__name__", file.stem)
        return f"{module}: {frame.f_code.co_qualname} raised {failure} ({file}:{line})", BAD_INPUT

    _, line, file = (of_project or places)[-1]
    shown_path = file.relative_to(_HOME) if file.is_relative_to(_HOME) else file
    return f"internal: {failure} ({shown_path}:{line}; {TRACEBACK} shows the traceback)", INTERNAL


def _places(trace: TracebackType | None) -> Iterator[tuple[FrameType, int, Path]]:
    """Frame, line and file of each level of a traceback that has a file, outermost first."""
    for frame, line in traceback.walk_tb(trace):
        if not frame.f_code.co_filename.startswith("<"):
            yield frame, line, Path(frame.f_code.co_filename).resolve()


def is_installed(file: Path) -> bool:
    """Return True if `file` belongs to Python itself or to an installed package."""
    packages = [
        Path(path).resolve()
        for name in ("stdlib", "platstdlib")
        if (path := sysconfig.get_path(name))
    ]
    return not {"site-packages", "dist-packages"}.isdisjoint(file.parts) or any(
        map(file.is_relative_to, packages)
    )


def _refusal(reason: str, code: int = BAD_INPUT) -> SystemExit:
    print(f"error: {one_line(' '.join(reason.split()))}", file=sys.stderr)
    return SystemExit(code)
