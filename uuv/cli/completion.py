"""Completion in the shell: `source <(uuv completion bash)`, or zsh."""

from collections.abc import Sequence
from dataclasses import fields

from uuv import jobs as options
from uuv.catalogue import JOBS, SHELVES
from uuv.cli.main import VERBS
from uuv.cli.skeletons import SKELETONS
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.runs.command_line import OF_UUV_RUN

_ZSH = "autoload -U +X compinit && compinit\nautoload -U +X bashcompinit && bashcompinit\n"
_OF_PAST_RUNS = ("compare", "replay", "report", "view", "picture")
_OF_RUN = (*OF_UUV_RUN, "--trust", "--help")
_SCRIPT = """_uuv() {{
    local word=${{COMP_WORDS[COMP_CWORD]}} words=""
    case "$COMP_CWORD ${{COMP_WORDS[1]}}" in
    1*) words="{verbs}" ;;
    "2 run") words="{jobs}" ;;
    *" list") words="{kinds}" ;;
    "2 new") words="{skeletons}" ;;
{past}
    *" run")
        case "${{COMP_WORDS[2]}}" in
{by_job}
        esac ;;
    esac
    case "$word" in
    -*) COMPREPLY=($(compgen -W "$words" -- "$word")) ;;
    *) COMPREPLY=($(compgen -W "$words" -- "$word") $(compgen -f -- "$word")) ;;
    esac
}}
complete -o filenames -F _uuv uuv
"""


def main(verb: str, args: Sequence[str]) -> int:
    """Prints the script; returns the exit code."""
    del verb
    if len(args) != 1 or args[0] in ("-h", "--help"):
        print("usage: uuv completion bash|zsh\n\nCompletion of verbs, names and options: source <(uuv completion bash)")
        return 0 if args and args[0] in ("-h", "--help") else 2
    if args[0] not in ("bash", "zsh"):
        raise ConfigurationError(f"completion: allowed bash, zsh, got {args[0]!r}")
    print((_ZSH if args[0] == "zsh" else "") + script(), end="")
    return 0


def script() -> str:
    """Completion for bash."""
    by_job = "\n".join(f'        {job}) words="{" ".join(options_of(job))}" ;;' for job in JOBS)
    past = "\n".join(f'    *" {verb}") words="{" ".join(JOBS)}" ;;' for verb in _OF_PAST_RUNS)
    return _SCRIPT.format(
        verbs=" ".join(VERBS),
        jobs=" ".join(JOBS),
        kinds=" ".join(shelf.kind for shelf in SHELVES),
        skeletons=" ".join(SKELETONS),
        past=past,
        by_job=by_job,
    )


def options_of(job: str) -> list[str]:
    """Options of a job as they are typed."""
    words = []
    for field in fields(getattr(options, JOBS[job])):
        name = field.name.replace("_", "-")
        words.append(f"--no-{name}" if field.default is True else f"--{name}")
    return [*words, *_OF_RUN]
