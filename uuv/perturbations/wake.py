"""Perturbation of the current by the object's wake, in which the current is slower."""

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

    The cylinder is along the longest side of the object's box, at the object's initial pose. A
    current along the cylinder has no wake.
    """

    diameter: float | None = None  # [m] diameter; None: the mean of the other two sides
    drag: float = DRAG  # drag coefficient, referred to the diameter

    def __post_init__(self) -> None:
        if self.diameter is not None:
            finite_number(self.diameter, "Wake diameter [m]", above=0.0)
        finite_number(self.drag, "Wake drag", above=0.0)

    def on_scene(self, scene: mujoco.MjSpec) -> None:
        """Refuse a site without an object."""
        if scene.body(TARGET_BODY) is None:
            raise ConfigurationError("Wake: needs an object, but this site has none")

    def on_water(self, current: Current) -> Current:
        """The current with the wake added."""
        stream = current.mean_W
        if not stream.any():
            raise ConfigurationError("Wake: needs a steady current, site.current [m/s], got none")
        return current.with_flow(_ObjectWake(stream=stream, diameter=self.diameter, drag=self.drag))


@dataclass(frozen=True, kw_only=True, eq=False)
class _ObjectWake(FlowField):
    """Wake of an object whose pose is not known yet."""

    stream: Array  # (3,) [m/s] in W
    diameter: float | None  # [m]
    drag: float

    def velocity(self, p_W: Array, time: float) -> Array:
        """Raise an error, since `placed` must be called first."""
        raise ConfigurationError(
            "Wake: has no velocity before a plant has placed it behind its object"
        )

    def placed(self, model: mujoco.MjModel) -> CylinderWake:
        """The wake behind the object of a compiled world."""
        body = model.body(TARGET_BODY)
        X_WT = pose(rotation_from_quat_wxyz(np.array(body.quat)), np.array(body.pos))
        return wake_behind(self.stream, X_WT, box_of(model, int(body.id)), self.diameter, self.drag)


def box_of(model: mujoco.MjModel, body: int) -> Array:
    """Smallest and largest coordinates (2, 3) [m] of the geoms of a body, in its frame."""
    signs = np.stack(np.meshgrid([-1.0, 1.0], [-1.0, 1.0], [-1.0, 1.0]), axis=-1).reshape(-1, 3)

    # Corners of the boxes of all geoms, each in its own axes.
    corners = []
    for geom in np.flatnonzero(model.geom_bodyid == body):
        middle, half = model.geom_aabb[geom].reshape(2, 3)
        R_BG = rotation_from_quat_wxyz(model.geom_quat[geom])
        corners.append((middle + signs * half) @ R_BG.T + model.geom_pos[geom])

    points = np.concatenate(corners) if corners else np.zeros((1, 3))
    return np.array([points.min(axis=0), points.max(axis=0)])
