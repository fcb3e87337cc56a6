"""Water of a URDF, an MJCF or a mesh from its geometry: writes an MJCF that carries it.

    ./uvw run scripts/wet.py arm.urdf               # arm.wet.xml beside it
    ./uvw run scripts/wet.py hull.stl --scale 0.001 # a mesh in millimetres

The same as `uuv wet`.
"""

from uuv.start import parse, run_scenario  # isort: skip

from uuv.cli.wet_model import WetOptions, wet_model


def main() -> int:
    """Writes the model, prints the table and returns the exit code."""
    options = parse(WetOptions)
    from uuv.sim.runs.terminal import PlainConsole

    return wet_model(options, PlainConsole())


if __name__ == "__main__":
    run_scenario(main)
