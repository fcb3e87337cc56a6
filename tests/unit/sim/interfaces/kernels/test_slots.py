"""Slots: the same call for kernels and for plain Python, what Python raises, and which classes give
a kernel.
"""

from dataclasses import dataclass

import numpy as np
import pytest
from numba.np.numpy_support import carray

from untyped import untyped
from uuv.sim.interfaces.errors import ConfigurationError, UuvError
from uuv.sim.interfaces.kernels import kernel
from uuv.sim.interfaces.kernels.slots import (
    FAILED,
    FINE,
    RAISED,
    PythonSlots,
    Slot,
    call,
    gives_kernel,
    has_slot,
    slot_function,
)


@kernel(nogil=True)
def called(slot, times):
    """Call a slot until it does not answer FINE; the last answer."""
    answer = FINE
    for _ in range(times):
        answer = call(slot)
        if answer != FINE:
            return answer
    return answer


def adding(memory, values):
    state, arguments = carray(memory, 1), carray(values, 2)
    state[0] += arguments[0]
    arguments[1] = state[0]
    return FINE


COMPILED = slot_function(adding)


def test_a_kernel_and_plain_python_work_on_the_same_arrays():
    slots = PythonSlots()
    sums = []
    memory = np.array([0.25])
    arguments = np.array([1.5, 0.0])

    def add() -> None:
        memory[0] += arguments[0]
        arguments[1] = memory[0]

    for address in (COMPILED.address, slots.add(add)):
        memory[0] = 0.25
        assert slots.check(called(Slot(address, memory, arguments), 4)) == FINE
        sums.append((memory[0], arguments[1]))
    assert sums == [(6.25, 6.25)] * 2


def test_what_python_raises_ends_the_kernel_and_comes_out_as_it_is():
    slots = PythonSlots()
    calls = []

    def fail() -> None:
        calls.append(len(calls))
        if len(calls) == 3:
            raise KeyError("the third")

    slot = Slot(slots.add(fail), np.zeros(0), np.zeros(0))
    answer = called(slot, 10)
    assert (answer, calls) == (RAISED, [0, 1, 2])
    with pytest.raises(KeyError, match="the third") as raised:
        slots.check(answer)
    assert raised.traceback[-1].name == "fail"
    assert slots.check(called(slot, 2)) == FINE  # nothing is left of it


def test_an_answer_of_python_comes_out_too_and_a_kernel_that_fails_is_an_error():
    slots = PythonSlots()
    assert called(Slot(slots.add(lambda: 7), np.zeros(0), np.zeros(0)), 10) == 7
    with pytest.raises(UuvError, match="a kernel of the controller failed"):
        slots.check(FAILED)


def _opens(_memory, _values):
    return dir()


def test_what_numba_cannot_compile_is_named():
    with pytest.raises(
        ConfigurationError,
        match=r"^a law of mine: numba cannot compile the function: "
        r"[^\n]*$",
    ):
        slot_function(untyped(_opens), "a law of mine")


class Part:
    """With a kernel for what `work` does."""

    gain = 2.0

    def slot(self, state):
        return Slot(COMPILED.address, state, np.zeros(2))

    def work(self):
        return self.gain


class Tuned(Part):
    gain = 3.0

    def more(self):
        return 2.0 * self.work()


class Changed(Part):
    def work(self):
        return 0.0


class Complete(Changed):
    def slot(self, state):
        return Slot(0, state, np.zeros(2))


class Around:
    """Wrapper that passes everything on."""

    def __init__(self, part):
        self._part = part

    def __getattr__(self, name):
        return getattr(self._part, name)


@dataclass(frozen=True, slots=True)
class Frozen(Part):
    gain: float = 4.0


@pytest.mark.parametrize(
    ("part", "has"),
    [
        (Part(), True),
        (Tuned(), True),
        (Frozen(), True),
        (Complete(), True),
        (Changed(), False),
        (Around(Part()), False),
        (object(), False),
    ],
    ids=lambda value: type(value).__name__,
)
def test_a_class_that_overrides_what_its_kernel_stands_for_has_none(part, has):
    assert has_slot(part) == has


def test_a_method_replaced_in_the_object_itself_counts_too():
    part = Part()
    part.work = lambda: 0.0
    assert not gives_kernel(part, "slot")
