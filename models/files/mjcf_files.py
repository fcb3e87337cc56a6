"""Reader of users' MJCF files, which are read, compiled and validated once. Each fault gives one
line.
"""

import re
from pathlib import Path

import mujoco
import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.files import bytes_of, existing_file, text_of
from uuv.sim.interfaces.spatial import shown

_LARGEST = 1e6  # [SI] larger numbers are taken as input errors
_JUDGED = (
    "qpos0",
    "body_pos",
    "body_mass",
    "body_inertia",
    "geom_size",
    "geom_pos",
    "site_pos",
    "actuator_gear",
)


def read_mjcf(file: str | Path, what: str) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
    """Read and compile an MJCF file, whatever its ending.

    Args:
        file: path.
        what: role of the file, as first words of error messages.

    Returns:
        Spec and compiled model.

    Raises:
        ConfigurationError: MuJoCo cannot read or compile it, or a number is not finite or beyond
            1e6.
    """
    path = existing_file(file, what)
    name = f"{what} {shown(str(path))}"

    root = re.search(
        rb"<([A-Za-z][\w.-]*)", re.sub(rb"<!--.*?-->", b"", bytes_of(path, what), flags=re.DOTALL)
    )
    if root is None or not root[1].startswith(b"mujoco"):
        content = "no XML" if root is None else f"XML with the root <{root[1].decode()}>"
        raise ConfigurationError(
            f"{name}: {content}; must be an MJCF with the root <mujoco>, or a URDF with the root "
            "<robot>"
        )

    try:
        if path.suffix.lower() == ".xml":
            spec = mujoco.MjSpec.from_file(str(path))
        # MuJoCo infers the format from the ending, so files with other endings are read as text
        else:
            spec = mujoco.MjSpec.from_string(text_of(path, what))
            spec.modelfiledir = str(path.parent)
    except (ValueError, mujoco.FatalError) as error:
        raise ConfigurationError(f"{name}: MuJoCo cannot read this MJCF: {error}") from error

    return spec, compiled(spec, name)


def compiled(spec: mujoco.MjSpec, name: str) -> mujoco.MjModel:
    """Compile a user's spec, and check that its numbers are finite and not too large.

    Args:
        spec: spec of a file.
        name: first words of error messages.

    Raises:
        ConfigurationError: MuJoCo cannot compile it, or a number is not finite or beyond 1e6.
    """
    try:
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise ConfigurationError(f"{name}: {reason_of(error)}") from error

    for field in _JUDGED:
        numbers = np.asarray(getattr(model, field))
        if not np.all(np.abs(numbers) <= _LARGEST):  # written so that NaN fails too
            worst = numbers.flat[
                int(np.argmax(np.where(np.isfinite(numbers), np.abs(numbers), np.inf)))
            ]
            raise ConfigurationError(
                f"{name}: {field} must be finite and at most {_LARGEST:g} in magnitude, got "
                f"{worst:g}"
            )

    return model


def reason_of(error: Exception) -> str:
    """Reason why MuJoCo refuses a model, in one line, with a remedy if a mass is missing."""
    reason = " ".join(str(error).split())
    body = re.search(r"moving bodies.*Element name '(.*?)'", reason)
    if body is None:
        return f"MuJoCo cannot compile it: {reason}"
    return (
        f"body {body[1]!r} moves and has no mass or inertia; state it in the file, or in its "
        f"mapping, masses: {{{body[1]}: 30}} [kg]"
    )
