"""Snapshot of a value with everything that it refers to: one copy in, any number of copies out.

`copy.deepcopy` gives every array memory of its own. The states of sensors, navigation and
controller hold arrays and views of these arrays: a kernel changes an array, and Python reads its
view. In a copy from a snapshot, arrays that share memory in the original share it too.
"""

import io
import pickle
from types import BuiltinFunctionType, FunctionType, MappingProxyType, ModuleType
from typing import Any

import mujoco
import numpy as np
from numba.core.dispatcher import Dispatcher

from uuv.models.meshes.ray_casting import RayScene
from uuv.sim.interfaces.errors import ConfigurationError, one_line

# These are not copied: code, and objects that are only read. Data of MuJoCo are copied by their
# owner.
_SHARED = (
    *(type, FunctionType, BuiltinFunctionType, ModuleType, Dispatcher),
    *(mujoco.MjModel, mujoco.MjData, RayScene),
)


class Snapshot:
    """Copy of a value in memory, independent of later changes of the value."""

    def __init__(self, value: Any, name: str) -> None:
        """Copy `value`.

        Args:
            value: Numbers, arrays, random generators, dataclasses, containers, plain objects.
                Functions, classes, ray casters, models and data of MuJoCo are not copied.
            name: Name of the value, which begins the error message.

        Raises:
            ConfigurationError: The value holds an object that cannot be copied, such as a lock or a
                connection.
        """
        file = io.BytesIO()
        self._shared: list[Any] = []
        try:
            _Pickler(file, self._shared).dump(value)
        except (pickle.PicklingError, TypeError, AttributeError) as error:
            raise ConfigurationError(f"{name} cannot be copied: {one_line(str(error))}") from error

        self._bytes = file.getvalue()

    def copy(self) -> Any:
        """A new copy, which belongs to the caller."""
        return _Unpickler(io.BytesIO(self._bytes), self._shared).load()


class _Pickler(pickle.Pickler):
    def __init__(self, file: io.BytesIO, shared: list[Any]) -> None:
        super().__init__(file, protocol=pickle.HIGHEST_PROTOCOL)
        self._shared = shared
        self._place: dict[int, int] = {}  # index in `shared`, by identity

    def persistent_id(self, obj: Any) -> int | None:
        if not isinstance(obj, _SHARED):
            return None

        if id(obj) not in self._place:
            self._place[id(obj)] = len(self._shared)
            self._shared.append(obj)
        return self._place[id(obj)]

    def reducer_override(self, obj: Any) -> Any:
        if type(obj) is MappingProxyType:
            return MappingProxyType, (dict(obj),)
        if isinstance(obj, np.void) and isinstance(obj.base, np.ndarray):
            raise TypeError("it holds a record that is part of an array; hold the array instead")
        if type(obj) is not np.ndarray or obj.dtype.hasobject:
            return NotImplemented

        owner = _owner(obj)
        if owner is obj:
            return NotImplemented
        offset = _address(obj) - _address(owner)
        return _view, (owner, offset, obj.shape, obj.strides, obj.dtype, obj.flags.writeable)


class _Unpickler(pickle.Unpickler):
    def __init__(self, file: io.BytesIO, shared: list[Any]) -> None:
        super().__init__(file)
        self._shared = shared

    def persistent_load(self, pid: int) -> Any:
        return self._shared[pid]


def _owner(array: np.ndarray) -> np.ndarray:
    """The array that `array` is a view of; `array` itself if it has its own memory, or memory of no
    array.
    """
    while isinstance(array.base, np.ndarray):
        array = array.base
    return array


def _address(array: np.ndarray) -> int:
    return array.__array_interface__["data"][0]


def _view(
    owner: np.ndarray,
    offset: int,
    shape: tuple[int, ...],
    strides: tuple[int, ...],
    dtype: np.dtype,
    writeable: bool,
) -> np.ndarray:
    """View that begins `offset` bytes after the start of `owner`."""
    memory_order = np.argsort([-stride for stride in owner.strides], kind="stable")
    view = np.ndarray(shape, dtype, owner.transpose(memory_order), offset, strides)
    view.flags.writeable = writeable
    return view
