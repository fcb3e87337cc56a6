"""Kinds of terrain by name."""

from typing import Literal, get_args

Kind = Literal["flat", "ripples", "slope", "rocks"]
KINDS: tuple[Kind, ...] = get_args(Kind)
