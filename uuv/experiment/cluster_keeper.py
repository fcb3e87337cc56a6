"""Keeper of a Ray cluster: a process that outlives the study and ends the remaining processes of
its cluster.

The operating system ends a cluster's head together with the process that has started it. The two
agents of a node continue for 60 s (`ray._private.utils.publish_error_to_driver`), because they try
to report the death of their node to a cluster that no longer exists.
"""

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_PROC = Path("/proc")
_PERIOD = 0.1  # [s] between two searches for processes
# number of searches without a result after which all processes count as ended, since a process that
# ends may have started another
_QUIET = 5
_LOOKS = 300  # at most this many searches; a process that cannot be ended is left


@contextmanager
def kept_cluster() -> Iterator[str | None]:
    """Context manager that provides a folder. When the block or this process ends, it ends all
    other processes that write there.

    The processes of a cluster are recognised by their open log files. Their environment cannot be
    used, since Ray overwrites it with the process name. The folder is removed after an orderly end
    of the block. Without /proc, that is, outside Linux, no process is ended.

    Yields:
        The folder, for Ray's `_temp_dir`; None outside Linux, where Ray uses its own.
    """
    if not (_PROC / "self" / "fd").exists():
        yield None
        return
    folder = tempfile.mkdtemp(prefix="uuv_ray_", dir=os.environ.get("RAY_TMPDIR"))
    command = [sys.executable, "-I", "-S", __file__, folder, str(os.getpid())]
    # The keeper has its own session, so that a signal to the study's group, such as Ctrl-C, does
    # not end it.
    with subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    ):
        yield folder
    shutil.rmtree(folder, ignore_errors=True)


def _end_all(folder: str, but: str) -> None:
    """End the processes that write in a folder, except the process `but`."""
    quiet = 0
    for _ in range(_LOOKS):
        ended = [_ended(process, folder) for process in _PROC.glob("[0-9]*") if process.name != but]
        quiet = 0 if any(ended) else quiet + 1
        if quiet == _QUIET:
            return
        time.sleep(_PERIOD)


def _ended(process: Path, folder: str) -> bool:
    """End a process, given by its folder in /proc, if it wrote in the folder; True if it did."""
    try:
        # opened before the test, because the process number may be used again by another process
        handle = os.pidfd_open(int(process.name))
    except OSError:
        return False
    try:
        if not any(_writes(file, folder) for file in (process / "fd").iterdir()):
            return False
        signal.pidfd_send_signal(handle, signal.SIGKILL)
    except OSError:  # the process belongs to another user, or has ended
        return False
    finally:
        os.close(handle)
    return True


def _writes(file: Path, folder: str) -> bool:
    """True if an open file, given by its link in /proc, is in the folder and open for writing."""
    try:
        return os.readlink(file).startswith(f"{folder}{os.sep}") and bool(
            file.lstat().st_mode & 0o200
        )
    except OSError:  # closed in the meantime
        return False


if __name__ == "__main__":
    sys.stdin.buffer.read()  # the pipe closes with the block, or with the study
    _end_all(*sys.argv[1:])
