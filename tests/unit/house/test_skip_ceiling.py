"""`pytest --most-skipped N`: skips by count and reason, and red above N."""

import subprocess
import sys
from pathlib import Path

import pytest

FILES = {
    "test_a.py": """
import pytest

def test_that_runs(): ...

@pytest.mark.parametrize("i", range(3))
def test_without_its_library(i):
    pytest.skip("no library")

@pytest.mark.skipif(True, reason="no device")
def test_without_its_device(): ...

@pytest.mark.xfail(reason="known")
def test_expected_to_fail():
    assert False
""",
    "test_b.py": "import pytest\npytest.skip('no packages', allow_module_level=True)",
}


@pytest.mark.parametrize(
    ("options", "code", "title"),
    [
        (["--most-skipped=5"], 0, "skipped: 5, at most 5"),
        (["--most-skipped=4", "-p", "xdist", "-n1"], 1, "skipped: 5, more than 4"),
    ],
)
def test_skips_are_counted_by_reason(
    options: list[str],
    code: int,
    title: str,
    monkeypatch: pytest.MonkeyPatch,
    root: Path,
    tmp_path: Path,
):
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "pytest.ini").write_text(f"[pytest]\npythonpath = {root / 'tests' / 'support'}\n")
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    monkeypatch.delenv("PYTEST_XDIST_WORKER", raising=False)

    command = [sys.executable, "-m", "pytest", "-p", "skip_ceiling", *options]
    ran = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)

    assert ran.returncode == code, ran.stdout + ran.stderr
    _, head, rows = ran.stdout.partition(title)
    assert head, ran.stdout
    counts = {
        reason: int(count)
        for count, reason in (line.split(maxsplit=1) for line in rows.splitlines()[1:4])
    }
    assert counts == {"no library": 3, "no device": 1, "no packages (whole file test_b.py)": 1}
