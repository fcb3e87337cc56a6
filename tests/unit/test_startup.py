"""Scripts start on our rooms, and end in one line and the right code."""

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pytest

from sim.interfaces.errors import ConfigurationError
from sim.startup import check, parse, run_scenario


@dataclass
class Options:
    """A job."""

    path: Literal["longitudinal", "transverse"] = "longitudinal"
    """Which path."""
    force: float = 60.0
    """Set force [N]."""
    first_seed: int = 0
    """Of the noise."""


@pytest.mark.parametrize(
    ("args", "culprit"),
    [
        (["--path", "sideways"], "'sideways'"),
        (["--force", "much"], "'much'"),
        (["--forse", "3"], "--forse"),
        (["--force"], "--force"),
        (["--first-seed", "-1"], "--first-seed: must not be negative, got -1"),
    ],
)
def test_bad_option_gives_one_line_and_code_2(args: list[str], culprit: str, capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit) as stop:
        parse(Options, args)
    said = capsys.readouterr()
    assert stop.value.code == 2
    assert said.err.count("\n") == 1
    assert said.err.startswith("error: ")
    assert culprit in said.err
    assert not set("│─╭╰") & set(said.err)


def test_options_are_parsed_and_help_is_whole(capsys: pytest.CaptureFixture[str]):
    assert parse(Options, ["--path", "transverse", "--force", "90"]) == Options("transverse", 90.0)
    with pytest.raises(SystemExit) as stop:
        parse(Options, ["--help"])
    assert not stop.value.code
    assert "Set force [N]." in capsys.readouterr().out


@pytest.mark.parametrize(
    ("outcome", "code", "line"),
    [
        (None, 0, ""),
        (0, 0, ""),
        (1, 1, ""),
        (
            ConfigurationError("force: must not be\n negative, got -5"),
            2,
            "error: force: must not be negative, got -5\n",
        ),
        (KeyboardInterrupt(), 130, "interrupted\n"),
    ],
)
def test_scenario_ends_in_its_code(
    outcome: int | BaseException | None, code: int, line: str, capsys: pytest.CaptureFixture[str]
):
    def main() -> int | None:
        if isinstance(outcome, BaseException):
            raise outcome
        return outcome

    with pytest.raises(SystemExit) as stop:
        run_scenario(main)
    assert stop.value.code == code
    assert capsys.readouterr().err == line


def test_other_errors_keep_their_traceback():
    def main() -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run_scenario(main)


def test_our_rooms_pass():
    check()


@pytest.mark.parametrize("foreign", ["sim.py", "sim/__init__.py", "models/__init__.py", "calib.py"])
def test_foreign_module_that_hides_a_room_is_named(foreign: str, tmp_path: Path, root: Path):
    file = tmp_path / foreign
    file.parent.mkdir(exist_ok=True)
    file.write_text("raise RuntimeError('a foreign room was run')\n")
    run = subprocess.run(
        [sys.executable, "-c", "import _start"],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(root / "scripts"), str(tmp_path)])},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 2, run.stderr
    assert run.stderr.count("\n") == 1
    assert str(file) in run.stderr


def test_python_without_the_project_is_told_the_way(root: Path, tmp_path: Path):
    run = subprocess.run(
        [sys.executable, "-S", "-c", "import _start"],  # -S: no site-packages
        env={"PYTHONPATH": str(root / "scripts")},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 2
    assert run.stderr.count("\n") == 1
    assert "./uvw run" in run.stderr
