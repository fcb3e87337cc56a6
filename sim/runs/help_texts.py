"""Help texts of options: the strings that follow the fields of a dataclass in its source."""

import ast
import sys
from collections.abc import Mapping
from functools import cache
from itertools import pairwise
from pathlib import Path


def help_texts(kind: type) -> dict[str, str]:
    """Texts that follow the fields of a dataclass and of its bases, by field."""
    texts: dict[str, str] = {}
    for base in reversed(kind.__mro__[:-1]):
        texts |= vars(base).get("abouts", {})
        file = getattr(sys.modules.get(base.__module__), "__file__", None)
        body = None if file is None else _classes(file).get(base.__qualname__)
        if body is None:  # typed in at a prompt, or made by a function
            continue

        for declared, below in pairwise(body.body):
            match declared, below:
                case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(
                    value=ast.Constant(value=str(text))
                ):
                    texts[name] = " ".join(text.split())

    return texts


@cache
def _classes(file: str) -> Mapping[str, ast.ClassDef]:
    """Source of each class in a module's file, read once, because `inspect.getsource` reads the
    file for each class.
    """
    try:
        tree = ast.parse(Path(file).read_text(encoding="utf-8"))
    except (OSError, SyntaxError):  # source of a plug-in that was changed after its import
        return {}
    return {node.name: node for node in tree.body if isinstance(node, ast.ClassDef)}
