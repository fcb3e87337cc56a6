"""Identification of the dry and viscous friction of the arm's gears, in water, free of contact.

The vehicle keeps station while its joints swing, slowly, then fast. Encoders, torque sensors at the gear outputs and
motor torques give the friction of each gear, which is compared with the true one. The true gears deviate from those
that the vehicle believes in. Rotor inertias are known. No other command reads the result.
"""

from scenarios.start import ScenarioOptions, parse, run_scenario  # isort: skip

import time
from dataclasses import dataclass

from rich.console import Console

from scenarios.arm_identification import friction_run
from scenarios.runner import run_with_report
from sim.interfaces.spatial import finite_number

_QUICK, _USUAL, _SHORTEST, _LONGEST = 15.0, 30.0, 10.0, 300.0  # [s] of swings


@dataclass(kw_only=True)
class Options(ScenarioOptions):
    """Identify the friction of an arm's gears."""

    vehicle: str = "uuv_puma"
    """A name of models.available(), or an MJCF file with the named parts (docs/concepts.md)."""
    seconds: float | None = None
    """Duration of the swings [s], after 4 s of unfolding; default 30, with --quick 15."""
    gear_spread: float = 0.3
    """Share in +- by which the true friction of each gear deviates from the controller's model, drawn from the seed."""


def main() -> int:
    """Runs the identification and returns the exit code."""
    started = time.perf_counter()
    options = parse(Options)
    seconds = options.seconds if options.seconds is not None else _QUICK if options.quick else _USUAL
    finite_number(seconds, "--seconds [s]", least=_SHORTEST, most=_LONGEST)
    finite_number(options.gear_spread, "--gear-spread", least=0.0, most=0.9)
    console = Console()
    folder = options.folder("identify_friction")
    case = friction_run.prepare(
        options.vehicle,
        seconds=seconds,
        gear_spread=options.gear_spread,
        current=options.current,
        gust=options.gust,
        seed=options.seed,
    )
    return run_with_report(
        "identify_friction",
        case.ready,
        friction_run.evaluation(case, console),
        f"Friction of the gears of {options.vehicle}, swings of {seconds:g} s, seed {options.seed}",
        options,
        folder,
        console,
        started,
        story=lambda *_: case.samples,
    )


if __name__ == "__main__":
    run_scenario(main)
