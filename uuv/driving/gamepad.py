"""A joystick device of Linux, whose records are an operator's inputs: `/dev/input/js0`.

A record has 8 bytes, little-endian: time [ms] (uint32), value (int16), kind (uint8: 1 button, 2
axis, with 128 the state when the device was opened), number (uint8) [linux/joystick.h].
"""

import os
import select
import stat
import struct
import threading
from types import TracebackType
from typing import Self

from uuv.controllers.driving.gamepad_inputs import GamepadInputs
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import shown

_RECORD = struct.Struct("<IhBB")
_BUTTON = 1  # kind of a record
_AXIS = 2  # kind of a record
_MOST = 64  # records that are read at a time
_PATIENCE = 0.2  # [s] after which the end of the run is looked for


def refuse_without_gamepad(device: str) -> None:
    """Refuse a device that cannot be read.

    Raises:
        ConfigurationError: It is not there, may not be read, or is a file or folder.
    """
    os.close(_opened(device))


def _opened(device: str) -> int:
    """Descriptor of a joystick device, or of a pipe that stands for one."""
    try:
        kind = os.stat(device).st_mode
        if stat.S_ISCHR(kind) or stat.S_ISFIFO(kind):
            return os.open(device, os.O_RDONLY | os.O_NONBLOCK)
        reason = "it is none"

    except OSError as error:
        reason = error.strerror or str(error)
    raise ConfigurationError(
        f"gamepad: must be a joystick device such as /dev/input/js0, got {shown(device)} ({reason})"
    )


class Gamepad:
    """Reader of a device, in a thread of its own; a device that is unplugged ends the inputs."""

    def __init__(self, device: str, inputs: GamepadInputs) -> None:
        """Open a device.

        Raises:
            ConfigurationError: It is not there, may not be read, or is a file or folder.
        """
        self._inputs = inputs

        # Read without waiting: the device is asked first whether there is something.
        self._file = _opened(device)
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._listen, name="gamepad", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._closing.set()
        self._thread.join()
        os.close(self._file)

    def _listen(self) -> None:
        """Take records until the device or the run ends."""
        left = b""
        while not self._closing.is_set():
            if not select.select([self._file], [], [], _PATIENCE)[0]:
                continue

            try:
                content = os.read(self._file, _MOST * _RECORD.size)
            except OSError:  # unplugged
                content = b""
            if not content:
                self._inputs.end()
                return

            # A pipe may hand over a part of a record.
            left += content
            whole = len(left) // _RECORD.size * _RECORD.size
            take(left[:whole], self._inputs)
            left = left[whole:]


def take(records: bytes, inputs: GamepadInputs) -> None:
    """Hand whole records to the inputs; those of other kinds do nothing.

    The state when the device was opened does not count: Linux then says 0, the middle, of a trigger
    that is at rest, and a stick that leans on something must not move the vehicle.
    """
    for _, position, kind, number in _RECORD.iter_unpack(records):
        if kind == _AXIS:
            inputs.move(number, position)
        elif kind == _BUTTON:
            inputs.press(number, down=bool(position))
