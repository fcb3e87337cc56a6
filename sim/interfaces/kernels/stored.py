"""Connects numba to the store: machine code of kernels is loaded from the store, and kept there."""

import atexit
import json
import pickle
import platform
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from types import FunctionType
from typing import Any

import llvmlite
import numba
import numpy as np
from numba import types
from numba.core import compiler, config
from numba.core.caching import _Cache
from numba.core.ccallback import CFunc
from numba.core.serialize import dumps
from numba.core.sigutils import normalize_signature

from uuv.sim.interfaces.kernels import store
from uuv.sim.interfaces.kernels.stamps import UnkeyableError, stamp

# Settings of numba that change machine code. A name that this version of numba does not have counts
# as None.
_SETTINGS = (
    *(
        "OPT",
        "LOOP_VECTORIZE",
        "SLP_VECTORIZE",
        "BOUNDSCHECK",
        "FULL_TRACEBACKS",
        "DEBUGINFO_DEFAULT",
        "USING_SVML",
    ),
    *(
        "DISABLE_INTEL_SVML",
        "ENABLE_AVX",
        "LLVM_REFPRUNE_PASS",
        "LLVM_REFPRUNE_FLAGS",
        "CAPTURED_ERRORS",
    ),
)


@dataclass(slots=True)
class Counts:
    """Numbers of kernels of this process, by where their machine code came from."""

    loaded: int = 0
    compiled: int = 0
    unkept: int = 0  # of those compiled, the ones that the store could not keep


counts = Counts()


def kernel(function: Any = None, signature: Any = None, **options: Any) -> Any:
    """Decorator like `numba.njit`, with machine code that the store keeps.

    Args:
        function: The function; None where the decorator is called with options.
        signature: The only types to compile for, on the first call. None: compile for the types of
            each call.
        **options: Options of `numba.njit`, such as error_model="numpy".

    Returns:
        The compiled function, or the decorator.
    """
    if function is None:
        return lambda function: kernel(function, signature, **options)
    compiled: Any = numba.njit(**options)(function)

    if isinstance(compiled, FunctionType):  # NUMBA_DISABLE_JIT
        return compiled
    compiled._cache = StoredKernel(function, options)
    if signature is not None:
        _compile_on_first_use(compiled, signature)
    return compiled


def _compile_on_first_use(compiled: Any, signature: Any) -> None:
    """Delay the compilation of `compiled` for one signature until its first call from Python or a
    kernel.

    Numba would compile it at its definition, that is, during an import. Until the first call,
    methods set on the object replace those of its class, one for each kind of first call.
    """

    def make() -> Any:
        del compiled._compile_for_args, compiled.get_call_template
        entry = compiled.compile(signature)
        compiled.disable_compile()
        return entry

    def compile_for_args(*_args: Any, **_kws: Any) -> Any:
        return make()

    def get_call_template(args: Any, kws: Any) -> Any:
        make()
        return compiled.get_call_template(args, kws)

    compiled._compile_for_args = compile_for_args
    compiled.get_call_template = get_call_template


def c_function(signature: Any, **options: Any) -> Callable[[Any], Any]:
    """Decorator like `numba.cfunc`, with machine code that the store keeps.

    Args:
        signature: Types of the C function.
        **options: Options of `numba.cfunc`.

    Returns:
        The decorator.
    """

    def decorate(function: Any) -> Any:
        callback: Any = CFunc(
            function,
            normalize_signature(signature),
            locals={},
            options={"nopython": True, **options},
        )
        callback._cache = StoredKernel(function, {"C": str(signature), **options})
        callback.compile()
        return callback

    return decorate


def is_stored(compiled: Any, signature: Any) -> bool:
    """True if the store has the machine code of a `kernel` for these argument types."""
    if signature in compiled.overloads:
        return True
    cache = getattr(compiled, "_cache", None)
    return isinstance(cache, StoredKernel) and cache.is_stored(signature, compiled.targetctx)


class StoredKernel(_Cache):
    """Cache of one kernel, with the interface that numba expects."""

    def __init__(self, function: FunctionType, options: dict[str, Any]) -> None:
        self._function = function
        self._options = sorted(options.items())
        self._enabled = True
        # set on first use, when everything that the kernel calls is defined
        self._described: str | None = None

    @property
    def cache_path(self) -> Any:
        """The store's folder."""
        folder = store.folder()
        return None if folder is None else str(folder)

    def enable(self) -> None:
        """Enable loading and keeping of machine code."""
        self._enabled = True

    def disable(self) -> None:
        """Disable the store: always compile."""
        self._enabled = False

    def flush(self) -> None:
        """Does nothing, since another stamp is another file."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The kernel for these argument types; None if it must be compiled."""
        target_context.refresh()  # as numba's own cache does: the code finds its symbols
        key = self._stamp(sig, target_context.codegen())
        code = store.load(key) if key is not None else None
        if code is None:
            return None
        try:
            rebuilt = compiler.CompileResult._rebuild(target_context, *pickle.loads(code))
        except Exception:  # any exception that a pickle from another state of the code may raise
            return None

        counts.loaded += 1
        return rebuilt

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a kernel that has just been compiled."""
        counts.compiled += 1
        key = self._stamp(sig, data.codegen)
        if key is None or not _can_be_kept(data) or not store.save(key, dumps(data._reduce())):
            counts.unkept += 1
        else:
            _trim_at_exit()

    def is_stored(self, sig: Any, target_context: Any) -> bool:
        """True if the store has the machine code for this signature."""
        key = self._stamp(sig, target_context.codegen())
        return key is not None and store.holds(key)

    def _stamp(self, sig: Any, codegen: Any) -> str | None:
        """Stamp of all that the machine code depends on; None if that is unknown, or if there is no
        store.
        """
        if not self._enabled or store.folder() is None:
            return None
        try:
            if self._described is None:
                self._described = stamp(self._function, self._options)
            name = f"{self._function.__module__}:{self._function.__qualname__}"
            return json.dumps(
                [name, self._described, type_text(sig), codegen.magic_tuple(), toolchain()]
            )
        except UnkeyableError:
            return None


@cache
def type_text(kind: Any) -> str:
    """Argument types as a text that identifies them, the same in every process.

    Machine code depends on the module of a named tuple, and on the names and order of its fields.
    Numba's own text has none of these, so they are appended.

    Raises:
        UnkeyableError: The type exists in one process only, such as the type of a function as an
            argument.
    """
    # a signature; its return type follows from the code
    if hasattr(kind, "args") and hasattr(kind, "return_type"):
        kind = tuple(kind.args)
    if isinstance(kind, tuple):
        return f"({', '.join(map(type_text, kind))})"
    text = str(kind)
    if " at 0x" in text:
        raise UnkeyableError(text)
    return " ".join([text, *dict.fromkeys(_named_tuples(kind))])


def _named_tuples(kind: Any) -> Iterator[str]:
    """Classes of the named tuples within a type, with their fields."""
    if isinstance(kind, (tuple, list)):
        for part in kind:
            yield from _named_tuples(part)
    elif isinstance(kind, types.Type):
        named = getattr(kind, "instance_class", None)
        if named is not None:
            yield f"{named.__module__}.{named.__qualname__}{named._fields}"
        for part in vars(kind).values():
            if part is not kind:
                yield from _named_tuples(part)


@cache
def toolchain() -> list[Any]:
    """Versions and settings that machine code depends on, except those of the processor."""
    versions = [numba.__version__, llvmlite.__version__, np.__version__]
    python = [platform.python_implementation(), *platform.python_version_tuple()[:2]]
    return [python, versions, [f"{name}={getattr(config, name, None)}" for name in _SETTINGS]]


def _can_be_kept(compiled: Any) -> bool:
    """True unless the machine code holds addresses of this process."""
    return not compiled.library.has_dynamic_globals and not any(
        not lifted.can_cache for lifted in compiled.lifted
    )


@cache
def _trim_at_exit() -> None:
    atexit.register(store.trim)
