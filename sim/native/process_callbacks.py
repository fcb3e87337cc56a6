"""MuJoCo's callbacks in this process that are native code of this project, built once and installed
together.

MuJoCo has one place for each kind of callback. It holds the bare address, and gives no notice when
other code replaces it. The replacement is detected by the deletion of the ctypes pointer that
MuJoCo's Python binding keeps along with the address.
"""

import ctypes
import sys
import warnings
import weakref
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import llvmlite.binding
import mujoco
import numpy as np
from numba.core import event

from uuv.models.arms.gear_friction import has_curves
from uuv.models.hydrodynamics import is_wet
from uuv.models.site import soil_bed
from uuv.models.water import thrusters
from uuv.models.water.mujoco_library import library
from uuv.sim.interfaces.errors import HydrodynamicsError
from uuv.sim.native import actuator_dynamics, mujoco_layout, passive_callback, thruster_force


class CallbackSource(Protocol):
    """A module with the code of a callback."""

    # Fields that the callback reads or writes; their layout is verified before it is built.
    MODEL_FIELDS: tuple[str, ...]
    DATA_FIELDS: tuple[str, ...]
    SYMBOLS: tuple[str, ...]  # functions of libmujoco that the callback calls

    def build(self) -> Any:
        """Compile the callback: a numba CFunc."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NativeCallback:
    """One native callback, and MuJoCo's place for it."""

    name: str  # name in messages: the "passive" callback
    source: Any  # `CallbackSource`
    set: Callable[[Any], None]
    get: Callable[[], Any]
    without: str  # what happens to a model without this callback


CALLBACKS = (
    NativeCallback(
        name="passive",
        source=passive_callback,
        set=mujoco.set_mjcb_passive,
        get=mujoco.get_mjcb_passive,
        without="models with hydrodynamics move without water, and gears slide without stiction",
    ),
    NativeCallback(
        name="actuator dynamics",
        source=actuator_dynamics,
        set=mujoco.set_mjcb_act_dyn,
        get=mujoco.get_mjcb_act_dyn,
        without="propellers of thrusters do not turn",
    ),
    NativeCallback(
        name="actuator bias",
        source=thruster_force,
        set=mujoco.set_mjcb_act_bias,
        get=mujoco.get_mjcb_act_bias,
        without="thrusters give no thrust",
    ),
)

ONE = "MuJoCo has room for one"

# By name. MuJoCo holds bare addresses of the built functions, which therefore must exist as long as
# the process. The `weakref.finalize` of a pointer runs when other code replaces the callback.
_built: dict[str, Any] = {}
_pointers: dict[str, Any] = {}


class _Notice(event.Listener):
    """Compile listener that prints the reason of the slow first start once."""

    def __init__(self) -> None:
        self._said = False

    def on_start(self, event: event.Event) -> None:
        # numba compiles only the functions that its cache lacks.
        if not self._said:
            text = "compiling the hydrodynamics for this MuJoCo, once: about 10 s"
            print(text, file=sys.stderr, flush=True)
            self._said = True

    def on_end(self, event: event.Event) -> None:
        pass


def install() -> None:
    """Install all callbacks that are not installed yet, or none.

    Raises:
        HydrodynamicsError: Other code has installed one of these callbacks, or MuJoCo's memory
            layout differs from its introspection data.
    """
    missing = [callback for callback in CALLBACKS if not _is_ours(callback)]
    if foreign := [callback.name for callback in missing if callback.get() is not None]:
        raise HydrodynamicsError(f"another {foreign[0]} callback is installed; {ONE}")

    if unbuilt := [callback for callback in missing if callback.name not in _built]:
        _build(unbuilt)

    for callback in missing:
        function = _built[callback.name]
        pointer = type(function.ctypes)(function.address)
        callback.set(pointer)
        (pointer._objects or {}).clear()  # MuJoCo's binding leaves a reference cycle there
        _pointers[callback.name] = weakref.finalize(pointer, _warn_replaced, callback)
        _pointers[callback.name].atexit = False


def uninstall() -> None:
    """Remove the callbacks that are installed by this module; callbacks of other code stay."""
    for callback in CALLBACKS:
        if _is_ours(callback):
            _pointers[callback.name].detach()
            callback.set(None)


def needed_by(model: mujoco.MjModel) -> bool:
    """Return True if a model has water, gear friction, thrusters or soil, which need the
    callbacks.
    """
    return is_wet(model) or has_curves(model) or _has_user_actuators(model)


def _has_user_actuators(model: mujoco.MjModel) -> bool:
    """Return True if a model has thruster actuators, or actuators that hold the state of its
    soil.
    """
    rows = np.asarray(model.actuator_user)
    if rows.shape[1] < thrusters.HEADER:
        return False
    stamps = thrusters.STAMP_VALUE, soil_bed.STAMP_VALUE
    return bool(np.isin(rows[:, thrusters.STAMP], stamps).any())


def left_out(model: mujoco.MjModel) -> str:
    """Forces of a model that do not act, and the reason: "hydrodynamics but moves dry: ..."."""
    reason = missing()
    missed = "gear friction but its gears have Coulomb friction alone"
    if not has_curves(model):
        missed = "thrusters or soil but they give no force"
    if is_wet(model):
        missed = f"hydrodynamics but {'moves' if reason else 'moved'} dry"
    return f"{missed}: {reason or 'MuJoCo did not call its callback, by a flag or a disabled step'}"


def is_installed() -> bool:
    """Return True if every callback of this module is installed."""
    return not missing()


def missing() -> str:
    """Name of the first callback of this module that is not installed, and the reason; empty if all
    are.
    """
    for callback in CALLBACKS:
        if callback.get() is None:
            return "call uuv.sim.hydrodynamics.install()"
        if not _is_ours(callback):
            return f"another {callback.name} callback is installed; {ONE}"
    return ""


def _is_ours(callback: NativeCallback) -> bool:
    finalizer = _pointers.get(callback.name)
    pointer = finalizer.peek() if finalizer is not None else None
    return pointer is not None and callback.get() is pointer[0]


def _build(callbacks: list[NativeCallback]) -> None:
    """Compile callbacks, after checking the memory layout that they depend on."""
    sources: list[CallbackSource] = [callback.source for callback in callbacks]
    mujoco_layout.verify(
        [name for source in sources for name in source.MODEL_FIELDS],
        [name for source in sources for name in source.DATA_FIELDS],
    )

    # Compiled code calls these functions of MuJoCo by their names.
    native = library()
    for symbol in {symbol for source in sources for symbol in source.SYMBOLS}:
        address = ctypes.cast(getattr(native, symbol), ctypes.c_void_p).value
        llvmlite.binding.add_symbol(symbol, address)

    with event.install_listener("numba:compile", _Notice()):
        for callback in callbacks:
            _built[callback.name] = callback.source.build()


def _warn_replaced(callback: NativeCallback) -> None:
    replaced = f"the {callback.name} callback of uuv.sim.hydrodynamics was replaced or removed"
    # The warning names the line that called MuJoCo's `set_mjcb_...`, two frames above.
    warnings.warn(f"{replaced}: {callback.without}", RuntimeWarning, 3)
