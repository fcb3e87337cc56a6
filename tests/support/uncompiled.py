"""Kernels as plain Python: what is asked of them alone costs no compilation, and a debugger can
step through them.
"""

import sys
from importlib import import_module
from types import ModuleType
from typing import Any

from numba.core import config


def uncompiled(*names: str) -> list[ModuleType]:
    """Import the named modules anew, with numba switched off; one that imports another of them gets
    the plain one.

    The modules that everybody else uses stay as they are.
    """
    modules = {name: import_module(name) for name in names}
    switches: Any = config
    before = switches.DISABLE_JIT
    switches.DISABLE_JIT = True
    try:
        for name in names:
            del sys.modules[name]
        return [import_module(name) for name in names]
    finally:
        switches.DISABLE_JIT = before
        for name, module in modules.items():
            sys.modules[name] = module
            package, _, last = name.rpartition(".")
            setattr(sys.modules[package], last, module)
