"""Box of a record: hands a whole record to a compiled function in less than a microsecond, whatever its size.

Numba takes each array of a tuple apart at every call from Python. A box is taken apart once, when it is made.
"""

from typing import Any

import numba
from numba import types
from numba.experimental import structref
from numba.extending import overload


@structref.register
class RecordBoxType(types.StructRef):  # pyright: ignore[reportGeneralTypeIssues, reportAttributeAccessIssue]
    """Numba's type of a box."""

    def preprocess_fields(self, fields: Any) -> Any:
        """Field types without literals."""
        return tuple((name, types.unliteral(kind)) for name, kind in fields)


class RecordBox(structref.StructRefProxy):
    """Box of one record; compiled functions read it as `box.record`."""

    def __new__(cls, record: Any) -> "RecordBox":
        """Box of `record`, a NamedTuple of arrays, numbers and such tuples; the arrays are shared.

        Numbers take the type that the record annotates: a whole number for a float would compile everything anew.
        """
        return _boxed(_as_annotated(record))


def _as_annotated(record: Any) -> Any:
    """`record` with its numbers as float, int or bool, as annotated."""
    kinds = type(record).__annotations__
    return type(record)(
        *(
            _as_annotated(value)
            if hasattr(value, "_fields")
            else kinds[name](value)
            if kinds[name] in (float, int, bool)
            else value
            for name, value in zip(record._fields, record, strict=True)
        )
    )


structref.define_boxing(RecordBoxType, RecordBox)


def _new_box(record: Any) -> Any:
    """Compiled code only: a box of `record`."""
    raise NotImplementedError


@overload(_new_box)
def _overload_new_box(record: Any) -> Any:
    box = RecordBoxType([("record", types.unliteral(record))])

    def new(record: Any) -> Any:
        made = structref.new(box)  # pyright: ignore[reportCallIssue]
        made.record = record
        return made

    return new


@numba.njit(cache=True)
def _boxed(record):
    return _new_box(record)
