"""Files that are there whole or not at all: results are written beside their place, synced, and renamed into it."""

import json
import os
from pathlib import Path
from typing import Any

from sim.interfaces.errors import ConfigurationError


def write_whole(file: str | Path, content: str | bytes) -> None:
    """Write `content`, text in UTF-8, to `file`: whoever looks sees the old file or the new one, never a part.

    Raises ConfigurationError where that cannot be (no such folder, no right, no space).
    """
    path = Path(file)
    part = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        try:
            with part.open("wb") as stream:
                stream.write(content.encode() if isinstance(content, str) else content)
                stream.flush()
                os.fsync(stream.fileno())
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be written ({error.strerror})") from error


def write_json(file: str | Path, content: Any) -> None:
    """Write `content` to `file` as `write_whole` does. ValueError for what JSON has no word for, such as NaN."""
    write_whole(file, json.dumps(content, indent=2, allow_nan=False) + "\n")
