"""MuJoCo's callbacks of this process that are our native code: built once, installed together.

MuJoCo has one place for each kind of callback. It holds the bare address and tells nobody when
other code takes the place. What is noticed is the end of the ctypes pointer that its Python
binding keeps beside the address.
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
    SYMBOLS: tuple[str, ...]  # functions of libmujoco that it calls

    def build(self) -> Any:
        """Compile the callback: a numba CFunc."""


@dataclass(frozen=True, slots=True, kw_only=True)
class NativeCallback:
    """One callback of ours, and MuJoCo's place for it."""

    name: str  # in messages: the "passive" callback
    source: Any  # `CallbackSource`
    set: Callable[[Any], None]
    get: Callable[[], Any]
    without: str  # what a model does that lacks it


CALLBACKS = (
    NativeCallback(
        name="passive",
        source=passive_callback,
        set=mujoco.set_mjcb_passive,
        get=mujoco.get_mjcb_passive,
        without="models with hydrodynamics move dry, and gears slide without stiction",
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

# By name. MuJoCo holds bare addresses of the built functions, which therefore live as long as the
# process. A pointer's `weakref.finalize` fires when other code takes its place.
_built: dict[str, Any] = {}
_pointers: dict[str, Any] = {}


class _Notice(event.Listener):
    """Compile listener that prints once why the first start is slow."""

    def __init__(self) -> None:
        self._said = False

    def on_start(self, event: event.Event) -> None:
        # numba compiles only what its cache lacks.
        if not self._said:
            text = "compiling the hydrodynamics for this MuJoCo, once: about 10 s"
            print(text, file=sys.stderr, flush=True)
            self._said = True

    def on_end(self, event: event.Event) -> None:
        pass


def install() -> None:
    """Install all callbacks that are not installed yet, or none.

    Raises:
        HydrodynamicsError: Another callback is in one of their places, or MuJoCo's memory layout
            differs from its introspection.
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
    """Remove those callbacks that are ours; no effect on others."""
    for callback in CALLBACKS:
        if _is_ours(callback):
            _pointers[callback.name].detach()
            callback.set(None)


def needed_by(model: mujoco.MjModel) -> bool:
    """Return True if a model has what the callbacks do: water, gear friction, thrusters or soil."""
    return is_wet(model) or has_curves(model) or _has_user_actuators(model)


def _has_user_actuators(model: mujoco.MjModel) -> bool:
    """Return True if an actuator of a model is a thruster, or the state of its soil."""
    rows = np.asarray(model.actuator_user)
    if rows.shape[1] < thrusters.HEADER:
        return False
    stamps = thrusters.STAMP_VALUE, soil_bed.STAMP_VALUE
    return bool(np.isin(rows[:, thrusters.STAMP], stamps).any())


def left_out(model: mujoco.MjModel) -> str:
    """What a model has that does not act, and why: "hydrodynamics but moves dry: ..."."""
    reason = missing()
    missed = "gear friction but its gears have Coulomb friction alone"
    if not has_curves(model):
        missed = "thrusters or soil but they give no force"
    if is_wet(model):
        missed = f"hydrodynamics but {'moves' if reason else 'moved'} dry"
    return f"{missed}: {reason or 'MuJoCo was kept from calling its callback'}"


def is_installed() -> bool:
    """Return True if every callback of ours is in its place."""
    return not missing()


def missing() -> str:
    """Name the first callback of ours that is not in its place and why; empty if all are."""
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
    """Compile callbacks, after a look at the memory that they reach into."""
    sources: list[CallbackSource] = [callback.source for callback in callbacks]
    mujoco_layout.verify(
        [name for source in sources for name in source.MODEL_FIELDS],
        [name for source in sources for name in source.DATA_FIELDS],
    )

    # Compiled code calls MuJoCo's functions by these names.
    native = library()
    for symbol in {symbol for source in sources for symbol in source.SYMBOLS}:
        address = ctypes.cast(getattr(native, symbol), ctypes.c_void_p).value
        llvmlite.binding.add_symbol(symbol, address)

    with event.install_listener("numba:compile", _Notice()):
        for callback in callbacks:
            _built[callback.name] = callback.source.build()


def _warn_replaced(callback: NativeCallback) -> None:
    replaced = f"the {callback.name} callback of uuv.sim.hydrodynamics was replaced or removed"
    # Named is the line that called MuJoCo's `set_mjcb_...`, two frames above.
    warnings.warn(f"{replaced}: {callback.without}", RuntimeWarning, 3)
