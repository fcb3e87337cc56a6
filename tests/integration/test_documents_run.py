"""What the documents tell a user to type is typed, page by page, in an empty folder."""

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

SESSIONS = (
    "calibrate_arm",
    "change_water",
)  # whose Python tests/unit/house/test_page_examples.py runs
PAGES = (*SESSIONS, "first_run", "own_current", "own_sensor", "own_task", "uuv")
_PLACEHOLDER = re.compile(r"\b(RUN|NAME|VEHICLE|KIND)\b|my\.toml|perturbations\.MountedObject")
_BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", flags=re.MULTILINE | re.DOTALL)


def typed(page: Path) -> list[tuple[str, str]]:
    """Language and text of each block of a page that stands for itself."""
    blocks = _BLOCK.findall(page.read_text(encoding="utf-8"))
    # no files, no output
    typed_in = [(kind, text) for kind, text in blocks if kind in ("", "python")]
    return [(kind, text) for kind, text in typed_in if not _PLACEHOLDER.search(text)]


@pytest.mark.long
@pytest.mark.parametrize("page", PAGES)
def test_what_a_page_says_works(page: str, root: Path, tmp_path: Path):
    blocks = typed(root / "docs" / f"{page}.md")
    if page in SESSIONS:
        blocks = [(kind, text) for kind, text in blocks if kind != "python"]
    for example in (root / "docs" / "examples").glob("*.py"):  # files that a page says to save
        shutil.copy(example, tmp_path)
    (tmp_path / "docs").symlink_to(root / "docs")
    commands = 0
    for kind, text in blocks:
        lines = [text] if kind == "python" else text.splitlines()
        for line in lines:
            words = (
                [sys.executable, "-c", line]
                if kind == "python"
                else shlex.split(line, comments=True)
            )
            if not words:
                continue
            if words[0] == "uuv":
                words = [sys.executable, "-m", "uuv.cli.main", *words[1:]]
            elif words[0] == "python":
                words[0] = sys.executable
            ran = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
            assert ran.returncode == 0, f"{line}\n{ran.stdout[-500:]}\n{ran.stderr[-500:]}"
            commands += 1
    assert commands > 2
