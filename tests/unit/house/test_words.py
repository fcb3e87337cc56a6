"""The tree and its words: small folders, documented names, sources that exist, one class a name,
readable sentences.
"""

import ast
import re
from collections import Counter, defaultdict
from pathlib import Path

from source_tree import ROOT, nodes, parsed, sources, tracked

FILES_A_FOLDER, SWITCHES, WORDS_A_SENTENCE = 18, 20, 40
SOURCES = sources()
WORDS_OF_PAGES, WORDS_A_PAGE, ROWS = 20_000, 1_500, 30
NOT_COUNTED = {
    "references",
    "glossary",
    "licences",
    "results",
    "results_earlier",
    "papers",
    "gallery",
}
# pages of doors and parts that came later: each has the bound of a page, and none of their sum
LATER = {"your_tools", "udp", "thrusters", "own_tool", "vehicle_files", "pictures"} | {
    "own_grasp",
    "turn_valve",
    "move_plug",
    "calibrate_arm",
    "change_water",
    "data_out",
    "find_object",
    "measured",
    "open3d",
    "mkps",
    "own_ik",
}
# words of a private dialect, which have a term of the field: probability, identifiable, cases
DIALECT = re.compile(r"\b(chance|seas|nobody|told|tells?|beyond doubt|hull's place)\b")
KEY = re.compile(r"\[([A-Z][A-Za-z]+ (?:1[89]|20)\d\d[a-z]?)(?:[,\]])")


def public(tree: ast.Module) -> list[tuple[str, ast.AST]]:
    """Public functions and classes of a module, and the public methods of these, by name."""
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
    definitions: list[tuple[str, ast.AST]] = []
    for node in tree.body:
        if isinstance(node, kinds) and not node.name.startswith("_"):
            definitions.append((node.name, node))
            if isinstance(node, ast.ClassDef):
                definitions += [
                    (f"{node.name}.{member.name}", member)
                    for member in node.body
                    if isinstance(member, kinds) and not member.name.startswith("_")
                ]
    return definitions


def sentences(path: Path) -> list[str]:
    """Sentences of the docstrings of a module, or of a page without its code blocks and tables."""
    if path.suffix == ".py":
        kinds = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
        texts = [ast.get_docstring(node) or "" for node in nodes(path) if isinstance(node, kinds)]
    else:
        texts = [re.sub(r"```.*?```", " ", path.read_text(), flags=re.DOTALL)]
    texts = [re.sub(r"^\s*\|.*$", "\n", text, flags=re.MULTILINE) for text in texts]
    return [
        s for text in texts for s in re.split(r"(?<=[.!?:;])\s+|\n\s*\n|\n\s*[-*] |\n +\w+: ", text)
    ]


def strings(path: Path) -> list[str]:
    """Texts of a module that a user may read: strings with blanks that are no docstrings."""
    documentation = {id(node.value) for node in nodes(path) if isinstance(node, ast.Expr)}
    constants = [
        node.value
        for node in nodes(path)
        if isinstance(node, ast.Constant) and id(node) not in documentation
    ]
    return [text for text in constants if isinstance(text, str) and " " in text.strip()]


def words_of(page: Path) -> int:
    """Number of words of a page, without its code blocks; an equation counts as one."""
    prose = re.sub(r"```.*?```", " ", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    prose = re.sub(r"\$\$.*?\$\$|\$[^$]*\$", "equation", prose, flags=re.DOTALL)
    return sum(re.search(r"\w", word) is not None for word in prose.split())


def test_no_folder_is_crowded():
    count = Counter(path.parent.relative_to(ROOT).as_posix() for path in SOURCES)
    assert {folder: n for folder, n in count.items() if n > FILES_A_FOLDER} == {}


def test_every_folder_says_what_it_is_for():
    silent = [
        path.parent.relative_to(ROOT).as_posix()
        for path in SOURCES
        if path.name == "__init__.py" and not ast.get_docstring(parsed(path))
    ]
    assert silent == []


def test_public_names_are_documented():
    silent = [
        f"{path.relative_to(ROOT)}: {name}"
        for path in SOURCES
        for name, node in [("the module", parsed(path)), *public(parsed(path))]
        if not ast.get_docstring(node)  # pyright: ignore[reportArgumentType]
    ]
    assert silent == []


def test_a_class_name_has_one_meaning():
    places = defaultdict(set)
    for path in SOURCES:
        for name, node in public(parsed(path)):
            if isinstance(node, ast.ClassDef) and name not in ("Options",):  # each command's own
                places[name].add(path.relative_to(ROOT).as_posix())
    assert {name: sorted(where) for name, where in places.items() if len(where) > 1} == {}


def test_every_source_is_listed_once():
    listed = re.findall(
        r"^- \*\*\[([^\]]+)\]\*\*",
        (ROOT / "docs" / "references.md").read_text(),
        flags=re.MULTILINE,
    )
    assert [key for key, n in Counter(listed).items() if n > 1] == []
    cited = defaultdict(set)
    for path in (*SOURCES, *tracked("README.md", "docs/*.md")):
        for key in KEY.findall(path.read_text()):
            cited[key].add(path.relative_to(ROOT).as_posix())
    assert {key: sorted(where) for key, where in cited.items() if key not in listed} == {}


def test_nothing_refers_to_what_a_stranger_cannot_open():
    closed = re.compile(r"[Pp]apers? 00\d|\bfacts/|issue \d")
    here = Path(__file__)
    offending = [
        path
        for path in tracked("*.py", "README.md", "docs/*.md")
        if closed.search(path.read_text())
    ]
    assert [path.relative_to(ROOT).as_posix() for path in offending if path != here] == []


def test_the_formatter_and_the_checkers_are_hardly_ever_switched_off():
    switch = re.compile(r"#\s*(fmt: (skip|off)|noqa|type: ignore|pyright: ignore)")
    assert sum(len(switch.findall(path.read_text())) for path in tracked("*.py")) <= SWITCHES


def test_named_numbers_say_what_they_are():
    number = re.compile(r"^(_?[A-Z][A-Z_0-9]+)(?:: [\w\[\], ]+)? = -?[\d.][\w.+-]*\s*$")
    silent = []
    for path in SOURCES:
        lines = path.read_text().splitlines()
        silent += [
            f"{path.relative_to(ROOT)}:{i + 1} {line}"
            for i, line in enumerate(lines)
            if number.match(line) and not (i and lines[i - 1].startswith("#"))
        ]
    assert silent == []


def test_sentences_can_be_read_at_once():
    pages = [*SOURCES, *tracked("README.md", "CHANGELOG.md", "docs/*.md")]
    long = [
        f"{path.relative_to(ROOT)}: {' '.join(sentence.split())[:90]}"
        for path in pages
        for sentence in sentences(path)
        if len(re.findall(r"[A-Za-z][A-Za-z'-]*", sentence)) > WORDS_A_SENTENCE
    ]
    assert long == []


def test_messages_have_the_terms_of_the_field():
    foreign = [
        f"{path.relative_to(ROOT)}: {text[:90]}"
        for path in SOURCES
        if path.relative_to(ROOT).parts[0] != "scripts"
        for text in strings(path)
        if DIALECT.search(text)
    ]
    assert foreign == []


def test_pages_are_short():
    counts = {
        page.stem: words_of(page)
        for page in (ROOT / "docs").glob("*.md")
        if page.stem not in NOT_COUNTED
    }
    assert len(counts) > 20
    assert sum(n for name, n in counts.items() if name not in LATER) <= WORDS_OF_PAGES
    # the list of the promised names has 150 rows, and concepts a bound of their own
    long = {name for name, n in counts.items() if n > WORDS_A_PAGE}
    assert long <= {"api", "concepts"}
    concepts = (ROOT / "docs" / "concepts.md").read_text(encoding="utf-8")
    assert len(concepts.split()) <= 2_000
    vocabulary = (ROOT / "docs" / "vocabulary.md").read_text(encoding="utf-8")
    assert len(re.findall(r"^\|", vocabulary, flags=re.MULTILINE)) - 2 <= ROWS


def test_the_first_page_is_short():
    assert len((ROOT / "README.md").read_text().splitlines()) <= 110


def test_the_changelog_is_short_and_in_short_items():
    changes = (ROOT / "CHANGELOG.md").read_text()
    items = changes.split("\n- ")[1:]
    assert len(changes.split()) <= 1_000
    assert max(len(item.split("\n\n")[0].split()) for item in items) <= 45
