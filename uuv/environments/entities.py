"""Entities of dm_control's composer: the sea, a vehicle with arm and tool, and a work object.

    sea, vehicle = Sea(speed=0.2), VehicleEntity("uuv_puma")
    sea.add_free_entity(vehicle)
    physics = mjcf.Physics.from_mjcf_model(sea.mjcf_model)  # or composer.Environment(task)

dm_control steps its own physics. Before and after each of its steps, the vehicle commands thrusters
and joints and reads contacts by a `uuv.sim.plant.plant.Plant` with the same MjModel and MjData. A
trajectory therefore has the same bits as that of the plant. After a step, MjData holds values from
the start of the step. Positions are updated after each step, all other values after each action.
"""

import warnings
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from dm_control import composer, mjcf
from dm_control.composer import variation
from dm_control.rl import control

from uuv.environments.mjcf_parts import MOUNT, parts_of, root_of
from uuv.environments.model_variation import ModelVariation
from uuv.environments.sensing import (
    ArmObservables,
    SensorReadings,
    ToolObservables,
    VehicleObservables,
)
from uuv.models import hydrodynamics as hydrodynamic_rows
from uuv.models.files.exact_mjcf import exact_xml
from uuv.models.naming import (
    ARM_BASE_BODY,
    CAMERA_SITE,
    GRIPPER,
    HULL_BODY,
    TIP_SITE,
    TOOL_FACE_SITE,
    TOOL_GEOM,
    PartNames,
)
from uuv.models.objects.target_model import TargetModel
from uuv.models.site.sliding_contact import TARGET_BODY, friction_stiffness, friction_time
from uuv.own_vehicle import OwnVehicle, vehicle_spec
from uuv.perturbations.perturbation import Perturbation
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError, HydrodynamicsError, PhysicsWarning
from uuv.sim.interfaces.messages import Command
from uuv.sim.interfaces.protocols import Sensor
from uuv.sim.interfaces.spatial import (
    Array,
    checked_pose,
    finite_number,
    fitting,
    pose,
    quat_wxyz_from_rotation,
    shown,
)
from uuv.sim.plant.plant import Plant
from uuv.sim.plant.truth import Truth
from uuv.sim.sensors.arm_camera import beside_tool
from uuv.sim.water.current import Current
from uuv.sim.water.water_motion import FLOW, take_last

_PLANE = 12.0  # [m] half the side of the seabed
Random = np.random.RandomState


class Sea(composer.Arena):
    """Water with a steady current and gusts, drawn in each episode, above a flat seabed.

    `Sea(speed=0.0, gust=0.0, *, depth=10.0, current_W=None, name="sea")`; `Sea._build` describes
    the arguments.
    """

    def _build(
        self,
        speed: Any = 0.0,
        gust: float = 0.0,
        *,
        depth: float = 10.0,
        current_W: Sequence[float] | None = None,
        name: str = "sea",
    ) -> None:
        """Build the sea.

        Args:
            speed: [m/s] Speed of the horizontal current, whose direction is drawn in each episode;
                a number, or a variation of composer that is evaluated in each episode.
            gust: [m/s] Standard deviation of gusts per axis.
            depth: [m] Depth of the seabed below the surface, z = 0.
            current_W: (3,) [m/s] Fixed current for every episode, in place of `speed`.
            name: Name of the model.

        Raises:
            ConfigurationError: A number is out of range.
        """
        super()._build(name=name)

        # The current. A speed that composer draws is not a number that could be checked.
        self._speed = speed if current_W is None else 0.0
        self._gust = finite_number(gust, "gust [m/s]", least=0.0, most=2.0)
        if not isinstance(self._speed, variation.Variation) and not callable(self._speed):
            finite_number(self._speed, "speed of the current [m/s]", least=0.0, most=5.0)
        self._always_W = (
            None if current_W is None else fitting(np.array(current_W), (3,), "current [m/s]")
        )
        self._mean_W = np.zeros(3) if self._always_W is None else self._always_W
        self._stream: int | None = None

        root = self.mjcf_model
        # the arena of composer gives mass to frames
        root.compiler.boundmass = root.compiler.boundinertia = 0
        root.option.integrator, root.option.cone = "implicitfast", "elliptic"
        root.option.noslip_iterations = 0  # composer has 5, which use the dry inertia

        # Light, haze and colours of the water.
        root.visual.headlight.set_attributes(ambient=[0.45, 0.45, 0.45], diffuse=[0.5, 0.5, 0.5])
        root.visual.map.set_attributes(znear=0.01, fogstart=4.0, fogend=14.0)
        root.visual.rgba.fog = [0.05, 0.25, 0.33, 1.0]
        root.visual.get_children("global").set_attributes(offwidth=1920, offheight=1080)

        sky = {
            "type": "skybox",
            "builtin": "gradient",
            "rgb1": [0.1, 0.42, 0.5],
            "rgb2": [0.01, 0.08, 0.12],
        }
        root.asset.add("texture", name="water", width=64, height=64, **sky)

        squares = {
            "type": "2d",
            "builtin": "checker",
            "rgb1": [0.56, 0.51, 0.41],
            "rgb2": [0.5, 0.45, 0.36],
        }
        root.asset.add("texture", name="sand", width=128, height=128, **squares)
        root.asset.add("material", name="sand", texture="sand", texrepeat=[20, 20])

        # Seabed.
        depth = finite_number(depth, "depth [m]", above=0.0, most=1e3)
        self.seabed = root.worldbody.add(
            "geom",
            name="seabed",
            type="plane",
            size=[_PLANE, _PLANE, 0.1],
            pos=[0, 0, -depth],
            material="sand",
        )

        root.worldbody.add(
            "light", name="sun", directional=True, dir=[0.2, 0.1, -1], diffuse=[0.5, 0.5, 0.5]
        )

    def attach(self, entity: composer.Entity, attach_site: Any = None) -> Any:
        """Attach an entity.

        Raises:
            ConfigurationError: The entity is a second vehicle, but the flow is for one.
        """
        if isinstance(entity, VehicleEntity) and any(
            isinstance(entity, VehicleEntity) for entity in self._attached
        ):
            raise ConfigurationError("Sea: must have one vehicle only; it already has one")
        return super().attach(entity, attach_site)

    def initialize_episode(self, physics: mjcf.Physics, random_state: Random) -> None:
        """Draw the current of the episode, which the vehicle in the sea reads by `flow`."""
        heading = random_state.uniform(-np.pi, np.pi)
        stream = int(random_state.randint(2**31))
        self._stream = stream
        if self._always_W is None:
            speed = variation.evaluate(self._speed, random_state=random_state)
            self._mean_W = float(speed) * np.array([np.cos(heading), np.sin(heading), 0.0])

    @property
    def current_W(self) -> Array:
        """Steady current (3,) [m/s] of the present episode, world axes."""
        return self._mean_W

    def flow(self, timestep: float) -> Current:
        """Current of the present episode, from its beginning, for a `timestep` [s]."""
        gust = self._gust if self._stream is not None else 0.0
        rng = np.random.default_rng(self._stream) if gust else None
        return Current(self._mean_W, gust=gust, timestep=timestep, rng=rng)


class ToolEntity(composer.Entity):
    """Tool at the end of an arm: its pad or sampler on a slide joint, and the site of its tip."""

    def _build(
        self,
        vehicle: str = "uuv_puma",
        tool: str | None = None,
        *,
        part: tuple[str, str] | None = None,
    ) -> None:
        """Take the tool of a vehicle.

        Args:
            vehicle: A name of `uuv.models.available()`, or an MJCF file.
            tool: A tool of `uuv.models.tools.tools.TOOLS` in place of the vehicle's own.
            part: MJCF of the tool and the folder of the files that it names, if they are known.

        Raises:
            ConfigurationError: The vehicle has no tool of its own.
        """
        if part is None:
            parts = parts_of(vehicle_spec(vehicle, tool))
            if parts.tool is None:
                raise ConfigurationError(f"vehicle {vehicle!r} must have a detachable tool")
            part = parts.tool, parts.folder

        self._root = root_of(part[0], "tool", part[1])

        # Camera next to the tool.
        X_GC = beside_tool()
        self.tip.parent.add(
            "camera",
            name=CAMERA_SITE,
            pos=_in_parent(self.tip, X_GC)[:3, 3],
            xyaxes=[*_in_parent(self.tip, X_GC)[:3, 0], *-_in_parent(self.tip, X_GC)[:3, 1]],
            fovy=60.0,
        )

    def _build_observables(self) -> ToolObservables:
        return ToolObservables(self)

    @property
    def mjcf_model(self) -> mjcf.RootElement:
        """PyMJCF model of the tool."""
        return self._root

    @property
    def tip(self) -> Any:
        """Site of the tip, z out of the tool."""
        return self._root.find("site", TIP_SITE)


class ArmEntity(composer.Entity):
    """Arm of a vehicle, from its base to the flange for the tool."""

    def _build(
        self,
        vehicle: str = "uuv_puma",
        *,
        tool: ToolEntity | None = None,
        part: tuple[str, str] | None = None,
        bare: bool = False,
    ) -> None:
        """Take the arm of a vehicle.

        Args:
            vehicle: A name of `uuv.models.available()`, or an MJCF file.
            tool: Tool for its flange; None: the vehicle's own.
            part: MJCF of the arm and the folder of the files that it names, if they are known.
            bare: Whether to leave the flange without a tool.

        Raises:
            ConfigurationError: The vehicle has no arm that can be detached.
        """
        if part is None:
            parts = parts_of(vehicle_spec(vehicle))
            if parts.arm is None:
                raise ConfigurationError(f"vehicle {vehicle!r} must have a detachable arm")
            part = parts.arm, parts.folder
            if tool is None and parts.tool is not None and not bare:
                tool = ToolEntity(vehicle, part=(parts.tool, parts.folder))

        self._root = root_of(part[0], "arm", part[1])
        self.tool = tool
        if tool is not None:
            self.attach(tool)

    def _build_observables(self) -> ArmObservables:
        return ArmObservables(self)

    @property
    def mjcf_model(self) -> mjcf.RootElement:
        """PyMJCF model of the arm."""
        return self._root

    @property
    def attachment_site(self) -> Any:
        """Site of the flange."""
        return self._root.find("site", MOUNT)

    @property
    def joints(self) -> list[Any]:
        """Joints of the arm, from base to tip."""
        return self._root.find_all("joint", exclude_attachments=True)

    @property
    def actuators(self) -> list[Any]:
        """Motors of the joints."""
        return self._root.find_all("actuator", exclude_attachments=True)


class VehicleEntity(composer.Entity):
    """A vehicle with thrusters, arm and tool, to be added to a `Sea` by `add_free_entity`.

    `VehicleEntity(vehicle="uuv_puma", *, tool=None, sensors=(), perturbations=(), name="vehicle")`;
    `VehicleEntity._build` describes the arguments.
    """

    def _build(
        self,
        vehicle: str = "uuv_puma",
        *,
        tool: str | None = None,
        sensors: Sequence[Sensor] = (),
        perturbations: Sequence[Perturbation] = (),
        name: str = "vehicle",
    ) -> None:
        """Build the vehicle.

        Args:
            vehicle: A name of `uuv.models.available()`, or an MJCF file with the parts of
                `uuv.models.naming`.
            tool: A tool of `uuv.models.tools.tools.TOOLS` in place of the vehicle's own.
            sensors: Sensors whose readings are observables in addition to the true state, each with
                its own rate, delay and noise.
            perturbations: Deviations of the true vehicle from its model, drawn in each episode.
            name: Name of the model.

        Raises:
            ConfigurationError: There is no such vehicle or tool, or the vehicle has no free hull.
        """
        _check_each("sensors", sensors, "init", "step", "period")
        _check_each("perturbations", perturbations, "on_vehicle", "rng")

        # Hull, arm and tool as separate models.
        self.spec = vehicle_spec(vehicle, tool)
        self._parts = parts = parts_of(self.spec)
        self._root = root_of(parts.hull, name, parts.folder)
        if parts.arm is not None:
            held = (
                None if parts.tool is None else ToolEntity(vehicle, part=(parts.tool, parts.folder))
            )
            part = parts.arm, parts.folder
            self.arm: ArmEntity | None = ArmEntity(vehicle, part=part, tool=held, bare=held is None)
        else:
            self.arm = None

        self.kind = vehicle
        self.own = OwnVehicle.of(self.spec.copy(), _ANYTHING)
        self._root.size.nuserdata = FLOW.size  # entries in which the plant keeps the current

        self._plant: Plant | None = None
        self.command: Command | None = None  # of the next step; None: all off
        self.readings = SensorReadings(sensors)
        self._variation = ModelVariation(self.spec, perturbations) if perturbations else None

        # The arm on its mount, and the cameras.
        if self.arm is not None:
            self.attach(self.arm, self._root.find("site", MOUNT))
        if (camera := self._root.find("site", CAMERA_SITE)) is not None:
            self._add_camera(camera)

        self._root.find("body", HULL_BODY).add(
            "camera",
            name="overview",
            mode="track",
            pos=[2.9, -2.5, 0.9],
            xyaxes=[0.65, 0.76, 0, -0.29, 0.25, 0.92],
        )

    def _add_camera(self, site: Any) -> None:
        """MuJoCo camera at the site of the vehicle's camera, half a turn from OpenCV axes."""
        R = np.empty(9)
        camera = self.own.model.site(CAMERA_SITE)
        mujoco.mju_quat2Mat(R, camera.quat)
        R = R.reshape(3, 3)

        site.parent.add(
            "camera", name=CAMERA_SITE, pos=camera.pos, xyaxes=[*R[:, 0], *-R[:, 1]], fovy=50.0
        )

    def _build_observables(self) -> VehicleObservables:
        return VehicleObservables(self)

    def observe(self, *, sensors: bool) -> None:
        """Enable only the sensors' readings or, without any, the true states of all parts."""
        for entity in self.iter_entities():
            of_sensors = getattr(entity.observables, "of_sensors", {})
            for name, observable in entity.observables.as_dict(fully_qualified=False).items():
                observable.enabled = (name in of_sensors) == sensors

    @property
    def mjcf_model(self) -> mjcf.RootElement:
        """PyMJCF model of the vehicle."""
        return self._root

    @property
    def tool(self) -> ToolEntity | None:
        """The tool, if it is an entity of its own."""
        return None if self.arm is None else self.arm.tool

    @property
    def plant(self) -> Plant:
        """The plant that works on the physics of the environment.

        Raises:
            ConfigurationError: The model has not been compiled by an environment yet.
        """
        if self._plant is None:
            raise ConfigurationError(
                "vehicle: has no physics yet; first make a composer.Environment with its task"
            )
        return self._plant

    @property
    def drawn(self) -> dict[str, float]:
        """Means of the factors that perturbations drew for the present episode, by name."""
        return {} if self._variation is None else self._variation.drawn

    @property
    def truth(self) -> Truth:
        """True state (`uuv.sim.plant.truth.Truth`), as views."""
        return self.plant.truth

    def names(self) -> PartNames:
        """Names of the vehicle's parts in the whole scene."""
        names = {
            "hull": self._find("body", HULL_BODY),
            "arm_base": self._find("body", ARM_BASE_BODY),
            "tip": self._find("site", TIP_SITE),
            "tool": self._find("geom", TOOL_GEOM),
            "tool_face": self._find("site", TOOL_FACE_SITE),
            "gripper": self._find("actuator", GRIPPER),
        }

        return PartNames(**{part: name for part, name in names.items() if name})

    def _find(self, kind: str, name: str) -> str:
        for entity in self.iter_entities():
            element = entity.mjcf_model.find(kind, self._parts.renamed.get(name, name))
            if element is not None:
                return element.full_identifier
        return f"{self._root.full_identifier}{name}"

    def place(
        self, physics: mjcf.Physics, X_WB: Array | None = None, q: Array | None = None
    ) -> None:
        """Place hull and arm at rest; called by a task's `initialize_episode`.

        Args:
            physics: Physics of the environment.
            X_WB: (4, 4) hull pose; None: the pose in the model.
            q: (n,) [rad] joint angles; None: folded, as in the model's keyframe `home`.

        Raises:
            ConfigurationError: `X_WB` is not a pose, or `q` has another shape.
        """
        vehicle, data = self.plant.vehicle, physics.data
        q = (
            self.own.vehicle.q_home
            if q is None
            else fitting(q, vehicle.qpos.shape, "joint angles [rad]")
        )
        data.qpos[vehicle.qpos] = q

        X_WB = pose() if X_WB is None else checked_pose(X_WB, "X_WB")
        at = vehicle.hull_qpos
        data.qpos[at : at + 3], data.qpos[at + 3 : at + 7] = (
            X_WB[:3, 3],
            quat_wxyz_from_rotation(X_WB[:3, :3]),
        )

    def after_compile(self, physics: mjcf.Physics, random_state: Random) -> None:
        """Compute the new model's constants with added mass, and make its plant."""
        model = physics.model.ptr
        physics.legacy_step = False  # read contacts before the next step

        hydrodynamics.install()
        hydrodynamics.set_constants(model)
        take_last(model, self._root.size.nuserdata)

        if self._variation is not None:
            self._variation.bind(model, self._find)

        for name in _dry(model):
            warnings.warn(
                f"the body {name!r} floats without hydrodynamics: it falls as in a vacuum",
                PhysicsWarning,
                2,
            )

        self._plant = self._over(physics)

    def _over(self, physics: mjcf.Physics) -> Plant:
        """The plant that works on a physics."""
        return Plant(
            physics.model.ptr,
            current=Current(np.zeros(3)),
            data=physics.data.ptr,
            names=self.names(),
        )

    def initialize_episode(self, physics: mjcf.Physics, random_state: Random) -> None:
        """Begin at the state that the task has set, with the current of the sea."""
        if self._variation is not None:
            self._variation.draw(random_state)
            self._plant = self._over(physics)  # thrusters are read from the model

        sea = self.parent
        timestep = self.plant.timestep
        current = (
            sea.flow(timestep) if isinstance(sea, Sea) else Current(np.zeros(3), timestep=timestep)
        )
        self.plant.start(current)
        self.command = None

        mujoco.mj_step1(physics.model.ptr, physics.data.ptr)
        self.readings.start(self.truth, random_state)

    def before_substep(self, physics: mjcf.Physics, random_state: Random) -> None:
        """Command thrusters and joints."""
        plant, command = self.plant, self.command
        if command is not None and not isinstance(command, Command):
            raise ConfigurationError(
                "vehicle.command: expected a uuv.sim.interfaces.messages.Command, got "
                f"{type(command).__name__}"
            )

        plant.begin(command if command is not None else self._off(plant))

    @staticmethod
    def _off(plant: Plant) -> Command:
        n, m = len(plant.vehicle.joints), len(plant.vehicle.thruster_names)
        return Command(time=0.0, joint_torque=np.zeros(n), thrusters=np.zeros(m), scan=False)

    def after_substep(self, physics: mjcf.Physics, random_state: Random) -> None:
        """Read contacts, set the next current, and update positions."""
        plant = self.plant
        plant.finish()
        mujoco.mj_kinematics(plant.model, plant.data)
        plant.truth.time = float(plant.data.time)

    def after_step(self, physics: mjcf.Physics, random_state: Random) -> None:
        """Update all values, for observations and images.

        Raises:
            control.PhysicsError: Exception of dm_control; the simulation diverged.
        """
        try:
            self.plant.observe(again=True)
        except HydrodynamicsError as error:
            raise control.PhysicsError(str(error)) from error


class WorkObjectEntity(composer.Entity):
    """Object with its shapes: `WorkObjectEntity(target, *, stand=True, name="object")`."""

    def _build(self, target: TargetModel, *, stand: bool = True, name: str = "object") -> None:
        """Build the object.

        Args:
            target: Model of the object, from `uuv.models.objects.targets`.
            stand: Whether to add its stand.
            name: Name of the model.
        """
        self.target = target
        spec = mujoco.MjSpec()
        target.add_to(spec, np.eye(4), stand=stand)
        self._root = root_of(exact_xml(spec), name)

    @property
    def mjcf_model(self) -> mjcf.RootElement:
        """PyMJCF model of the object."""
        return self._root

    @property
    def geoms(self) -> list[Any]:
        """Geoms of the object that collide."""
        geoms = self._root.find("body", TARGET_BODY).find_all("geom")
        return [geom for geom in geoms if geom.contype != 0 or geom.conaffinity != 0]


def _in_parent(site: Any, X: Array) -> Array:
    """Pose (4, 4) in a site's axes, converted to the axes of the site's body."""
    R = np.empty(9)
    mujoco.mju_quat2Mat(
        R, np.array([1.0, 0.0, 0.0, 0.0]) if site.quat is None else np.array(site.quat, np.float64)
    )

    return (
        pose(R.reshape(3, 3), np.zeros(3) if site.pos is None else np.array(site.pos, np.float64))
        @ X
    )


def put(sea: Sea, entity: composer.Entity, X_WT: Array) -> Any:
    """Fix an entity to the world at a pose (4, 4); returns its frame."""
    frame = sea.attach(entity)
    X = checked_pose(X_WT, "X_WT")
    frame.pos, frame.quat = X[:3, 3], quat_wxyz_from_rotation(X[:3, :3])
    return frame


def let_slide(
    sea: Sea, vehicle: VehicleEntity, entity: WorkObjectEntity, *, speed: float, force: float
) -> None:
    """Set a sliding tool's contact so that it does not lift (`uuv.models.site.sliding_contact`).

    Args:
        sea: The arena.
        vehicle: Vehicle in the arena, with a tool.
        entity: The object.
        speed: [m/s] Speed of the sliding tool.
        force: [N] Normal force on the tool.
    """
    pads = (part.mjcf_model.find("geom", TOOL_GEOM) for part in vehicle.iter_entities())
    pad = next((geom for geom in pads if geom), None)
    if pad is None:
        raise ConfigurationError(f"vehicle: must have a tool to slide, a geom named {TOOL_GEOM!r}")

    tool_geom = vehicle.own.model.geom(TOOL_GEOM)
    root = sea.mjcf_model
    time = friction_time(vehicle.own.model, speed=speed, force=force)
    root.option.impratio = friction_stiffness(time)

    # Contact pairs use the tool's friction, unless the object's own shapes have priority.
    sliding, spinning, rolling = tool_geom.friction
    for geom in entity.geoms:
        if (geom.priority or 0) > tool_geom.priority[0] or not geom.name:
            continue
        root.contact.add(
            "pair",
            geom1=pad,
            geom2=geom,
            friction=[sliding, sliding, spinning, rolling, rolling],
            condim=int(tool_geom.condim[0]),
            solref=tool_geom.solref,
            solimp=tool_geom.solimp,
            solreffriction=[time, 1.0],
        )


def _check_each(name: str, objects: Any, *methods: str) -> None:
    """Refuse a value that is not a list of objects with these attributes.

    Raises:
        ConfigurationError: `objects` is not such a list.
    """
    if not isinstance(objects, Sequence) or isinstance(objects, str):
        raise ConfigurationError(f"{name}: expected a list, got {shown(objects)}")
    for candidate in objects:
        if isinstance(candidate, type) or not all(hasattr(candidate, method) for method in methods):
            hint = f"; did you mean {candidate.__name__}()?" if isinstance(candidate, type) else ""
            raise ConfigurationError(f"{name}: must be such objects, got {shown(candidate)}{hint}")


def _dry(model: mujoco.MjModel) -> list[str]:
    """Names of free bodies with mass that have no hydrodynamics in their whole tree."""
    dry = []
    for joint in np.flatnonzero(np.asarray(model.jnt_type) == mujoco.mjtJoint.mjJNT_FREE):
        root = int(model.jnt_bodyid[joint])
        tree = np.flatnonzero(np.asarray(model.body_rootid) == model.body_rootid[root])
        if not any(hydrodynamic_rows.carries(model.body_user[body]) for body in tree):
            dry.append(model.body(root).name or f"body {root}")

    return dry


class _Anything:
    """Requirements that contain no part, since each task checks the parts that it needs."""

    def __contains__(self, name: object) -> bool:
        return True

    def __iter__(self) -> Any:
        return iter(())

    def __len__(self) -> int:
        return 0


_ANYTHING = _Anything()
