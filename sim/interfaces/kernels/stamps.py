"""Hash of everything that the machine code of a kernel depends on: its byte code, and the values
and functions that this uses.

Numba translates byte code, so comments, docstrings and line numbers do not count. The hash follows
the globals that a kernel names, its closure and its defaults, through every compiled function that
it calls. An edit therefore changes the stamps of the edited kernel and of its callers only.
"""

import hashlib
import inspect
import sys
from collections.abc import Iterator
from enum import Enum
from functools import cache
from pathlib import Path
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

# values whose repr identifies them completely
_NAMED = (type(None), bool, int, float, complex, str, bytes, type(Ellipsis))

_TOOLS = ("numba", "numpy", "llvmlite")  # packages whose versions are part of every stamp


class UnkeyableError(Exception):
    """A kernel uses a value that cannot be hashed; its machine code cannot be kept."""


def stamp(function: FunctionType, options: object = ()) -> str:
    """Hash (64 hexadecimal digits) of all that the machine code depends on, except its argument
    types.

    Args:
        function: The Python function of a kernel.
        options: Options of its compilation, such as {"fastmath": True}.

    Raises:
        UnkeyableError: The kernel uses a value that cannot be described.
    """
    digest = hashlib.sha256(repr(options).encode())
    numbers = {id(function): 0}
    waiting = [function]

    # Each function reached is hashed once, and refers to the functions it uses by their place in
    # the order of discovery. The stamp of functions that call each other therefore does not depend
    # on the first one.
    while waiting:
        part, used = _described(waiting.pop())
        digest.update(part)
        for callee in used:
            if id(callee) not in numbers:
                numbers[id(callee)] = len(numbers)
                waiting.append(callee)
            digest.update(b"%d;" % numbers[id(callee)])
    return digest.hexdigest()


_memo: dict[int, tuple[FunctionType, bytes, list[FunctionType]]] = {}


def _described(function: FunctionType) -> tuple[bytes, list[FunctionType]]:
    """Description of a function without the functions that it uses, and a list of these."""
    known = _memo.get(id(function))
    if known is None:
        used: list[FunctionType] = []
        text = "\n".join(_function(function, used)).encode()
        # keeps the function alive, so that its id is not reused
        known = _memo[id(function)] = (function, text, used)

    return known[1], known[2]


def _function(function: FunctionType, used: list[FunctionType]) -> Iterator[str]:
    yield from _code(function.__code__, function.__doc__)
    yield _value((function.__defaults__, function.__kwdefaults__), used)

    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        try:
            yield f"{name}={_value(cell.cell_contents, used)}"
        except ValueError:  # an empty cell
            yield f"{name}="

    for name in sorted(set(_names(function.__code__))):
        if name in function.__globals__:
            yield f"{name}={_value(function.__globals__[name], used)}"


def _code(code: CodeType, doc: str | None) -> Iterator[str]:
    """Everything in a code object that its translation reads."""
    yield repr(
        (
            code.co_code,
            code.co_exceptiontable,
            code.co_flags,
            code.co_argcount,
            code.co_kwonlyargcount,
        )
    )
    yield repr((code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars, code.co_name))

    for const in code.co_consts:
        if isinstance(const, CodeType):
            yield from _code(const, None)
        elif doc is None or const != doc:
            yield repr(sorted(map(repr, const)) if isinstance(const, frozenset) else const)


def _names(code: CodeType) -> Iterator[str]:
    """Names that a function, or one within it, may look up among its globals."""
    yield from code.co_names
    for const in code.co_consts:
        if isinstance(const, CodeType):
            yield from _names(const)


def _value(value: Any, used: list[FunctionType]) -> str:
    """Description of a value; functions that are compiled as well are added to `used`."""
    if isinstance(value, Enum):
        return f"{_class(type(value))}.{value.name}={value.value!r}"
    if isinstance(value, _NAMED):
        return repr(value)

    if isinstance(value, (tuple, list)):
        kind = _class(type(value)) if hasattr(value, "_fields") else type(value).__name__
        return f"{kind}({','.join(_value(entry, used) for entry in value)})"
    if isinstance(value, (set, frozenset)):
        return f"{{{','.join(sorted(_value(entry, used) for entry in value))}}}"
    if isinstance(value, dict):
        return (
            "{"
            + ",".join(
                f"{key!r}:{_value(entry, used)}" for key, entry in sorted(value.items(), key=repr)
            )
            + "}"
        )

    if isinstance(value, (np.ndarray, np.generic)):
        if value.dtype.hasobject:
            raise UnkeyableError(f"an array of {value.dtype}")
        return f"{value.dtype.descr}{value.shape}{hashlib.sha256(value.tobytes()).hexdigest()}"
    if isinstance(value, (np.dtype, np.ufunc)):
        return repr(value)
    if isinstance(value, type):
        return _class(value)
    if isinstance(value, ModuleType):
        return _module(value, used)

    return _called(value, used)


def _called(value: Any, used: list[FunctionType]) -> str:
    """Description of a value that a kernel may call."""
    # numba's own functions refer to their source in this way
    compiled = inspect.unwrap(value) if hasattr(value, "__wrapped__") else None
    if isinstance(compiled, FunctionType) and hasattr(value, "targetoptions"):
        used.append(compiled)
        return f"kernel {_value(dict(value.targetoptions), used)}"
    if isinstance(compiled, FunctionType):  # a C function
        used.append(compiled)
        return f"C function {getattr(value, '_sig', '')}"

    # an intrinsic: its machine code is written by Python code
    builder = getattr(value, "_defn", None)
    if isinstance(builder, FunctionType):
        return f"intrinsic {_plain(builder, used)}"
    if isinstance(value, FunctionType):
        return f"function {_plain(value, used)}"

    if isinstance(value, BuiltinFunctionType):
        return f"{value.__module__}.{value.__qualname__}"
    if any(base.__module__.partition(".")[0] in _TOOLS for base in type(value).__mro__):
        # types of numba and LLVM, external functions
        return f"{_class(type(value))} {_without_address(value)}"

    raise UnkeyableError(f"{value!r}")


def _plain(function: FunctionType, used: list[FunctionType]) -> str:
    """Description of a function that is not compiled: its whole file, in which numba's replacement
    is defined.
    """
    name = f"{function.__module__}.{function.__qualname__}"
    if _is_told_by_version(function.__module__):
        return name
    closure = [cell.cell_contents for cell in function.__closure__ or ()]
    known = (function.__globals__.get(called) for called in sorted(set(_names(function.__code__))))
    # these may be in other files
    kernels = [global_value for global_value in known if hasattr(global_value, "targetoptions")]
    called = f" {_value(kernels, used)}" if kernels else ""

    return f"{name} {_file(function.__code__.co_filename)} {_value(closure, used)}{called}"


def _class(kind: type) -> str:
    name = f"{kind.__module__}.{kind.__qualname__}"
    fields = getattr(kind, "_fields", None)  # of a named tuple
    if fields is not None and issubclass(kind, tuple):
        return f"{name} {fields} {getattr(kind, '_field_defaults', None)!r}"
    file = getattr(sys.modules.get(kind.__module__), "__file__", None)
    return name if file is None or _is_told_by_version(kind.__module__) else f"{name} {_file(file)}"


def _module(module: ModuleType, used: list[FunctionType]) -> str:
    """Description of a module of a project: its file, and the kernels in it."""
    file = getattr(module, "__file__", None)
    if file is None or _is_told_by_version(module.__name__):
        return module.__name__

    kernels = [
        member for _, member in sorted(vars(module).items()) if hasattr(member, "targetoptions")
    ]
    return f"{module.__name__} {_file(file)} {_value(kernels, used)}"


def _is_told_by_version(module: str) -> bool:
    """True for modules whose version is part of every stamp: see `stored.toolchain`."""
    package = module.partition(".")[0]
    return package in _TOOLS or package in sys.stdlib_module_names


def _without_address(value: Any) -> str:
    text = str(value)
    if " at 0x" in text:
        raise UnkeyableError(text)
    return text


@cache
def _file(file: str) -> str:
    try:
        return hashlib.sha256(Path(file).read_bytes()).hexdigest()
    except OSError as error:
        raise UnkeyableError(f"{file}: {error}") from None
