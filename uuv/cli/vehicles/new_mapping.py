"""`uuv new mapping FILE`: writes a first mapping for a vehicle's file; prints open questions."""

from pathlib import Path

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.files import existing_file


def new_mapping(file: Path) -> int:
    """Writes NAME.parts.yaml to the folder of a file; returns the exit code.

    Raises:
        ConfigurationError: The mapping exists already, or the file cannot be read.
    """
    from uuv.models.completing.first_mapping import first_mapping
    from uuv.models.files.parts_file import PARTS_SUFFIX, read_parts
    from uuv.models.files.vehicle_file import read

    vehicle = existing_file(file, "vehicle")
    mapping = vehicle.with_name(vehicle.stem + PARTS_SUFFIX)
    if mapping.exists():
        raise ConfigurationError(f"{mapping} exists already; move it away to write a new one")

    source = read(vehicle)
    text, questions = first_mapping(source)
    try:
        mapping.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigurationError(f"{mapping}: cannot be written ({error.strerror})") from error
    read_parts(mapping)  # check that the written file can be read

    for entry in source.entries:
        print(f"  {entry.line()}")
    print(f"written: {mapping}")
    for question in questions:
        print(f"  ? {question}")
    print(f"\ntry:   uuv check {vehicle}")
    return 0
