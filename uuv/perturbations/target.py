"""Perturbations of the object: pushed, oscillating, compliantly mounted, or floating freely."""

from dataclasses import dataclass, replace

import mujoco
import numpy as np

from uuv.models import hydrodynamics
from uuv.models.files.keyframes import keyframes_kept
from uuv.models.hydrodynamics import BodyHydrodynamics
from uuv.models.site.sliding_contact import TARGET_BODY
from uuv.perturbations.loop import Failure
from uuv.perturbations.perturbation import Loop, Perturbation
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import checked, finite_number, rotation_from_quat_wxyz

# added mass as a share of the displaced water's mass: a sphere, exact in potential flow
ADDED_MASS = 0.5
DRAG = 0.47  # drag coefficient of a sphere
# [kg, kg m^2] of an object with a prescribed motion: 60 N change its speed by 0.1 mm/s in a step. A
# far heavier body would coarsen the solver's tolerance, which MuJoCo scales by the mean inertia.
_HEAVY = 1e3


@dataclass(frozen=True, kw_only=True)
class PushedObject(Failure):
    """The object is displaced at a time, or after the planner enters a state, and stays there."""

    by: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [m] in W
    # [rad] rotation vector in W, about the origin of the object's frame
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ramp: float = 0.5  # [s] duration of the displacement

    def __post_init__(self) -> None:
        super().__post_init__()
        checked(self.by, (3,), "PushedObject by [m]")
        checked(self.turn, (3,), "PushedObject turn [rad]")
        finite_number(self.ramp, "PushedObject ramp [s]", above=0.0)
        if self.duration is not None:
            raise ConfigurationError(
                "PushedObject duration: the object stays where it was pushed to; leave it out"
            )

    def on_scene(self, scene: mujoco.MjSpec) -> None:
        """Make the object a body with a prescribed motion."""
        _let_move(scene, type(self).__name__)

    def on_loop(self, loop: Loop) -> Loop:
        """Wrap the plant."""
        from uuv.sim.plant.moved_object import MovedObjectPlant, push

        onset = self.onset()
        plant = MovedObjectPlant(
            loop.plant, TARGET_BODY, push(onset, self.by, self.turn, self.ramp)
        )
        return replace(loop, plant=plant, observers=(*loop.observers, *self._observers(onset)))


@dataclass(frozen=True, kw_only=True)
class MovingObject(Perturbation):
    """The object oscillates along a line, independent of contact forces."""

    amplitude: tuple[float, float, float] = (0.0, 0.02, 0.0)  # [m] in W
    frequency: float = 0.1  # [Hz]

    def __post_init__(self) -> None:
        checked(self.amplitude, (3,), "MovingObject amplitude [m]")
        finite_number(self.frequency, "MovingObject frequency [Hz]", above=0.0)

    def on_scene(self, scene: mujoco.MjSpec) -> None:
        """Make the object a body with a prescribed motion."""
        _let_move(scene, type(self).__name__)

    def on_loop(self, loop: Loop) -> Loop:
        """Wrap the plant."""
        from uuv.sim.plant.moved_object import MovedObjectPlant, swing

        plant = MovedObjectPlant(loop.plant, TARGET_BODY, swing(self.amplitude, self.frequency))
        return replace(loop, plant=plant)


@dataclass(frozen=True, kw_only=True)
class MountedObject(Perturbation):
    """The object is neutrally buoyant, and is held by springs or floats; the seabed does not
    support it.

    Its hydrodynamic data are those of a sphere of its volume.
    """

    # [N/m] stiffness of the mount in every direction; 0: the object is free, and can also rotate
    stiffness: float = 1e4
    damping: float = 0.1  # damping of the mount, as a share of the critical damping
    mass: float | None = None  # [kg] None: the mass of the water that its colliding solids displace

    def __post_init__(self) -> None:
        finite_number(self.stiffness, "MountedObject stiffness [N/m]", least=0.0)
        if self.mass is not None:
            finite_number(self.mass, "MountedObject mass [kg]", above=0.0)
        finite_number(self.damping, "MountedObject damping", least=0.0)

    def on_scene(self, scene: mujoco.MjSpec) -> None:
        """Give the object mass, hydrodynamic data and joints."""
        body = _object(scene, type(self).__name__)
        density = hydrodynamics.density_of(scene)
        mass, center = self._weigh(scene, body, density)

        # A sphere of the same volume gives added mass and drag.
        radius = (0.75 * mass / density / np.pi) ** (1.0 / 3.0)
        added = ADDED_MASS * mass
        drag = 0.5 * density * DRAG * np.pi * radius**2
        water = BodyHydrodynamics(
            volume=mass / density,
            center_of_buoyancy=center,
            added_mass=np.diag([added] * 3 + [0.0] * 3),
            quadratic_damping=np.array([drag] * 3 + [drag * radius**3] * 3),
        )

        hydrodynamics.attach(scene, {TARGET_BODY: water})
        scene.add_exclude(name="object_on_mount", bodyname1=TARGET_BODY, bodyname2="world")

        # A floating object has a free joint; a mounted one has springs along the axes of W.
        with keyframes_kept(scene):
            if self.stiffness == 0.0:
                body.add_freejoint(name=TARGET_BODY)
                return
            R_WT = rotation_from_quat_wxyz(np.array(body.quat))
            for axis, direction in zip("xyz", R_WT.T @ np.eye(3), strict=True):
                body.add_joint(
                    name=f"{TARGET_BODY}_{axis}",
                    type=mujoco.mjtJoint.mjJNT_SLIDE,
                    axis=direction,
                    stiffness=self.stiffness,
                    damping=2.0 * self.damping * np.sqrt(self.stiffness * (mass + added)),
                )

    def _weigh(
        self, scene: mujoco.MjSpec, body: mujoco.MjsBody, density: float
    ) -> tuple[float, np.ndarray]:
        """Set the body's inertia, and return its mass [kg] and centre of mass (3,) [m] in T."""
        solids = [
            geom
            for geom in body.geoms
            if geom.type != mujoco.mjtGeom.mjGEOM_MESH and (geom.contype or geom.conaffinity)
        ]
        if not solids and self.mass is None:
            raise ConfigurationError(
                "MountedObject: `mass` must be given for this object, which has no solids with a "
                "volume"
            )

        for geom in body.geoms:
            geom.mass = 0.0
        if self.mass is not None:
            moment = 0.4 * self.mass * (0.75 * self.mass / density / np.pi) ** (2.0 / 3.0)
            body.mass = self.mass
            body.inertia = [moment] * 3
            body.explicitinertial = True
            return self.mass, np.zeros(3)

        for geom in solids:
            geom.mass = np.nan
            geom.density = density

        alone = scene.copy().compile().body(TARGET_BODY)
        return float(alone.mass[0]), np.array(alone.ipos)


def _object(scene: mujoco.MjSpec, who: str) -> mujoco.MjsBody:
    body = scene.body(TARGET_BODY)
    if body is None:
        raise ConfigurationError(f"{who}: needs an object, but this site has none")
    if body.joints:
        raise ConfigurationError(f"{who}: must be the only perturbation that moves the object")
    return body


def _let_move(scene: mujoco.MjSpec, who: str) -> None:
    """Make the object a body with a free joint, moved only by `MovedObjectPlant`."""
    body = _object(scene, who)
    body.mass = _HEAVY
    body.inertia = [_HEAVY] * 3
    body.explicitinertial = True
    body.gravcomp = 1.0
    body.ipos = np.zeros(3)
    scene.add_exclude(name="object_moves", bodyname1=TARGET_BODY, bodyname2="world")
    with keyframes_kept(scene):
        body.add_freejoint(name=TARGET_BODY)
