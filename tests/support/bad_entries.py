"""Entries of the benchmark that fail in every way, and one that looks for the truth in its own
memory.
"""

import os
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from good_estimators import RawEstimator
from untyped import untyped
from uuv.controllers.whole_body.work_controller import WorkController

FAIL_AT = 5  # step
MASK = 0xA5  # over a sought pattern, so that the pattern itself is in no memory
# variables with the names of files
PATTERNS, FOUND = "BENCHMARK_TEST_PATTERNS", "BENCHMARK_TEST_FOUND"


class _Failing:
    """The default controller up to FAIL_AT."""

    def __init__(self, model, *, water_error=0.0):
        self.work = WorkController(model, water_error=water_error)
        self.steps = 0
        self.period = self.work.period

    def init(self, estimate):
        return self.work.init(estimate)

    def step(self, state, estimate, reference):
        self.steps += 1
        state, command = self.work.step(state, estimate, reference)
        return (state, command) if self.steps < FAIL_AT else self.fail(state, command)

    def fail(self, state, command):
        raise NotImplementedError


class Raises(_Failing):
    def fail(self, state, command):
        raise RuntimeError("out of\nideas")


class Dies(_Failing):
    def fail(self, state, command):
        print("last words", flush=True)
        os._exit(7)


class Hangs(_Failing):
    def fail(self, state, command):
        time.sleep(60.0)
        return state, command


class NotANumber(_Failing):
    def fail(self, state, command):
        return state, replace(command, joint_torque=np.full_like(command.joint_torque, np.nan))


class WrongType(_Failing):
    def fail(self, state, command):
        return state, {"joint_torque": command.joint_torque}


class WrongShape(_Failing):
    def fail(self, state, command):
        return state, replace(command, thrusters=command.thrusters[:-1])


class WrongTime(_Failing):
    def fail(self, state, command):
        return state, replace(command, time=command.time + 1.0)


class EstimatesNothing(RawEstimator):
    def step(self, state, measurements):
        return state, untyped(None)


class EstimatesOtherShape(RawEstimator):
    def step(self, state, measurements):
        state, estimate = super().step(state, measurements)
        return state, replace(estimate, v_WB_B=np.zeros(2))


class EstimatesNotANumber(RawEstimator):
    def step(self, state, measurements):
        state, estimate = super().step(state, measurements)
        return state, replace(estimate, v_WB_B=np.full(3, np.nan))


class EstimatesNoPose(RawEstimator):
    def step(self, state, measurements):
        state, estimate = super().step(state, measurements)
        return state, replace(estimate, X_WB=2.0 * estimate.X_WB)


class SearchesItself(_Failing):
    """Writes how often each masked pattern of the file PATTERNS occurs in the memory of its
    process.
    """

    def fail(self, state, command):
        if self.steps == FAIL_AT:
            masked = np.load(os.environ[PATTERNS])
            counts = [count(unmasked(row)) for row in masked]
            Path(os.environ[FOUND]).write_text(" ".join(map(str, counts)))
        return state, command


def unmasked(masked: np.ndarray) -> bytearray:
    """The pattern in the only copy that this process makes of it."""
    pattern = bytearray(masked.tobytes())
    for i in range(len(pattern)):
        pattern[i] ^= MASK
    return pattern


def count(pattern: bytearray) -> int:
    """Number of occurrences of `pattern` in the writable memory of this process, beside itself."""
    total = 0
    own_address = np.frombuffer(pattern, dtype=np.uint8).ctypes.data
    with open("/proc/self/maps", encoding="ascii") as maps:
        lines = maps.readlines()
    with open("/proc/self/mem", "rb", buffering=0) as memory:
        for line in lines:
            span, rights = line.split()[:2]
            first, last = (int(end, 16) for end in span.split("-"))
            if not rights.startswith("rw") or "[v" in line:
                continue
            try:
                memory.seek(first)
                part = memory.read(last - first)
            except OSError:
                continue
            at = part.find(pattern)
            while at >= 0:
                total += first + at != own_address
                at = part.find(pattern, at + 1)
    return total
