"""Objects to work on: the one door to their models (`models.target_model`) and to the objects there are."""

from models.barrel import BARREL_DIAMETER, BARREL_LENGTH, barrel, longitudinal, transverse
from models.pile import PILE_DIAMETER, PILE_LENGTH, helix, pile, ring, vertical
from models.target_model import ModelPath, Solid, Symmetry, TargetModel, revolve

__all__ = [
    "BARREL_DIAMETER",
    "BARREL_LENGTH",
    "PILE_DIAMETER",
    "PILE_LENGTH",
    "ModelPath",
    "Solid",
    "Symmetry",
    "TargetModel",
    "barrel",
    "helix",
    "longitudinal",
    "pile",
    "revolve",
    "ring",
    "transverse",
    "vertical",
]
