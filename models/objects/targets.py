"""Access to objects to work on: registry by name, mesh files, and the classes of `models.objects.target_model`."""

import inspect
from collections.abc import Callable
from pathlib import Path
from types import MappingProxyType
from typing import Any

from models.meshes.closed_shells import revolve
from models.objects.anode import anode
from models.objects.barrel import BARREL_DIAMETER, BARREL_LENGTH, barrel, longitudinal, transverse
from models.objects.manifold import manifold
from models.objects.pile import PILE_DIAMETER, PILE_LENGTH, helix, pile, ring, vertical
from models.objects.rock import rock
from models.objects.starfish import starfish
from models.objects.target_model import ModelPath, Solid, Symmetry, TargetModel
from models.objects.valve import valve
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.spatial import shown

__all__ = [
    "BARREL_DIAMETER",
    "BARREL_LENGTH",
    "PILE_DIAMETER",
    "PILE_LENGTH",
    "ModelPath",
    "Solid",
    "Symmetry",
    "TargetModel",
    "available",
    "barrel",
    "helix",
    "longitudinal",
    "named",
    "of",
    "pile",
    "revolve",
    "ring",
    "transverse",
    "vertical",
]

_OBJECTS: MappingProxyType[str, Callable[..., Any]] = MappingProxyType(
    {
        "anode": anode,
        "barrel": barrel,
        "manifold": manifold,
        "pile": pile,
        "rock": rock,
        "starfish": starfish,
        "valve": valve,
    }
)


def available() -> tuple[str, ...]:
    """Names of the registered objects."""
    return tuple(sorted(_OBJECTS))


def named(name: str, **options: Any) -> TargetModel:
    """Build a registered object, such as "starfish"; `options` go to its own function, such as a rock's `seed`.

    Raises:
        ConfigurationError: an unknown name or option; the message lists the known ones.
    """
    if not isinstance(name, str) or name not in _OBJECTS:
        raise ConfigurationError(f"unknown object {shown(name)}; there are {', '.join(available())}")
    allowed = inspect.signature(_OBJECTS[name]).parameters
    if not set(options) <= set(allowed):
        raise ConfigurationError(
            f"object {name!r} has no {sorted(set(options) - set(allowed))}; it has {list(allowed)}"
        )
    made = _OBJECTS[name](**options)
    return made if isinstance(made, TargetModel) else made.target


def of(name_or_file: str | Path, scale: float | None = None) -> TargetModel:
    """Object by name, or from a mesh file (`TargetModel.from_file`) if the argument has a file ending.

    Raises:
        ConfigurationError: an unknown name, or an invalid file or `scale`.
    """
    if not isinstance(name_or_file, str | Path):
        raise ConfigurationError(f"object: expected a name or a mesh file, got {shown(name_or_file)}")
    name_or_file = str(name_or_file)
    if Path(name_or_file).suffix:
        return TargetModel.from_file(name_or_file, scale=scale)
    if scale is not None:
        raise ConfigurationError(f"object {name_or_file!r} has its size; a scale is for mesh files")
    return named(name_or_file)
