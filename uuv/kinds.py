"""Sensors and controllers of a scenario by name; the code of each is imported when it is made."""

import importlib.util
import traceback
from collections.abc import Callable
from importlib.machinery import ModuleSpec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uuv.models.registry import MadeForm, Registry
from uuv.sim.interfaces.errors import ConfigurationError, one_line
from uuv.sim.interfaces.protocols import Controller, Sensor
from uuv.sim.interfaces.spatial import shown
from uuv.sim.runs.command_line import ROOMS

if TYPE_CHECKING:
    from uuv.perception.clouds.scan import SensorModel

# option of every command that reads a scenario, which allows the code that the scenario names
TRUST = "--trust"
CONTROLLER = "control.controller"  # begins the messages about a sensor or controller
_HOME = Path(__file__).resolve().parent
_SCENARIOS = "scenarios"
# packages that were separate before they became parts of `uuv`
_EARLIER = (_SCENARIOS, *ROOMS)
_FOREIGN = 100  # number of characters kept of the message of a foreign error
SURVEY = "survey"  # sensor: the object's pose is known, and no sensor is needed
SENSORS: "Registry[tuple[Sensor, SensorModel | None]]" = Registry(
    "sensor",
    {
        "camera": "uuv.components.contact_parts:camera",
        "sonar": "uuv.components.contact_parts:sonar",
        SURVEY: "uuv.components.contact_parts:survey",
    },
    form=MadeForm(
        "a sensor and its uuv.perception.SensorModel or None",
        lambda pair: isinstance(pair, tuple) and len(pair) == 2,
    ),
)
CONTROLLERS: Registry[Controller] = Registry(
    "controller", {"work": "uuv.controllers.whole_body.work_controller:WorkController"}
)


def class_of(name: str, option: str) -> Callable[..., Any]:
    """The class MODULE:CLASS; error messages begin with `option`.

    Raises:
        ConfigurationError: The class cannot be imported; the message contains the line that raised
            the error.
    """
    module, _, word = name.partition(":")
    if not (module and word):
        raise ConfigurationError(f"{option} {shown(name)}: expected MODULE:CLASS")

    try:
        return getattr(importlib.import_module(module), word)
    except (Exception, SystemExit) as error:
        raise ConfigurationError(
            f"{option} {shown(name)}: cannot be imported; {cause_of(error)}"
        ) from error


def where_moved(name: str) -> str:
    """Sentence about the present name of the module in MODULE:ATTRIBUTE, if it was once outside
    `uuv`; otherwise "".

    A user's own module may have the name of one of those packages, and is then not reported.
    """
    first, _, rest = name.partition(":")[0].partition(".")
    if first not in _EARLIER:
        return ""

    spec = importlib.util.find_spec(first)
    if spec is not None and not any(
        Path(path).is_relative_to(_HOME.parent) for path in _places(spec)
    ):
        return ""

    module = ".".join(filter(None, ("" if first == _SCENARIOS else first, rest)))
    file = _HOME.joinpath(*module.split("."))
    if file.with_suffix(".py").is_file() or (file / "__init__.py").is_file():
        return f"that module is now uuv.{module}".rstrip(".")
    return f"{first} is now part of uuv, which has no module {module}"


def _places(spec: ModuleSpec) -> list[str]:
    """Files and folders of a module."""
    return [*filter(None, (spec.origin,)), *(spec.submodule_search_locations or ())]


def cause_of(error: BaseException, *ours: str) -> str:
    """Type and message of a foreign error, and the line that raised it outside the files `ours`."""
    if isinstance(error, SyntaxError) and error.filename:
        where = f" ({error.filename}:{error.lineno})"
    else:
        places = [
            f"{frame.filename}:{frame.lineno}"
            for frame in traceback.extract_tb(error.__traceback__)
        ]
        foreign = [line for line in places if not line.startswith((__file__, *ours, "<frozen"))]
        where = f" ({foreign[-1]})" if foreign and "importlib" not in foreign[-1] else ""

    return f"{type(error).__name__}: {one_line(str(error), _FOREIGN)}{where}"
