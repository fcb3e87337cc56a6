"""Keys as an operator's inputs: each press changes a velocity by a step, and the velocity is
kept.
"""

from collections.abc import Sequence
from typing import NamedTuple

from uuv.controllers.driving.live_inputs import LiveInputs
from uuv.controllers.driving.operator_inputs import COLUMNS

STEPS = 5  # number of presses from rest to the largest velocity
_FORCE_STEP = 10.0  # [N]


class _Key(NamedTuple):
    """A key; the code of a letter is that of the capital."""

    name: str
    code: int  # of GLFW


class _Axis(NamedTuple):
    """A column whose value two keys change by a step."""

    column: str
    help: str
    more: _Key
    less: _Key


def _letter(name: str) -> _Key:
    return _Key(name, ord(name))


_HULL = (
    _Axis("surge", "surge", _letter("I"), _letter("K")),
    _Axis("sway", "sway", _letter("J"), _letter("L")),
    _Axis("heave", "heave", _letter("Y"), _letter("H")),
    _Axis("yaw_rate", "yaw", _letter("U"), _letter("O")),
)
_TOOL = (
    _Axis("tool_x", "x", _Key("Up", 265), _Key("Down", 264)),
    _Axis("tool_y", "y", _Key("Left", 263), _Key("Right", 262)),
    _Axis("tool_z", "out and in", _Key("Page Down", 267), _Key("Page Up", 266)),
)
_SPACE = _Key("Space", 32)
_ENTER = _Key("Enter", 257)
_END = _Key("End", 269)
_STEPPED = {
    key.code: (axis.column, sign)
    for axis in (*_HULL, *_TOOL)
    for key, sign in ((axis.more, 1.0), (axis.less, -1.0))
}


def _help(axes: Sequence[_Axis]) -> str:
    return ", ".join(f"{axis.more.name} {axis.less.name} {axis.help}" for axis in axes)


HELP = (
    f"hull: {_help(_HULL)}",
    f"tool: {_help(_TOOL)}",
    f"0 to 9: set force of 0 to {9.0 * _FORCE_STEP:.0f} N; {_SPACE.name}: rest; "
    f"{_ENTER.name}: clutch; {_END.name}: end",
)


class KeyInputs(LiveInputs):
    """Inputs by key presses, with the clutch closed at first. The times of presses are recorded as
    they arrive.
    """

    def press(self, key: int) -> None:
        """Take a key by its code; others do nothing."""
        values = self.values

        # Change one velocity by a step, within its bounds
        if key in _STEPPED:
            name, sign = _STEPPED[key]
            most = COLUMNS[name].most
            step = round(values[name] * STEPS / most + sign)
            values[name] = most * min(max(step, -STEPS), STEPS) / STEPS

        # Force, rest, clutch, end
        elif ord("0") <= key <= ord("9"):
            values["set_force"] = _FORCE_STEP * (key - ord("0"))
        elif key == _SPACE.code:
            self._now = self.at_rest(values["set_force"], values["clutch"])
            return
        elif key == _ENTER.code:
            values["clutch"] = 1.0 - values["clutch"]
        elif key == _END.code:
            self.end()
            return
        self.change(values)
