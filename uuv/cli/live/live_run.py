"""A run that is driven as it goes, by keyboard or gamepad, with its window."""

import contextlib

from uuv.assembly import Assembly
from uuv.command import command
from uuv.controllers.driving.gamepad_inputs import HELP, GamepadInputs
from uuv.controllers.driving.key_inputs import KeyInputs
from uuv.driving.driven_work import DrivenWork
from uuv.driving.gamepad import Gamepad
from uuv.driving.keyboard import Window, has_screen
from uuv.scenario import Scenario
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.runs.command_line import RunOptions


def run_by_keyboard(scenario: Scenario, options: RunOptions, started: float) -> int:
    """Run a scenario with a window and progress on screen; returns the exit code.

    Args:
        scenario: Scenario with an operator at the keyboard.
        options: Options of the run.
        started: [s] time.perf_counter() at the start of the command.
    """
    windows: list[Window] = []

    def window_of(assembly: Assembly) -> list[Window]:
        match assembly.placed:
            case DrivenWork(source=KeyInputs() as keys):
                windows.append(Window(assembly.plant, assembly.X_WB, keys, press=keys.press))
            case _:
                raise ConfigurationError("drive: the scenario has no operator at the keyboard")
        return windows

    try:
        return command(scenario, options, started, observers_of=window_of)
    finally:
        for window in windows:
            window.close()


def run_by_gamepad(scenario: Scenario, options: RunOptions, started: float, device: str) -> int:
    """Run a scenario that a gamepad drives, with a window if there is a screen; the exit code.

    Args:
        scenario: Scenario with an operator at the gamepad.
        options: Options of the run.
        started: [s] time.perf_counter() at the start of the command.
        device: Joystick device.
    """
    with contextlib.ExitStack() as closing:

        def observed(assembly: Assembly) -> list[Window]:
            match assembly.placed:
                case DrivenWork(source=GamepadInputs() as inputs):
                    closing.enter_context(Gamepad(device, inputs))
                case _:
                    raise ConfigurationError("drive: the scenario has no operator at a gamepad")
            if not has_screen():
                return []
            window = Window(assembly.plant, assembly.X_WB, inputs, help_lines=HELP)
            closing.callback(window.close)
            return [window]

        return command(scenario, options, started, observers_of=observed)
