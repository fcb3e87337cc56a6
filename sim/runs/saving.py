"""Atomic file writing: to a temporary file in the same folder, synced, then renamed."""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from uuv.sim.interfaces.errors import ConfigurationError


def write_whole(file: str | Path, content: str | bytes, *, part_in: Path | None = None) -> None:
    """Write `content`, text in UTF-8, to `file`; otherwise as `whole_file`."""
    with whole_file(file, part_in=part_in) as stream:
        stream.write(content.encode() if isinstance(content, str) else content)


@contextmanager
def whole_file(file: str | Path, *, part_in: Path | None = None) -> Iterator[BinaryIO]:
    """Stream whose content becomes `file` at the end, atomically: a reader sees the old or the new.

    Where the block raises, the old one stays.

    Args:
        file: File to write.
        part_in: Folder of the temporary file, on the same file system; None: that of `file`.

    Raises:
        ConfigurationError: The file cannot be written (no such folder, no right, no space).
    """
    path = Path(file)
    part = (path if part_in is None else part_in / path.name).with_name(
        f".{path.name}.{os.getpid()}"
    )

    try:
        try:
            part.unlink(missing_ok=True)
            with open(part, "wb", opener=_not_through_a_link) as stream:
                yield stream
                stream.flush()
                os.fsync(stream.fileno())
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be written ({error.strerror})") from error


def _not_through_a_link(name: str, flags: int) -> int:
    """Opens a file; a link of its name, in a folder of another's making, is not followed."""
    return os.open(name, flags | getattr(os, "O_NOFOLLOW", 0), 0o666)


def write_json(file: str | Path, content: Any) -> None:
    """Write `content` to `file` as `write_whole` does.

    Raises:
        ValueError: `content` has values that JSON lacks, such as NaN.
    """
    write_whole(file, json.dumps(content, indent=2, allow_nan=False) + "\n")
