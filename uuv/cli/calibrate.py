"""`uuv calibrate`: kinematic calibration of an arm from touches of fixed points."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

from uuv.arm_identification.calibration_options import COMMAND, CalibrationOptions, check_inputs
from uuv.cli.carry_out import METRICS
from uuv.cli.json_output import file_alone
from uuv.sim.runs.command_line import as_base
from uuv.start import parse


@dataclass(kw_only=True)
class CalibrateVerb(CalibrationOptions):
    """Calibrate an arm: the tip rests in one fixed point in many postures, and encoders are read.

    Without --touches the touches are simulated, by hand with noise, or by contact under water. The
    arm is then the UR10e of [Yukhimets 2023] (3 points, 21 touches each), another published arm, or
    the arm of a vehicle, with manufacturing errors. With --touches any arm can be calibrated:

        uuv calibrate --arm robot.urdf --tip ball --touches a.csv b.csv --distance a b 0.5

    With --plan N nothing is identified: the N most informative touches are printed and written
    as plan.csv.
    """

    groups: ClassVar[Mapping[str, str]] = {"output": "json"}

    json: bool = False
    """Print metrics.json alone."""


def main(verb: str, args: Sequence[str]) -> int:
    """Calibrates or plans touches, writes the results; returns the exit code."""
    del verb
    options = parse(CalibrateVerb, args)
    plain = as_base(options, CalibrationOptions)
    work = partial(calibrate, plain)
    return file_alone(work, METRICS) if options.json else work()


def calibrate(options: CalibrationOptions) -> int:
    """Checks the inputs, calibrates or plans touches, writes the results; returns the exit code.

    Raises:
        UuvError: Options, arm or touches are wrong.
    """
    check_inputs(options)
    import numpy as np

    # Imported, and compiled, after the check.
    from uuv.arm_identification import calibration_command
    from uuv.sim.runs.terminal import PlainConsole

    work = calibration_command.plan_touches
    if options.plan is None:
        work = calibration_command.calibrate
    rng = np.random.default_rng(options.seed)
    return work(options, options.folder(COMMAND), PlainConsole(), rng)
