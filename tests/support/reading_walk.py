"""Walks of a reader through the code, from a trace of a real call.

A reader follows a thing, such as a vehicle on its way from a file to a running job, from function
to function. He enters each function that is handed the thing when it is first called, and goes back
to the caller after it. What counts is the files that he enters, and the returns: how often he comes
into a file that he had left. Foundations, which he takes by their names, are not entered.
"""

import os
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
# calls of a function that are looked at: later ones are handed the same kinds of things
_MOST = 100


@dataclass(frozen=True, slots=True, kw_only=True)
class Walk:
    """Files of a walk, in order: each visit with the functions that are read there."""

    visits: tuple[tuple[str, tuple[str, ...]], ...]

    @property
    def files(self) -> list[str]:
        """Each file once, in the order in which they are entered."""
        return list(dict.fromkeys(file for file, _ in self.visits))

    @property
    def returns(self) -> int:
        """Visits to a file that was left before."""
        return len(self.visits) - len(self.files)

    def __str__(self) -> str:
        """One line a visit, returns marked, and the counts."""
        left: set[str] = set()
        lines = []
        for file, functions in self.visits:
            mark = "<-" if file in left else "  "
            lines.append(f"{mark} {file}: {', '.join(filter(None, functions))}")
            left.add(file)
        return "\n".join([*lines, f"{len(self.files)} files, {self.returns} returns"])


def walk(
    call: Callable[[], Any], follows: Callable[[Any], bool], foundations: tuple[str, ...] = ()
) -> Walk:
    """The walk of a reader who follows a thing through a call.

    Args:
        call: traced; it takes no arguments.
        follows: whether an argument of a function is the thing, or holds it.
        foundations: beginnings of the paths of files that are not entered.
    """
    steps: list[tuple[str, str]] = []
    walked: set[CodeType] = set()
    looks: Counter[CodeType] = Counter()
    stack: list[tuple[str, bool]] = []  # file of each function, and whether it is read

    def trace(frame: FrameType, event: str, arg: Any) -> None:
        del arg
        if event not in ("call", "return"):
            return
        file = _file(frame.f_code)
        if file is None:
            return
        if event == "call":
            code = frame.f_code
            looks[code] += 1
            new = looks[code] <= _MOST and code not in walked and not file.startswith(foundations)
            read = new and any(follows(argument) for argument in _arguments(frame))
            stack.append((file, read))
            if read:
                walked.add(code)
                steps.append((file, code.co_qualname))
        elif stack and stack.pop()[1]:
            above = next((file for file, read in reversed(stack) if read), None)
            steps.append((above or file, ""))

    sys.setprofile(trace)
    try:
        call()
    finally:
        sys.setprofile(None)
    return Walk(visits=tuple(_visits(steps)))


@cache
def _file(code: CodeType) -> str | None:
    """Path of a function's file in the checkout, by its real folder; None: it is elsewhere."""
    if code.co_filename.startswith("<"):
        return None
    path = os.path.realpath(code.co_filename)
    inside = path.startswith(f"{ROOT}{os.sep}") and f"{os.sep}.venv{os.sep}" not in path
    return os.path.relpath(path, ROOT) if inside and "/tests/" not in path else None


def _arguments(frame: FrameType) -> list[Any]:
    count = frame.f_code.co_argcount + frame.f_code.co_kwonlyargcount
    return [frame.f_locals.get(name) for name in frame.f_code.co_varnames[:count]]


def _visits(steps: list[tuple[str, str]]) -> list[tuple[str, tuple[str, ...]]]:
    """Steps in one file, one after the other, as one visit."""
    visits: list[tuple[str, tuple[str, ...]]] = []
    for file, function in steps:
        if visits and visits[-1][0] == file:
            visits[-1] = file, (*visits[-1][1], function)
        else:
            visits.append((file, (function,)))
    return visits
