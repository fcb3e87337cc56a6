"""Expansion of xacro to URDF by the package `xacro`, with ROS packages in the folders around the
file.
"""

import contextlib
import io
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from uuv.models.files.ros_packages import look_anew, package_folder
from uuv.sim.interfaces.errors import ConfigurationError, MissingLibraryError
from uuv.sim.interfaces.extras import wanted

# namespaces of its tags
TAGS = (
    b"http://www.ros.org/wiki/xacro",
    b"http://ros.org/wiki/xacro",
    b"http://wiki.ros.org/xacro",
)
ENDING = ".xacro"


def is_xacro(content: bytes) -> bool:
    """True for content with tags of xacro, and not just a declaration of their name space."""
    return any(tag in content for tag in TAGS) and b"<xacro:" in content


def expanded(
    file: str | os.PathLike[str], name: str, arguments: Mapping[str, str] | None = None
) -> bytes:
    """The URDF into which xacro expands a file.

    Args:
        file: path.
        name: begins the error messages.
        arguments: values of the file's arguments, beside their defaults.

    Raises:
        ConfigurationError: the package is not installed, a package of ROS that the file names is
            not there, or xacro refuses the file.
    """
    path = Path(file)

    try:
        with wanted():
            import xacro
    except MissingLibraryError as error:
        raise ConfigurationError(
            f"{name}: is xacro; first convert it to a URDF: xacro FILE > rov.urdf, or {error}"
        ) from error

    look_anew()
    warned = io.StringIO()  # its warnings
    try:
        with _packages_around(path.parent), contextlib.redirect_stderr(warned):
            document: Any = xacro.process_file(str(path), mappings=dict(arguments or {}))
            return document.toxml(encoding="utf-8")
    except Exception as error:  # whatever the macros of the file raise, and what is raised here
        inner = getattr(error, "exc", None) or error
        if isinstance(inner, ConfigurationError):
            raise ConfigurationError(f"{name}: {inner}") from error
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ConfigurationError(
            f"{name}: xacro refuses it: {reason[:300]} (its arguments: `xacro: {{NAME: VALUE}}` in "
            "the mapping)"
        ) from error


@contextlib.contextmanager
def _packages_around(folder: Path) -> Iterator[None]:
    """Context in which xacro also finds packages around a folder that ROS's own index lacks."""
    from xacro import substitution_args

    def find(package: str) -> str:
        place = package_folder(package, folder)
        if place is None:
            raise ConfigurationError(
                f"the package {package!r} is not in the folders around {str(folder)!r}; add its "
                "parent folder to ROS_PACKAGE_PATH"
            )

        return str(place)

    replaced = substitution_args._eval_find
    evaluated: dict[str, Any] = substitution_args._eval_dict
    substitution_args._eval_find = evaluated["find"] = find

    try:
        yield
    finally:
        substitution_args._eval_find = evaluated["find"] = replaced
