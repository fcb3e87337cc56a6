"""Process of a command: refusal of other operating systems, import path, and closed output pipes.

Only the standard library is used, since this is the first module that a command imports.
"""

import os
import select
import sys
from collections.abc import Iterator
from contextlib import contextmanager

BAD_INPUT = 2  # exit code
_PIPE_CLOSED = 128 + 13  # exit code of a program that SIGPIPE ended, by the convention of shells
_SAFE_PATH = "PYTHONSAFEPATH"  # environment variable that Python reads at its start
_NOT_POSIX = ("win32", "cygwin")


def refuse_foreign_system() -> None:
    """End the process with one line on Windows, since signals, locks and workers are those of
    POSIX.
    """
    if sys.platform in _NOT_POSIX:
        print(
            "error: Windows is not supported; run this under WSL 2 (wsl --install) or in a Linux "
            "container",
            file=sys.stderr,
        )
        raise SystemExit(BAD_INPUT)


def parts_from_the_working_folder() -> None:
    """Let a user's own components, MODULE:ATTRIBUTE, be imported from the working folder, after all
    installed packages.

    If the working folder were first on the path, a csv.py or a folder `models` in it would be
    imported in place of Python's module or of ours.
    """
    working_folder = os.getcwd()
    sys.path[:] = [
        folder
        for folder in sys.path
        if folder and os.path.realpath(folder) != os.path.realpath(working_folder)
    ] + [working_folder]


@contextmanager
def children_kept_from_the_working_folder() -> Iterator[None]:
    """Context manager in which child processes of Python, started by `-m` or `-c`, do not search
    their working folder first for modules.

    Afterwards the environment variable is restored, for a program that ran a command and continues.
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
    """Context manager that ends the process without a message if the reader of its output has
    closed the pipe, as in `uuv list | head`.

    Raises:
        SystemExit: The reader has closed the pipe; the code is that of programs ended by SIGPIPE.
    """
    stopped: SystemExit | None = None
    try:
        try:
            yield
        except SystemExit as stop:
            stopped = stop
        if stopped is None or not reader_is_gone(stopped):
            # otherwise the interpreter meets the closed pipe at its very end, and reports it
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
    """True if `error` means that the pipe of stdout or stderr was closed by its reader."""
    if isinstance(error, SystemExit):  # an exception of rich, which has already redirected stdout
        return isinstance(error.__context__, BrokenPipeError)
    if not isinstance(error, BrokenPipeError):
        return False

    poll = select.poll()
    for stream in (sys.stdout, sys.stderr):
        try:
            poll.register(stream.fileno(), 0)
        except (OSError, ValueError):  # stdout is not a file
            continue
    return any(event & select.POLLERR for _, event in poll.poll(0))


def _discard_output() -> None:
    """Redirect stdout and stderr, so that output that is still to be flushed is dropped
    silently.
    """
    null_device = os.open(os.devnull, os.O_WRONLY)
    for stream in (sys.stdout, sys.stderr):
        try:
            os.dup2(null_device, stream.fileno())
        except (OSError, ValueError):
            continue
