"""Kinds of files that are read as logs of vehicles."""

from pathlib import Path

ENDINGS = (".bin", ".tlog", ".mcap", ".bag", ".db3")


def is_vehicle_log(path: Path) -> bool:
    """Whether a path is of a kind that is read here: by its ending, or a folder with a bag."""
    return path.suffix.lower() in ENDINGS or (path / "metadata.yaml").is_file()
