"""Input files and folder names: checks of existence, content and encoding; failures are
ConfigurationErrors.
"""

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from io import BufferedReader
from pathlib import Path
from typing import Any

from uuv.sim.interfaces.errors import ConfigurationError, commands_a_terminal
from uuv.sim.interfaces.spatial import shown

# [bytes] of a folder's name; file systems allow 255, and suffixes are added to some names
_LONGEST_NAME = 200


def folder_name(name: Any, what: str) -> str:
    """Return `name` if it is valid for a new folder below another one, such as the folder of a
    scenario.

    Args:
        name: Letters, digits, - and _; several such names may be joined by slashes.
        what: Begins the error message.

    Raises:
        ConfigurationError: The name is too long, or has other characters, which could lead out of
            the folder or control a terminal.
    """
    parts = name.split("/") if isinstance(name, str) else [""]
    if not all(part.replace("_", "").replace("-", "").isalnum() for part in parts):
        raise ConfigurationError(f"{what}: must be letters, digits, - and _, got {shown(name)}")
    if max(len(part.encode()) for part in parts) > _LONGEST_NAME:
        raise ConfigurationError(
            f"{what}: must be at most {_LONGEST_NAME} bytes long, got {shown(name)}"
        )
    return name


def folder_given(folder: Path, what: str) -> Path:
    """Path of a folder that a user has named; the name must be printable.

    Raises:
        ConfigurationError: The name has a control character; the message begins with `what`.
    """
    if commands_a_terminal(str(folder)) or not str(folder).isprintable():
        raise ConfigurationError(f"{what}: must be a printable name, got {shown(str(folder))}")
    return folder


def existing_file(file: Any, what: str) -> Path:
    """Path of an existing file; `what` begins the error message.

    Raises:
        ConfigurationError: `file` is no file name, or there is no such file.
    """
    if not isinstance(file, str | os.PathLike) or isinstance(file, bytes):
        raise ConfigurationError(f"{what}: expected the name of a file, got {shown(file)}")
    path = Path(file)
    try:
        exists = path.is_file()
    except (OSError, ValueError) as error:
        # a name of more than 255 characters, or a cycle of links
        raise ConfigurationError(f"{what} {shown(str(path))}: {_why(error)}") from error

    if not exists:
        fault = "there is no such file"
        if path.exists():
            fault = "it is a folder" if path.is_dir() else "it is no regular file"
        raise ConfigurationError(f"{what} {shown(str(path))}: {fault}")
    return path


def bytes_of(file: Any, what: str, most: int | None = None) -> bytes:
    """Content of a file; `what` begins the error message.

    Args:
        file: Name of a regular file. A device or a pipe, also at the end of a link, is refused
            before reading.
        what: Description of the file.
        most: [bytes] largest content; None: any.

    Raises:
        ConfigurationError: The file does not exist, is empty, is larger than `most`, or cannot be
            read.
    """
    path = existing_file(file, what)
    with regular(path, what) as stream:
        raw = stream.read(-1 if most is None else most + 1)

    if most is not None and len(raw) > most:
        raise ConfigurationError(f"{what} {shown(str(path))}: larger than {most} bytes")
    if not raw.strip():
        raise ConfigurationError(f"{what} {shown(str(path))}: the file is empty")
    return raw


@contextmanager
def regular(file: Path, what: str) -> Iterator[BufferedReader]:
    """Context manager: an existing file, open for reading. `what` begins the error message.

    Raises:
        ConfigurationError: The file is a device or a pipe, or cannot be read.
    """
    try:
        # The file is opened first and examined afterwards, so that no other file can take its place
        # in between.
        with open(os.open(file, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0)), "rb") as stream:
            if not stat.S_ISREG(os.fstat(stream.fileno()).st_mode):
                raise ConfigurationError(f"{what} {shown(str(file))}: it is no regular file")
            yield stream
    except OSError as error:
        raise ConfigurationError(
            f"{what} {shown(str(file))}: cannot be read ({_why(error)})"
        ) from error


def text_of(file: Any, what: str, most: int | None = None) -> str:
    """Text of a UTF-8 file, with or without byte order mark; the arguments are those of `bytes_of`.

    Raises:
        ConfigurationError: `bytes_of` refuses the file, or it is not UTF-8.
    """
    raw = bytes_of(file, what, most)
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ConfigurationError(
            f"{what} {shown(str(file))}: not text in UTF-8 (byte {error.start} is "
            f"0x{raw[error.start]:02x})"
        ) from error
    if not text.strip():
        raise ConfigurationError(f"{what} {shown(str(file))}: the file is empty")
    return text


def _why(error: Exception) -> str:
    return (getattr(error, "strerror", None) or str(error)).lower()
