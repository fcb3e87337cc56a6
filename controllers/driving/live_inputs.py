"""Inputs that an operator gives during the run; they are recorded with the times at which the run
takes them.
"""

import math

from uuv.controllers.driving.operator_inputs import COLUMNS, LONGEST, OperatorInputs

_AFTER = 1e-9  # [s] far shorter than any period


class LiveInputs(OperatorInputs):
    """Present values of the inputs, with the clutch closed at first. After `LONGEST` they end.

    They come from another thread, which only replaces one tuple.
    """

    def __init__(self) -> None:
        super().__init__(ended=False)

        self._now = self.at_rest(0.0, 1.0)
        self._over = False
        self._polled = 0.0  # [s] last time at which inputs were taken

    @staticmethod
    def at_rest(set_force: float, clutch: float) -> tuple[float, ...]:
        """Values of all columns but the time, with all velocities zero."""
        values = dict.fromkeys(COLUMNS, 0.0) | {"set_force": set_force, "clutch": clutch}
        del values["time"]
        return tuple(values.values())

    @property
    def values(self) -> dict[str, float]:
        """Present values by column, without the time."""
        return dict(zip([*COLUMNS][1:], self._now, strict=True))

    def change(self, values: dict[str, float]) -> None:
        """Replace the present values, of all columns but the time."""
        self._now = tuple(values.values())

    def end(self) -> None:
        """End the inputs: none are taken any more."""
        self._over = True

    def poll(self, time: float) -> None:
        """Record changes since the last row, with the time `time` [s]."""
        if self.ended or not math.isfinite(time) or (self.rows and time <= self.rows[-1][0]):
            return

        # The end, or a change.
        self._polled = time
        if self.rows and (self._over or time >= LONGEST):
            self.add((min(time, LONGEST), *self._now))
            self.ended = True
        elif not self.rows or self.rows[-1][1:] != self._now:
            self.add((time, *self._now))

    def kept(self) -> list[tuple[float, ...]]:
        """Rows of a file that repeats the inputs; up to the last poll if the inputs have not
        ended.
        """
        if self.ended:
            return self.rows

        rows = self.rows or [(0.0, *self._now)]
        return [*rows, (max(self._polled, rows[-1][0]) + _AFTER, *rows[-1][1:])]
