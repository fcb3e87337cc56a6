"""Kinematic calibration of an arm from touches: the tip rests in one fixed point in many postures, encoders are read.

Without --touches the touching is simulated. The arm is then the UR10e of [Yukhimets 2023] (3 points, 21 touches each),
or any published arm or a vehicle's own with workshop errors. The touches come from a hand with noise, or by contact
under water. With --touches, any arm can be calibrated:

    calibrate_arm.py --arm robot.urdf --tip ball --touches a.csv b.csv --distance a b 0.5

With --plan N nothing is identified: the N touches that would tell most are printed and written as plan.csv.
"""

from uuv.start import parse, run_scenario  # isort: skip

import numpy as np

from uuv.arm_identification.calibration_options import COMMAND, CalibrationOptions, check_inputs


def main() -> int:
    """Calibrates or plans touches, writes the results and returns the exit code."""
    options = parse(CalibrationOptions)
    check_inputs(options)
    from uuv.arm_identification.calibration_command import calibrate, plan_touches
    from uuv.sim.runs.terminal import PlainConsole

    run = calibrate if options.plan is None else plan_touches
    return run(options, options.folder(COMMAND), PlainConsole(), np.random.default_rng(options.seed))


if __name__ == "__main__":
    run_scenario(main)
