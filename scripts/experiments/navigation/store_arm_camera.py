"""Stores the error model of the camera on the arm, fitted to the rows of fit_arm_camera.py, in
sim/sensors/arm_camera.toml.
"""

from uuv.start import parse, run_scenario  # isort: skip

from dataclasses import dataclass
from pathlib import Path

from experiments.navigation.arm_camera_fit import fit, pairs_of, to_toml
from uuv.experiment import read_rows
from uuv.sim.runs.run_folder import RUNS
from uuv.sim.runs.saving import write_whole
from uuv.sim.sensors.arm_camera import TABLE


@dataclass(kw_only=True)
class Options:
    """Where the rows are."""

    rows: Path = RUNS / "fit_arm_camera"
    """Folder of the experiment's rows."""


def main() -> int:
    """Fits the model and writes it."""
    options = parse(Options)
    write_whole(TABLE, to_toml(fit(pairs_of(read_rows(options.rows)))))
    print(f"written to {TABLE}")
    return 0


if __name__ == "__main__":
    run_scenario(main)
