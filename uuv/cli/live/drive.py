"""Drives the vehicle of a job by an operator's inputs: `uuv drive NAME`."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

from uuv.cli.carry_out import METRICS, Output, run_printed
from uuv.cli.json_output import file_alone
from uuv.cli.live.named_job import NamedJobOptions, named_scenario
from uuv.scenario import GAMEPAD, KEYBOARD, LIVE, Operator
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.runs.command_line import parse


@dataclass(kw_only=True)
class DriveOptions(NamedJobOptions):
    """Drive the vehicle of a job at its site, in place of the job's planner.

    The inputs are velocities of hull and tool, a set force and a clutch. Controllers, monitors and
    departure remain active (docs/your_tools.md).
    """

    inputs: str = KEYBOARD
    """CSV file of inputs over time; default: the keyboard, in MuJoCo's viewer, in real time."""
    gamepad: str | None = None
    """Joystick device of Linux, such as /dev/input/js0, in place of the keyboard; in real time."""
    delay: float = 0.0
    """Delay [s] between operator and vehicle: 0 to 1."""


def main(verb: str, args: Sequence[str]) -> int:
    """Drives; returns the exit code."""
    del verb
    started = time.perf_counter()
    options = parse(DriveOptions, args)
    scenario = named_scenario(options)
    inputs = options.inputs if options.gamepad is None else GAMEPAD
    if options.gamepad is not None and options.inputs != KEYBOARD:
        raise ConfigurationError("--gamepad and --inputs: give only one of them")
    operator = Operator(inputs=inputs, delay=options.delay)
    scenario = replace(scenario, control=replace(scenario.control, operator=operator))
    if inputs not in LIVE:
        return run_printed(scenario, options, Output(json=options.json), started)

    from uuv.driving.gamepad import refuse_without_gamepad
    from uuv.driving.keyboard import refuse_without_screen
    from uuv.inputs import check_inputs
    from uuv.pace import check_pace

    # In real time, with what it needs.
    paced = options if options.pace is not None else replace(options, pace=1.0)
    check_pace(paced.pace)
    device = options.gamepad
    if device is None:
        refuse_without_screen()
    else:
        refuse_without_gamepad(device)
    check_inputs(scenario, options.longest, live=True)
    from uuv.cli.live.live_run import run_by_gamepad, run_by_keyboard

    def work() -> int:
        if device is None:
            return run_by_keyboard(scenario, paced, started)
        return run_by_gamepad(scenario, paced, started, device)

    return file_alone(work, METRICS) if options.json else work()
