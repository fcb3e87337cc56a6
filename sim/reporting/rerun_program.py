"""Start of Rerun's viewer and command line without the usage data that they send by default.

Writing a log sends nothing. Rerun's own switch, `rerun analytics disable`, writes into the user's
home. Processes started here get CI=1 instead, under which they neither send usage data nor write
there.
"""

import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

PORT = 9876  # of the viewer, Rerun's own choice
WAIT = 15.0  # [s] for a viewer to start
_SMALL = 1_000_000  # [bytes] smaller logs load fast enough without compaction
_PATIENCE = 20.0  # [s] longest time for compaction


def send_to(rr: Any, stream: Any, file: Path, *, view: bool) -> None:
    """Send a recording to a file, and with `view` to a viewer. If none starts, stderr gets a line.

    Args:
        rr: The module `rerun`.
        stream: The recording.
        file: File to write.
        view: Show it too.
    """
    if view and spawn_viewer(rr, stream):
        stream.set_sinks(rr.FileSink(str(file)), rr.GrpcSink())
        return
    if view:
        print(
            f"view: the Rerun viewer did not start; open the log later by: rerun {file}",
            file=sys.stderr,
        )
    stream.save(str(file))


def spawn_viewer(rr: Any, stream: Any) -> bool:
    """Start the viewer, or find the running one.

    Args:
        rr: The module `rerun`.
        stream: Recording that is to be shown; without one `rerun` starts nothing.

    Returns:
        Whether it listens; without a screen or a graphics driver it may not start.
    """
    with _quiet():
        rr.spawn(connect=False, recording=stream, port=PORT, executable_path=str(_program()))
    return _listens(WAIT)


def _listens(patience: float) -> bool:
    """True if a viewer accepts connections within `patience` [s]."""
    until = time.monotonic() + patience
    while True:
        try:
            socket.create_connection(("127.0.0.1", PORT), timeout=1.0).close()
            return True
        except OSError:
            if time.monotonic() > until:
                return False
            time.sleep(0.1)


def compact(file: Path) -> bool:
    """Rewrite a closed log in fewer, larger chunks, which load faster; True if it was rewritten.

    1528 chunks of 8 MB become 52 of 6 MB, in about a second. On failure the log stays as it is.
    """
    smaller = file.with_name(f".{file.name}.{os.getpid()}.part")
    try:
        with file.open("rb") as log:
            # a file that is no log would come out empty
            if log.read(3) != b"RRF" or file.stat().st_size < _SMALL:
                return False

        command = [str(_program()), "rrd", "optimize", str(file), "-o", str(smaller)]
        subprocess.run(
            command,
            capture_output=True,
            check=True,
            timeout=_PATIENCE,
            env=os.environ | {"CI": "1"},
        )

        smaller.replace(file)
        return True
    except (ImportError, OSError, subprocess.SubprocessError):
        return False
    finally:
        smaller.unlink(missing_ok=True)


def _program() -> Path:
    """Path of Rerun's binary without its Python wrapper, which loses the exit code.

    ImportError if not installed.
    """
    import rerun_cli

    folder = Path(rerun_cli.__file__ or "").parent
    bundled = folder / "Rerun.app" / "Contents" / "MacOS" / "Rerun"  # on macOS
    return bundled if bundled.exists() else folder / ("rerun.exe" if os.name == "nt" else "rerun")


@contextmanager
def _quiet() -> Iterator[None]:
    """Context that suppresses usage data of the processes started in it."""
    before = os.environ.get("CI")
    os.environ["CI"] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ["CI"]
        else:
            os.environ["CI"] = before
