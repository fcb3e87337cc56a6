"""A run that keys drive, with its window."""

from dataclasses import replace

from uuv.assembly import Assembly, assemble
from uuv.command import command
from uuv.controllers.driving.key_inputs import KeyInputs
from uuv.driving.driven_work import DrivenWork
from uuv.driving.keyboard import Window
from uuv.scenario import Scenario
from uuv.sim.runs.command_line import RunOptions


def run_by_keyboard(scenario: Scenario, options: RunOptions, started: float) -> int:
    """Run a scenario with a window and progress on screen; the exit code.

    Args:
        scenario: With an operator at the keyboard.
        options: Of the run.
        started: [s] time.perf_counter() at the start of the command.
    """
    windows: list[Window] = []
    rehearsed = False

    def with_window(scenario: Scenario, *, full: bool = True) -> Assembly:
        """The scenario assembled; the first one is the rehearsal, which nobody looks at."""
        nonlocal rehearsed
        assembly = assemble(scenario, full=full)
        placed = assembly.placed
        if not rehearsed or not isinstance(placed, DrivenWork):
            rehearsed = True
            return assembly

        if isinstance(placed.source, KeyInputs):
            windows.append(Window(assembly.plant, assembly.X_WB, placed.source))
        observers = (*assembly.loop.observers, *windows)
        return replace(assembly, loop=replace(assembly.loop, observers=observers))

    try:
        return command(scenario, options, started, assembled=with_window)
    finally:
        for window in windows:
            window.close()
