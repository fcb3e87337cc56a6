"""`uuv new mapping FILE`: a first mapping beside a vehicle's file, and the questions left."""

from pathlib import Path

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.files import existing_file


def new_mapping(file: Path) -> int:
    """Writes NAME.parts.yaml beside a file; returns the exit code.

    Raises:
        ConfigurationError: the mapping is there already, or the file cannot be read.
    """
    from uuv.models.completing.first_mapping import first_mapping
    from uuv.models.files.parts_file import PARTS_SUFFIX, read_parts
    from uuv.models.files.vehicle_file import read

    vehicle = existing_file(file, "vehicle")
    mapping = vehicle.with_name(vehicle.stem + PARTS_SUFFIX)
    if mapping.exists():
        raise ConfigurationError(f"{mapping} is there already; move it away for a new one")

    source = read(vehicle)
    text, questions = first_mapping(source)
    try:
        mapping.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigurationError(f"{mapping}: cannot be written ({error.strerror})") from error
    read_parts(mapping)  # what is written can be read

    for entry in source.entries:
        print(f"  {entry.line()}")
    print(f"written: {mapping}")
    for question in questions:
        print(f"  ? {question}")
    print(f"\ntry:   uuv check {vehicle}")
    return 0
