"""Entry of the command `uuv`: chooses the verb, and imports what it needs only then."""

import importlib
import os
import sys
from typing import NoReturn

USAGE = """uuv list                      what there is: jobs, studies, vehicles, objects, ...
uuv run clean-barrel --seed 3 a job; also a scenario file, my.toml
uuv compare RUN RUN           figures of runs side by side
uuv replay RUN                runs again from its record, to the bit
uuv report RUN                the report of a run
uuv view RUN                  its log in the Rerun viewer
uuv picture RUN               a still and a clip of a run
uuv check VEHICLE             what a vehicle has of the contract, and what follows
uuv wet MODEL                 water of a URDF, MJCF or mesh from its geometry
uuv identify-water --log FILE added mass, damping, trim and thrust from logs
uuv doctor                    what works on this machine
uuv new KIND NAME             a working skeleton with a test
uuv completion bash           completion for the shell: source <(uuv completion bash)

uuv VERB --help lists the options of a verb."""
VERBS = {  # verb: module that has `main(verb, args) -> exit code`
    "list": "uuv.catalogue",
    "run": "uuv.cli.run_job",
    "compare": "uuv.cli.compare_runs",
    "replay": "uuv.cli.past_runs",
    "report": "uuv.cli.past_runs",
    "view": "uuv.cli.past_runs",
    "picture": "uuv.cli.picture",
    "check": "uuv.cli.check_vehicle",
    "wet": "uuv.cli.wet_model",
    "identify-water": "uuv.cli.identify_water",
    "doctor": "uuv.cli.doctor",
    "new": "uuv.cli.skeletons",
    "completion": "uuv.cli.completion",
}


def main() -> NoReturn:
    """Runs the verb of the command line, and exits with its code."""
    from uuv.sim.runs.process import BAD_INPUT, parts_from_the_working_folder, quiet_pipe, refuse_foreign_system

    refuse_foreign_system()
    args = sys.argv[1:]
    verb = args[0] if args else "help"
    if verb in VERBS and verb != "list":
        from uuv.start import run_scenario

        if verb == "picture":
            _choose_renderer()
        parts_from_the_working_folder()
        sys.argv = [f"uuv {verb}", *args[1:]]
        run_scenario(lambda: importlib.import_module(VERBS[verb]).main(verb, args[1:]))
    with quiet_pipe():  # half a second is too long to say what there is: nothing heavy is imported
        if verb == "list":
            raise SystemExit(importlib.import_module(VERBS[verb]).main(verb, args[1:]))
        if verb in ("-h", "--help", "help"):
            print(USAGE)
            raise SystemExit(0)
        if verb == "--version":
            from importlib.metadata import version

            print(f"uuv-arm {version('uuv-arm')}")
            raise SystemExit(0)
        from uuv.sim.interfaces.errors import did_you_mean

        print(f"error: no verb {verb!r}; there are {', '.join(VERBS)}{did_you_mean(verb, VERBS)}", file=sys.stderr)
        raise SystemExit(BAD_INPUT)


def _choose_renderer() -> None:
    """Lets MuJoCo draw without a screen where it can; read when it is imported, which fails without that library."""
    from ctypes.util import find_library

    if not os.environ.get("DISPLAY") and find_library("EGL"):
        os.environ.setdefault("MUJOCO_GL", "egl")


if __name__ == "__main__":
    main()
