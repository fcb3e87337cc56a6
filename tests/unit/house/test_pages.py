"""Pages can be read: no folder gets worse than its limits, and what is new obeys the rules."""

from pathlib import Path

import pytest

import ratchets
from page_counts import RULES, offences
from source_tree import ROOT, sources

LINE = "    pressure = depth * density\n"
BODY = "def rise(depth, density):\n"
FUNCTION = BODY + 12 * LINE
CLASS = "class Water:\n" + 20 * "    depth: float\n"
FILE = 500 * "DEPTH = 3.0\n"

# By rule: a page that just obeys it, and one that just does not.
PAGES = {
    "air": (FUNCTION, BODY + 13 * LINE),
    "walls": (BODY + 25 * LINE + "\n" + 25 * LINE, BODY + 26 * LINE),
    "columns": (f"DEPTH = '{90 * 'm'}'\n", f"DEPTH = '{91 * 'm'}'\n"),
    "tuples": ("a, b = b, a\nc, d = f(a)\n", "a, b = 3.0, f(a)\n"),
    "names": ("depth = 3.0\n", "def depth(_found): pass\n"),
    "parameters": (
        "def f(self, a, b, c, d, e, g, *, h, i): pass\n",
        "def f(a, b, c, d, e, g, *, h, i, j): pass\n",
    ),
    "fields": (CLASS + "    deepest: ClassVar[float]\n", CLASS + "    deepest: float\n"),
    "class-lines": (
        "class Water:\n" + 249 * "    depth = 3.0\n\n",
        "class Water:\n" + 250 * "    depth = 3.0\n",
    ),
    "function-lines": (BODY + 59 * (LINE + "    # deep\n"), BODY + 60 * LINE),
    "file-lines": (FILE, FILE + "DEPTH = 3.0\n"),
    "asserts": ("assert depth is not None\n", "assert isinstance(depth, float) and depth > 0.0\n"),
}


def written(folder: Path, text: str, name: str = "page.py") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def test_no_folder_is_worse_than_its_limits():
    excess = ratchets.worse(ratchets.counts(sources()), ratchets.limits())
    assert not excess, ratchets.complaint(excess)


def test_limits_are_of_places_and_rules_that_there_are():
    for folder, numbers in ratchets.limits().items():
        assert (ROOT / folder).exists(), folder
        assert set(numbers) <= {*RULES, ratchets.TABLES}, folder
    assert ratchets.FILE.read_text() == ratchets.as_text(ratchets.limits()), (
        "it is written by tests/support/ratchets.py"
    )


@pytest.mark.parametrize("rule", RULES)
def test_a_rule_tells_the_page_that_breaks_it(rule: str, tmp_path: Path):
    obeys, breaks = PAGES[rule]
    assert offences(written(tmp_path, obeys))[rule] == []
    (offence,) = offences(written(tmp_path, breaks, "worse.py"))[rule]
    assert offence.amount == 1


def test_docstrings_and_kernels_have_no_part_in_the_length_of_functions(tmp_path: Path):
    text = '"""' + "\n".join(30 * ["Words."]) + '"""\n'
    page = written(tmp_path, f"def rise(depth, density):\n    {text}{12 * LINE}")
    assert offences(page)["walls"] == []
    kernel = "    @_inline\n    def step(depth, density):\n" + 80 * f"    {LINE}"
    page = written(tmp_path, f"def build():\n{kernel}    return step\n", "built.py")
    assert offences(page)["function-lines"] == []
    assert offences(page)["walls"] != [], "a kernel has paragraphs as well"


@pytest.mark.parametrize("folder", ["sim/plant", "perception/registration/published", "uuv"])
def test_one_worse_page_in_a_folder_is_refused(
    folder: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    counted = ratchets.counts(path for path in sources() if path.parent == ROOT / folder)
    page = written(tmp_path, "".join(text for _, text in PAGES.values()))
    monkeypatch.setattr(ratchets, "name_of", lambda _: folder)
    added = ratchets.counts([page])[folder]
    broken = {rule for rule, number in added.items() if number}
    assert len(broken) >= len(RULES) - 1
    allowed = ratchets.tightened(counted, ratchets.limits())
    assert {
        rule for _, rule, *_ in ratchets.worse({folder: counted[folder] + added}, allowed)
    } == broken


def test_a_new_folder_has_no_allowance():
    assert ratchets.worse({"uuv/new": {"columns": 1, "walls": 0}}, ratchets.limits()) == [
        ("uuv/new", "columns", 1, 0)
    ]


def test_limits_become_smaller_only():
    allowed = {"sim": {"air": 9, "walls": 2, "columns": 4}, "gone": {"air": 1}}
    counted = {"sim": {"air": 7, "walls": 0, "columns": 6}, "new": {"air": 3}}
    assert ratchets.tightened(counted, allowed) == {"sim": {"air": 7, "columns": 4}}
    assert ratchets.as_text({"sim": {"columns": 4, "air": 7}}).endswith(
        '\n"sim" = { air = 7, columns = 4 }\n'
    )
