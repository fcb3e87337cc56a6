"""Sensors and controllers of a scenario by name; what makes one is imported when it is made."""

import importlib
import traceback
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from uuv.models.registry import Registry
from uuv.sim.interfaces.errors import ConfigurationError, one_line
from uuv.sim.interfaces.protocols import Controller, Sensor
from uuv.sim.interfaces.spatial import shown

if TYPE_CHECKING:
    from uuv.perception.clouds.scan import SensorModel

TRUST = "--trust"  # option of every command that reads a scenario: run the code that it names
CONTROLLER = "control.controller"  # begins the messages about one
_FOREIGN = 100  # characters kept of the message of a foreign error
SURVEY = "survey"  # sensor: the object's pose is known, and nothing looks for it
SENSORS: "Registry[tuple[Sensor, SensorModel | None]]" = Registry(
    "sensor",
    {
        "camera": "uuv.components.contact_parts:camera",
        "sonar": "uuv.components.contact_parts:sonar",
        SURVEY: "uuv.components.contact_parts:survey",
    },
)
CONTROLLERS: Registry[Controller] = Registry(
    "controller", {"work": "uuv.controllers.whole_body.work_controller:WorkController"}
)


def class_of(name: str, option: str) -> Callable[..., Any]:
    """The class named MODULE:CLASS, by an option with which errors begin.

    Raises:
        ConfigurationError: It cannot be imported; the message has the line that raised.
    """
    module, _, word = name.partition(":")
    if not (module and word):
        raise ConfigurationError(f"{option} {shown(name)}: expected MODULE:CLASS")
    try:
        return getattr(importlib.import_module(module), word)
    except (Exception, SystemExit) as error:
        raise ConfigurationError(f"{option} {shown(name)}: cannot be imported; {told(error)}") from error


def told(error: BaseException, *ours: str) -> str:
    """Type and message of a foreign error, and the line that raised it in code outside the files `ours`."""
    if isinstance(error, SyntaxError) and error.filename:
        where = f" ({error.filename}:{error.lineno})"
    else:
        places = [f"{frame.filename}:{frame.lineno}" for frame in traceback.extract_tb(error.__traceback__)]
        foreign = [place for place in places if not place.startswith((__file__, *ours, "<frozen"))]
        where = f" ({foreign[-1]})" if foreign and "importlib" not in foreign[-1] else ""
    return f"{type(error).__name__}: {one_line(str(error), _FOREIGN)}{where}"
