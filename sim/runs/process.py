"""The process of a command: its system, and a reader of its output who has had enough.

Standard library alone: this is the first thing that a command imports.
"""

import os
import select
import sys
from collections.abc import Iterator
from contextlib import contextmanager

BAD_INPUT = 2  # exit code
_PIPE_CLOSED = 128 + 13  # exit code of a program that SIGPIPE ended, by the convention of shells
_SAFE_PATH = "PYTHONSAFEPATH"  # read by a Python when it starts
_NOT_POSIX = ("win32", "cygwin")


def refuse_foreign_system() -> None:
    """Ends the process with one line on Windows: signals, locks and workers are those of POSIX."""
    if sys.platform in _NOT_POSIX:
        print(
            "error: Windows is not supported; run this under WSL 2 (wsl --install) or in a Linux "
            "container",
            file=sys.stderr,
        )
        raise SystemExit(BAD_INPUT)


def parts_from_the_working_folder() -> None:
    """Lets own parts, MODULE:ATTRIBUTE, be found where one works, after all that is installed.

    First on the path, a csv.py or a folder `models` beside one's data would be run in place of
    Python's or of ours.
    """
    working_folder = os.getcwd()
    sys.path[:] = [
        folder
        for folder in sys.path
        if folder and os.path.realpath(folder) != os.path.realpath(working_folder)
    ] + [working_folder]


@contextmanager
def children_kept_from_the_working_folder() -> Iterator[None]:
    """Lets Pythons started within, by `-m` and `-c`, not look for modules where they work first.

    The environment is then as before: a program that ran a command goes on in its own.
    """
    before = os.environ.get(_SAFE_PATH)
    os.environ[_SAFE_PATH] = "1"
    try:
        yield
    finally:
        if before is None:
            os.environ.pop(_SAFE_PATH, None)
        else:
            os.environ[_SAFE_PATH] = before


@contextmanager
def quiet_pipe() -> Iterator[None]:
    """Ends the process without a word where its output's reader is gone, as in `uuv list | head`.

    Raises:
        SystemExit: The reader is gone; the code is that of other programs that SIGPIPE ends.
    """
    stopped: SystemExit | None = None
    try:
        try:
            yield
        except SystemExit as stop:
            stopped = stop
        if stopped is None or not reader_is_gone(stopped):
            # else the interpreter meets the closed pipe at its very end, and says so
            sys.stdout.flush()
    except BrokenPipeError as error:
        if not reader_is_gone(error):
            raise
        stopped = SystemExit(_PIPE_CLOSED)
    else:
        if stopped is not None and reader_is_gone(stopped):
            stopped = SystemExit(_PIPE_CLOSED)

    if stopped is None:
        return
    if stopped.code == _PIPE_CLOSED:
        _discard_output()
    raise stopped


def reader_is_gone(error: BaseException) -> bool:
    """True if `error` means that nobody reads stdout or stderr any more, not some other pipe."""
    if isinstance(error, SystemExit):  # of rich, which has turned stdout away already
        return isinstance(error.__context__, BrokenPipeError)
    if not isinstance(error, BrokenPipeError):
        return False

    poll = select.poll()
    for stream in (sys.stdout, sys.stderr):
        try:
            poll.register(stream.fileno(), 0)
        except (OSError, ValueError):  # not a file
            continue
    return any(event & select.POLLERR for _, event in poll.poll(0))


def _discard_output() -> None:
    """Turns stdout and stderr away, so that what is still to be flushed is lost without a word."""
    null_device = os.open(os.devnull, os.O_WRONLY)
    for stream in (sys.stdout, sys.stderr):
        try:
            os.dup2(null_device, stream.fileno())
        except (OSError, ValueError):
            continue
