"""Box of a record, which passes the record to a compiled function in less than a microsecond, for
any size.

Numba unpacks each array of a tuple at every call from Python. A box is unpacked once, when it is
made.
"""

from typing import Any

from numba import types
from numba.experimental import structref
from numba.extending import overload


@structref.register
class RecordBoxType(types.StructRef):  # pyright: ignore
    """Numba's type of a box."""

    def preprocess_fields(self, fields: Any) -> Any:
        """Field types without literals."""
        return tuple((name, types.unliteral(kind)) for name, kind in fields)


class RecordBox(structref.StructRefProxy):
    """Box of one record, as Python holds it."""


structref.define_boxing(RecordBoxType, RecordBox)


def as_annotated(record: Any) -> Any:
    """The NamedTuple `record`, with its numbers converted to the annotated types float, int or
    bool.

    Otherwise a whole number given for a float would cause everything to be compiled again.
    """
    kinds = type(record).__annotations__
    return type(record)(
        *(
            as_annotated(field)
            if hasattr(field, "_fields")
            else kinds[name](field)
            if kinds[name] in (float, int, bool)
            else field
            for name, field in zip(record._fields, record, strict=True)
        )
    )


def new_box(record: Any) -> Any:
    """Compiled code only: box of `record`, a NamedTuple of arrays, which are shared, and numbers.

    The calling function must be in the module of the record's type. Numba's cache of a function
    names the types of its arguments, and a type that cannot be imported later would make the whole
    cache of that function unreadable.
    """
    raise NotImplementedError


@overload(new_box)
def _overload_new_box(record: Any) -> Any:
    box = RecordBoxType([("record", types.unliteral(record))])

    def new(record: Any) -> Any:
        filled = structref.new(box)  # pyright: ignore[reportCallIssue]
        filled.record = record
        return filled

    return new
