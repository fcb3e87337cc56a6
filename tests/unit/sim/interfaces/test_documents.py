"""Documents are read whole or refused in one line, and what is written is read back bit by bit."""

import math
import struct
import time
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uuv.sim.interfaces.documents import (
    DEEPEST,
    checked,
    parsed_toml,
    parsed_yaml,
    toml_of,
    toml_text,
    toml_value,
    yaml_of,
    yaml_text,
)
from uuv.sim.interfaces.errors import ConfigurationError

BOMB = "\n".join(
    ["a0: &a0 [1, 1, 1]", *(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 9))]
)


def test_a_yaml_document_is_read_as_it_stands():
    text = """
names: [hull, 'on', 2026-07-01, ~]
1: one  # a key is what is written
numbers: {a: 1e-3, b: -2.5E+2, c: 3, d: .inf, e: 0x10, f: "1e-3", g: .5e1}
true_word: !!str true
shared: &arm {kind: t200}
again: *arm
more: {<<: *arm, kind: other, size: 2}
"""
    assert parsed_yaml(text, "x") == {
        "names": ["hull", "on", "2026-07-01", None],
        "1": "one",
        "numbers": {"a": 1e-3, "b": -250.0, "c": 3, "d": math.inf, "e": 16, "f": "1e-3", "g": 5.0},
        "true_word": "true",
        "shared": {"kind": "t200"},
        "again": {"kind": "t200"},
        "more": {"kind": "other", "size": 2},
    }
    assert parsed_yaml("# nothing\n", "x") is None


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "the file is empty"),
        ("a: [1, 2", r"cannot be read \(did not find expected .* \(at line 2, column 1\)"),
        ("a: 1\na: 2", r"the key 'a' occurs twice in one table \(at line 2, column 1\)"),
        ("a: {b: 1, b: 2}", r"the key 'b' occurs twice in one table"),
        ("a: " + "[" * 40 + "]" * 40, rf"more than {DEEPEST} tables deep \(at line 1, column "),
        ("a: " + "[" * 50_000, rf"more than {DEEPEST} tables deep \(at line 1, column "),
        ("a: " + "{b: " * 50_000, rf"more than {DEEPEST} tables deep \(at line 1, column "),
        (BOMB, r"the aliases unfold to more than 1000000 values \(at line 7"),
        ("a: &a [*a]", r"the alias 'a' has no anchor before it, or is inside its own anchor"),
        ("a: *b", r"'b' has no anchor before it"),
        ("a: 1\n---\nb: 2", "more than one document"),
        ("a: !!python/object:os.system x", "the tag '!!python/object:os.system' is not supported"),
        ("a: !!binary aGVsbG8=", "the tag '!!binary' is not supported"),
        ("!!set {a, b}", "the tag '!!set' is not supported"),
        ("a: !!int x", "'x' is not a valid value of its tag"),
        ("? [1]\n: 2", r"a key must be a scalar, not a list or table \(at line 1"),
        ("<<: 5", "<< takes a table, or several, got 5"),
        ("a: [1, .nan]", r"a\[1\]: must not be NaN"),
        ("a: " + "9" * 30, "a: a whole number of more than 63 bits"),
        ('a: "\\e[2J"', "a: a control character in the text"),
        ('"\\a": 1', "is no name of a value"),
        ("a: 1\0", "cannot be read"),
        ("x" * 2000, "larger than 1000 bytes"),
    ],
)
def test_a_yaml_document_that_is_refused(text: str, said: str, tmp_path: Path):
    file = tmp_path / "x.yaml"
    file.write_text(text)
    with pytest.raises(ConfigurationError, match=said) as refused:
        yaml_of(file, "water file", 1000 if "larger" in said else 10**6)
    assert str(refused.value).startswith("water file '")
    assert str(refused.value).isprintable()


def test_a_full_yaml_file_is_read_in_seconds():
    text = "".join(f"k{i}: {{a: [1, 2, 3.5], b: text}}\n" for i in range(30_000))
    began = time.process_time()
    assert len(parsed_yaml(text, "x")) == 30_000
    assert time.process_time() - began < 20.0  # measured 0.9


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a = nan", "a: must not be NaN"),
        ("a = 1\na = 2", "cannot be read .*Cannot overwrite a value"),
        ("a = " + "[" * 40 + "]" * 40, rf"a: more than {DEEPEST} tables deep"),
        ("a = [1", "cannot be read"),
        ('a = "\\u001b"', "a: a control character"),
        ("\xff".encode("latin-1"), "not text in UTF-8"),
    ],
)
def test_a_toml_document_that_is_refused(text: str | bytes, said: str, tmp_path: Path):
    file = tmp_path / "x.toml"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ConfigurationError, match=said) as refused:
        toml_of(file, "campaign")
    assert str(refused.value).startswith("campaign '")


def test_a_value_as_it_is_typed():
    assert toml_value("[1, 2.5]") == [1, 2.5]
    assert toml_value("four") == "four"
    assert toml_value("4\nname = 5") == "4\nname = 5"  # the second line would be lost
    assert toml_value("[" * 50_000) == "[" * 50_000
    assert toml_value("9" * 5000) == "9" * 5000
    with pytest.raises(ConfigurationError, match=r"site.current\[0\]: must not be NaN"):
        checked(toml_value("[nan, 0, 0]"), "site.current")


def drawn(rng: np.random.Generator, depth: int = 0) -> Any:
    """A value of a document: every kind of number, text with every kind of character, tables and
    lists.
    """
    kind = int(rng.integers(8 if depth < 3 else 5))
    if kind == 0:
        # any bits, infinite ones too
        return struct.unpack("d", struct.pack("Q", int(rng.integers(2**63))))[0]
    if kind == 1:
        return int(rng.integers(-(2**62), 2**62))
    if kind == 2:
        return bool(rng.integers(2))
    if kind == 3:
        words = [
            "1e3",
            "1",
            "true",
            "null",
            "~",
            "nan",
            "2026-07-01",
            "a: b",
            "#x",
            "'",
            '"',
            "\\",
            "[",
            "ünï→",
            " x ",
        ]
        return str(rng.choice(words)) + "\t\n"[: int(rng.integers(3))]
    if kind == 4:
        return float(rng.choice([0.0, -0.0, 0.1, 1e-300, -1e22, 5e-324, math.inf, -math.inf]))
    if kind == 5:
        return {
            f"k{i} {rng.choice(['a', 'b.c', '1', ''])}": drawn(rng, depth + 1)
            for i in range(rng.integers(4))
        }
    return [drawn(rng, depth + 1) for _ in range(rng.integers(4))]


def bits(value: Any) -> Any:
    """`value` with its floats as their bytes, and the order of its keys."""
    if isinstance(value, float):
        return struct.pack("d", value)
    if isinstance(value, dict):
        return [(key, bits(entry)) for key, entry in value.items()]
    return [bits(entry) for entry in value] if isinstance(value, list) else (type(value), value)


def without_nan(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: without_nan(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [without_nan(entry) for entry in value]
    return 0.5 if isinstance(value, float) and math.isnan(value) else value


def test_what_is_written_is_read_back_bit_by_bit(rng: np.random.Generator):
    for _ in range(150):
        table = without_nan({f"key_{i}": drawn(rng) for i in range(4)})
        assert bits(parsed_yaml(yaml_text(table), "x")) == bits(table)
        plain = {key: entry for key, entry in table.items() if not holds_tables(entry)}
        assert bits(parsed_toml(toml_text(plain), "x")) == bits(plain)
        assert parsed_toml(toml_text(table), "x") == table  # tables stand behind the other keys


def holds_tables(value: Any) -> bool:
    return isinstance(value, dict) or (isinstance(value, list) and any(map(holds_tables, value)))


def test_the_layout_of_toml_is_that_of_a_person():
    table = {
        "seed": np.int64(3),
        "site": {"current": np.array([0.15, 0.0, -0.0]), "object": {"kind": "Barrel"}},
        "perturbations": [
            {"kind": "Water", "spread": np.float64(0.3)},
            {"kind": "Pad", "stiffness": math.inf},
        ],
        "path": ((0.0, 1.0), (1.0, 2.5)),
    }
    text = toml_text(table, "SI units\nand radians")
    assert text == (
        "# SI units\n# and radians\nseed = 3\npath = [[0.0, 1.0], [1.0, 2.5]]\n\n"
        "[site]\ncurrent = [0.15, 0.0, -0.0]\n\n"
        '[site.object]\nkind = "Barrel"\n\n[[perturbations]]\nkind = "Water"\nspread = '
        "0.3\n\n[[perturbations]]\n"
        'kind = "Pad"\nstiffness = inf\n'
    )
    assert tomllib.loads(f'{text}\n[[perturbations]]\nkind = "Gears"\n')["perturbations"][2] == {
        "kind": "Gears"
    }
