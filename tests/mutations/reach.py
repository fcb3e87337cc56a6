"""Which tests reach a name: a graph of top-level names over all files, read from the source alone.

A node is (module, top-level name); a class is one node. What a statement mentions are its edges:
names of its own file, names that it imports, attributes of modules, fixtures by their parameters,
and modules named by a string (`uuv.models.load("uuv_puma")`, `script("clean_barrel")`,
`uncompiled("uuv.calib.kernels")`). It is a guide to what is worth running, not a proof.
"""

import ast
from collections import defaultdict, deque
from dataclasses import dataclass, field
from pathlib import Path

ROOMS = ("models", "sim", "controllers", "perception", "calib")
Node = tuple[str, str]


@dataclass(slots=True)
class _Module:
    name: str
    path: str
    tree: ast.Module
    names: dict[str, list[ast.stmt]] = field(default_factory=lambda: defaultdict(list))
    imports: dict[str, str] = field(default_factory=dict)  # local name -> dotted origin


def _defined(statement: ast.stmt) -> list[str]:
    if isinstance(statement, (ast.FunctionDef, ast.ClassDef, ast.AsyncFunctionDef)):
        return [statement.name]
    return [
        n.id
        for n in ast.walk(statement)
        if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)
    ]


class Reach:
    """The graph of the files under `root`."""

    def __init__(self, root: Path) -> None:
        self._modules: dict[str, _Module] = {}
        for room in (*ROOMS, "uuv", "scripts", "tests"):
            for path in sorted((root / room).rglob("*.py")):
                self._read(root, path)
        self._by_stem: dict[str, list[str]] = defaultdict(list)
        for name in self._modules:
            self._by_stem[name.rpartition(".")[2]].append(name)
        self._users: dict[Node, set[Node]] = defaultdict(set)
        for module in self._modules.values():
            for name, statements in module.names.items():
                for statement in statements:
                    for used in self._mentioned(module, statement):
                        self._users[used].add((module.name, name))
                    # done on import, for all that is imported
                    if isinstance(statement, (ast.For, ast.Expr)):
                        self._users[(module.name, name)].update(
                            (module.name, other) for other in module.names
                        )

    def _read(self, root: Path, path: Path) -> None:
        relative = path.relative_to(root)
        parts = relative.with_suffix("").parts
        if parts[0] in ROOMS:  # as they import one another
            parts = ("uuv", *parts)
        parts = parts[1:] if parts[0] == "scripts" else parts
        name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        module = _Module(name, str(relative), ast.parse(path.read_text()))
        for statement in module.tree.body:
            for defined in _defined(statement) or ["<module>"]:
                module.names[defined].append(statement)
        for node in ast.walk(module.tree):
            if isinstance(node, ast.Import):
                for alias in node.names:
                    module.imports[alias.asname or alias.name.partition(".")[0]] = (
                        alias.name if alias.asname else alias.name.partition(".")[0]
                    )
            elif isinstance(node, ast.ImportFrom) and node.module:
                for alias in node.names:
                    module.imports[alias.asname or alias.name] = f"{node.module}.{alias.name}"
        self._modules[name] = module

    def _find(self, dotted: str) -> list[Node]:
        """Nodes that a dotted name may mean: a module's name, a name behind a package's lazy door,
        a whole module.
        """
        module = dotted
        while module and module not in self._modules:
            module = module.rpartition(".")[0]
        if not module:  # tests and scripts import their neighbours by a bare name
            first, _, rest = dotted.partition(".")
            nodes = [
                n
                for n in self._by_stem.get(first, ())
                if self._modules[n].path.startswith(("tests", "scripts"))
            ]
            return [node for n in nodes for node in self._find(f"{n}.{rest}" if rest else n)]
        name = dotted[len(module) + 1 :].partition(".")[0]
        if not name:
            return [(module, n) for n in self._modules[module].names]
        if name in self._modules[module].names:
            return [(module, name)]
        if name in self._modules[module].imports:
            return self._find(self._modules[module].imports[name])
        return [
            (m.name, name)
            for m in self._modules.values()
            if m.name.startswith(f"{module}.") and name in m.names
        ]

    def _mentioned(self, module: _Module, statement: ast.stmt) -> set[Node]:
        nodes: set[Node] = set()
        for node in ast.walk(statement):
            dotted = ""
            if isinstance(node, ast.Call):
                # A module that is handed on, as a callback's source is
                for handed in (*node.args, *(keyword.value for keyword in node.keywords)):
                    origin = (
                        module.imports.get(handed.id, "") if isinstance(handed, ast.Name) else ""
                    )
                    if origin in self._modules:
                        nodes.update(self._find(origin))
            elif isinstance(node, ast.Attribute):
                parts = [node.attr]
                inner = node.value
                while isinstance(inner, ast.Attribute):
                    parts.append(inner.attr)
                    inner = inner.value
                if (
                    isinstance(inner, ast.Name)
                    and module.imports.get(inner.id, "") in self._modules
                ):
                    dotted = ".".join([module.imports[inner.id], *reversed(parts)])
            elif isinstance(node, (ast.Name, ast.arg)):
                name = node.id if isinstance(node, ast.Name) else node.arg
                if name in module.names:
                    nodes.add((module.name, name))
                elif name in module.imports and module.imports[name] not in self._modules:
                    dotted = module.imports[name]
                elif isinstance(node, ast.arg) and module.name.startswith("tests."):
                    nodes.update(
                        (m, name)
                        for m in self._by_stem["conftest"]
                        if name in self._modules[m].names
                    )
            elif (
                isinstance(node, ast.Constant)
                and isinstance(node.value, str)
                and node.value in self._modules
            ):
                dotted = node.value  # `uncompiled("uuv.controllers.ik.sweeps")`
            elif (
                isinstance(node, ast.Constant)
                and isinstance(node.value, str)
                and node.value.isidentifier()
            ):
                for named in self._by_stem.get(node.value, ()):
                    if self._modules[named].path.startswith(("models/", "scripts/")):
                        nodes.update(self._find(named))
            if dotted:
                nodes.update(self._find(dotted))
        return nodes

    def names_at(self, path: str, line: int) -> list[Node]:
        """The top-level names that the statement on this line of the file defines."""
        module = next(m for m in self._modules.values() if m.path == path)
        return [
            (module.name, name)
            for name, statements in module.names.items()
            for s in statements
            if min([s.lineno, *(d.lineno for d in getattr(s, "decorator_list", ()))])
            <= line
            <= (s.end_lineno or 0)
        ]

    def tests(self, path: str, line: int) -> list[str]:
        """Tests (pytest's ids) that reach this line: those of the file's own name first, then the
        nearest ones.
        """
        start = self.names_at(path, line)
        steps = dict.fromkeys(start, 0)
        queue = deque(start)
        while queue:
            node = queue.popleft()
            for user in self._users[node]:
                if user not in steps:
                    steps[user] = steps[node] + 1
                    queue.append(user)
        stem = Path(path).stem.removesuffix("_kernel")
        mirror = f"tests/unit/{Path(path).parent.as_posix()}/"
        ranked = []
        for (name, top), count in steps.items():
            module = self._modules[name]
            if top.startswith("test_") and Path(module.path).name.startswith("test_"):
                of_mirror = stem in Path(module.path).stem
                whole = "integration" in module.path or "baseline" in module.path
                ranked.append(
                    (
                        not of_mirror,
                        whole,
                        not module.path.startswith(mirror),
                        count,
                        module.path,
                        top,
                    )
                )
        return [f"{path}::{top}" for *_, path, top in sorted(ranked)]
