"""YAML text of users' files as plain Python objects, with one clear error where it is none."""

from typing import Any

import yaml

from uuv.sim.interfaces.errors import ConfigurationError


def document_of(text: str, what: str) -> Any:
    """The one document of a YAML text; `what`, which names the file, begins the error message.

    Raises:
        ConfigurationError: the text is no YAML, or nested too deeply.
    """
    try:
        return yaml.safe_load(text)
    except RecursionError as error:
        raise ConfigurationError(f"{what}: no YAML: brackets within brackets, too deep") from error
    except Exception as error:  # its constructors of dates and numbers raise ValueError and others
        raise ConfigurationError(f"{what}: no YAML ({' '.join(str(error).split())[:120]})") from error
