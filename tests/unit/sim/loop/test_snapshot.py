"""Snapshot: copies that share no memory with the value, and share it among themselves as the value
did.
"""

import threading
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import mujoco
import numpy as np
import pytest

from uuv.models.meshes.ray_casting import RayScene
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.loop.snapshot import Snapshot


@dataclass(slots=True, eq=False)
class Memory:
    """A record as the sensors have it, and views of its fields."""

    record: np.ndarray
    drawn: np.ndarray
    used: np.ndarray


def memory() -> Memory:
    record = np.zeros(
        1,
        np.dtype(
            (np.record, [("bias", np.float64, 3), ("drawn", np.float64, 5), ("used", np.int64)])
        ),
    )
    record["drawn"][0] = [1.0, 2.0, 3.0, 4.0, 5.0]
    return Memory(record, record["drawn"][0], record["used"])


def test_views_are_views_in_a_copy_too():
    copy = Snapshot(memory(), "memory").copy()
    copy.drawn[1] = -7.0
    copy.used[0] = 3
    assert copy.record["drawn"][0].tolist() == [1.0, -7.0, 3.0, 4.0, 5.0]
    assert copy.record["used"][0] == 3


@pytest.mark.parametrize("order", ["C", "F", "mixed"])
def test_views_have_the_numbers_of_any_order_of_memory(order: Any):
    table = np.arange(24.0).reshape(2, 3, 4)
    if order == "mixed":
        table = table.transpose(1, 2, 0).copy(order="K")
        assert table.base is None
        assert not table.flags.c_contiguous
        assert not table.flags.f_contiguous
    else:
        table = np.array(table, order=order)
    views = [table[1:], table[:, ::-1], table[..., 1], table.T, table[0, 1, 1:]]
    whole, *parts = Snapshot([table, *views], "views").copy()
    for part, view in zip(parts, views, strict=True):
        assert np.array_equal(part, view)
        assert np.shares_memory(part, whole)


def test_nothing_that_happens_later_changes_it():
    original = memory()
    snapshot = Snapshot(original, "memory")
    original.drawn[:] = 0.0
    first = snapshot.copy()
    first.drawn[:] = 9.0
    assert snapshot.copy().drawn.tolist() == [1.0, 2.0, 3.0, 4.0, 5.0]


def test_what_is_one_object_is_one_object():
    """Parts of the loop compare messages by identity."""
    message = np.ones(3)
    copy = Snapshot({"now": message, "before": [message]}, "messages").copy()
    assert copy["now"] is copy["before"][0]
    assert copy["now"] is not message


def test_an_array_that_is_read_only_stays_so():
    fixed = np.arange(3.0)
    fixed.setflags(write=False)
    part = np.arange(6.0)[1:4]
    part.setflags(write=False)
    for copy in Snapshot([fixed, part], "arrays").copy():
        assert not copy.flags.writeable


def test_generators_go_on_alike():
    rng = np.random.default_rng(3)
    rng.standard_normal(5)
    snapshot = Snapshot(rng, "generator")
    expected = rng.standard_normal(4), rng.spawn(1)[0].integers(1 << 40)
    for _ in range(2):
        copy = snapshot.copy()
        assert np.array_equal(copy.standard_normal(4), expected[0])
        assert copy.spawn(1)[0].integers(1 << 40) == expected[1]


def test_code_and_models_are_handed_on():
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><geom size='1'/></worldbody></mujoco>"
    )
    scene = RayScene(np.eye(3), [[0, 1, 2]])
    original = {
        "model": model,
        "scene": scene,
        "law": lambda x: x,
        "kind": Memory,
        "names": MappingProxyType({"a": 1}),
    }
    copy = Snapshot(original, "parts").copy()
    assert all(copy[name] is original[name] for name in ("model", "scene", "law", "kind"))
    assert copy["names"] == {"a": 1}


def test_what_cannot_be_copied_is_refused_in_one_line():
    for locked in (threading.Lock(), memory().record[0]):
        with pytest.raises(
            ConfigurationError,
            match=r"^the state cannot be copied: "
            r".*(lock|record)",
        ):
            Snapshot({"inner": [locked]}, "the state")
