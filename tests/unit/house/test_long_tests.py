"""Tests that are too long for the suite name the test of the suite that guards the same code."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
UNGUARDED = 65  # marks that say no guard: none is added
MARK = re.compile(r"\blong\b")  # without the word a file has no such mark, and is not parsed


def long_marks(tree: ast.AST) -> Iterator[ast.Attribute | ast.Call]:
    """Each `pytest.mark.long` of a file, with its arguments where it is called."""
    called = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and is_long(node.func)]
    yield from called
    bare = {id(node.func) for node in called}
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and is_long(node) and id(node) not in bare:
            yield node


def is_long(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.Attribute)
        and node.attr == "long"
        and ast.unparse(node) == "pytest.mark.long"
    )


@cache
def tree_of(file: Path) -> ast.Module:
    """Syntax of a test file."""
    return ast.parse(file.read_text(encoding="utf-8"))


@cache
def marks() -> dict[str, list[str]]:
    """Guards that the marks of each test file name; an empty one for a mark without."""
    marked: dict[str, list[str]] = {}
    for file in sorted((ROOT / "tests").rglob("test_*.py")):
        if not MARK.search(file.read_text(encoding="utf-8")):
            continue
        tree = tree_of(file)
        constants = {
            target.id: node.value
            for node in tree.body
            if isinstance(node, ast.Assign)
            for target in node.targets
            if isinstance(target, ast.Name)
        }
        for mark in long_marks(tree):
            keywords = mark.keywords if isinstance(mark, ast.Call) else []
            words = {
                word.arg: ast.literal_eval(constants.get(ast.unparse(word.value), word.value))
                for word in keywords
            }
            assert words.keys() <= {"guarded_by"}, file
            marked.setdefault(file.relative_to(ROOT).as_posix(), []).append(
                words.get("guarded_by", "")
            )
    return marked


def is_plain(guard: str) -> bool:
    """True if the test is there, and runs in the suite at least for some of its parameters."""
    name, _, function = guard.partition("::")
    file = ROOT / name
    if not file.is_file():
        return False
    for node in ast.walk(tree_of(file)):
        if isinstance(node, ast.FunctionDef) and node.name == function.partition("[")[0]:
            return not any(
                is_long(part)
                for mark in node.decorator_list
                for part in (mark, getattr(mark, "func", mark))
            )
    return False


def test_the_guard_of_a_long_test_is_a_test_of_the_suite():
    guards = {guard for named in marks().values() for guard in named if guard}
    assert {guard for guard in guards if not is_plain(guard)} == set()


def test_no_further_long_test_is_without_a_guard():
    assert sum(guard == "" for named in marks().values() for guard in named) <= UNGUARDED
