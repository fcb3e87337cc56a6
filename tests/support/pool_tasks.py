"""Tasks for the tests of `scripts/scenarios/study`, in a module that a fresh process loads quickly."""

import os
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np

from sim.interfaces.errors import ConfigurationError

DEADLY = 2


def squared(run: int) -> dict[str, Any]:
    return {"run": run, "value": np.random.default_rng(run).normal() ** 2, "process": os.getpid()}


def deadly(run: int) -> dict[str, Any]:
    if run == DEADLY:
        os._exit(1)
    return squared(run)


def refusing(run: int) -> dict[str, Any]:
    if run == DEADLY:
        raise ConfigurationError(f"no luck with {run}")
    return squared(run)


def told_dead(run: int) -> dict[str, Any]:
    return {"run": run}


def ignores(number: int) -> bool:
    return signal.getsignal(number) is signal.SIG_IGN


def waiting(file: str) -> None:
    """Says in `file` which process this is, and waits to be ended."""
    part = Path(f"{file}.part")
    part.write_text(str(os.getpid()))
    part.replace(file)
    time.sleep(120.0)
