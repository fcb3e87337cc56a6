"""Reading of input files: existence, content and encoding, with ConfigurationError for every failure."""

import os
from pathlib import Path
from typing import Any

from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import shown


def existing_file(file: Any, what: str) -> Path:
    """Path of an existing file; `what` begins the error message.

    Raises:
        ConfigurationError: `file` is no file name, or there is no such file.
    """
    if not isinstance(file, str | os.PathLike) or isinstance(file, bytes):
        raise ConfigurationError(f"{what}: expected the name of a file, got {shown(file)}")
    path = Path(file)
    try:
        found = path.is_file()
    except (OSError, ValueError) as error:  # a name of more than 255 characters, or a cycle of links
        raise ConfigurationError(f"{what} {shown(str(path))}: {_why(error)}") from error
    if not found:
        there = "it is a folder" if path.is_dir() else "there is no such file"
        raise ConfigurationError(f"{what} {shown(str(path))}: {there}")
    return path


def bytes_of(file: Any, what: str) -> bytes:
    """Content of a file; `what` begins the error message.

    Raises:
        ConfigurationError: The file does not exist, is empty, or cannot be read.
    """
    path = existing_file(file, what)
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise ConfigurationError(f"{what} {shown(str(path))}: cannot be read ({_why(error)})") from error
    if not raw.strip():
        raise ConfigurationError(f"{what} {shown(str(path))}: the file is empty")
    return raw


def text_of(file: Any, what: str) -> str:
    """Text of a UTF-8 file, with or without byte order mark; `what` begins the error message.

    Raises:
        ConfigurationError: As `bytes_of` does, or the file is not UTF-8.
    """
    raw = bytes_of(file, what)
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ConfigurationError(
            f"{what} {shown(str(file))}: not text in UTF-8 (byte {error.start} is 0x{raw[error.start]:02x})"
        ) from error
    if not text.strip():
        raise ConfigurationError(f"{what} {shown(str(file))}: the file is empty")
    return text


def _why(error: Exception) -> str:
    return (getattr(error, "strerror", None) or str(error)).lower()
