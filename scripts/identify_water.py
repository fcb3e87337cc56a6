"""Identification of a vehicle's water from logs: added mass, damping, trim and thruster gains, with intervals.

    identify_water.py --vehicle bluerov2_heavy --log dive1.csv dive2.parquet --plan

The vehicle's present coefficients are the prior. What the logs cannot tell is said in words; with --plan the manoeuvre
that would tell most next is named. Without --log a vehicle drawn from the prior is simulated; with --plan alone the
first manoeuvre is planned.
"""

from uuv.start import parse, run_scenario  # isort: skip

from uuv.cli.identify_water import identify_water
from uuv.water_identification.options import WaterOptions


def main() -> int:
    """Identifies or plans, writes the results and returns the exit code."""
    return identify_water(parse(WaterOptions))


if __name__ == "__main__":
    run_scenario(main)
