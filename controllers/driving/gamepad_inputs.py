"""A gamepad as an operator's inputs: sticks are velocities, the pad of arrows steps the set force.

Axes and buttons are numbered as Linux numbers those of a pad with two sticks, two triggers and a
cross (drivers xpad, hid-generic with the same layout).
"""

from typing import NamedTuple

from uuv.controllers.driving.live_inputs import LiveInputs
from uuv.controllers.driving.operator_inputs import COLUMNS

FULL = 32_767  # value of an axis at its end
_DEAD = 0.15  # [-] share of an axis around its middle that counts as rest
_STEPS = 20  # number of velocities from rest to the largest; a shaking hand gives few rows
_FORCE_STEP = 10.0  # [N]
_CLUTCH = 0  # button A
_REST = 1  # button B
_DOWN = 4  # left shoulder button
_UP = 5  # right shoulder button
_END = 7  # start button
_LEFT_TRIGGER = 2  # axis
_RIGHT_TRIGGER = 5  # axis
_CROSS_ASIDE = 6  # axis, left and right
_CROSS = 7  # axis, up and down


class _Stick(NamedTuple):
    """An axis that is a velocity."""

    column: str
    sign: float  # of the velocity, at the positive end of the axis: right and towards the hand


_STICKS = {
    0: _Stick("sway", -1.0),
    1: _Stick("surge", -1.0),
    3: _Stick("tool_y", -1.0),
    4: _Stick("tool_x", -1.0),
    _CROSS_ASIDE: _Stick("yaw_rate", -1.0),
}

HELP = (
    "left stick: surge, sway; shoulder buttons: heave; cross left and right: yaw",
    "right stick: tool x, y; right trigger: tool out, left: in",
    "cross up and down: set force by 10 N; A: clutch; B: rest; Start: end",
)


class GamepadInputs(LiveInputs):
    """Inputs by a gamepad, whose axes are read as they move."""

    def __init__(self) -> None:
        super().__init__()
        self._triggers = {_LEFT_TRIGGER: 0.0, _RIGHT_TRIGGER: 0.0}  # shares of their ways
        self._heave = {_DOWN: False, _UP: False}

    def move(self, axis: int, position: int) -> None:
        """Take the position of an axis, -32767 to 32767; other axes do nothing."""
        values = self.values
        share = min(max(position / FULL, -1.0), 1.0)

        if axis in _STICKS:
            column, sign = _STICKS[axis]
            values[column] = sign * _velocity(share) * COLUMNS[column].most
        elif axis in self._triggers:
            self._triggers[axis] = 0.5 * (1.0 + share)
            out = self._triggers[_RIGHT_TRIGGER] - self._triggers[_LEFT_TRIGGER]
            values["tool_z"] = _velocity(out) * COLUMNS["tool_z"].most
        elif axis == _CROSS and abs(share) > 0.5:
            force = values["set_force"] - _FORCE_STEP * (1.0 if share > 0.0 else -1.0)
            values["set_force"] = min(max(force, 0.0), COLUMNS["set_force"].most)
        self.change(values)

    def press(self, button: int, *, down: bool) -> None:
        """Take a button that goes down or up; others do nothing."""
        values = self.values

        if button in self._heave:
            self._heave[button] = down
            way = self._heave[_UP] - self._heave[_DOWN]
            values["heave"] = 0.5 * COLUMNS["heave"].most * way
        elif down and button == _CLUTCH:
            values["clutch"] = 1.0 - values["clutch"]
        elif down and button == _REST:
            self._now = self.at_rest(values["set_force"], values["clutch"])
            return
        elif down and button == _END:
            self.end()
            return
        self.change(values)


def _velocity(share: float) -> float:
    """Share of the largest velocity, in steps, for a share of an axis: zero around its middle."""
    beyond = max(abs(share) - _DEAD, 0.0) / (1.0 - _DEAD)
    step = round(beyond * _STEPS) / _STEPS
    return step if share > 0.0 else -step
