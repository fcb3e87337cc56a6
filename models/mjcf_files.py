"""MJCF files of users: read and compiled once, at the door, so that what is wrong with them is told there."""

from pathlib import Path

import mujoco
import numpy as np

from sim.interfaces.errors import ConfigurationError
from sim.interfaces.files import existing_file, text_of
from sim.interfaces.spatial import shown

_LARGEST = 1e6  # [m] or [kg] and the like, beyond which a number is a slip
_JUDGED = ("qpos0", "body_pos", "body_mass", "body_inertia", "geom_size", "geom_pos", "site_pos", "actuator_gear")


def read_mjcf(file: str | Path, what: str) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
    """Spec and compiled model of an MJCF, whatever its ending.

    Raises ConfigurationError that begins with `what` where MuJoCo cannot read or compile it, and where a number of it
    is none, or beyond reason.
    """
    path = existing_file(file, what)
    name = f"{what} {shown(str(path))}"
    try:
        if path.suffix.lower() == ".xml":
            spec = mujoco.MjSpec.from_file(str(path))
        else:  # MuJoCo tells what a file is by its ending
            spec = mujoco.MjSpec.from_string(text_of(path, what))
            spec.modelfiledir = str(path.parent)
    except (ValueError, mujoco.FatalError) as error:
        raise ConfigurationError(f"{name} is not an MJCF that MuJoCo reads: {error}") from error
    try:
        model = spec.compile()
    except (ValueError, mujoco.FatalError) as error:
        raise ConfigurationError(f"{name}: MuJoCo cannot compile it: {error}") from error
    for field in _JUDGED:
        values = np.asarray(getattr(model, field))
        if not np.all(np.abs(values) <= _LARGEST):  # NaN neither
            worst = values.flat[int(np.argmax(np.where(np.isfinite(values), np.abs(values), np.inf)))]
            raise ConfigurationError(f"{name}: {field} must be finite and within {_LARGEST:g}, got {worst:g}")
    return spec, model
