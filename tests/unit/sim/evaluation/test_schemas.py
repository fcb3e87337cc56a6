"""Schemas from dataclasses: types, units and notes; the files on the disk are what the dataclasses
say.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import jsonschema
import pytest

from uuv.sim.evaluation.schema_files import FOLDER, contents
from uuv.sim.evaluation.schemas import metric, schema_of, unit_of, unmeasured


@dataclass(frozen=True, kw_only=True)
class Inner:
    depth_m: float | None = metric("Below the surface.", minimum=0)


@dataclass(frozen=True, kw_only=True)
class Outer:
    count: int
    inner: Inner
    other: Inner | None
    each: list[Inner]
    names: Mapping[str, str]
    anything: Mapping[str, Any]
    later: str = metric("Absent at first.", default="")


WHOLE = {
    "count": 1,
    "inner": {"depth_m": 0.5},
    "other": None,
    "each": [{"depth_m": None}],
    "names": {"a": "b"},
    "anything": {"a": [1]},
}
SCHEMA = schema_of((Outer,), "Outer", "For a test")


def test_what_a_dataclass_holds_keeps_its_schema():
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    outer = Outer(
        count=1,
        inner=Inner(depth_m=0.5),
        other=None,
        each=[Inner(depth_m=None)],
        names={"a": "b"},
        anything={"a": [1]},
    )
    jsonschema.validate({**asdict(outer), "later": "x"}, SCHEMA)
    jsonschema.validate(WHOLE, SCHEMA)
    assert SCHEMA["properties"]["inner"]["properties"]["depth_m"] == {
        "type": ["number", "null"],
        "unit": "m",
        "minimum": 0,
        "description": "Below the surface.",
    }


@pytest.mark.parametrize(
    "wrong",
    [
        {"count": 1.5},
        {"count": None},
        {"inner": None},
        {"inner": {"depth_m": -1.0}},
        {"inner": {}},
        {"other": {"depth": 1.0}},
        {"each": [{"depth_m": "deep"}]},
        {"names": {"a": 1}},
        {"more": 1},
    ],
)
def test_what_it_cannot_hold_does_not(wrong: dict[str, Any]):
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({**WHOLE, **wrong}, SCHEMA)


def test_units_are_those_of_the_names():
    names = (
        "speed_mean_m_s",
        "lost_s",
        "tilt_max_rad",
        "bias_nm",
        "force_n",
        "depth_m",
        "seen_share",
        "views",
    )
    assert [unit_of(name) for name in names] == ["m/s", "s", "rad", "N m", "N", "m", "1", None]


def test_what_was_not_measured_is_none():
    assert unmeasured(Inner) == Inner(depth_m=None)
    assert unmeasured(Inner, depth_m=1.0) == Inner(depth_m=1.0)


def test_files_are_as_generated():
    for file, text in contents().items():
        assert file.read_text(encoding="utf-8") == text, (
            f"{file.name}: run python -m uuv.sim.evaluation.schema_files"
        )
    assert {path.name for path in FOLDER.glob("*.json")} == {path.name for path in contents()}
