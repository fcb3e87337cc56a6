"""Kinds of files that are read as logs of vehicles."""

from pathlib import Path

ENDINGS = (".bin", ".tlog", ".mcap", ".bag", ".db3")


def is_vehicle_log(path: Path) -> bool:
    """True if a path can be read as a log: by its ending, or as a folder with a bag."""
    return path.suffix.lower() in ENDINGS or (path / "metadata.yaml").is_file()
