"""Entities that a hand moves: a loose object, and a valve whose handle turns."""

from collections.abc import Iterable
from typing import Any

import mujoco
import numpy as np
from dm_control import composer, mjcf
from lxml import etree

from uuv.environments.entities import Sea, VehicleEntity
from uuv.environments.mjcf_parts import root_of
from uuv.models import hydrodynamics
from uuv.models.arms.gear_friction import STAMP
from uuv.models.files.exact_mjcf import exact_xml
from uuv.models.naming import HANDLE
from uuv.models.objects.target_model import TargetModel
from uuv.models.site.grip_contact import HoldingContact
from uuv.models.site.pick_site import LooseObject, add_loose, loose_water
from uuv.models.site.sliding_contact import TARGET_BODY
from uuv.models.site.turned_valve import TurnedValve
from uuv.models.site.valve_site import SLIDING, STRIBECK, HingeFriction, add_valve
from uuv.models.tools.gripper import PADS
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array
from uuv.sim.plant.true_handle import TrueHandle


class LooseObjectEntity(composer.Entity):
    """Object that lies loose: `LooseObjectEntity(target, loose, density, name="object")`.

    To be added to a `Sea` by `add_free_entity`.
    """

    def _build(
        self, target: TargetModel, loose: LooseObject, density: float, name: str = "object"
    ) -> None:
        """Build the object.

        Args:
            target: Its shape.
            loose: Its mass and volume.
            density: [kg/m^3] Density of the water.
            name: Name of the model.
        """
        self.target = target
        self.loose = loose
        spec = mujoco.MjSpec()
        add_loose(spec, target, np.eye(4), loose)
        water = loose_water(target, loose, density)
        hydrodynamics.attach(spec, {TARGET_BODY: water}, density)

        # The sea gives it its free joint.
        document = etree.fromstring(exact_xml(spec).encode())
        for joint in list(document.iter("freejoint", "joint")):
            joint.getparent().remove(joint)
        self._root = root_of(etree.tostring(document).decode(), name)

    @property
    def mjcf_model(self) -> mjcf.RootElement:
        """PyMJCF model of the object."""
        return self._root

    @property
    def body(self) -> Any:
        """Its body."""
        return self._root.find("body", TARGET_BODY)

    @property
    def geoms(self) -> list[Any]:
        """Geoms that touch something."""
        geoms = self.body.find_all("geom")
        return [geom for geom in geoms if geom.contype != 0 or geom.conaffinity != 0]


class ValveEntity(composer.Entity):
    """Valve with a handle on a hinge: `ValveEntity(valve, X_WT, friction, name="valve")`."""

    def _build(
        self, valve: TurnedValve, X_WT: Array, friction: HingeFriction, name: str = "valve"
    ) -> None:
        """Build the valve.

        Args:
            valve: Its shape.
            X_WT: (4, 4) its pose in the model.
            friction: Friction of the hinge.
            name: Name of the model.
        """
        self.valve = valve
        spec = mujoco.MjSpec()
        add_valve(spec, valve, X_WT, friction)
        self._root = root_of(exact_xml(spec), name)

    @property
    def mjcf_model(self) -> mjcf.RootElement:
        """PyMJCF model of the valve."""
        return self._root

    @property
    def hinge(self) -> Any:
        """Joint of the handle."""
        return self._root.find("joint", HANDLE)

    def handle(self, physics: mjcf.Physics) -> TrueHandle:
        """True angle and moment of the handle, as views."""
        return TrueHandle.of(physics.data.ptr, self.hinge.full_identifier)

    def set_friction(self, physics: mjcf.Physics, friction: HingeFriction) -> None:
        """Write another friction of the hinge into the compiled model."""
        hinge = physics.bind(self.hinge)
        sliding = SLIDING * friction.stiction
        hinge.user = [STAMP, sliding, friction.stiction, STRIBECK]
        dof = int(physics.model.jnt_dofadr[hinge.element_id])
        physics.model.dof_frictionloss[dof] = sliding
        physics.model.dof_damping[dof] = friction.viscous


def let_hold(sea: Sea, vehicle: VehicleEntity, entity: LooseObjectEntity) -> None:
    """Set the contact between the gripper's pads and an object (`uuv.models.site.grip_contact`).

    Args:
        sea: The arena, whose solver gets the options for it.
        vehicle: Vehicle in the arena, with a gripper.
        entity: The object.
    """
    model = vehicle.own.model
    holding = HoldingContact.of(model, 1.0 / entity.loose.mass)
    option = sea.mjcf_model.option
    option.impratio = holding.impratio
    option.tolerance = holding.tolerance

    for name, contact in zip(PADS, holding.pads, strict=True):
        attributes = contact.of_pair(model.geom(name).friction)
        pad = _geom_of(vehicle.iter_entities(), name)
        for geom in entity.geoms:
            sea.mjcf_model.contact.add("pair", geom1=pad, geom2=geom, **attributes)


def _geom_of(parts: Iterable[Any], name: str) -> Any:
    """The geom of that name in one of several entities."""
    geoms = (part.mjcf_model.find("geom", name) for part in parts)
    geom = next((geom for geom in geoms if geom is not None), None)
    if geom is None:
        raise ConfigurationError(f"vehicle: must have a gripper, with a geom named {name!r}")
    return geom
