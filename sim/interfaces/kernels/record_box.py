"""Box of a record: hands it to a compiled function in less than a microsecond, whatever its size.

Numba takes each array of a tuple apart at every call from Python. A box is taken apart once, when
it is made.
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
    """`record`, a NamedTuple, with its numbers as float, int or bool as it and its parts annotate
    them.

    A whole number given for a float would else compile everything anew.
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

    The function that calls it stands in the module of the record's type: numba's cache of a
    function names the types of its arguments, and a type that cannot be imported later would make
    the whole cache of that function unreadable.
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
