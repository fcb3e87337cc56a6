"""Scripts start on our rooms, and end in one line and the right code."""

import os
import signal
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Literal

import pytest

from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.runs.command_line import parse, run_scenario
from uuv.sim.runs.run_folder import new_folder

ROOT = Path(__file__).resolve().parents[4]


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
def test_bad_option_gives_one_line_and_code_2(
    args: list[str], culprit: str, capsys: pytest.CaptureFixture[str]
):
    with pytest.raises(SystemExit) as stop:
        parse(Options, args)
    output = capsys.readouterr()
    assert stop.value.code == 2
    assert output.err.count("\n") == 1
    assert output.err.startswith("error: ")
    assert culprit in output.err
    assert not set("│─╭╰") & set(output.err)


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


@pytest.mark.parametrize("before", [None, "", "1"])
def test_a_command_leaves_the_environment_as_it_was(
    before: str | None, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    if before is not None:
        monkeypatch.setenv("PYTHONSAFEPATH", before)
    environment = dict(os.environ)
    settings: list[str] = []

    def main() -> int:
        settings.append(os.environ["PYTHONSAFEPATH"])  # of a Python that it starts
        raise ConfigurationError("no")

    with pytest.raises(SystemExit):
        run_scenario(main)
    assert settings == ["1"]
    assert dict(os.environ) == environment


def ended(main: Callable[[], None], capsys: pytest.CaptureFixture[str]) -> tuple[object, str]:
    """Exit code of a scenario, and what it says on stderr."""
    with pytest.raises(SystemExit) as stop:
        run_scenario(main)
    return stop.value.code, capsys.readouterr().err


def test_an_error_of_the_program_is_one_line_with_its_place(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    source = "import json\ndef main():\n    json.loads('{')\n"
    code = compile(source, str(ROOT / "scripts" / "made_up.py"), "exec")
    namespace: dict[str, Any] = {"__name__": "made_up"}
    exec(code, namespace)
    code, message = ended(namespace["main"], capsys)
    assert code == 70
    assert message.startswith("error: internal: JSONDecodeError: Expecting property name")
    assert "(scripts/made_up.py:3; --traceback" in message
    assert message.count("\n") == 1
    monkeypatch.setenv("UUV_TRACEBACK", "1")
    assert "Traceback" in ended(namespace["main"], capsys)[1]


def test_an_error_in_a_users_module_names_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
):
    (tmp_path / "pilot_of_mine.py").write_text(
        "class Pilot:\n    def step(self):\n        return {}['gain']\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    code, message = ended(import_module("pilot_of_mine").Pilot().step, capsys)
    assert code == 2
    assert message == (
        "error: pilot_of_mine: Pilot.step raised KeyError: 'gain' "
        f"({tmp_path / 'pilot_of_mine.py'}:3)\n"
    )


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_end_a_scenario_with_the_code_of_a_shell(
    number: signal.Signals, capsys: pytest.CaptureFixture[str]
):
    # as it is where the tests run in the background
    ignored = signal.signal(number, signal.default_int_handler)
    try:
        before = signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT)
        assert ended(lambda: signal.raise_signal(number), capsys) == (128 + number, "interrupted\n")
        assert (signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT)) == before
    finally:
        signal.signal(number, ignored)


@pytest.mark.parametrize(
    "outcome", [ConfigurationError("no"), KeyboardInterrupt(), ZeroDivisionError()]
)
def test_whatever_ends_a_scenario_at_its_door_leaves_no_folder(
    outcome: BaseException, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    def main() -> None:
        new_folder("x", tmp_path / "out")
        raise outcome

    ended(main, capsys)
    assert not (tmp_path / "out").exists()


def test_traceback_is_an_option_of_every_script():
    assert parse(Options, ["--traceback", "--force", "90"]).force == 90.0
