"""One reader and one writer of documents: no other module parses JSON, TOML or YAML, or writes TOML
by hand.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
PRODUCT = ("uuv", "models", "sim", "controllers", "perception", "calib")
DOCUMENTS = "sim/interfaces/documents.py"
PARSERS = {
    "tomllib",
    "tomli",
    "tomli_w",
    "tomlkit",
    "toml",
    "yaml",
    "ruamel",
    "json5",
    "orjson",
    "simplejson",
}
ALLOWED = {
    "uuv/experiment/harness.py": "a row goes through JSON's types and back, as its file will have "
    "it; no document",
    "uuv/experiment/row_table.py": "cells of a table of rows, text of JSON in Parquet that the "
    "study wrote itself",
}
# with a value put in
TOML_LINE = re.compile(r"(?:#.*\n)?(?:\[\[?[\w.{}]*\{\}[\w.{}]*\]\]?|[\w{}.]+ = .*\{\}.*)\n?")


def product(*more: str) -> Iterator[Path]:
    for room in (*PRODUCT, *more):
        for path in sorted((ROOT / room).rglob("*.py")):
            if not any(folder.is_symlink() for folder in path.parents):
                yield path


def parsers_in(text: str) -> set[str]:
    """What parses documents in a module: packages, and `load` and `loads` of json."""
    used: set[str] = set()
    if not any(word in text for word in ("json", *PARSERS)):
        return used
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            used |= {name.name.partition(".")[0] for name in node.names} & PARSERS
        elif isinstance(node, ast.ImportFrom):
            module = (node.module or "").partition(".")[0]
            used |= {module} & PARSERS
            if module == "json":
                used |= {f"json.{name.name}" for name in node.names} & {
                    "json.load",
                    "json.loads",
                    "json.JSONDecoder",
                }
        elif (
            isinstance(node, ast.Attribute)
            and isinstance(node.value, ast.Name)
            and node.value.id == "json"
        ):
            used |= {f"json.{node.attr}"} & {"json.load", "json.loads", "json.JSONDecoder"}
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith("import_module"):
            used |= {
                str(word.value) for word in node.args if isinstance(word, ast.Constant)
            } & PARSERS
    return used


def toml_by_hand(text: str) -> set[str]:
    """Texts with values put in that are `[table]` or `key = value`, in a module that speaks of
    TOML.
    """
    if "toml" not in text.lower():
        return set()
    lines: set[str] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.JoinedStr):
            pieces = [
                part.value if isinstance(part, ast.Constant) else "{}" for part in node.values
            ]
            lines |= {"".join(map(str, pieces))}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            lines |= {node.value}  # for `format`
    return {line for line in lines if TOML_LINE.fullmatch(line)}


def test_documents_are_parsed_in_one_module():
    parsers = {
        path.relative_to(ROOT).as_posix(): parsers_in(path.read_text(encoding="utf-8"))
        for path in product()
    }
    assert {"json.loads", "tomllib", "yaml", "tomlkit"} <= parsers.pop(DOCUMENTS)
    second = {name: parsers for name, parsers in parsers.items() if parsers}
    assert second.keys() <= ALLOWED.keys(), {
        name: second[name] for name in second if name not in ALLOWED
    }
    assert ALLOWED.keys() <= second.keys(), "an exception that is none: take it out of the list"


@pytest.mark.parametrize(
    "text",
    [
        "import yaml",
        "from yaml import safe_load",
        "def f(text):\n    import tomllib\n    return tomllib.loads(text)",
        "import json\nx = json.loads('1')",
        "import json\nx = json.load(stream)",
        "from json import loads",
        "import importlib\nimportlib.import_module('yaml')",
    ],
)
def test_a_second_reader_is_seen(text: str):
    assert parsers_in(text)


def test_what_writes_json_is_no_reader():
    assert not parsers_in("import json\nx = json.dumps(1)")


def test_no_module_writes_toml_by_hand():
    modules = {
        path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
        for path in product("scripts")
    }
    written = {name: toml_by_hand(text) for name, text in modules.items() if name != DOCUMENTS}
    assert {name: lines for name, lines in written.items() if lines} == {}


@pytest.mark.parametrize(
    "text",
    ['f"[{name}]"', 'f"[[{name}{key}]]\\n"', 'f"{key} = {text(value)}"', '"[{}]".format(key)'],
)
def test_toml_by_hand_is_seen(text: str):
    assert toml_by_hand(f"{text}  # TOML")
