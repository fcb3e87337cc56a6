"""Atomic file writing: into a temporary file in the same folder, which is synced and then
renamed.
"""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from uuv.sim.interfaces.errors import ConfigurationError


def write_whole(file: str | Path, content: str | bytes, *, part_in: Path | None = None) -> None:
    """Write `content`, as text in UTF-8, to `file`; see `whole_file` for the rest."""
    with whole_file(file, part_in=part_in) as stream:
        stream.write(content.encode() if isinstance(content, str) else content)


@contextmanager
def whole_file(file: str | Path, *, part_in: Path | None = None) -> Iterator[BinaryIO]:
    """Stream whose content becomes `file` at the end, atomically: a reader sees the old or the new
    file.

    If the block raises an exception, the old file stays.

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
    """Open a file, but do not follow a link of its name, since others may have written to the
    folder.
    """
    return os.open(name, flags | getattr(os, "O_NOFOLLOW", 0), 0o666)


def write_json(file: str | Path, content: Any) -> None:
    """Write `content` to `file` by `write_whole`.

    Raises:
        ValueError: `content` has values that JSON lacks, such as NaN.
    """
    write_whole(file, json.dumps(content, indent=2, allow_nan=False) + "\n")
