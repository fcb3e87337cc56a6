"""Pages whose Python is one session: it runs as written, and prints what stands below it."""

import contextlib
import io
import re
import shlex
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from source_tree import ROOT

PAGES = ("calibrate_arm", "change_water", "find_object", "mkps", "own_ik")
_BLOCK = re.compile(r"^```(python|text)\n(.*?)^```", flags=re.MULTILINE | re.DOTALL)


def session(page: Path) -> list[tuple[str, str | None]]:
    """Blocks of Python of a page, each with the text that follows it as its output, or None."""
    blocks = [(match[1], match[2]) for match in _BLOCK.finditer(page.read_text(encoding="utf-8"))]
    following = [*blocks[1:], ("python", "")]
    return [
        (text, output if kind == "text" else None)
        for (language, text), (kind, output) in zip(blocks, following, strict=True)
        if language == "python"
    ]


def run_session(page: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs the blocks of a page in an empty folder beside docs/, and compares what they print."""
    (folder / "docs").symlink_to(ROOT / "docs")
    monkeypatch.chdir(folder)
    monkeypatch.setitem(sys.modules, "session", ModuleType("session"))  # dataclasses look there
    names = {"__name__": "session"}

    compared = 0
    for code, output in session(page):
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(code, page.name, "exec"), names)
        if output is not None:
            assert printed.getvalue() == output, code
            compared += 1
    assert compared > 0


def typed_in(page: Path, folder: Path) -> None:
    """Types the first commands of a page, in the folder."""
    text = page.read_text(encoding="utf-8")
    commands = re.findall(r"^```\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)[0]
    for line in commands.splitlines():
        words = shlex.split(line, comments=True)
        assert words[0] == "uuv"
        subprocess.run(
            [sys.executable, "-m", "uuv.cli.main", *words[1:]],
            cwd=folder,
            capture_output=True,
            check=True,
        )


@pytest.mark.parametrize("page", PAGES)
def test_the_python_of_a_page_prints_what_the_page_says(page: str, tmp_path, monkeypatch):
    run_session(ROOT / "docs" / f"{page}.md", tmp_path, monkeypatch)


def test_the_python_of_the_page_on_open3d(open3d, tmp_path, monkeypatch):
    assert open3d is not None
    run_session(ROOT / "docs" / "open3d.md", tmp_path, monkeypatch)


@pytest.mark.long(
    guarded_by="tests/unit/sim/reporting/test_run_plot.py::test_series_are_data_frames_over_time"
)
def test_the_python_of_a_page_that_needs_a_run(tmp_path, monkeypatch):
    page = ROOT / "docs" / "data_out.md"
    typed_in(page, tmp_path)
    run_session(page, tmp_path, monkeypatch)
