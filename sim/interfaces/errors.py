"""Exceptions of the project; a message names the item, the allowed values and the given one, in one
line.
"""

import re
from collections.abc import Iterable
from difflib import get_close_matches

LONGEST = 300  # [characters] longest message
# [characters] kept from the end of a message that is too long, since the given value is named there
_TAIL = 90
# colour codes in other packages' messages, where colorama is installed
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
# Control characters, line separators, marks that reverse the direction of text, and halves of
# surrogate pairs.
_CONTROL = r"\x00-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069\ud800-\udfff"
_UNPRINTABLE = re.compile(rf"\s*[{_CONTROL}]+\s*")
_COMMANDING = re.compile(rf"(?![\n\t])[{_CONTROL}]")


def plain(text: str) -> str:
    """`text` without the colours of a terminal."""
    return _COLOUR.sub("", text)


def one_line(text: str, most: int = LONGEST) -> str:
    """`text` on one line of at most `most` characters; the middle of a longer text is cut out."""
    line = _UNPRINTABLE.sub(" ", plain(text)).strip()
    if len(line) <= most:
        return line
    tail = min(_TAIL, most // 3)
    return f"{line[: most - tail - 5]} ... {line[len(line) - tail :]}"


def harmless(text: str) -> str:
    """`text` with a replacement character for every character that `commands_a_terminal`
    matches.
    """
    return _COMMANDING.sub("\ufffd", text)


def commands_a_terminal(text: str) -> bool:
    """Whether `text` has a control character that a terminal does not display, other than a new
    line or a tab.
    """
    return _COMMANDING.search(text) is not None


def did_you_mean(given: object, known: Iterable[str]) -> str:
    """Question at the end of a message that offers the most similar of the `known` words; empty if
    none is similar.
    """
    near = get_close_matches(given, list(known), 1) if isinstance(given, str) else []
    return f" (did you mean {near[0]}?)" if near else ""


class UuvError(Exception):
    """Base of all errors of the project. Scripts print it in one line and exit with code 2."""

    def __init__(self, message: object = "") -> None:
        super().__init__(one_line(str(message)))


class ConfigurationError(UuvError, ValueError):
    """A value from outside (file, option, argument) is not allowed."""


class HydrodynamicsError(UuvError):
    """The hydrodynamic model cannot run under these settings (solver, step length, MuJoCo's
    layout).
    """


class MissingLibraryError(UuvError, ImportError):
    """An optional package, or a system library that it needs, is not installed."""


class PerceptionError(UuvError):
    """The measurements do not contain the object or feature that was sought."""


class ReachError(UuvError):
    """A pose or path lies outside the arm's reach."""


class StrongCurrentError(ReachError):
    """A path is within reach, but there is no hull pose for it that the thrusters can hold in the
    current.
    """


class OverloadError(ConfigurationError):
    """A set force or moment is more than the vehicle can give in any posture."""

    def __init__(self, message: object = "", *, setting: str = "", most: float = 0.0) -> None:
        """Keep the setting's name, and the largest value [N] or [N m] that is allowed."""
        # Keywords have defaults: an exception from another process is made of its message first.
        super().__init__(message)
        self.setting = setting
        self.most = most


class OverloadHereError(ReachError):
    """A set force or moment is more than joints or thrusters can give in the best posture there."""

    def __init__(self, message: object = "", *, setting: str = "", most: float = 0.0) -> None:
        """Keep the setting's name, and the largest value [N] or [N m] that they can give."""
        # As above.
        super().__init__(message)

        self.setting = setting
        self.most = most


class PhysicsWarning(UserWarning):
    """The simulation runs, but the model looks implausible or has left the range that it is valid
    in.
    """
