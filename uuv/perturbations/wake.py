"""Perturbation of the water by the object: its wake, in which the current is slower."""

from dataclasses import dataclass

import mujoco
import numpy as np

from uuv.models.site.sliding_contact import TARGET_BODY
from uuv.perturbations.perturbation import Perturbation
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, finite_number, pose, rotation_from_quat_wxyz
from uuv.sim.water.current import Current
from uuv.sim.water.cylinder_wake import DRAG, CylinderWake, wake_behind
from uuv.sim.water.flow_field import FlowField


@dataclass(frozen=True, kw_only=True)
class Wake(Perturbation):
    """The steady current is slower behind the object, as behind a circular cylinder [Huse 1993].

    The cylinder lies along the longest side of the object's box, where the object is at the start.
    A current along it has no wake.
    """

    diameter: float | None = None  # [m] None: the mean of the other two sides
    drag: float = DRAG  # coefficient, by the diameter

    def __post_init__(self) -> None:
        if self.diameter is not None:
            finite_number(self.diameter, "Wake diameter [m]", above=0.0)
        finite_number(self.drag, "Wake drag", above=0.0)

    def on_scene(self, scene: mujoco.MjSpec) -> None:
        """Refuses a site without an object."""
        if scene.body(TARGET_BODY) is None:
            raise ConfigurationError("Wake: there is no object at this site")

    def on_water(self, current: Current) -> Current:
        """The current with the wake on top."""
        stream = current.mean_W
        if not stream.any():
            raise ConfigurationError("Wake: there is no steady current, site.current [m/s]")
        return current.with_flow(_ObjectWake(stream=stream, diameter=self.diameter, drag=self.drag))


@dataclass(frozen=True, kw_only=True, eq=False)
class _ObjectWake(FlowField):
    """Wake of the object, before its place is known."""

    stream: Array  # (3,) [m/s] in W
    diameter: float | None  # [m]
    drag: float

    def velocity(self, p_W: Array, time: float) -> Array:
        """Is not known yet: `placed` comes first."""
        raise ConfigurationError("Wake: a plant places it behind its object first")

    def placed(self, model: mujoco.MjModel) -> CylinderWake:
        """The wake behind the object of a compiled world."""
        body = model.body(TARGET_BODY)
        X_WT = pose(rotation_from_quat_wxyz(np.array(body.quat)), np.array(body.pos))
        return wake_behind(self.stream, X_WT, box_of(model, int(body.id)), self.diameter, self.drag)


def box_of(model: mujoco.MjModel, body: int) -> Array:
    """Smallest and largest coordinates (2, 3) [m] of the geoms of a body, in its frame."""
    signs = np.stack(np.meshgrid([-1.0, 1.0], [-1.0, 1.0], [-1.0, 1.0]), axis=-1).reshape(-1, 3)

    # Corners of the boxes of all geoms, each in axes of its own.
    corners = []
    for geom in np.flatnonzero(model.geom_bodyid == body):
        middle, half = model.geom_aabb[geom].reshape(2, 3)
        R_BG = rotation_from_quat_wxyz(model.geom_quat[geom])
        corners.append((middle + signs * half) @ R_BG.T + model.geom_pos[geom])

    points = np.concatenate(corners) if corners else np.zeros((1, 3))
    return np.array([points.min(axis=0), points.max(axis=0)])
