"""One error tree. A message names the offending thing, what is allowed, and what was given, in one short line."""

import re

LONGEST = 300  # characters of a message
_TAIL = 90  # of them that are kept from its end, where what was given is said
_UNPRINTABLE = re.compile(r"\s*[\x00-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff]+\s*")


def one_line(text: str, most: int = LONGEST) -> str:
    """`text` in one line of at most `most` characters: what is longer loses its middle."""
    line = _UNPRINTABLE.sub(" ", text).strip()
    if len(line) <= most:
        return line
    tail = min(_TAIL, most // 3)
    return f"{line[: most - tail - 5]} ... {line[len(line) - tail :]}"


class UuvError(Exception):
    """Base of every error that this project raises on purpose; scripts turn it into one line and exit code 2."""

    def __init__(self, message: object = "") -> None:
        super().__init__(one_line(str(message)))


class ConfigurationError(UuvError, ValueError):
    """A value given at a door (file, option, argument) is not allowed."""


class HydrodynamicsError(UuvError):
    """The hydrodynamic model cannot be run as asked (solver, step length, MuJoCo's layout)."""


class MissingLibraryError(UuvError, ImportError):
    """A package that only some things need, or a system library of one, is not installed."""


class PerceptionError(UuvError):
    """Measurements do not hold what was asked of them (nothing seen, object not found)."""


class ReachError(UuvError):
    """A pose or path lies outside what the arm can take."""


class PhysicsWarning(UserWarning):
    """The physics runs, but a model looks unlike any real vehicle, or has gone beyond what it was judged for."""
