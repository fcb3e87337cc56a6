"""PNG file of a figure: refused at the door if it cannot be one, and written whole."""

from pathlib import Path
from typing import Any

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import shown
from uuv.sim.runs.saving import whole_file


def check_picture(file: Path) -> None:
    """Refuse a file that is no PNG, or in a folder that there is not.

    Raises:
        ConfigurationError: It is one of these.
    """
    if file.suffix != ".png":
        raise ConfigurationError(f"--picture: must be a file *.png, got {shown(file.name)}")
    if not file.parent.is_dir():
        raise ConfigurationError(f"--picture: there is no folder {str(file.parent)!r}")


def save_figure(figure: Any, file: Path, dots: int) -> None:
    """Write a figure of Matplotlib as PNG with `dots` per inch.

    Raises:
        ConfigurationError: The file cannot be written.
    """
    with whole_file(file) as stream:
        figure.savefig(stream, format="png", dpi=dots)
