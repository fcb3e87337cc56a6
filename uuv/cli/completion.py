"""Completion in the shell: `source <(uuv completion bash)`, or zsh."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from importlib import import_module
from typing import Annotated, Any, get_type_hints

from tyro.conf import Positional, arg

from uuv import jobs, models
from uuv.catalogue import SHELVES
from uuv.cli.main import VERBS, Verb, objects_of
from uuv.cli.past.past_runs import Run
from uuv.cli.run_job import EveryJob, file_options
from uuv.cli.skeletons import KINDS
from uuv.jobs.command_line import options_class as options_of_job
from uuv.sim.interfaces.errors import ConfigurationError, did_you_mean
from uuv.sim.runs.command_line import parse

_SHELLS = ("bash", "zsh")
_OF_VEHICLES = ("--vehicle",)  # options whose value may be the name of a vehicle
_ON_VEHICLES = ("check", "models")  # verbs whose first argument is a vehicle
_ZSH = "autoload -U +X compinit && compinit\nautoload -U +X bashcompinit && bashcompinit\n"
_MARK = getattr(Positional[str], "__metadata__")[0]  # noqa: B009  mark of an argument without --
_SCRIPT = """_uuv() {{
    local word=${{COMP_WORDS[COMP_CWORD]}} words=""
    case "$COMP_CWORD ${{COMP_WORDS[1]}} ${{COMP_WORDS[2]}}" in
    "1 "*) words="{verbs}" ;;
{groups}
    "2 run "*) words="{jobs}" ;;
    "2 new "*) words="{skeletons}" ;;
    "2 completion "*) words="{shells}" ;;
{by_job}
{by_verb}
    esac
    case "${{COMP_WORDS[COMP_CWORD-1]}}" in
    {vehicle_options}) words="{vehicles}" ;;
    esac
    case "$word" in
    -*) COMPREPLY=($(compgen -W "$words" -- "$word")) ;;
    *) COMPREPLY=($(compgen -W "$words" -- "$word") $(compgen -f -- "$word")) ;;
    esac
}}
complete -o filenames -F _uuv uuv
"""


@dataclass(kw_only=True)
class CompletionOptions:
    """Print the script that completes verbs, names and options: source <(uuv completion bash)."""

    shell: Annotated[Positional[str], arg(metavar="SHELL", help=f"One of {', '.join(_SHELLS)}.")]


def main(verb: str, args: Sequence[str]) -> int:
    """Prints the script; returns the exit code."""
    del verb
    shell = parse(CompletionOptions, args).shell

    if shell not in _SHELLS:
        allowed = ", ".join(_SHELLS)
        raise ConfigurationError(
            f"completion: allowed {allowed}, got {shell!r}{did_you_mean(shell, _SHELLS)}"
        )
    print((_ZSH if shell == "zsh" else "") + script(), end="")
    return 0


def script() -> str:
    """Completion for bash."""
    firsts = dict.fromkeys(name.partition(" ")[0] for name in VERBS)
    groups = {first: objects_of(first) for first in firsts if objects_of(first)}
    names = jobs.JOBS.names()
    by_job = {name: options_in(options_of_job(jobs.named(name), EveryJob)) for name in names}
    by_job["*.toml"] = options_in(file_options())

    return _SCRIPT.format(
        verbs=" ".join(firsts),
        groups=_cases((f'"2 {first} "*', objects) for first, objects in groups.items()),
        jobs=" ".join(names),
        skeletons=" ".join(KINDS),
        shells=" ".join(_SHELLS),
        vehicles=" ".join(models.available()),
        vehicle_options="|".join(_OF_VEHICLES),
        by_job=_cases((f'*" run "{job}', words) for job, words in by_job.items()),
        by_verb=_cases((_pattern(name), words_of(name, verb)) for name, verb in VERBS.items()),
    )


def words_of(name: str, verb: Verb) -> list[str]:
    """Words that may follow a verb: its options, and names if it takes any."""
    kind = options_class(verb)
    hints = get_type_hints(kind, include_extras=True)
    takes_runs = Run in hints.values()

    names = list(jobs.JOBS.names()) if takes_runs else []  # the latest run of a job
    if name == "list":
        names = [shelf.kind for shelf in SHELVES]
    if name in _ON_VEHICLES:
        names = list(models.available())
    return [*names, *options_in(kind)]


def options_class(verb: Verb) -> type[Any]:
    """Class of the options of a verb."""
    return getattr(import_module(f"uuv.cli.{verb.module}"), verb.options)


def options_in(kind: type[Any]) -> list[str]:
    """Options of a class as they are typed."""
    hints = get_type_hints(kind, include_extras=True)
    words = []
    for field in fields(kind):
        if _MARK not in getattr(hints[field.name], "__metadata__", ()):
            name = field.name.replace("_", "-")
            words.append(f"--no-{name}" if field.default is True else f"--{name}")
    return [*words, "--help"]


def _pattern(name: str) -> str:
    """Pattern of number, first and second word of a command line with that verb."""
    return f'*" {name}"' if " " in name else f'*" {name} "*'


def _cases(entries: Iterable[tuple[str, Sequence[str]]]) -> str:
    """Branches of the script: words by pattern."""
    return "\n".join(f'    {pattern}) words="{" ".join(words)}" ;;' for pattern, words in entries)
