"""Entry of the command `uuv`: the table of verbs, whose modules are imported when chosen."""

import importlib
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NoReturn


@dataclass(frozen=True, slots=True)
class Verb:
    """One verb: the module that carries it out, and its line of USAGE."""

    module: str  # below `uuv.cli`; it has `main(verb, args) -> exit code`
    options: str  # class of the verb's options in that module
    words: str  # arguments after the verb in its line of USAGE
    about: str  # description in that line
    earlier: str = ""  # name of the earlier separate command, if it was spelled otherwise


VERBS = {  # by the one or two words that are typed
    "list": Verb("listing", "ListOptions", "", "names of jobs, experiments, vehicles, ..."),
    "run": Verb("run_job", "RunVerb", "NAME", "a job, or a scenario file: my.toml", "run-scenario"),
    "check": Verb(
        "vehicles.check_vehicle",
        "CheckOptions",
        "VEHICLE",
        "parts, figures and feasible jobs of a vehicle",
    ),
    "wet": Verb(
        "vehicles.wet_model", "WetOptions", "MODEL", "hydrodynamic data of a URDF, MJCF or mesh"
    ),
    "new": Verb("skeletons", "NewOptions", "KIND NAME", "a working skeleton with a test"),
    "doctor": Verb("doctor", "DoctorOptions", "", "what works on this machine"),
    "completion": Verb("completion", "CompletionOptions", "SHELL", "completion for bash or zsh"),
    "compare": Verb(
        "past.compare_runs", "CompareOptions", "RUN RUN", "figures of runs side by side"
    ),
    "replay": Verb(
        "past.past_runs",
        "ReplayOptions",
        "RUN",
        "repeat a run bit for bit; --log: a real log beside its simulation",
    ),
    "report": Verb("past.past_runs", "ReportOptions", "RUN", "the report of a run"),
    "view": Verb("past.past_runs", "ViewOptions", "RUN", "the log of a run in the Rerun viewer"),
    "export": Verb(
        "past.export", "ExportOptions", "RUN", "data of a run as MCAP, ROS 2 bag, CSV or MATLAB"
    ),
    "picture": Verb("past.picture", "PictureOptions", "RUN", "a still and a clip of a run"),
    "gallery": Verb(
        "past.gallery", "GalleryOptions", "", "pictures of the documents, in a checkout"
    ),
    "identify object": Verb(
        "identify.object", "ObjectVerb", "--cloud FILE", "pose of a known object in a point cloud"
    ),
    "identify friction": Verb(
        "identify.friction", "FrictionVerb", "", "friction of the arm's gears"
    ),
    "identify water": Verb(
        "identify.water",
        "WaterVerb",
        "--log FILE",
        "added mass, damping, trim and thrust from logs",
    ),
    "logs": Verb(
        "logs", "LogsOptions", "FILE", "content of a vehicle's log: .BIN, .tlog, MCAP, bag"
    ),
    "calibrate": Verb(
        "calibrate",
        "CalibrateVerb",
        "--touches FILE",
        "an arm's kinematics from touches",
        "calibrate-arm",
    ),
    "plan-seabed": Verb(
        "plan_seabed", "PlanOptions", "--cloud FILE", "a tool path on the seabed from a cloud"
    ),
    "campaign": Verb(
        "campaign", "CampaignOptions", "FILE", "many runs with drawn parameters", "run-campaign"
    ),
    "compare-campaigns": Verb(
        "compare_campaigns",
        "CompareCampaignsOptions",
        "FOLDER FOLDER",
        "two campaigns, paired by case",
    ),
    "models": Verb(
        "vehicles.models",
        "ModelsOptions",
        "",
        "named models, their size and sources",
        "show-models",
    ),
    "validate": Verb(
        "validate",
        "ValidateOptions",
        "",
        "the physics against closed forms, in a checkout",
        "validate-physics",
    ),
    "results": Verb(
        "results",
        "ResultsOptions",
        "",
        "tables of the experiments, printed and checked, in a checkout",
    ),
    "serve ardupilot": Verb(
        "live.serve", "ArduPilotOptions", "", "physics behind ArduPilot's simulation, over UDP"
    ),
    "serve udp": Verb("live.serve", "UdpOptions", "NAME", "a job with a controller behind UDP"),
    "drive": Verb(
        "live.drive", "DriveOptions", "NAME", "a job driven by inputs of a file or by keys"
    ),
    "benchmark": Verb(
        "benchmark",
        "BenchmarkOptions",
        "--entry NAME",
        "score of a controller: UUV contact",
        "contact-score",
    ),
}


def _usage() -> str:
    begin = {name: f"uuv {name} {verb.words}".rstrip() for name, verb in VERBS.items()}
    wide = max(map(len, begin.values())) + 2
    return "\n".join(f"{begin[name]:<{wide}}{verb.about}" for name, verb in VERBS.items())


USAGE = _usage()


def main() -> NoReturn:
    """Runs the verb of the command line, and exits with its code."""
    from uuv.sim.runs.process import (
        BAD_INPUT,
        parts_from_the_working_folder,
        quiet_pipe,
        refuse_foreign_system,
    )

    refuse_foreign_system()
    args = sys.argv[1:]
    name = chosen(args)
    if name:
        from uuv.start import run_scenario

        if name == "picture":
            _choose_renderer()
        parts_from_the_working_folder()
        verb = VERBS[name]
        rest = args[len(name.split()) :]
        sys.argv = [f"uuv {name}", *rest]
        run_scenario(lambda: importlib.import_module(f"uuv.cli.{verb.module}").main(name, rest))

    with quiet_pipe():  # these answers need no heavy import
        if not args or args[0] in ("-h", "--help", "help"):
            print(f"{USAGE}\n\nuuv VERB --help lists the options of a verb.")
            raise SystemExit(0)

        if args[0] == "--version":
            from importlib.metadata import version

            print(f"uuv-arm {version('uuv-arm')}")
            raise SystemExit(0)
        print(f"error: {no_verb(args)}", file=sys.stderr)
        raise SystemExit(BAD_INPUT)


def chosen(args: Sequence[str]) -> str:
    """The verb that a command line begins with; empty if it begins with none."""
    both = " ".join(args[:2])
    if both in VERBS:
        return both
    return args[0] if args and args[0] in VERBS else ""


def no_verb(args: Sequence[str]) -> str:
    """Message on a command line without a verb: an earlier spelling, a group alone, or unknown."""
    from uuv.sim.interfaces.errors import did_you_mean, one_line

    word, *more = args
    if spelling := present_spelling(word):
        return f"{one_line(word)}: this command is now `uuv {spelling}`"
    if objects := objects_of(word):
        got = one_line(more[0]) if more else "none"
        return f"{word}: needs one of {', '.join(objects)}, got {got}{did_you_mean(got, objects)}"

    first = list(dict.fromkeys(name.partition(" ")[0] for name in VERBS))
    return f"no verb {one_line(word)!r}; there are {', '.join(first)}{did_you_mean(word, first)}"


def present_spelling(word: str) -> str:
    """The verb that replaces an earlier command of that name; empty if there was none."""
    plain = word.removesuffix(".py").replace("_", "-")
    for name, verb in VERBS.items():
        if plain == verb.earlier or (plain == name.replace(" ", "-") and word != name):
            return name
    return ""


def objects_of(group: str) -> list[str]:
    """Second words of the verbs whose first one is `group`."""
    return [name.partition(" ")[2] for name in VERBS if name.startswith(f"{group} ")]


def _choose_renderer() -> None:
    """Select EGL for MuJoCo if there is no screen; MuJoCo reads the variable when imported."""
    from ctypes.util import find_library

    if not os.environ.get("DISPLAY") and find_library("EGL"):
        os.environ.setdefault("MUJOCO_GL", "egl")


if __name__ == "__main__":
    main()
