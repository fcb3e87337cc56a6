"""What a page of code may hold, counted in its syntax tree: paragraphs, columns, names and sizes.

Each rule gives offences, a place and an amount; a file that obeys all of them has none.
"""

import ast
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from source_tree import nodes, parsed

AIR = 8  # blank and comment lines for 100 lines of code in a file's functions, at least
UNBROKEN = 25  # lines of a function without a blank line or a comment, at most
COLUMNS, PARAMETERS, FIELDS = 100, 8, 20
CLASS_LINES, FUNCTION_LINES, FILE_LINES = 250, 60, 500
EMPTY_NAMES = frozenset(
    ("found", "said", "told", "given", "made", "own", "there", "wanted", "one", "each", "now")
)
KERNEL_DECORATORS = frozenset(("kernel", "jit", "njit", "inline", "inlined", "c_function"))

Function = ast.FunctionDef | ast.AsyncFunctionDef
Definition = (ast.FunctionDef, ast.AsyncFunctionDef)


@dataclass(frozen=True, slots=True)
class Offence:
    """A place that breaks a rule."""

    line: int
    amount: int  # by which the rule is broken: the sum over a folder may not grow
    what: str


@dataclass(frozen=True, slots=True)
class Page:
    """A file as its rules see it."""

    tree: ast.Module
    nodes: Sequence[ast.AST]  # all of the tree
    lines: list[str]
    documented: frozenset[int]  # numbers of the lines of docstrings


def too_little_air(page: Page) -> Iterator[Offence]:
    """Blank and comment lines that a file's functions lack."""
    pauses = code = 0
    for function in _outer_functions(page.tree):
        for _, line in _body_lines(page, function):
            pauses += _is_pause(line)
            code += not _is_pause(line)

    lacking = AIR * code // 100 - pauses
    if lacking > 0:
        yield Offence(1, lacking, f"{pauses} blank and comment lines in {code} lines of functions")


def walls(page: Page) -> Iterator[Offence]:
    """Runs of lines in a function without a pause."""
    for function in _outer_functions(page.tree):
        length = 0
        for number, line in [*_body_lines(page, function), (function.end_lineno or 0, "")]:
            if not _is_pause(line):
                length += 1
                continue
            if length > UNBROKEN:
                yield Offence(
                    number - length, 1, f"{length} lines of {function.name} without a pause"
                )
            length = 0


def long_lines(page: Page) -> Iterator[Offence]:
    """Lines that a reader has to scroll for."""
    for number, line in enumerate(page.lines, start=1):
        if len(line) > COLUMNS:
            yield Offence(number, 1, f"{len(line)} columns")


def two_thoughts(page: Page) -> Iterator[Offence]:
    """Assignments of several values to several names; a swap is one thought."""
    for node in page.nodes:
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Tuple):
            target = node.targets[0]
            if isinstance(target, ast.Tuple) and _words(target.elts) != _words(node.value.elts):
                yield Offence(node.lineno, 1, ast.unparse(target) + " = ...")


def empty_names(page: Page) -> Iterator[Offence]:
    """Names that say nothing of what they hold."""
    for node in page.nodes:
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            name, line = node.id, node.lineno
        elif isinstance(node, ast.arg):
            name, line = node.arg, node.lineno
        elif isinstance(node, (*Definition, ast.ClassDef)):
            name, line = node.name, node.lineno
        else:
            continue
        if name.strip("_") in EMPTY_NAMES:
            yield Offence(line, 1, name)


def many_parameters(page: Page) -> Iterator[Offence]:
    """Parameters of a function beyond those allowed; `self` and `cls` do not count."""
    for node in page.nodes:
        if isinstance(node, Definition):
            names = [arg.arg for arg in (*node.args.posonlyargs, *node.args.args)]
            number = len(names) - (names[:1] in (["self"], ["cls"])) + len(node.args.kwonlyargs)
            yield from _excess(node, number, PARAMETERS, "parameters")


def many_fields(page: Page) -> Iterator[Offence]:
    """Fields of a class beyond those allowed."""
    for node in page.nodes:
        if isinstance(node, ast.ClassDef):
            fields = [statement for statement in node.body if isinstance(statement, ast.AnnAssign)]
            number = sum("ClassVar" not in ast.unparse(field.annotation) for field in fields)
            yield from _excess(node, number, FIELDS, "fields")


def long_classes(page: Page) -> Iterator[Offence]:
    """Lines of a class beyond those allowed."""
    for node in page.nodes:
        if isinstance(node, ast.ClassDef):
            yield from _excess(node, _length(page, node), CLASS_LINES, "lines")


def long_functions(page: Page) -> Iterator[Offence]:
    """Lines of a function beyond those allowed; those of compiled kernels do not count."""
    for node in page.nodes:
        if isinstance(node, Definition) and not _is_kernel(node):
            inner = [
                nested
                for nested in ast.walk(node)
                if isinstance(nested, Definition) and _is_kernel(nested)
            ]
            length = _length(page, node) - sum(_length(page, kernel) for kernel in inner)
            yield from _excess(node, length, FUNCTION_LINES, "lines")


def long_files(page: Page) -> Iterator[Offence]:
    """Lines of a file beyond those allowed."""
    length = _count(page, 1, len(page.lines))
    if length > FILE_LINES:
        yield Offence(1, length - FILE_LINES, f"{length} lines of {FILE_LINES}")


def asserted_types(page: Page) -> Iterator[Offence]:
    """`assert isinstance`, which is no branch: the object is asked, or its field has the type."""
    for node in page.nodes:
        if isinstance(node, ast.Assert):
            calls = [call.func for call in ast.walk(node.test) if isinstance(call, ast.Call)]
            if any(isinstance(called, ast.Name) and called.id == "isinstance" for called in calls):
                yield Offence(node.lineno, 1, ast.unparse(node))


RULES: dict[str, Callable[[Page], Iterator[Offence]]] = {  # by the key in the ratchets
    "air": too_little_air,
    "walls": walls,
    "columns": long_lines,
    "tuples": two_thoughts,
    "names": empty_names,
    "parameters": many_parameters,
    "fields": many_fields,
    "class-lines": long_classes,
    "function-lines": long_functions,
    "file-lines": long_files,
    "asserts": asserted_types,
}


@cache
def offences(path: Path) -> dict[str, list[Offence]]:
    """Offences of a file against each rule, in the order of its lines."""
    tree = parsed(path)
    lines = path.read_text(encoding="utf-8").splitlines()
    page = Page(tree, nodes(path), lines, frozenset(_docstring_lines(nodes(path))))
    return {
        name: sorted(rule(page), key=lambda offence: offence.line) for name, rule in RULES.items()
    }


def _excess(node: Function | ast.ClassDef, number: int, most: int, unit: str) -> Iterator[Offence]:
    if number > most:
        yield Offence(node.lineno, number - most, f"{node.name}: {number} {unit}, at most {most}")


def _docstring_lines(nodes: Iterable[ast.AST]) -> Iterator[int]:
    for node in nodes:
        if (
            isinstance(node, (*Definition, ast.ClassDef, ast.Module))
            and ast.get_docstring(node, clean=False) is not None
        ):
            yield from range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1)


def _length(page: Page, node: Function | ast.ClassDef) -> int:
    return _count(page, node.lineno, node.end_lineno or node.lineno)


def _count(page: Page, first: int, last: int) -> int:
    """Lines of code from `first` to `last`: air, comments and docstrings make nothing longer."""
    return sum(
        number not in page.documented and not _is_pause(page.lines[number - 1])
        for number in range(first, last + 1)
    )


def _words(nodes: list[ast.expr]) -> set[str]:
    return {ast.unparse(node) for node in nodes}


def _is_kernel(node: Function) -> bool:
    decorators = [
        decorator.func if isinstance(decorator, ast.Call) else decorator
        for decorator in node.decorator_list
    ]
    names = [ast.unparse(decorator).rpartition(".")[2].lstrip("_") for decorator in decorators]
    return not KERNEL_DECORATORS.isdisjoint(names)


def _is_pause(line: str) -> bool:
    return not line.strip() or line.lstrip().startswith("#")


def _outer_functions(node: ast.AST) -> Iterator[Function]:
    """Functions and methods that stand in no other function."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, Definition):
            yield child
        else:
            yield from _outer_functions(child)


def _body_lines(page: Page, function: Function) -> Iterator[tuple[int, str]]:
    """Numbers and lines of a function's body, docstrings left out."""
    for number in range(function.body[0].lineno, (function.end_lineno or 0) + 1):
        if number not in page.documented:
            yield number, page.lines[number - 1]
