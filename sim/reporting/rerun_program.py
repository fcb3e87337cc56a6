"""Rerun's own program, as we start it: without usage data, which it sends to its makers unless told not to.

Writing a log sends nothing; the viewer and the command line do. Their own switch, `rerun analytics disable`, writes
into the user's home; what we start is told by CI=1, under which they neither send nor write there.
"""

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

_SMALL = 1_000_000  # [bytes] a log that loads soon enough
_PATIENCE = 20.0  # [s] for a log to be made compact


def spawn_viewer(rr: Any) -> None:
    """Start the viewer, or find the one that runs; `rr` is the module `rerun`."""
    with _quiet():
        rr.spawn(connect=False)


def compact(file: Path) -> bool:
    """Rewrite a closed log in fewer, larger pieces, which a viewer loads sooner; whether it was.

    1528 pieces of 8 MB become 52 of 6 MB, in about a second. Where that cannot be done the log stays as it is.
    """
    smaller = file.with_name(f".{file.name}.{os.getpid()}.part")
    try:
        with file.open("rb") as log:
            if log.read(3) != b"RRF" or file.stat().st_size < _SMALL:  # of what is no log it would make an empty one
                return False
        command = [str(_program()), "rrd", "optimize", str(file), "-o", str(smaller)]
        subprocess.run(command, capture_output=True, check=True, timeout=_PATIENCE, env=os.environ | {"CI": "1"})
        smaller.replace(file)
        return True
    except (ImportError, OSError, subprocess.SubprocessError):
        return False
    finally:
        smaller.unlink(missing_ok=True)


def _program() -> Path:
    """Without Python's wrapper around it, which loses the exit code. Raises ImportError where it is not installed."""
    import rerun_cli

    folder = Path(rerun_cli.__file__ or "").parent
    bundled = folder / "Rerun.app" / "Contents" / "MacOS" / "Rerun"  # on macOS
    return bundled if bundled.exists() else folder / ("rerun.exe" if os.name == "nt" else "rerun")


@contextmanager
def _quiet() -> Iterator[None]:
    """No usage data from processes that are started meanwhile."""
    before = os.environ.get("CI")
    os.environ["CI"] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ["CI"]
        else:
            os.environ["CI"] = before
