"""Keys as an operator's inputs: a press changes a velocity by a step, and it stays."""

import math

from uuv.controllers.driving.operator_inputs import COLUMNS, OperatorInputs

STEPS = 5  # presses from rest to the largest velocity
_FORCE_STEP = 10.0  # [N]
# Column and sign of the step, by GLFW's code of the key; letters are their capitals' codes.
_CODES = {
    "right": 262,
    "left": 263,
    "down": 264,
    "up": 265,
    "page up": 266,
    "page down": 267,
    "space": 32,
    "enter": 257,
    "end": 269,
}
_KEYS = {
    # hull
    ord("I"): ("surge", 1.0),
    ord("K"): ("surge", -1.0),
    ord("J"): ("sway", 1.0),
    ord("L"): ("sway", -1.0),
    ord("Y"): ("heave", 1.0),
    ord("H"): ("heave", -1.0),
    ord("U"): ("yaw_rate", 1.0),
    ord("O"): ("yaw_rate", -1.0),
    # tool
    _CODES["up"]: ("tool_x", 1.0),
    _CODES["down"]: ("tool_x", -1.0),
    _CODES["left"]: ("tool_y", 1.0),
    _CODES["right"]: ("tool_y", -1.0),
    _CODES["page down"]: ("tool_z", 1.0),
    _CODES["page up"]: ("tool_z", -1.0),
}
HELP = (
    "hull: I K surge, J L sway, Y H heave, U O yaw; tool: arrows across, Page Down out, Page Up in",
    "0 to 9: set force of 0 to 90 N; Space: rest; Enter: clutch; End: end",
)


class KeyInputs(OperatorInputs):
    """Inputs by key presses, with the clutch closed at first; their times are noted as they come.

    Presses come from another thread: each replaces one tuple.
    """

    def __init__(self) -> None:
        super().__init__(ended=False)
        self._now = self._at_rest(0.0, 1.0)
        self._over = False

    @staticmethod
    def _at_rest(set_force: float, clutch: float) -> tuple[float, ...]:
        """Values of all columns but the time."""
        values = dict.fromkeys(COLUMNS, 0.0) | {"set_force": set_force, "clutch": clutch}
        del values["time"]
        return tuple(values.values())

    def press(self, key: int) -> None:
        """Take a key by its code; others do nothing."""
        values = dict(zip([*COLUMNS][1:], self._now, strict=True))

        # A step of one velocity, within its bounds
        if key in _KEYS:
            name, sign = _KEYS[key]
            most = COLUMNS[name].most
            step = round(values[name] * STEPS / most + sign)
            values[name] = most * min(max(step, -STEPS), STEPS) / STEPS

        # Force, rest, clutch, end
        elif ord("0") <= key <= ord("9"):
            values["set_force"] = _FORCE_STEP * (key - ord("0"))
        elif key == _CODES["space"]:
            self._now = self._at_rest(values["set_force"], values["clutch"])
            return
        elif key == _CODES["enter"]:
            values["clutch"] = 1.0 - values["clutch"]
        elif key == _CODES["end"]:
            self._over = True
            return
        self._now = tuple(values.values())

    def end(self) -> None:
        """No more keys come."""
        self._over = True

    def poll(self, time: float) -> None:
        """Note what has changed since the last row, at `time` [s]."""
        if self.ended or (self.rows and time <= self.rows[-1][0]):
            return
        if self._over and math.isfinite(time):
            self.add((time, *self._now))
            self.ended = True
        elif not self.rows or self.rows[-1][1:] != self._now:
            self.add((time, *self._now))
