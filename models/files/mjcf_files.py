"""Reader of users' MJCF files: read, compiled and validated once, each fault in one clear line."""

import re
from pathlib import Path

import mujoco
import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.files import bytes_of, existing_file, text_of
from uuv.sim.interfaces.spatial import shown

_LARGEST = 1e6  # [SI] magnitude beyond which a number is taken as an input error
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
        what: name of the file's role, with which errors begin.

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
            f"{name}: {content}; allowed are an MJCF, root <mujoco>, or a URDF, root <robot>"
        )

    try:
        if path.suffix.lower() == ".xml":
            spec = mujoco.MjSpec.from_file(str(path))
        else:  # MuJoCo takes the format from the ending, so other endings are read as text
            spec = mujoco.MjSpec.from_string(text_of(path, what))
            spec.modelfiledir = str(path.parent)
    except (ValueError, mujoco.FatalError) as error:
        raise ConfigurationError(f"{name} is not an MJCF that MuJoCo reads: {error}") from error

    return spec, compiled(spec, name)


def compiled(spec: mujoco.MjSpec, name: str) -> mujoco.MjModel:
    """Compile a user's spec, and judge its numbers.

    Args:
        spec: of a file.
        name: with which errors begin.

    Raises:
        ConfigurationError: MuJoCo cannot compile it, or a number is not finite or beyond 1e6.
    """
    try:
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise ConfigurationError(f"{name}: {reason_of(error)}") from error

    for field in _JUDGED:
        numbers = np.asarray(getattr(model, field))
        if not np.all(np.abs(numbers) <= _LARGEST):  # this form also catches NaN
            worst = numbers.flat[
                int(np.argmax(np.where(np.isfinite(numbers), np.abs(numbers), np.inf)))
            ]
            raise ConfigurationError(
                f"{name}: {field} must be finite and within {_LARGEST:g}, got {worst:g}"
            )

    return model


def reason_of(error: Exception) -> str:
    """What MuJoCo has against a model, in one line, with a way on where it lacks a mass."""
    reason = " ".join(str(error).split())
    body = re.search(r"moving bodies.*Element name '(.*?)'", reason)
    if body is None:
        return f"MuJoCo cannot compile it: {reason}"
    return (
        f"body {body[1]!r} moves and has no mass or inertia; state it in the file, or in its "
        f"mapping, masses: {{{body[1]}: 30}} [kg]"
    )
