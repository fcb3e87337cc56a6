"""Results live as long as what they were worked out from."""

from collections.abc import Callable
from dataclasses import dataclass
from weakref import ref

import numpy as np

from uuv.sim.interfaces.remembered import remembered
from uuv.sim.interfaces.spatial import Array


@dataclass(frozen=True, eq=False)
class Frame:
    """Equal to itself alone."""

    values: tuple[float, ...]


@dataclass(frozen=True)
class Model:
    """Equal to all of the same content."""

    size: float


class Worked:
    """A result, to which a weak reference can be made."""


def counted(most: int, owners: int = 0) -> tuple[Callable[..., Worked], list[tuple[object, ...]]]:
    """A remembering function, and the arguments that it was worked out for."""
    calls: list[tuple[object, ...]] = []

    @remembered(most, owners)
    def work(owner: object, *rest: object) -> Worked:
        del owner
        calls.append(rest)
        return Worked()

    return work, calls


def test_results_go_with_their_owner() -> None:
    work, calls = counted(most=4)
    frame = Frame((1.0,))
    memo = work(frame, 2)
    assert work(frame, 2) is memo
    assert work(frame, 3) is not memo
    assert calls == [(2,), (3,)]
    alive = ref(memo), ref(frame)
    del memo, frame
    assert [reference() for reference in alive] == [None, None]  # also without the collector


def test_the_oldest_results_of_an_owner_go_first() -> None:
    work, calls = counted(most=2)
    frame = Frame((1.0,))
    for key in (1, 2, 3, 3, 2, 1):
        work(frame, key)
    assert calls == [(1,), (2,), (3,), (1,)]


def test_owners_of_the_same_content_find_the_results_of_the_latest() -> None:
    work, calls = counted(most=4, owners=2)
    for size in (1.0, 2.0, 1.0, 3.0, 1.0, 2.0):
        work(Model(size))
    assert len(calls) == 5  # the third model displaced the first


def test_an_owner_that_is_its_own_result_is_not_held() -> None:
    @remembered(4)
    def thinned(frame: Frame, points: int) -> Frame:
        return frame if len(frame.values) <= points else Frame(frame.values[:points])

    frame = Frame((1.0, 2.0))
    assert thinned(frame, 2) is frame
    assert thinned(frame, 1) is thinned(frame, 1)
    alive = ref(frame)
    del frame
    assert alive() is None


def test_arguments_by_name_are_told_apart() -> None:
    @remembered(4)
    def scaled(frame: Frame, by: float = 1.0) -> Array:
        return by * np.array(frame.values)

    frame = Frame((1.0, -2.0))
    np.testing.assert_array_equal(scaled(frame, by=3.0), [3.0, -6.0])
    np.testing.assert_array_equal(scaled(frame), [1.0, -2.0])
