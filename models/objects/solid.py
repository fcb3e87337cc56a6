"""Solid of an object: a collision primitive with the shape of one part of the object's mesh."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from uuv.sim.interfaces.spatial import Array, one_of, quat_wxyz_from_rotation

if TYPE_CHECKING:
    import mujoco

SolidKind = Literal["box", "capsule", "cylinder", "ellipsoid", "sphere"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Solid:
    """Collision primitive of a target."""

    name: str
    kind: SolidKind
    size: tuple[float, ...]  # [m] in the form of MuJoCo's geom size
    X_TS: Array  # (4, 4) pose in T

    def __post_init__(self) -> None:
        one_of(self.kind, get_args(SolidKind), f"solid {self.name!r}: kind")

    def add_to(self, body: "mujoco.MjsBody") -> "mujoco.MjsGeom":
        """Add the solid to the body of its target, as a geom with the solid's name."""
        import mujoco

        size = np.zeros(3)
        size[: len(self.size)] = self.size
        return body.add_geom(
            name=self.name,
            type=getattr(mujoco.mjtGeom, f"mjGEOM_{self.kind.upper()}"),
            size=size,
            pos=self.X_TS[:3, 3],
            quat=quat_wxyz_from_rotation(self.X_TS[:3, :3]),
        )
