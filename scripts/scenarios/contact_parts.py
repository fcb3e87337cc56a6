"""Factories for the parts of a contact job: vehicle models, sensor, controller, scan pose, hull box."""

import importlib
import traceback
from collections.abc import Callable, Collection, Set
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import mujoco
import numpy as np

from controllers.arm.inverse_dynamics import ArmDynamics
from controllers.arm.position_force import NominalStiffness
from controllers.hull.feedforward import Term, WithoutCompensation, WithoutTerms
from controllers.safety.safety_wrapper import SafetyWrapper
from controllers.tool_control import FromReference
from controllers.tuning import DRIVE_PERIOD, ArmTuning
from controllers.work_controller import WorkController
from models.arms import dh_geometry
from models.naming import ARM_BASE_BODY, HULL_BODY, TIP_SITE, TOOL_GEOM, check_parts
from models.registry import Registry
from models.site import scenes
from models.vehicle import Vehicle
from perception.clouds.scan import SensorModel
from perception.clouds.sonar_cloud import sonar_model
from perception.target_finder import KnownObjectFinder
from scenarios import deck_calibration as _deck_calibration
from sim.interfaces.errors import ConfigurationError, UuvError, one_line
from sim.interfaces.messages import Measurement, StateEstimate, Target
from sim.interfaces.protocols import Controller, Sensor
from sim.interfaces.spatial import Array, exp_so3, finite_number, pose, readonly, shown, whole_number
from sim.sensors.depth_camera import DepthCamera
from sim.sensors.sonar import BEAMS, Sonar

# Words of --without: what a controller leaves out, see `ablated`.
Method = Literal[
    "compensation", "hydrodynamic-term", "dynamic-term", "contact-term", "drift-correction", "force-control"
]
_TERMS: dict[str, Term] = {"hydrodynamic-term": "hydrodynamic", "dynamic-term": "dynamic", "contact-term": "contact"}
_FARTHEST = 1e3  # [m] largest scan range, far beyond any sensor here
_FOREIGN = 100  # characters kept of the message of a foreign error


def believed_and_built(
    vehicle: str, *, arm_errors: int | None, calibrated: bool, arm_file: Path | None
) -> tuple[mujoco.MjSpec, mujoco.MjSpec, str]:
    """Specs of the vehicle as its controller knows it (believed) and as it is (built).

    Both are equal but for the arm errors that are asked for.

    Args:
        vehicle: Name of the vehicle, or an MJCF file.
        arm_errors: Seed of the errors with which the arm is built; None: no errors.
        calibrated: Identify the believed arm from touches on deck.
        arm_file: File of the believed arm; excludes `calibrated`.

    Returns:
        Believed spec, built spec, line about the arm for the terminal (empty: nothing to report).

    Raises:
        ConfigurationError: The arm is to be both calibrated and read from a file, or the file does not match.
    """
    if arm_errors is not None:
        whole_number(arm_errors, "--arm-errors")
    believed, built = scenes.vehicle_spec(vehicle), scenes.vehicle_spec(vehicle)
    if arm_errors is None and not calibrated and arm_file is None:
        return believed, built, ""
    if calibrated and arm_file is not None:
        raise ConfigurationError("--calibrated and --arm: one of the two")
    drawn = believed.compile()
    passive = passive_joints(drawn, checked_vehicle(drawn))
    arm = true = dh_geometry.read(drawn, ARM_BASE_BODY, TIP_SITE, exclude=passive)
    if arm_errors is not None:
        true = dh_geometry.with_errors(arm, np.random.default_rng(arm_errors))
        dh_geometry.move(built, arm, true, ARM_BASE_BODY)
    known, said = arm, ""
    if calibrated:
        known, said = _deck_calibration.calibrate_on_deck(arm, true, np.random.default_rng([arm_errors or 0, 1]))
    elif arm_file is not None:
        known, said = _deck_calibration.from_file(arm_file, arm)
    if known is not arm:
        dh_geometry.move(believed, arm, known, ARM_BASE_BODY)
    return believed, built, said


def exteroceptive_sensor(kind: str, model: mujoco.MjModel, X_BS: Array) -> tuple[Sensor, SensorModel | None]:
    """The vehicle's depth camera, sonar or registered sensor, and the sensor model that perception uses.

    Args:
        kind: A name of SENSORS.
        model: The compiled world.
        X_BS: (4, 4) pose of the sensor on the hull.

    Returns:
        The sensor, and its model; None: the default model.

    Raises:
        ConfigurationError: There is no such sensor; the message lists those that there are.
    """
    return SENSORS.load(kind, model=model, X_BS=X_BS)


def _camera(model: mujoco.MjModel, X_BS: Array) -> tuple[Sensor, SensorModel | None]:
    return DepthCamera(model, HULL_BODY, X_BS), None


def _sonar(model: mujoco.MjModel, X_BS: Array) -> tuple[Sensor, SensorModel | None]:
    return Sonar(model, HULL_BODY, X_BS), sonar_model(BEAMS.pitch)


SENSORS = Registry("sensor", {"camera": _camera, "sonar": _sonar})
CONTROLLERS: Registry[Controller] = Registry("controller", {"work": WorkController})


def ablated(without: Set[str], own: mujoco.MjModel, water_error: float) -> dict[str, Any]:
    """Keyword arguments of `WorkController` that leave methods out; none where nothing is left out.

    Args:
        without: methods to leave out, each one of `Method`.
        own: the vehicle's model of itself.
        water_error: [-] share by which its hydrodynamic coefficients are wrong.

    Returns:
        `force_law`, `drift` and `feedforward`, as far as they differ from the controller's own.
    """
    parts: dict[str, Any] = {}
    if "force-control" in without:
        parts["force_law"] = NominalStiffness()
    if "drift-correction" in without:
        parts["drift"] = FromReference()
    terms: set[Term] = {term for word, term in _TERMS.items() if word in without}
    if terms or "compensation" in without:
        arm = ArmDynamics(own, water_error=water_error)
        if "compensation" in without:
            parts["feedforward"] = WithoutCompensation(arm, Vehicle.of(own).q_home)
        else:
            lag = ArmTuning().acceleration_filter
            parts["feedforward"] = WithoutTerms(arm, terms, acceleration_filter=lag, period=DRIVE_PERIOD)
    return parts


def tool_radius(model: mujoco.MjModel) -> float:
    """Radius [m] of a spherical tool pad; 0 (a point) for a pad of another shape."""
    pad = model.geom(TOOL_GEOM)
    return float(pad.size[0]) if pad.type[0] == mujoco.mjtGeom.mjGEOM_SPHERE else 0.0


def passive_joints(model: mujoco.MjModel, vehicle: Vehicle) -> list[str]:
    """Names of the joints that belong neither to the arm nor to the hull: springs, a pad."""
    return [model.joint(j).name for j in range(model.njnt) if j not in vehicle.joints and model.jnt_type[j] != 0]


def controller(name: str, own: mujoco.MjModel, *, without: Set[str], water_error: float) -> Controller:
    """The controller of that name, made of the vehicle's own model and wrapped in SafetyWrapper.

    Args:
        name: A name of CONTROLLERS, or MODULE:CLASS.
        own: The vehicle's model of itself.
        without: Methods to leave out (`ablated`); the controller gets other objects in their place.
        water_error: Share by which the controller's hydrodynamic coefficients are wrong.

    Raises:
        ConfigurationError: The class does not exist, or its module or constructor raises; the message names the place.
    """
    kind = partial(CONTROLLERS.load, name) if ":" not in name else _class(name)
    if ":" not in name:
        CONTROLLERS.resolve(name)
    try:
        made: Any = kind(own, water_error=water_error, **ablated(without, own, water_error))
        finite_number(made.period, "period [s]", above=0.0)
        lacking = [method for method in ("init", "step") if not callable(getattr(made, method, None))]
        if lacking:
            raise TypeError(f"it has no method {' and no '.join(lacking)}")
    except UuvError as error:
        raise ConfigurationError(f"--controller {shown(name)}: {error}") from error
    except (Exception, SystemExit) as error:
        raise ConfigurationError(f"--controller {shown(name)}: cannot be made of a model; {_told(error)}") from error
    return SafetyWrapper(made, own)


def _class(name: str) -> Callable[..., Any]:
    """The class named MODULE:CLASS."""
    module, _, word = name.partition(":")
    if not (module and word):
        raise ConfigurationError(f"--controller {shown(name)}: expected MODULE:CLASS")
    try:
        return getattr(importlib.import_module(module), word)
    except (Exception, SystemExit) as error:
        raise ConfigurationError(f"--controller {shown(name)}: cannot be imported; {_told(error)}") from error


def _told(error: BaseException) -> str:
    """Type and message of a foreign error, and the line in foreign code that raised it."""
    if isinstance(error, SyntaxError) and error.filename:
        where = f" ({error.filename}:{error.lineno})"
    else:
        places = [f"{frame.filename}:{frame.lineno}" for frame in traceback.extract_tb(error.__traceback__)]
        foreign = [place for place in places if not place.startswith((__file__, "<frozen"))]
        where = f" ({foreign[-1]})" if foreign and "importlib" not in foreign[-1] else ""
    return f"{type(error).__name__}: {one_line(str(error), _FOREIGN)}{where}"


def checked_vehicle(own: mujoco.MjModel, but: Collection[str] = ()) -> Vehicle:
    """The vehicle in `own`, checked for every part that work with the arm needs, except those in `but`.

    Raises:
        ConfigurationError: Parts are missing; the message names them all and their purpose.
    """
    check_parts(own, but)
    return Vehicle.of(own)


def scan_pose(X_BC: Array, approach_W: Array, scan_range: float) -> Array:
    """Level hull pose (4, 4) in W from which the camera sees the coarse position from the scan range.

    The camera looks towards +x of W, or down, or up.

    Args:
        X_BC: (4, 4) pose of the camera on the hull.
        approach_W: (3,) [m] coarse position of the object.
        scan_range: [m] distance along the camera's axis.

    Raises:
        ConfigurationError: The scan range is out of range.
    """
    finite_number(scan_range, "--range [m]", above=0.0, most=_FARTHEST)
    R_WB = exp_so3([0.0, 0.0, -np.arctan2(X_BC[1, 2], X_BC[0, 2])])
    return pose(R_WB, approach_W - R_WB @ (X_BC[:3, 3] + scan_range * X_BC[:3, 2]))


def hull_box(own: mujoco.MjModel, vehicle: Vehicle) -> Array:
    """Corners (2, 3) [m] in B of the box around the hull's own geoms."""
    geoms = [g for g in range(own.ngeom) if own.geom_bodyid[g] == vehicle.hull]
    if not geoms:
        return np.zeros((2, 3))
    centre = np.array([own.geom_pos[g] for g in geoms])
    reach = np.empty_like(centre)
    for row, g in enumerate(geoms):
        R = np.empty(9)
        mujoco.mju_quat2Mat(R, own.geom_quat[g])
        box = own.geom_aabb[g]
        centre[row] += R.reshape(3, 3) @ box[:3]
        reach[row] = np.abs(R.reshape(3, 3)) @ box[3:]
    return np.array([(centre - reach).min(axis=0), (centre + reach).max(axis=0)])


@dataclass(frozen=True, slots=True, eq=False)
class ShiftedFinder:
    """Wrapper of a TargetFinder that shifts the found pose and path against the tool's approach direction."""

    finder: KnownObjectFinder
    offset: float  # [m] the found surface lies so far before the true one

    def init(self) -> Any:
        """Initial state of the wrapped finder."""
        return self.finder.init()

    def step(self, state: Any, estimate: StateEstimate, measurement: Measurement) -> tuple[Any, Target | None]:
        """Step of the wrapped finder, its target shifted.

        Args:
            state: State of the wrapped finder.
            estimate: State estimate of the vehicle.
            measurement: Measurements of this step.

        Returns:
            New state, shifted target or None.
        """
        state, target = self.finder.step(state, estimate, measurement)
        if target is None or target.path is None:
            return state, target
        way = target.path.z[len(target.path.z) // 2]
        X_WT = np.array(target.X_WT)
        X_WT[:3, 3] -= self.offset * way
        path = replace(target.path, p=readonly(target.path.p - self.offset * way))
        return state, replace(target, X_WT=readonly(X_WT), path=path)
