"""Boxes of records: shared arrays, and one type whatever the numbers were given as."""

from typing import NamedTuple

import numba
import numpy as np

from uuv.sim.interfaces.kernels.record_box import as_annotated, new_box


class Inner(NamedTuple):
    values: np.ndarray
    gain: float


class Outer(NamedTuple):
    inner: Inner
    most: int


@numba.njit
def boxed(record):
    return new_box(record)


@numba.njit
def scaled(box):
    record = box.record
    for i in range(record.most):
        record.inner.values[i] *= record.inner.gain


def test_a_kernel_changes_the_arrays_of_the_record_itself():
    array = np.array([1.0, 2.0, 4.0])
    box = boxed(Outer(Inner(array, 0.5), 2))
    scaled(box)
    scaled(box)
    assert array.tolist() == [0.25, 0.5, 4.0]


def test_whole_numbers_make_no_other_type():
    array = np.zeros(3)
    first, other = (boxed(as_annotated(Outer(Inner(array, gain), 2))) for gain in (2.0, 2))
    assert numba.typeof(first) == numba.typeof(other)
