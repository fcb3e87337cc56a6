"""Site of a collection: a loose object on flat seabed, and an open basket next to it."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from uuv.models.meshes.closed_shells import volume
from uuv.models.objects.target_model import TargetModel
from uuv.models.site.sliding_contact import TARGET_BODY
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, pose, rotation_from_quat_wxyz, transform_points

if TYPE_CHECKING:
    import mujoco

    from uuv.models.hydrodynamics import BodyHydrodynamics

WALL = 0.006  # [m] thickness of the basket's walls and floor
FRICTION = (0.7, 0.005, 0.002)  # of the object on ground and basket: slides, turns, rolls
RIM = 0.06  # [m] height of its walls over the floor
_ROOM = 0.06  # [m] between the object and the walls, for the open jaws
_NARROWEST = 0.12  # [m] half of its side, at least
_SETTLED = 2.0  # [s] in which the object comes to rest


@dataclass(frozen=True, slots=True, kw_only=True)
class LooseObject:
    """Properties of an object other than its shape: its mass, and the water that it displaces."""

    mass: float  # [kg]
    volume: float  # [m^3]
    center_T: Array  # (3,) [m] of the volume
    inertia_T: Array  # (3,) [kg m^2] about it, along the axes of T

    @classmethod
    def of(cls, target: TargetModel, *, density: float, mass: float | None) -> "LooseObject":
        """An object of uniform density with the inertia of its bounding box.

        Args:
            target: its shape; where its mesh is open, its convex hull displaces the water.
            density: [kg/m^3], where `mass` is not given.
            mass: [kg]; None: by `density`.
        """
        from scipy.spatial import ConvexHull

        # An open mesh encloses nothing, or less than nothing.
        hull = ConvexHull(target.vertices)
        enclosed = volume(target.vertices, target.triangles)
        if not 0.02 * hull.volume < enclosed <= 1.001 * hull.volume:
            enclosed = float(hull.volume)
        mass = density * enclosed if mass is None else mass

        size = np.ptp(target.vertices, axis=0)
        inertia = mass / 12.0 * (np.sum(size**2) - size**2)
        center = target.vertices[hull.vertices].mean(axis=0)
        return cls(mass=mass, volume=enclosed, center_T=center, inertia_T=inertia)

    def weight(self, water: float, gravity: float) -> float:
        """Weight [N] in water of a density [kg/m^3]; negative if the object floats."""
        return gravity * (self.mass - water * self.volume)


def basket_half(target: TargetModel) -> float:
    """Half of the basket's inner side [m], with room for the object and open jaws."""
    return max(_NARROWEST, target.radius + _ROOM)


def add_basket(spec: "mujoco.MjSpec", floor_W: Array, half: float) -> None:
    """Add an open basket that stands on the seabed.

    Args:
        spec: scene, changed.
        floor_W: (3,) [m] middle of its floor's upper side.
        half: [m] half of its inner side.
    """
    import mujoco

    basket = spec.worldbody.add_body(name="basket", pos=floor_W)
    panel = {"type": mujoco.mjtGeom.mjGEOM_BOX, "rgba": [0.2, 0.45, 0.3, 1.0]}
    basket.add_geom(
        name="basket_floor", size=[half, half, 0.5 * WALL], pos=[0.0, 0.0, -0.5 * WALL], **panel
    )
    for number, (x, y) in enumerate(((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))):
        thick = 0.5 * WALL
        basket.add_geom(
            name=f"basket_wall_{number}",
            size=[thick if x else half, thick if y else half, 0.5 * RIM],
            pos=[(half + thick) * x, (half + thick) * y, 0.5 * RIM],
            **panel,
        )


def add_loose(
    spec: "mujoco.MjSpec", target: TargetModel, X_WT: Array, loose: LooseObject
) -> "mujoco.MjsBody":
    """Add the object as a free body; its water comes with `hydrodynamics.attach`."""
    body = target.add_to(spec, X_WT, stand=False)
    body.add_freejoint()
    body.mass = loose.mass
    body.ipos = loose.center_T
    body.inertia = loose.inertia_T
    body.explicitinertial = True
    for geom in body.geoms:
        geom.mass = 0.0
        # Stone on the ground, whatever touches it: parts of a mesh have no friction of their own.
        geom.priority = 0
        geom.friction = FRICTION
        geom.condim = 6
    return body


def loose_water(target: TargetModel, loose: LooseObject, density: float) -> "BodyHydrodynamics":
    """Hydrodynamics of a loose object: of an ellipsoid in its box, with its own volume.

    Args:
        target: the object's shape.
        loose: its mass and volume.
        density: [kg/m^3] of the water.
    """
    from uuv.models import hydrodynamics

    size = np.ptp(target.vertices, axis=0)
    water = hydrodynamics.ellipsoid(0.5 * size, center=loose.center_T, water_density=density)
    return replace(water, volume=loose.volume)


def pick_site(
    vehicle: "mujoco.MjSpec",
    target: TargetModel,
    X_WT: Array,
    loose: LooseObject,
    *,
    seabed: float,
    basket: tuple[Array, float],
) -> "mujoco.MjSpec":
    """Add a loose object on flat seabed, and a basket, to the spec of a vehicle with a gripper.

    Args:
        vehicle: spec, changed in place.
        target: the object's shape.
        X_WT: (4, 4) its pose.
        loose: its mass and volume.
        seabed: [m] height of the seabed in W.
        basket: middle (3,) [m] of its floor in W, and half of its inner side [m].

    Returns:
        The same spec.
    """
    from uuv.models import hydrodynamics
    from uuv.models.site.grip_contact import let_gripper_hold

    spec = vehicle
    _add_seabed(spec, X_WT, seabed)
    add_loose(spec, target, X_WT, loose)
    add_basket(spec, *basket)

    density = hydrodynamics.density_of(spec)
    hydrodynamics.attach(spec, {TARGET_BODY: loose_water(target, loose, density)})
    let_gripper_hold(spec, TARGET_BODY)
    return spec


def at_rest(target: TargetModel, X_WT: Array, seabed: float) -> Array:
    """Pose (4, 4) in which a loose object comes to rest after release just above the seabed.

    Raises:
        ConfigurationError: it does not come to rest there.
    """
    import mujoco

    # From where its lowest point touches the ground.
    X = X_WT.copy()
    X[2, 3] += seabed - transform_points(X, target.vertices)[:, 2].min()

    spec = mujoco.MjSpec()
    _add_seabed(spec, X, seabed)
    loose = LooseObject.of(target, density=2000.0, mass=None)
    add_loose(spec, target, X, loose)
    model = spec.compile()
    data = mujoco.MjData(model)
    while data.time < _SETTLED:
        mujoco.mj_step(model, data)

    R_WT = rotation_from_quat_wxyz(data.qpos[3:7])
    rest = pose(R_WT, data.qpos[:3])
    if np.linalg.norm(rest[:3, 3] - X[:3, 3]) > 2.0 * target.radius:
        raise ConfigurationError(
            f"object {target.name!r} rolls away on flat seabed from this pose; give another one "
            "by site.X_WT"
        )
    return rest


def _add_seabed(spec: "mujoco.MjSpec", X_WT: Array, height: float) -> None:
    """Add flat seabed at a height [m] around an object."""
    import mujoco

    seabed = spec.worldbody.add_geom()
    seabed.name = "seabed"
    seabed.type = mujoco.mjtGeom.mjGEOM_PLANE
    seabed.size = [8.0, 8.0, 0.1]
    seabed.pos = [X_WT[0, 3], X_WT[1, 3], height]
    seabed.rgba = [0.55, 0.5, 0.4, 1.0]
