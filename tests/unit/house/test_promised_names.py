"""docs/api.md promises names: they are there, they are few, and documents and packages offer no
others.
"""

import ast
import importlib.util
import re
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from notebook_cells import cells, code_of
from uuv.cli.skeletons import SKELETONS

ROOT = Path(__file__).resolve().parents[3]
PAGE = ROOT / "docs" / "api.md"
MOST = 150  # names
# that hand out names
PACKAGES = ("uuv", "uuv.models", "uuv.perception", "uuv.calib", "uuv.environments")
DOCUMENTS = [
    ROOT / "README.md",
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "docs" / "examples").glob("*")),
    *sorted((ROOT / "docs" / "notebooks").glob("*.ipynb")),
]


def promised_names_of_site() -> ModuleType:
    """The site's reader of the page."""
    file = ROOT / "docs" / "site" / "promised_names.py"
    spec = importlib.util.spec_from_file_location("promised_names", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look there
    spec.loader.exec_module(module)
    return module


GROUPS = promised_names_of_site().groups_of(PAGE.read_text(encoding="utf-8"))
NAMES = [name for group in GROUPS for name in group.lines]


def needs_environments(name: str) -> bool:
    """Whether `name` is of a package that needs dm_control, and there is none."""
    return name.startswith("uuv.environments") and find_spec("dm_control") is None


def python_blocks(document: Path) -> list[str]:
    """Fenced Python of a document, the code of a notebook, or all of a Python file."""
    if document.suffix == ".ipynb":
        return ["\n".join(code_of(cell) for cell in cells(document) if cell["cell_type"] == "code")]
    text = document.read_text(encoding="utf-8")
    return (
        [text]
        if document.suffix == ".py"
        else re.findall(r"^```python\n(.*?)^```", text, flags=re.M | re.S)
    )


def skeletons() -> list[Any]:
    """What `uuv new` writes, parts and their tests."""
    texts = [
        (f"{kind} {part}", getattr(it, part))
        for kind, it in SKELETONS.items()
        for part in ("part", "test")
    ]
    return [pytest.param(text, id=name) for name, text in texts]


def is_module(name: str) -> bool:
    """Whether a dotted name below `uuv` is a file or a folder of code."""
    path = ROOT.joinpath(*name.split("."))
    return path.with_suffix(".py").is_file() or (path / "__init__.py").is_file()


def names_used(code: str) -> set[str]:
    """Dotted names of `uuv` that a piece of Python takes; of a module that it imports, the
    attributes.
    """
    tree = ast.parse(code)
    meaning: dict[str, str] = {}  # dotted name by local name
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "uuv":
            meaning |= {
                alias.asname or alias.name: f"{node.module}.{alias.name}" for alias in node.names
            }
        if isinstance(node, ast.Import):
            meaning |= {
                a.asname or "uuv": a.name if a.asname else "uuv"
                for a in node.names
                if a.name[:3] == "uuv"
            }

    used = {name for name in meaning.values() if not is_module(name)}
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Attribute)
            and isinstance(node.value, ast.Name)
            and node.value.id in meaning
        ):
            home = meaning[node.value.id]
            if is_module(home) and not is_module(f"{home}.{node.attr}"):
                used.add(f"{home}.{node.attr}")
    return used - {"uuv"}


def test_the_page_keeps_within_its_number():
    assert len(GROUPS) == 9
    assert all(group.lines and "```python" in group.text for group in GROUPS)
    assert len(NAMES) == len(set(NAMES))
    assert len(NAMES) <= MOST


@pytest.mark.parametrize("name", [name for name in NAMES if not needs_environments(name)])
def test_a_promised_name_is_there_and_is_no_module(name: str):
    module, _, attribute = name.rpartition(".")
    assert not isinstance(getattr(import_module(module), attribute), ModuleType)


@pytest.mark.parametrize("package", PACKAGES)
def test_what_a_package_hands_out_is_promised(package: str):
    if needs_environments(package):
        pytest.skip("dm_control has no packages for this Python")
    handed_out = import_module(package).__all__
    assert len(handed_out) > 3
    assert {f"{package}.{name}" for name in handed_out} - set(NAMES) == set()


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_documents_use_promised_names_only(document: Path):
    used: set[str] = set()
    if document.suffix in (".md", ".py", ".ipynb"):
        used = set().union(*(names_used(block) for block in python_blocks(document)))
    assert used - set(NAMES) == set()


@pytest.mark.parametrize("text", skeletons())
def test_skeletons_use_promised_names_only(text: str):
    assert names_used(text) - set(NAMES) == set()


def test_names_that_a_piece_of_code_uses():
    code = """
from uuv import models as m, run
from uuv.sim import hydrodynamics
import uuv.calib as c
import uuv
m.load('x').copy()
hydrodynamics.compile(m.load('y'))
c.identify([])
uuv.saved()
run(1)
"""
    expected = {
        "uuv.models.load",
        "uuv.run",
        "uuv.sim.hydrodynamics.compile",
        "uuv.calib.identify",
        "uuv.saved",
    }
    assert names_used(code) == expected


def test_names_of_a_stub(tmp_path):
    from uuv.sim.interfaces.lazy_names import names_of_stub

    stub = (
        "from math import pi as pi\nfrom json import dumps as dumps\nfrom json import "
        "loads\n\nread = loads\n"
    )
    (tmp_path / "__init__.pyi").write_text(stub)
    get, _, names = names_of_stub("shelf", str(tmp_path / "__init__.py"))
    assert names == ["dumps", "pi", "read"]
    assert get("read")("[1, 2]") == [1, 2]
    assert get("pi") == pytest.approx(3.14159265)
    with pytest.raises(
        AttributeError,
        match=r"module 'shelf' has no attribute 'loads'; it has "
        r"\['dumps', 'pi', 're",
    ):
        get("loads")


def examples() -> list[Any]:
    """The blocks of Python of the page, whole jobs marked as long."""
    long = pytest.mark.long(
        guarded_by="tests/unit/house/test_promised_names.py::test_a_promised_name_is_there_and_is_no_module"
    )
    blocks = [
        (group.page, block)
        for group in GROUPS
        for block in re.findall(r"```python\n(.*?)```", group.text, re.S)
    ]
    return [
        pytest.param(name, code, marks=[long] if "run(" in code and name == "run" else [])
        for name, code in blocks
    ]


@pytest.mark.parametrize(("group", "code"), examples())
def test_the_examples_of_the_page_run(group: str, code: str, tmp_path, monkeypatch):
    if needs_environments(f"uuv.{group}"):
        pytest.skip("dm_control has no packages for this Python")
    (tmp_path / "docs").symlink_to(ROOT / "docs")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "example", ModuleType("example"))  # dataclasses look there
    exec(compile(code, group, "exec"), {"__name__": "example"})
