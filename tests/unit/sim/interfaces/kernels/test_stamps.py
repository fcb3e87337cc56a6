"""A stamp changes with all that machine code depends on, and with nothing else."""

from collections import namedtuple
from typing import Any

import numba
import numpy as np
import pytest
from numba import types

from uuv.sim.interfaces.kernels.stamps import UnkeyableError, stamp
from uuv.sim.interfaces.kernels.stored import type_text

SOURCE = '''
import numba
import numpy as np

SCALE = 3.0
TABLE = np.array([1.0, 2.0])
UNUSED = 1

@numba.njit
def bottom(x):
    return SCALE * x

@numba.njit
def middle(x, y=1.0):
    """Middle."""
    return bottom(x) + y  # the sum

@numba.njit
def top(x):
    return middle(x) + TABLE[0]

@numba.njit
def beside(x):
    return -x

@numba.njit
def even(n):
    return True if n == 0 else odd(n - 1)

@numba.njit
def odd(n):
    return False if n == 0 else even(n - 1)

def made(factor):
    @numba.njit
    def scaled(x):
        return factor * x
    return scaled

doubled = made(2.0)
'''
KERNELS = ("bottom", "middle", "top", "beside", "even", "odd", "doubled")


def stamps(source: str) -> dict[str, str]:
    """Stamps of all kernels of a source."""
    names: dict[str, Any] = {"__name__": "of_a_test"}
    exec(source, names)
    return {name: stamp(names[name].py_func) for name in KERNELS}


@pytest.mark.parametrize(
    ("old", "new", "changed"),
    [
        ("# the sum", "# another remark", ""),
        ('"""Middle."""', '"""The middle one, in other words."""', ""),
        ("import numpy as np\n", "import numpy as np\n\n\n", ""),
        ("UNUSED = 1", "UNUSED = 2", ""),
        ("return -x", "return 2.0 - x", "beside"),
        ("SCALE * x", "SCALE / x", "bottom middle top"),
        ("SCALE = 3.0", "SCALE = 3", "bottom middle top"),
        ("y=1.0", "y=2.0", "middle top"),
        ("[1.0, 2.0]", "[1.0, 2.5]", "top"),
        ("made(2.0)", "made(3.0)", "doubled"),
        ("return True", "return n < 9", "even odd"),
        # its own options: below
        ("@numba.njit\ndef bottom", "@numba.njit(fastmath=True)\ndef bottom", "middle top"),
    ],
)
def test_an_edit_changes_the_stamps_of_a_kernel_and_of_its_callers_alone(old, new, changed):
    assert SOURCE.count(old) == 1
    before = stamps(SOURCE)
    after = stamps(SOURCE.replace(old, new))
    assert {name for name in KERNELS if before[name] != after[name]} == set(changed.split())


def test_the_options_of_the_compilation_count():
    def function(x: float) -> float:
        return x

    assert stamp(function) == stamp(function, ())
    assert (
        len(
            {
                stamp(function),
                stamp(function, [("fastmath", True)]),
                stamp(function, [("nogil", True)]),
            }
        )
        == 3
    )


def test_what_cannot_be_told_is_refused():
    sentinel = object()

    def function() -> object:
        return sentinel

    with pytest.raises(UnkeyableError, match="object"):
        stamp(function)


def test_a_plain_function_stands_for_its_file(tmp_path):
    """Numba takes something else in its place, an overload, which the kernel does not name."""

    def of(text: str) -> str:
        file = tmp_path / "plain.py"
        file.write_text(text)
        names: dict[str, Any] = {"__name__": f"plain{len(text)}"}
        exec(compile(text, str(file), "exec"), names)
        helper = names["helper"]

        def kernel(x: float) -> float:
            return helper(x)

        digest = stamp(kernel)
        _forget(file)
        return digest

    assert of("def helper(x): ...\nA = 1") != of("def helper(x): ...\nA = 1.5")


def test_a_plain_function_brings_the_kernels_that_it_names():
    """An overload may call a kernel of another file: an edit there changes the stamps of all that
    call the overload.
    """

    def of(inner: float) -> str:
        @numba.njit
        def elsewhere(x: float) -> float:
            return x + inner

        names: dict[str, Any] = {"__name__": "plain", "elsewhere": elsewhere}
        exec(compile("def helper(x): return elsewhere(x)", __file__, "exec"), names)
        helper = names["helper"]

        def kernel(x: float) -> float:
            return helper(x)

        return stamp(kernel)

    assert of(1.0) == of(1.0)
    assert of(1.0) != of(2.0)


def _forget(file: Any) -> None:
    from uuv.sim.interfaces.kernels import stamps as module

    del file
    module._file.cache_clear()


def test_the_order_of_a_named_tuple_counts():
    """Numba's own text of the type is the same for both; code compiled for the one would read the
    other's fields.
    """

    def text(fields: str) -> str:
        pair: Any = namedtuple("Pair", list(fields))
        return type_text((types.NamedUniTuple(types.float64, 2, pair),))

    assert str(types.NamedUniTuple(types.float64, 2, namedtuple("Pair", ["a", "b"]))) in text("ba")
    assert text("ab") != text("ba")
    assert text("ab") == text("ab")


def test_types_of_one_process_are_refused():
    @numba.njit
    def function(x):
        return x

    with pytest.raises(UnkeyableError):
        type_text((types.Dispatcher(function),))


@pytest.mark.parametrize(
    "kind", [types.float64[::1], types.Array(types.float64, 1, "C", readonly=True), types.int32]
)
def test_types_are_told_apart(kind):
    others = {types.float64[:], types.float32[::1], types.int64, types.boolean} - {kind}
    assert type_text((kind,)) not in {type_text((other,)) for other in others}


def test_arrays_within_a_closure_count_by_their_numbers():
    def over(table: np.ndarray) -> Any:
        def function(i: int) -> float:
            return table[i]

        return function

    first, same, other = (stamp(over(np.array([1.0, second]))) for second in (2.0, 2.0, 2.5))
    assert first == same != other
