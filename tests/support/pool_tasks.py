"""Tasks for the tests of `scripts/scenarios/campaigns/pool.py`, in a module that a fresh process loads quickly."""

import os
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np

DEADLY = 2


def squared(run: int) -> dict[str, Any]:
    return {"run": run, "without": "", "value": np.random.default_rng(run).normal() ** 2, "timing": os.getpid()}


def deadly(run: int) -> dict[str, Any]:
    if run == DEADLY:
        os._exit(1)
    return squared(run)


def told_dead(run: int) -> dict[str, Any]:
    return {"run": run, "without": ""}


def ignores(number: int) -> bool:
    return signal.getsignal(number) is signal.SIG_IGN


def waiting(file: str) -> None:
    """Says in `file` which process this is, and waits to be ended."""
    part = Path(f"{file}.part")
    part.write_text(str(os.getpid()))
    part.replace(file)
    time.sleep(120.0)
