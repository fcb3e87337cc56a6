"""Messages about keys of a scenario file, as a command line tells them."""

from dataclasses import dataclass

import pytest

from uuv.jobs import clean_object, identify_friction
from uuv.jobs.command_line import options_class
from uuv.scenario import Sensing
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.runs.command_line import RunOptions, parse, run_scenario, with_options

OBJECT = options_class(clean_object)


@dataclass(kw_only=True)
class LookOptions(RunOptions):
    """Options of a command that looks."""

    looks: int = 1
    """Frames."""


@pytest.mark.parametrize(
    ("message", "words"),
    [
        ("task.range [m]: got nan", "--range (task.range) [m]: got nan"),
        ("vehicle.arm_errors: got -1", "--arm-errors (vehicle.arm_errors): got -1"),
        ("task.turn.angle [rad]: got 9", "--turn (task.turn.angle) [rad]: got 9"),
        ("task.least, a share: got 2", "--least (task.least), a share: got 2"),
        ("task.promise.least: got 2", "--least-chance (task.promise.least): got 2"),
        (
            "task.speed 9: not; task.speed 0.1 would do",
            "--speed (task.speed) 9: not; --speed 0.1 would do",
        ),
        ("site.object.line; belief.arm", "--line (site.object.line); --arm (belief.arm)"),
        ("longest 9 s: the work takes 10 s", "--longest 9 s: the work takes 10 s"),
        ("longest [s]: got -1", "--longest [s]: got -1"),
    ],
)
def test_the_option_is_named_beside_the_key(message: str, words: str):
    assert with_options(message, OBJECT) == words


@pytest.mark.parametrize(
    "message",
    [
        "sensing.vision_noise: got -1",  # no option sets it
        "--set: task.speed [m/s]: got 9",  # the user typed the key
        "file runs/task.speed/x: cannot be read",
        "sensor 'my.sensor': no such name",
        "my.sensor:make raised ValueError (my.range:12)",
        "record of a run: cannot be read",
        "scenario 'a.toml': task.turn.dwelling: got 9",
    ],
)
def test_other_messages_stay_as_they_are(message: str):
    assert with_options(message, OBJECT) == message


def test_an_argument_of_the_job_alone_is_named_by_its_option():
    message = "gear_spread: must be finite, >= 0, got -1"
    assert with_options(message, options_class(identify_friction)) == message.replace(
        "gear_spread", "--gear-spread"
    )


def test_a_key_with_an_option_of_another_name_does_not_lend_it_to_others():
    assert with_options("task.turn [rad]", OBJECT) == "task.turn [rad]"


def test_the_command_says_it_and_a_script_gets_the_key(capsys: pytest.CaptureFixture[str]):
    with pytest.raises(ConfigurationError, match=r"^sensing\.looks: must be"):
        Sensing(looks=0)
    with pytest.raises(SystemExit):
        run_scenario(lambda: Sensing(looks=parse(LookOptions, ["--looks", "0"]).looks) and 0)
    assert capsys.readouterr().err == (
        "error: --looks (sensing.looks): must be a whole number in 1..40, got 0\n"
    )
