"""Preparation of a vehicle for work: read, mapped, completed, and checked; and its model of
itself.
"""

from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Self

import mujoco

from uuv.models.completing.complete import COMPUTABLE, complete, is_armed
from uuv.models.completing.hull_box import hull_box
from uuv.models.completing.mapping import mapped
from uuv.models.files.vehicle_file import read
from uuv.models.naming import (
    ARM_BASE_BODY,
    CAMERA_SITE,
    GRIPPER,
    TIP_SITE,
    TOOL_GEOM,
    check_parts,
    find,
)
from uuv.models.tools import attachment
from uuv.models.tools.tools import TOOLS
from uuv.models.vehicle import Vehicle, pose_in_body
from uuv.sim.interfaces.spatial import Array

if TYPE_CHECKING:
    from uuv.controllers.mkps import Chain
    from uuv.controllers.planning.work_vehicle import WorkVehicle

# Shape of the tool that a task needs. A vehicle keeps its own tool if it has this shape.
_SHAPES = {
    "sampler": mujoco.mjtGeom.mjGEOM_CAPSULE,
    "corer": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "box": mujoco.mjtGeom.mjGEOM_BOX,
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OwnVehicle:
    """The vehicle in the models of its controller and planner."""

    model: mujoco.MjModel
    vehicle: Vehicle
    # (2, 3) [m] corners in B of the box around the geoms of the hull and of bodies fixed to it
    hull_box: Array

    @classmethod
    def of(cls, spec: mujoco.MjSpec, but: Collection[str] = ()) -> Self:
        """Compile `spec`, and check that it has every part for work with the arm, except those in
        `but`.

        Raises:
            ConfigurationError: Parts are missing; the message names them all and their purpose.
        """
        model = spec.compile()
        check_parts(model, but)
        vehicle = Vehicle.of(model)
        return cls(
            model=model, vehicle=vehicle, hull_box=hull_box(model, vehicle.hull, vehicle.arm_base)
        )

    def chain(self) -> "Chain":
        """Kinematics of the arm from its base to the tip; springs and pads are left out."""
        # imports compiled kernels, which the reading of a vehicle does not need
        from uuv.controllers.mkps import Chain

        return Chain.from_mjcf(self.model, ARM_BASE_BODY, TIP_SITE, exclude=self.passive_joints)

    @property
    def passive_joints(self) -> list[str]:
        """Names of the joints that belong neither to the arm nor to the hull: springs, a pad."""
        model = self.model
        driven = self.vehicle.joints
        return [
            model.joint(j).name
            for j in range(model.njnt)
            if j not in driven and model.jnt_type[j] != 0
        ]

    @property
    def X_BC(self) -> Array:
        """Pose (4, 4) of the camera on the hull."""
        return pose_in_body(
            self.model, find(self.model, mujoco.mjtObj.mjOBJ_SITE, CAMERA_SITE), self.vehicle.hull
        )

    def at_work(self) -> "WorkVehicle":
        """The vehicle for the planners of its work, with a forward camera if it has none."""
        from uuv.controllers.planning.work_vehicle import WorkVehicle

        known = WorkVehicle(vehicle=self.vehicle, chain=self.chain(), hull_box=self.hull_box)
        has_camera = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_SITE, CAMERA_SITE) >= 0
        return replace(known, X_BC=self.X_BC) if has_camera else known

    @property
    def tool_radius(self) -> float:
        """Radius [m] of a spherical tool pad; 0, that is a point, for a pad of another shape."""
        pad = self.model.geom(TOOL_GEOM)
        return float(pad.size[0]) if pad.type[0] == mujoco.mjtGeom.mjGEOM_SPHERE else 0.0


def vehicle_spec(
    vehicle: str | Path | mujoco.MjSpec,
    tool: str | None = None,
    parts: str | Path | None = None,
    needs: str | None = None,
    *,
    water: str | Path | None = None,
    spares: Collection[str] | None = None,
    computed: bool = True,
) -> mujoco.MjSpec:
    """A vehicle ready for work: read, mapped to the contract, completed, and checked.

    Jobs, `uuv check` and the environments all call this function.

    Args:
        vehicle: A name of `uuv.models.available()`, MODULE:FUNCTION, a file, MJCF, URDF, xacro or
            SDF, or a spec, which is not changed.
        tool: Tool of `uuv.models.tools.tools.TOOLS` in place of the vehicle's own; None: its own.
        parts: File that maps names of the model to those of the contract; None: the one next to the
            vehicle's file.
        needs: Tool that a task needs, attached if `tool` is None and the vehicle's own tool has
            another shape.
        water: File with hydrodynamic data; None: the one next to the vehicle's file.
        spares: Named parts that the work does not need; None: no part is required.
        computed: False leaves out computed parts, which need a search of postures.

    Returns:
        Spec of the vehicle with hydrodynamics; `uuv.models.files.notes.computed` lists the added
        parts.

    Raises:
        ConfigurationError: There is no such vehicle or tool, the vehicle's file cannot be read or
            compiled, or the vehicle lacks a part.
    """
    file = read(vehicle, parts=parts, water=water, tool=tool or needs)
    spec = mapped(file)
    if computed:
        complete(spec, trim=file.trim, name=file.name)

    if not file.has_tool:
        with_tool(spec, tool, needs)
    if spares is not None:
        check(spec, spares, computed=computed)
    return spec


def check(spec: mujoco.MjSpec, spares: Collection[str], *, computed: bool = True) -> None:
    """Refuse a vehicle that lacks a part needed for work with the arm.

    Args:
        spec: Spec of the vehicle.
        spares: Named parts that the work does not need.
        computed: False: parts that can be computed are not required.

    Raises:
        ConfigurationError: Parts are missing; the message names them all and their purpose.
    """
    computable = () if computed or not is_armed(spec) else COMPUTABLE
    check_parts(spec.compile(), {*spares, *computable})


def with_tool(spec: mujoco.MjSpec, tool: str | None, needs: str | None = None) -> mujoco.MjSpec:
    """`spec` itself with a tool at its tip: `tool`, or the tool that a task needs if the vehicle's
    own differs.

    Raises:
        ConfigurationError: There is no such tool, or the vehicle has no tip for it.
    """
    if tool is not None:
        attachment.attach(spec, TOOLS.load(tool))
    elif needs is not None and any(site.name == TIP_SITE for site in spec.sites):
        if needs == GRIPPER and any(motor.name == GRIPPER for motor in spec.actuators):
            return spec
        shape = next((geom.type for geom in spec.geoms if geom.name == TOOL_GEOM), None)
        if shape is None or shape != _SHAPES.get(needs):
            attachment.attach(spec, TOOLS.load(needs))
    return spec
