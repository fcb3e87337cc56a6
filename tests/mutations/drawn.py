"""Mutants drawn at random from the source: every place where one of these operators applies is as
likely as another.

Operators: comparisons turned or made (un)strict, + and -, * and /, factors of `@` swapped, sign
dropped, numbers moved by one or scaled or negated, booleans flipped, `.T` dropped, `and` and `or`,
conditions negated, the first two arguments or returned values swapped, a statement dropped.
Strings, annotations, imports, decorators and messages are left alone.
"""

import ast
import copy
import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from reach import ROOMS

_COMPARED = {
    ast.Lt: (ast.LtE, ast.Gt),
    ast.LtE: (ast.Lt, ast.GtE),
    ast.Gt: (ast.GtE, ast.Lt),
    ast.GtE: (ast.Gt, ast.LtE),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
_COMBINED = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Pow: ast.Mult,
}


@dataclass(frozen=True, slots=True)
class Mutant:
    """One change of one file, and the text around it for people."""

    file: str
    line: int
    old: str
    new: str
    text: str  # of the whole file as changed


def _changes(node: ast.AST) -> Iterator[ast.AST]:
    """What may stand in place of `node`."""

    def changed(**fields: object) -> ast.AST:
        other = copy.deepcopy(node)
        for name, field in fields.items():
            setattr(other, name, field)
        return other

    match node:
        case ast.Compare(ops=[op]):
            yield from (changed(ops=[other()]) for other in _COMPARED[type(op)])
        case ast.BinOp(op=ast.MatMult(), left=left, right=right):
            yield changed(left=right, right=left)
        case ast.BinOp(op=op) if type(op) in _COMBINED:
            yield changed(op=_COMBINED[type(op)]())
        case ast.UnaryOp(op=ast.USub() | ast.Not(), operand=operand):
            yield operand
        case ast.Constant(value=bool(value)):
            yield changed(value=not value)
        case ast.Constant(value=int(value)):
            yield from (changed(value=value + 1), changed(value=value - 1))
        case ast.Constant(value=float(value)):
            yield from (
                changed(value=1.5 * value if value else 1.0),
                changed(value=-value if value else -1.0),
            )
        case ast.Attribute(attr="T", value=value):
            yield value
        case ast.BoolOp(op=op):
            yield changed(op=ast.Or() if isinstance(op, ast.And) else ast.And())
        case ast.IfExp(test=test):
            yield changed(test=ast.UnaryOp(op=ast.Not(), operand=test))
        case ast.Call(args=[first, second, *rest]) if not any(
            isinstance(a, ast.Starred) for a in (first, second)
        ):
            yield changed(args=[second, first, *rest])
        case ast.Return(value=ast.Tuple(elts=[first, second, *rest])):
            yield changed(value=ast.Tuple(elts=[second, first, *rest], ctx=ast.Load()))
        case ast.If(test=test) | ast.While(test=test):
            yield ast.UnaryOp(op=ast.Not(), operand=test)  # in place of the test
        case ast.AugAssign() | ast.Expr(value=ast.Call()) | ast.Raise():
            yield ast.Pass()
        case ast.Assign(targets=[ast.Attribute() | ast.Subscript()]):
            yield ast.Pass()


def _visited(node: ast.AST) -> Iterator[ast.AST]:
    """All nodes below that may be changed."""
    if isinstance(
        node, (ast.Import, ast.ImportFrom, ast.JoinedStr, ast.Global, ast.Nonlocal, ast.Assert)
    ):
        return
    yield node
    if isinstance(node, ast.Raise):
        return
    left_alone = {id(getattr(node, "annotation", None)), id(getattr(node, "returns", None))}
    left_alone.update(map(id, getattr(node, "decorator_list", ())))
    for child in ast.iter_child_nodes(node):
        if id(child) not in left_alone:
            yield from _visited(child)


@dataclass(frozen=True, slots=True)
class _Place:
    """A piece of a file's source, in bytes, and what may stand there."""

    file: str
    line: int
    start: int
    end: int
    others: tuple[ast.AST, ...]


def _places(root: Path, file: str) -> Iterator[_Place]:
    source = (root / file).read_bytes()
    starts = [0, *itertools.accumulate(map(len, source.splitlines(keepends=True)))]
    for node in _visited(ast.parse(source)):
        at = node.test if isinstance(node, (ast.If, ast.While)) else node
        if others := tuple(_changes(node)):
            assert isinstance(at, (ast.expr, ast.stmt))
            assert at.end_lineno is not None
            assert at.end_col_offset is not None
            start, end = (
                starts[at.lineno - 1] + at.col_offset,
                starts[at.end_lineno - 1] + at.end_col_offset,
            )
            yield _Place(file, at.lineno, start, end, others)


def _mutant(root: Path, place: _Place, other: ast.AST) -> Mutant | None:
    """The changed file; None where it would say the same."""
    source = (root / place.file).read_bytes()
    old = source[place.start : place.end].decode()
    text = ast.unparse(ast.fix_missing_locations(other))
    if isinstance(other, ast.expr):
        text = f"({text})"
    new = source[: place.start] + text.encode() + source[place.end :]
    if ast.dump(ast.parse(new)) == ast.dump(ast.parse(source)):
        return None
    return Mutant(place.file, place.line, old, text, new.decode())


def files(root: Path) -> list[str]:
    """Every source file of the rooms."""
    return sorted(str(p.relative_to(root)) for room in ROOMS for p in (root / room).rglob("*.py"))


def draw(root: Path, count: int, seed: int) -> list[Mutant]:
    """`count` different mutants over all rooms under `seed`, places weighing alike whatever may be
    done to them.
    """
    places = [position for file in files(root) for position in _places(root, file)]
    rng = np.random.default_rng(seed)
    drawn = []
    for i in rng.permutation(len(places)):
        others = places[i].others
        mutant = _mutant(root, places[i], others[int(rng.integers(len(others)))])
        if mutant is not None:
            drawn.append(mutant)
        if len(drawn) == count:
            break
    return drawn
