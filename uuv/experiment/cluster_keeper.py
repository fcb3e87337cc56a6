"""Keeper of a Ray cluster: a process that outlives the study and ends what its cluster left.

The kernel ends a cluster's head with the process that has started it. The two agents of a node go
on for 60 s (`ray._private.utils.publish_error_to_driver`): they report the death of their node to a
cluster that is gone.
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
_PERIOD = 0.1  # [s] between two looks
# looks without a process, until all of them count as gone: one that ends may have started another
_QUIET = 5
_LOOKS = 300  # at most: a process that the kernel does not end is left


@contextmanager
def kept_cluster() -> Iterator[str | None]:
    """Gives a folder, and ends all others that write there with the block or with this process,
    whichever is first.

    Each process of a cluster keeps its logs open. Its environment would not tell: Ray overwrites
    that with its name. The folder is removed after an orderly end of the block. Without /proc, thus
    outside Linux, nothing is ended.

    Yields:
        The folder, for Ray's `_temp_dir`; None outside Linux: Ray's own.
    """
    if not (_PROC / "self" / "fd").exists():
        yield None
        return
    folder = tempfile.mkdtemp(prefix="uuv_ray_", dir=os.environ.get("RAY_TMPDIR"))
    command = [sys.executable, "-I", "-S", __file__, folder, str(os.getpid())]
    # A session of its own: what ends the study by a signal to its group, as Ctrl-C does, leaves the
    # keeper.
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
    """Ends the processes that write in a folder, but not one of them."""
    quiet = 0
    for _ in range(_LOOKS):
        ended = [_ended(process, folder) for process in _PROC.glob("[0-9]*") if process.name != but]
        quiet = 0 if any(ended) else quiet + 1
        if quiet == _QUIET:
            return
        time.sleep(_PERIOD)


def _ended(process: Path, folder: str) -> bool:
    """True if a process, as its folder in /proc, wrote in the folder; it is ended then."""
    try:
        # before the look: its number may become another one's
        handle = os.pidfd_open(int(process.name))
    except OSError:
        return False
    try:
        if not any(_writes(file, folder) for file in (process / "fd").iterdir()):
            return False
        signal.pidfd_send_signal(handle, signal.SIGKILL)
    except OSError:  # it is another user's, or gone
        return False
    finally:
        os.close(handle)
    return True


def _writes(file: Path, folder: str) -> bool:
    """True if an open file, as its link in /proc, lies in the folder and is open for writing."""
    try:
        return os.readlink(file).startswith(f"{folder}{os.sep}") and bool(
            file.lstat().st_mode & 0o200
        )
    except OSError:  # closed since
        return False


if __name__ == "__main__":
    sys.stdin.buffer.read()  # ends with the block, or with the study
    _end_all(*sys.argv[1:])
