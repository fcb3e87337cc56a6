"""One core while times are measured, all of them afterwards, after an error too."""

import os

import pytest

from uuv.experiment.one_core import one_core


def cores_then_error(seen: list[int]) -> None:
    with one_core():
        seen.append(len(os.sched_getaffinity(0)))
        raise ZeroDivisionError


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="the system cannot choose cores")
def test_a_process_keeps_to_one_core_meanwhile():
    before = os.sched_getaffinity(0)
    cores: list[int] = []
    with pytest.raises(ZeroDivisionError):
        cores_then_error(cores)
    assert cores == [1]
    assert os.sched_getaffinity(0) == before
