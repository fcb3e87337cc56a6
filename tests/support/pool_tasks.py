"""Tasks for the tests of `uuv/study`, in a module that a fresh process loads quickly."""

import os
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np

from uuv.sim.interfaces.errors import ConfigurationError

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


def sleeping(seconds: float) -> dict[str, Any]:
    time.sleep(seconds)
    return {"run": seconds, "value": 0.0}


def hungry(megabytes: int) -> dict[str, Any]:
    return {"run": megabytes, "value": float(np.ones((megabytes, 2**17))[-1, -1])}


def dying(file: str) -> None:
    """Adds a letter to `file`, and kills its process."""
    with Path(file).open("a") as log:
        log.write("x")
    os.kill(os.getpid(), signal.SIGKILL)


def slow_and_logged(case: tuple[int, str]) -> dict[str, Any]:
    """Takes some 50 ms and adds a line to a log; now and then its row has a column that no other
    has.
    """
    number, file = case
    with Path(file).open("a") as log:
        log.write(f"{number}\n")
    time.sleep(0.05)
    return {
        "case": number,
        "value": number / 7,
        **({f"only_{number}": 1.0} if number % 50 == 7 else {}),
    }
