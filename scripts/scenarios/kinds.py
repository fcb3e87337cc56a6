"""Sensors and controllers of a scenario by name; what makes one is imported when it is made."""

from typing import TYPE_CHECKING

from models.registry import Registry
from sim.interfaces.protocols import Controller, Sensor

if TYPE_CHECKING:
    from perception.clouds.scan import SensorModel

SURVEY = "survey"  # sensor: the object's pose is known, and nothing looks for it
SENSORS: "Registry[tuple[Sensor, SensorModel | None]]" = Registry(
    "sensor",
    {
        "camera": "scenarios.contact_parts:camera",
        "sonar": "scenarios.contact_parts:sonar",
        SURVEY: "scenarios.contact_parts:survey",
    },
)
CONTROLLERS: Registry[Controller] = Registry("controller", {"work": "controllers.work_controller:WorkController"})
