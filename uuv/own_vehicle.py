"""The vehicle's model of itself: compiled without the scene and checked once, with all that parts are made of."""

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

import mujoco

from uuv.models.completing.hull_box import hull_box
from uuv.models.naming import ARM_BASE_BODY, CAMERA_SITE, TIP_SITE, TOOL_GEOM, check_parts, find
from uuv.models.site import scenes
from uuv.models.tools import attachment
from uuv.models.tools.tools import TOOLS
from uuv.models.vehicle import Vehicle, pose_in_body
from uuv.models.vehicles import uuv_puma
from uuv.sim.interfaces.spatial import Array

if TYPE_CHECKING:
    from uuv.controllers.mkps import Chain
    from uuv.controllers.planning.work_vehicle import WorkVehicle

# Shape of the tool that a task needs; a vehicle whose own tool has it keeps its own.
_SHAPES = {
    "sampler": mujoco.mjtGeom.mjGEOM_CAPSULE,
    "corer": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "box": mujoco.mjtGeom.mjGEOM_BOX,
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OwnVehicle:
    """The vehicle as its controller and planner know it."""

    model: mujoco.MjModel
    vehicle: Vehicle
    hull_box: Array  # (2, 3) [m] corners in B of the box around the hull's geoms and those fixed to it

    @classmethod
    def of(cls, spec: mujoco.MjSpec, but: Collection[str] = ()) -> Self:
        """Compiles `spec` and checks it for every part that work with the arm needs, except those in `but`.

        Raises:
            ConfigurationError: Parts are missing; the message names them all and their purpose.
        """
        model = spec.compile()
        check_parts(model, but)
        vehicle = Vehicle.of(model)
        return cls(model=model, vehicle=vehicle, hull_box=hull_box(model, vehicle.hull, vehicle.arm_base))

    def chain(self) -> "Chain":
        """Kinematics of the arm from its base to the tip; springs and pads are left out."""
        from uuv.controllers.mkps import Chain  # brings compiled kernels, which reading a vehicle does without

        return Chain.from_mjcf(self.model, ARM_BASE_BODY, TIP_SITE, exclude=self.passive_joints)

    @property
    def passive_joints(self) -> list[str]:
        """Names of the joints that belong neither to the arm nor to the hull: springs, a pad."""
        model, driven = self.model, self.vehicle.joints
        return [model.joint(j).name for j in range(model.njnt) if j not in driven and model.jnt_type[j] != 0]

    @property
    def X_BC(self) -> Array:
        """Pose (4, 4) of the camera on the hull."""
        return pose_in_body(self.model, find(self.model, mujoco.mjtObj.mjOBJ_SITE, CAMERA_SITE), self.vehicle.hull)

    def at_work(self) -> "WorkVehicle":
        """The vehicle as the planners of its work know it; without a camera one that looks ahead is taken."""
        from uuv.controllers.planning.work_vehicle import WorkVehicle

        known = WorkVehicle(vehicle=self.vehicle, chain=self.chain(), hull_box=self.hull_box)
        has_camera = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_SITE, CAMERA_SITE) >= 0
        return replace(known, X_BC=self.X_BC) if has_camera else known

    @property
    def tool_radius(self) -> float:
        """Radius [m] of a spherical tool pad; 0 (a point) for a pad of another shape."""
        pad = self.model.geom(TOOL_GEOM)
        return float(pad.size[0]) if pad.type[0] == mujoco.mjtGeom.mjGEOM_SPHERE else 0.0


def vehicle_spec(
    name: str, tool: str | None = None, parts: str | None = None, needs: str | None = None
) -> mujoco.MjSpec:
    """The vehicle's spec, complete as `uuv.models.site.scenes.vehicle_spec` makes it, with a tool on its tip.

    Args:
        name: Of the vehicle, or its file.
        tool: A tool of `uuv.models.tools.tools.TOOLS` in place of its own; None: its own.
        parts: File that maps its names to those of the contract; None: the one beside its file.
        needs: Tool of a task, put on if none is asked for and its own has another shape.

    Raises:
        ConfigurationError: There is no such vehicle or tool, or its file cannot be read.
    """
    wanted = tool or needs
    if wanted is None:
        return scenes.vehicle_spec(name, parts=parts)
    if name == "uuv_puma" and parts is None:
        return uuv_puma.build(wanted)
    return with_tool(scenes.vehicle_spec(name, parts=parts), tool, needs)


def with_tool(spec: mujoco.MjSpec, tool: str | None, needs: str | None = None) -> mujoco.MjSpec:
    """`spec` itself with a tool on its tip: `tool`, or the one that a task needs and its own is not.

    Raises:
        ConfigurationError: There is no such tool, or no tip for it.
    """
    if tool is not None:
        attachment.attach(spec, TOOLS.load(tool))
    elif needs is not None and any(site.name == TIP_SITE for site in spec.sites):
        own = next((geom.type for geom in spec.geoms if geom.name == TOOL_GEOM), None)
        if own is None or own != _SHAPES.get(needs):
            attachment.attach(spec, TOOLS.load(needs))
    return spec
