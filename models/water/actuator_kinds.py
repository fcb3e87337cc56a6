"""Kinds of actuators on a site: a plain motor, whose control is its force, and a thruster."""

from collections.abc import Callable, Mapping
from typing import Any

import mujoco
import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError

ROUNDED = 1e-5  # tolerance of a gear, which may come from a file of six digits
# Fields that the two kinds share, and those of each kind.
_COMMON: dict[str, Any] = {
    "trntype": mujoco.mjtTrn.mjTRN_SITE,
    "gaintype": mujoco.mjtGain.mjGAIN_FIXED,
    "delay": 0.0,
}
MOTOR: dict[str, Any] = {
    "biastype": mujoco.mjtBias.mjBIAS_NONE,
    "dyntype": mujoco.mjtDyn.mjDYN_NONE,
    "gainprm": 1.0,
}
DRIVEN: dict[str, Any] = {
    "biastype": mujoco.mjtBias.mjBIAS_USER,
    "dyntype": mujoco.mjtDyn.mjDYN_USER,
    "gainprm": 0.0,
}


def set_kind(actuator: mujoco.MjsActuator, kind: Mapping[str, Any]) -> None:
    """Give an actuator of a spec the fields of MOTOR or DRIVEN."""
    actuator.dyntype = kind["dyntype"]
    actuator.biastype = kind["biastype"]
    actuator.gainprm[0] = kind["gainprm"]


def check_kind(
    name: str, field: Callable[[str], Any], kind: Mapping[str, Any], refers: bool
) -> None:
    """Raise ConfigurationError unless an actuator applies its force along a unit axis of a site.

    Args:
        name: of the actuator, for the message.
        field: returns a field of the actuator by the name that spec and model share.
        kind: what it must be, `MOTOR` or `DRIVEN`.
        refers: True if the actuator has a reference site or a plugin.
    """
    along = np.array(field("gear")[:3])

    odd = [word for word, plain in _COMMON.items() if np.any(np.ravel(field(word)) != plain)]
    odd += [word for word, plain in kind.items() if np.ravel(field(word))[0] != plain]
    if refers:
        odd.append("refsite or plugin")

    odd += [
        f"{word}range"
        for word in ("ctrl", "force", "act")
        if not _range_fits(field, word, kind is DRIVEN)
    ]

    if odd and kind is MOTOR:
        raise ConfigurationError(
            f"thruster {name!r}: its actuator must be a plain motor on a site, with the thrust [N] "
            "as its control: gain 1, no bias, dynamics, delay, limits, refsite or plugin; these "
            f"differ: {', '.join(odd)}"
        )
    if odd:
        raise ConfigurationError(
            f"thruster {name!r}: its actuator must be as uuv.models.water.thrusters.attach leaves "
            "it, on a site, with dynamics and bias of the type user and a control in [-1, 1]; "
            f"these differ: {', '.join(odd)}"
        )

    if not abs(np.linalg.norm(along) - 1.0) < ROUNDED:
        raise ConfigurationError(
            f"thruster {name!r}: its actuator must act on a site with a gear of length 1, got "
            f"{along.tolist()}"
        )


def _range_fits(field: Callable[[str], Any], word: str, driven: bool) -> bool:
    """True if exactly the commands of a thruster are limited."""
    low, high = field(f"{word}range")
    limited = int(field(f"{word}limited"))
    is_limited = limited == mujoco.mjtLimited.mjLIMITED_TRUE
    is_limited = is_limited or (limited == mujoco.mjtLimited.mjLIMITED_AUTO and low < high)

    if word == "ctrl" and driven:
        return is_limited and (low, high) == (-1.0, 1.0)
    return not is_limited


def of_compiled(model: mujoco.MjModel, actuator: int, field: str) -> Any:
    """A field of an actuator of a compiled model, by the name that it has in a spec."""
    return getattr(model, f"actuator_{field}")[actuator]
