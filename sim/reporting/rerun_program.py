"""Start of Rerun's viewer and command line without usage data, which they send to their makers by default.

Writing a log sends nothing. Rerun's own switch, `rerun analytics disable`, writes into the user's home. Processes
started here get CI=1 instead, under which they neither send usage data nor write there.
"""

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

_SMALL = 1_000_000  # [bytes] smaller logs load fast enough without compaction
_PATIENCE = 20.0  # [s] longest time for compaction


def spawn_viewer(rr: Any) -> None:
    """Start the viewer, or find the running one; `rr` is the module `rerun`."""
    with _quiet():
        rr.spawn(connect=False)


def compact(file: Path) -> bool:
    """Rewrite a closed log in fewer, larger chunks, which a viewer loads faster; True if it was rewritten.

    1528 chunks of 8 MB become 52 of 6 MB, in about a second. On failure the log stays as it is.
    """
    smaller = file.with_name(f".{file.name}.{os.getpid()}.part")
    try:
        with file.open("rb") as log:
            if log.read(3) != b"RRF" or file.stat().st_size < _SMALL:  # a file that is no log would come out empty
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
    """Path of Rerun's binary without its Python wrapper, which loses the exit code. ImportError if not installed."""
    import rerun_cli

    folder = Path(rerun_cli.__file__ or "").parent
    bundled = folder / "Rerun.app" / "Contents" / "MacOS" / "Rerun"  # on macOS
    return bundled if bundled.exists() else folder / ("rerun.exe" if os.name == "nt" else "rerun")


@contextmanager
def _quiet() -> Iterator[None]:
    """Suppress usage data of processes started meanwhile."""
    before = os.environ.get("CI")
    os.environ["CI"] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ["CI"]
        else:
            os.environ["CI"] = before
