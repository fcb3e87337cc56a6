"""Factories for components of a run: models of the vehicle, sensor, controller."""

from collections.abc import Callable, Mapping, Set
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from uuv.components.ablations import ablated
from uuv.controllers.arm.published_force_law import (
    LengthForceLaw,
    PublishedForceLaw,
    TangentialForceLoop,
)
from uuv.controllers.estimation.closed_form_force import ClosedFormForce
from uuv.controllers.estimation.load_observer import MomentumObserver
from uuv.controllers.safety.safety_wrapper import SafetyWrapper
from uuv.controllers.tuning import ELASTIC_GEARS, ArmTuning
from uuv.kinds import CONTROLLER, CONTROLLERS, SENSORS, cause_of, class_of
from uuv.methods import NAVIGATION, PublishedForce
from uuv.models.arms import dh_geometry
from uuv.models.files.notes import computed
from uuv.models.naming import ARM_BASE_BODY, HULL_BODY, TIP_SITE
from uuv.models.water import battery_feed
from uuv.own_vehicle import OwnVehicle, vehicle_spec
from uuv.perception.clouds.scan import SensorModel
from uuv.perception.clouds.sonar_cloud import sonar_model
from uuv.scenario import Belief, Control, Task, VehicleSetup
from uuv.sim.interfaces.errors import ConfigurationError, UuvError
from uuv.sim.interfaces.protocols import Controller, Estimator, Sensor
from uuv.sim.interfaces.spatial import Array, finite_number, shown
from uuv.sim.sensors.depth_camera import DepthCamera
from uuv.sim.sensors.sonar import BEAMS, Sonar
from uuv.sim.sensors.survey import Survey

# keyword arguments of `WorkController` for each published force law; these parts have no state
FORCE_PARTS: Mapping[PublishedForce, Mapping[str, Any]] = {
    "force-law": {"force_law": PublishedForceLaw(), "compliance": TangentialForceLoop()},
    "normal-force-law": {"force_law": PublishedForceLaw()},
    "force-length-law": {"force_law": LengthForceLaw()},
}
_ESTIMATOR = "estimator"  # begins the messages about the controller


def believed_and_built(
    vehicle: VehicleSetup, belief: Belief, task: Task
) -> tuple[mujoco.MjSpec, mujoco.MjSpec, str]:
    """Specs of the vehicle in its controller's model (believed) and in reality (built).

    Both are equal except for the requested errors of the arm.

    Args:
        vehicle: The real vehicle.
        belief: Differences of its model of itself.
        task: Task of the vehicle, which determines the tool, and the parts that are not needed.

    Returns:
        Believed spec, built spec, lines about computed parts and the arm for the terminal (empty:
        none).

    Raises:
        ConfigurationError: The vehicle is unknown, or the file of the arm does not match.
    """
    believed = vehicle_spec(vehicle.vehicle, vehicle.tool, vehicle.parts, task.tool)
    if vehicle.battery is not None:
        battery_feed.attach(believed, vehicle.battery)
    built = believed.copy()
    computed_parts = "\n".join(computed(believed).values())
    if vehicle.arm_errors is None and not belief.calibrated and belief.arm is None:
        return believed, built, computed_parts

    # The true arm, with its errors.
    drawn = OwnVehicle.of(believed, task.spares)
    arm = true = dh_geometry.read(
        drawn.model, ARM_BASE_BODY, TIP_SITE, exclude=drawn.passive_joints
    )
    if vehicle.arm_errors is not None:
        true = dh_geometry.with_errors(arm, np.random.default_rng(vehicle.arm_errors))
        dh_geometry.move(built, arm, true, ARM_BASE_BODY)

    # The calibrated arm, which the controller believes.
    known = arm
    summary = ""
    if belief.calibrated or belief.arm is not None:
        # imported only here, since its kernels compile on import
        from uuv.components import deck_calibration

        if belief.calibrated:
            rng = np.random.default_rng([vehicle.arm_errors or 0, 1])
            known, summary = deck_calibration.calibrate_on_deck(arm, true, rng)
        elif belief.arm is not None:
            known, summary = deck_calibration.from_file(Path(belief.arm), arm)

    if known is not arm:
        dh_geometry.move(believed, arm, known, ARM_BASE_BODY)
    return believed, built, "\n".join(filter(None, (computed_parts, summary)))


def exteroceptive_sensor(
    kind: str, model: mujoco.MjModel, X_BS: Array
) -> tuple[Sensor, SensorModel | None]:
    """The vehicle's depth camera, sonar or registered sensor, and the model that perception uses.

    Args:
        kind: A name of SENSORS.
        model: The compiled world.
        X_BS: (4, 4) pose of the sensor on the hull.

    Returns:
        The sensor, and its model; None: the default model.

    Raises:
        ConfigurationError: There is no such sensor; the message lists the known ones.
    """
    return SENSORS.load(kind, model=model, X_BS=X_BS)


def camera(model: mujoco.MjModel, X_BS: Array) -> tuple[Sensor, SensorModel | None]:
    """Stereo depth camera at `X_BS` (4, 4) on the hull."""
    return DepthCamera(model, HULL_BODY, X_BS), None


def sonar(model: mujoco.MjModel, X_BS: Array) -> tuple[Sensor, SensorModel | None]:
    """Multibeam 3D sonar at `X_BS` (4, 4) on the hull."""
    return Sonar(model, HULL_BODY, X_BS), sonar_model(BEAMS.pitch)


def survey(model: mujoco.MjModel, X_BS: Array) -> tuple[Sensor, SensorModel | None]:
    """None: the object's pose is known (--sensor survey)."""
    del X_BS  # no sensor is needed
    return Survey(model), None


def as_published(methods: Set[str], model: mujoco.MjModel, water_error: float) -> dict[str, Any]:
    """Keyword arguments of `WorkController` for methods of [Konoplin 2022]; empty if no method is
    chosen.

    Args:
        methods: Methods, each one of `uuv.methods.PublishedMethod`.
        model: The vehicle's model of itself.
        water_error: [-] Share by which its hydrodynamic coefficients are wrong.

    Returns:
        `force_law` and `compliance`, and `estimator`, as far as they differ from the controller's
        own.
    """
    parts: dict[str, Any] = {}
    for law, replaced in FORCE_PARTS.items():
        if law in methods:
            parts |= replaced
    if "tip-force" in methods:
        parts["estimator"] = ClosedFormForce(model, water_error=water_error)
    return parts


def controller(control: Control, model: mujoco.MjModel, *, water_error: float) -> Controller:
    """The controller of a scenario, made of the vehicle's own model and wrapped in SafetyWrapper.

    Args:
        control: The name, one of CONTROLLERS or MODULE:CLASS, and the methods that other objects
            take the place of (`ablated`, `as_published`), also the load observer for the torque
            sensors. Another inverse kinematics than "hybrid", and a servo for elastic gears, go to
            it in its tuning.
        model: The vehicle's model of itself.
        water_error: Share by which the controller's hydrodynamic coefficients are wrong.

    Raises:
        ConfigurationError: The class does not exist, or its module or constructor raises; the
            message names the place.
    """
    name = control.controller
    without = frozenset(control.without) - NAVIGATION
    parts = ablated(without, model, water_error) | as_published(
        frozenset(control.published), model, water_error
    )
    if control.force_from == "motors":
        parts["estimator"] = MomentumObserver(model, water_error=water_error)

    kind = partial(CONTROLLERS.load, name) if ":" not in name else class_of(name, CONTROLLER)
    if ":" not in name:
        CONTROLLERS.resolve(name)

    tuning = replace(
        ELASTIC_GEARS if control.elastic_gears else ArmTuning(), inverse_kinematics=control.ik
    )
    if tuning != ArmTuning():
        parts["tuning"] = tuning

    composed = _part(partial(kind, model, water_error=water_error, **parts), name, CONTROLLER)
    return SafetyWrapper(composed, model)


def estimator(name: str, model: mujoco.MjModel) -> Estimator:
    """Estimator of a user, made from the vehicle's model of itself.

    Args:
        name: MODULE:CLASS.
        model: The vehicle's model of itself.

    Raises:
        ConfigurationError: The class does not exist, or its module or constructor raises; the
            message names the place.
    """
    return _part(partial(class_of(name, _ESTIMATOR), model), name, _ESTIMATOR)


def _part(make: Callable[[], Any], name: str, option: str) -> Any:
    """Make a component with a period and the methods `init` and `step`."""
    try:
        part = make()
        finite_number(part.period, "period [s]", above=0.0)

        lacking = [
            method for method in ("init", "step") if not callable(getattr(part, method, None))
        ]
        if lacking:
            raise TypeError(
                f"it must have the methods `init` and `step`, it has no {' and no '.join(lacking)}"
            )
    except UuvError as error:
        raise ConfigurationError(f"{option} {shown(name)}: {error}") from error
    except (Exception, SystemExit) as error:
        raise ConfigurationError(
            f"{option} {shown(name)}: cannot be made from a model; {cause_of(error, __file__)}"
        ) from error
    return part
