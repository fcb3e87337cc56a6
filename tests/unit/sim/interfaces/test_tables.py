"""A document of others becomes a dataclass, or one line says where in it the fault is."""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from uuv.sim.interfaces.documents import DEEPEST, json_of, toml_of
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.files import bytes_of, folder_name
from uuv.sim.interfaces.spatial import Array
from uuv.sim.interfaces.tables import TableReader, WithFields


@dataclass(frozen=True, kw_only=True)
class Inner:
    share: float = field(metadata={"schema": {"minimum": 0, "maximum": 1}})
    digest: str = field(default="ab", metadata={"schema": {"pattern": "^[a-f]+$"}})


@dataclass(frozen=True, kw_only=True)
class Outer:
    inner: Inner
    state: Literal["done", "abort"]
    place: tuple[float, float] = (0.0, 0.0)
    names: list[str] = field(default_factory=list)
    more: Mapping[str, int] = field(default_factory=dict)
    seed: int | None = None
    rest: Any = None


GOOD: dict[str, Any] = {
    "inner": {"share": 0.25},
    "state": "done",
    "place": [1, 2.5],
    "more": {"a": 3},
    "rest": [{}],
}


def test_a_table_becomes_a_dataclass():
    outer = TableReader().made(Outer, {**GOOD, "names": ["x"], "seed": None})
    assert outer == Outer(
        inner=Inner(share=0.25),
        state="done",
        place=(1.0, 2.5),
        names=["x"],
        more={"a": 3},
        rest=[{}],
    )
    assert isinstance(outer.place[0], float)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"inner": {"share": 1.5}}, r"inner.share: must be at least 0 and at most 1, got 1.5"),
        (
            {"inner": {"share": 0.5, "digest": "xyz"}},
            r"inner.digest: must be of the form "
            r"\^\[a-f\]\+\$, got 'xyz'",
        ),
        (
            {"inner": {"shares": 0.5}},
            r"\[inner\] has no 'shares'; it has share, digest \(did you "
            r"mean share\?\)",
        ),
        ({"inner": {}}, r"\[inner\]: share is missing"),
        ({"inner": None}, r"inner: must be a table, got None"),
        ({"state": "don"}, r"state: allowed done, abort, got 'don' \(did you mean done\?\)"),
        ({"state": ["done"]}, r"state: allowed done, abort, got \['done'\]"),
        ({"place": [1.0]}, r"place: must be 2 values"),
        ({"place": 5}, r"place: must be a list, got 5"),
        ({"names": [1]}, r"names\[0\]: must be text, got 1"),
        ({"more": {"a": True}}, r"more.a: must be a whole number, got True"),
        ({"more": []}, r"more: must be a table, got \[\]"),
        ({"seed": 1.5}, r"seed: must be a whole number, got 1.5"),
    ],
)
def test_a_fault_is_told_with_its_place(change: dict[str, Any], said: str):
    with pytest.raises(ConfigurationError, match=said):
        TableReader().made(Outer, {**GOOD, **change})


@dataclass(frozen=True, kw_only=True, eq=False)
class Body:
    """What a document may have beside plain values: arrays, several kinds at one key, units,
    bounds.
    """

    center: Array = field(metadata={"schema": {"unit": "m"}})
    name: str | Inner | None = field(
        default=None, metadata={"schema": {"minLength": 1, "title": "a name or a share"}}
    )
    parts: Inner | tuple[Inner, ...] = ()
    limits: Mapping[str, float | None] | list[str] = field(
        default_factory=list,
        metadata={
            "schema": {
                "minProperties": 1,
                "additionalProperties": {"unit": "N m", "exclusiveMinimum": 0},
            }
        },
    )
    rows: list[tuple[float | None, float]] = field(
        default_factory=list, metadata={"schema": {"maxItems": 2}}
    )
    count: int = field(default=1, metadata={"schema": {"minimum": 1, "maximum": 10_000_000}})

    def __post_init__(self) -> None:
        if self.count == 13:
            raise ConfigurationError("count: unlucky")


CENTER: dict[str, Any] = {"center": [1, 2.5, -0.0]}


def test_several_kinds_may_stand_at_one_key():
    reader = TableReader()
    body = reader.made(
        Body, {**CENTER, "name": "x", "parts": {"share": 0.5}, "limits": {"a": 3, "b": None}}
    )
    assert body.center.tolist() == [1.0, 2.5, 0.0]
    assert np.signbit(body.center[2])
    assert (body.name, body.parts, body.limits) == ("x", Inner(share=0.5), {"a": 3.0, "b": None})
    body = reader.made(
        Body,
        {
            **CENTER,
            "name": {"share": 1},
            "parts": [{"share": 0}],
            "limits": ["a"],
            "rows": [[None, 1]],
        },
    )
    assert (body.name, body.parts, body.limits, body.rows) == (
        Inner(share=1.0),
        (Inner(share=0.0),),
        ["a"],
        [(None, 1.0)],
    )


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"center": "here"}, r"center \[m\]: must be a list of numbers, got 'here'"),
        ({"center": [1, "up", 3]}, r"center\[1\] \[m\]: must be a number, got 'up'"),
        ({"center": [1, True, 3]}, r"center\[1\] \[m\]: must be a number, got True"),
        (
            {"center": [1, "2.5", 3]},
            r"center\[1\] \[m\]: must be a number, got '2.5'; it is text: leave out the quotes",
        ),
        (
            {"center": [[1, 2], [3]]},
            r"center \[m\]: must be rows of one length, got \[\[1, 2\], "
            r"\[3\]\]",
        ),
        ({"center": [10**400]}, r"center\[0\] \[m\]: must be a number that a float can hold"),
        ({"name": 5}, r"name: must be a name or a share, got 5"),
        ({"name": ""}, r"name: must be a name or a share, got ''"),
        (
            {"name": {"shares": 1}},
            r"\[name\] has no 'shares'; it has share, digest \(did you mean "
            r"share\?\)",
        ),
        ({"parts": 5}, r"parts: must be a table or a list, got 5"),
        (
            {"parts": [{"share": 0.5}, {"share": 2}]},
            r"parts\[1\].share: must be at least 0 and at "
            r"most 1, got 2.0",
        ),
        ({"parts": [{"share": 0.5, "x": 1}]}, r"parts\[0\] has no 'x'; it has share, digest"),
        ({"limits": "all"}, r"limits: must be a table or a list, got 'all'"),
        ({"limits": {}}, r"limits: must be 1 or more entries, got \{\}"),
        ({"limits": {"a": -1}}, r"limits.a \[N m\]: must be above 0, got -1.0"),
        ({"limits": {"a": float("inf")}}, r"limits.a \[N m\]: must be finite, above 0, got inf"),
        ({"rows": [[1, 2], [3]]}, r"rows\[1\]: must be 2 values, got \[3\]"),
        ({"rows": [[1, 2]] * 3}, r"rows: must be 0 to 2 entries"),
        ({"count": 0}, r"count: must be at least 1 and at most 10000000, got 0"),
        (
            {"count": "4"},
            r"count: must be a whole number, at least 1 and at most 10000000, got "
            r"'4'; it is text",
        ),
        (
            {"count": 2.0},
            r"count: must be a whole number, at least 1 and at most 10000000, got 2.0",
        ),
    ],
)
def test_a_fault_names_place_unit_and_what_is_allowed(change: dict[str, Any], said: str):
    with pytest.raises(ConfigurationError, match=f"^{said}"):
        TableReader().made(Body, {**CENTER, **change})


def test_all_that_is_missing_is_said():
    with pytest.raises(ConfigurationError, match=r"^the file: inner, state are missing$"):
        TableReader().made(Outer, {})


def test_what_a_class_refuses_may_be_told_with_its_place():
    with pytest.raises(ConfigurationError, match=r"^count: unlucky$"):
        TableReader().made(Body, {**CENTER, "count": 13}, "hull")
    with pytest.raises(ConfigurationError, match=r"^hull: count: unlucky$"):
        TableReader(places_faults=True).made(Body, {**CENTER, "count": 13}, "hull")


def of_share(share: float, *, places: Array | None = None, **others: Any) -> tuple[Any, ...]:
    return share, places if places is None else places.tolist(), others


def test_a_function_is_called_with_the_arguments_of_a_table():
    maker = WithFields(of_share, Body)
    assert TableReader().made(maker, {"share": 1, "places": [1], "count": 3}) == (
        1.0,
        [1.0],
        {"count": 3},
    )
    with pytest.raises(
        ConfigurationError,
        match=r"\[a\] has no 'cuont'; it has share, places, "
        r"center, .*mean count",
    ):
        TableReader().made(maker, {"share": 1, "cuont": 3}, "a")
    with pytest.raises(ConfigurationError, match=r"\[a\]: share is missing"):
        TableReader().made(of_share, {}, "a")


def test_a_table_may_say_itself_what_it_is():
    def choose(
        kind: Any, table: Mapping[str, Any], where: str
    ) -> tuple[Any, Mapping[str, Any], str]:
        if kind is not Inner or "like" not in table:
            return kind, table, where
        return of_share, table["like"], f"{where}.like"

    reader = TableReader(choose=choose)
    assert reader.made(Outer, {**GOOD, "inner": {"like": {"share": 0.5}}}).inner == (0.5, None, {})
    with pytest.raises(ConfigurationError, match=r"\[inner.like\] has no 'shar'"):
        reader.made(Outer, {**GOOD, "inner": {"like": {"shar": 0.5}}})


@pytest.mark.parametrize("given", [[], 5, None, "x"])
def test_what_is_no_table_is_refused(given: Any):
    with pytest.raises(ConfigurationError, match=r"study\.json: must be a table, got"):
        TableReader("study.json").made(Outer, given)


def test_keys_of_a_later_version_can_be_passed_over():
    assert TableReader(passes_unknown=True).made(Outer, {**GOOD, "later": 1}).state == "done"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "the file is empty"),
        ("{", "cannot be read"),
        ('{"a": NaN}', "NaN is no JSON"),
        ('{"a": 1e999}', r"a: must be a finite number, got inf"),
        ('{"a": 1, "b": 2, "a": 3}', "the key 'a' occurs twice in one table"),
        ('{"a": ' + "9" * 5000 + "}", "cannot be read"),
        ('{"a": ' + "9" * 30 + "}", r"a: a whole number of more than 63 bits"),
        ("[" * 50_000 + "]" * 50_000, f"more than {DEEPEST} tables deep"),
        ("[" * 50 + "]" * 50, f"more than {DEEPEST} tables deep"),
        (r'{"a": "\u001b[2J"}', r"a: a control character in the text"),
        (r'{"\u0007": 1}', "is no name of a value"),
        (r'{"a": "\ud800"}', r"a: a control character in the text"),
        (json.dumps({"a" * 300: 1}), "is no name of a value"),
        (json.dumps({"a": "b" * 2000}), "larger than 1000 bytes"),
    ],
)
def test_what_can_neither_be_printed_nor_computed_with_is_refused(
    text: str, said: str, tmp_path: Path
):
    file = tmp_path / "x.json"
    file.write_text(text)
    with pytest.raises(ConfigurationError, match=said) as refused:
        json_of(file, "metrics", 1000 if "larger" in said else 10**6)
    assert str(refused.value).startswith("metrics '")
    assert str(refused.value).isprintable()


def test_a_document_is_read_as_it_stands(tmp_path: Path):
    content = {"[/red]k": [1.5, None, True, "two\nlines"], "ünï": {"a": -3}}
    (tmp_path / "x.json").write_text(json.dumps(content), encoding="utf-8")
    assert json_of(tmp_path / "x.json", "x") == content
    (tmp_path / "x.toml").write_text("a = inf\n[b]\nc = [1]\n")
    assert toml_of(tmp_path / "x.toml", "x") == {"a": float("inf"), "b": {"c": [1]}}


def test_only_regular_files_are_read(tmp_path: Path):
    (tmp_path / "zero").symlink_to("/dev/zero")
    os.mkfifo(tmp_path / "pipe")
    for name in ("zero", "pipe"):
        with pytest.raises(ConfigurationError, match=f"log '.*{name}': it is no regular file"):
            bytes_of(tmp_path / name, "log")
    (tmp_path / "sparse").touch()
    os.truncate(tmp_path / "sparse", 10**12)
    with pytest.raises(ConfigurationError, match="larger than 100 bytes"):
        bytes_of(tmp_path / "sparse", "log", 100)


@pytest.mark.parametrize("name", ["clean_barrel", "a-b/case_0007", "élan2"])
def test_names_that_a_folder_may_have(name: str):
    assert folder_name(name, "name") == name


@pytest.mark.parametrize(
    "name", ["../x", "/x", "a/../b", "a//b", "", "x\x1b", "[/bold]", "a b", "a" * 300, "-", ".", 5]
)
def test_names_that_no_folder_may_have(name: Any):
    with pytest.raises(ConfigurationError, match=r"^name: must be "):
        folder_name(name, "name")
