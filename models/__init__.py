"""What exists: vehicles, arms, targets and scenes as MjSpec, with hydrodynamic and thruster tables. Steps nothing."""

import mujoco

from models import uuv_puma
from sim.interfaces.errors import ConfigurationError

_MODELS = {"uuv_puma": uuv_puma.build}


def available() -> tuple[str, ...]:
    """Names that `load` knows."""
    return tuple(sorted(_MODELS))


def load(name: str) -> mujoco.MjSpec:
    """A named model, coefficients already attached. Raises ConfigurationError, with the names there are, for others."""
    if name not in _MODELS:
        raise ConfigurationError(f"unknown model {name!r}; there are {', '.join(available())}")
    return _MODELS[name]()
