"""Objects to work on: registry by name, mesh files, classes of models."""

from functools import lru_cache
from pathlib import Path
from typing import Any

from uuv.models.meshes.closed_shells import revolve
from uuv.models.objects.anode import anode, small_anode
from uuv.models.objects.barrel import (
    BARREL_DIAMETER,
    BARREL_LENGTH,
    barrel,
    longitudinal,
    transverse,
)
from uuv.models.objects.block import block
from uuv.models.objects.manifold import manifold
from uuv.models.objects.pile import PILE_DIAMETER, PILE_LENGTH, helix, pile, ring, vertical
from uuv.models.objects.plate import plate
from uuv.models.objects.rock import rock, stone
from uuv.models.objects.solid import Solid
from uuv.models.objects.starfish import starfish
from uuv.models.objects.target_model import ModelPath, Symmetry, TargetModel
from uuv.models.objects.valve import valve
from uuv.models.registry import Registry
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.files import existing_file
from uuv.sim.interfaces.spatial import shown

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
    "block",
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

OBJECTS: Registry[Any] = Registry(
    "object",
    {
        "anode": anode,
        "barrel": barrel,
        "block": block,
        "manifold": manifold,
        "pile": pile,
        "plate": plate,
        "rock": rock,
        "small_anode": small_anode,
        "starfish": starfish,
        "stone": stone,
        "valve": valve,
    },
)
# What a gripper takes; the studies of identification go over the others.
SMALL = ("small_anode", "stone")


def available() -> tuple[str, ...]:
    """Names of the objects that `named` accepts, of other packages too, but without SMALL."""
    return tuple(name for name in OBJECTS.names() if name not in SMALL)


def named(name: str, **options: Any) -> TargetModel:
    """The object of that name, such as "starfish".

    Args:
        name: One of `available()`, or of SMALL.
        options: Options of the object's own function, such as a rock's `seed`.

    Raises:
        ConfigurationError: Unknown name or option; the message lists the known ones.
    """
    target = OBJECTS.load(name, **options)
    target = target if isinstance(target, TargetModel) else getattr(target, "target", None)
    if not isinstance(target, TargetModel):
        raise ConfigurationError(f"object {name!r}: the function must return a TargetModel")
    return target


def of(name_or_file: str | Path, scale: float | None = None) -> TargetModel:
    """Object by name, from a user's MODULE:FUNCTION, or from a mesh or cloud file.

    A name with an ending, such as part.stl, is read as a file (`TargetModel.from_file`).

    Raises:
        ConfigurationError: an unknown name, or an invalid file or `scale`.
    """
    if not isinstance(name_or_file, str | Path):
        raise ConfigurationError(
            f"object: expected a name or a mesh file, got {shown(name_or_file)}"
        )
    name_or_file = str(name_or_file)

    if ":" not in name_or_file and Path(name_or_file).suffix:
        about = existing_file(name_or_file, "target mesh").stat()
        return _from_file(name_or_file, scale, (about.st_mtime_ns, about.st_size))

    if scale is not None:
        raise ConfigurationError(
            f"object {name_or_file!r} has a fixed size; scale is allowed for mesh files only"
        )
    return named(name_or_file)


@lru_cache(maxsize=4)
def _from_file(file: str, scale: float | None, stamp: tuple[int, int]) -> TargetModel:
    """The object in a file, read once, since both the check of the inputs and the work need it."""
    del stamp
    return TargetModel.from_file(file, scale=scale)
