"""The house keeps its word: our rooms and no others, a leaf that stays a leaf, documents whose
commands are true.
"""

import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import pytest
import yaml

from uuv.cli.main import chosen
from uuv.jobs import JOBS
from uuv.sim.runs.command_line import ROOMS

ROOT = Path(__file__).resolve().parents[3]
SCRIPTS = sorted(
    path for path in (ROOT / "scripts").rglob("*.py") if "    run_scenario(" in path.read_text()
)
README = ROOT / "README.md"
DOCUMENTS = [README, *sorted((ROOT / "docs").glob("*.md"))]
LEAF = "uuv.sim.interfaces"


def commands_in(document: Path) -> list[str]:
    """The commands ./uvw and uuv in the fenced blocks of a document, continued lines joined."""
    text = document.read_text(encoding="utf-8")
    fenced = re.findall(r"^```(\w*)[^\n]*\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)
    blocks = [block for kind, block in fenced if kind != "text"]  # what is printed is no command
    lines = "\n".join(blocks).replace("\\\n", " ").splitlines()
    commands = [part.strip().removeprefix("$ ") for line in lines for part in line.split(" | ")]
    return [command for command in commands if command.startswith(("./uvw ", "uuv "))]


def modules_after(statement: str) -> set[str]:
    """Modules that `statement` adds to those of a bare interpreter."""
    code = f"import sys; before = set(sys.modules); {statement}; print(*set(sys.modules) - before)"
    run = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return set(run.stdout.split())


@pytest.mark.parametrize("room", ROOMS)
def test_room_is_ours(room: str):
    file = import_module(f"uuv.{room}").__file__
    assert file is not None
    assert Path(file).resolve() == ROOT / room / "__init__.py"


def test_leaf_imports_numpy_only():
    leaf = sorted((ROOT / "sim" / "interfaces").glob("*.py"))
    names = [LEAF if path.stem == "__init__" else f"{LEAF}.{path.stem}" for path in leaf]
    assert len(names) > 3
    loaded = modules_after("import " + ", ".join(names)) - modules_after(
        "import numpy.random, numpy.typing"
    )
    ours = {"uuv", "uuv.sim", *(name for name in loaded if name.startswith(LEAF))}
    assert {
        name
        for name in loaded - ours
        if name.partition(".")[0] not in {"numpy", *sys.stdlib_module_names}
    } == set()


@pytest.mark.parametrize("room", ["perception", "calib"])
def test_room_is_imported_lazily(room: str):
    loaded = modules_after(f"import uuv.{room}")
    assert not {"embreex", "open3d", "scipy", "numba", "mujoco", "trimesh"} & loaded


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.name)
def test_script_starts_as_all_do(script: Path):
    assert script.stem not in ROOMS, "a script named like a room hides it"
    text = script.read_text()
    assert re.search(r"^from uuv\.start import .*\brun_scenario\b", text, flags=re.MULTILINE)
    assert re.search(r"^    run_scenario\((\w+\.)?main\)$", text, flags=re.MULTILINE)


def without_uv_options(words: list[str]) -> list[str]:
    """A command without what it tells uv, which must be true as well."""
    while words[0].startswith("--"):
        option, argument, *words = words
        if option == "--with-requirements":
            assert (ROOT / argument).is_file(), argument
        elif option == "--group":
            assert (
                argument
                in tomllib.loads((ROOT / "pyproject.toml").read_text())["dependency-groups"]
            ), argument
        elif option == "--extra":
            assert (
                argument
                in tomllib.loads((ROOT / "pyproject.toml").read_text())["project"][
                    "optional-dependencies"
                ]
            ), argument
        else:
            assert option == "--with", option
    return words


def verbs_in(document: Path) -> list[str]:
    """What follows the word `uuv` where running text shows a command."""
    text = re.sub(
        r"^```.*?^```", "", document.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL
    )
    return re.findall(r"`(?:\./uvw run (?:--group \w+ )?)?uuv ([^`]+)`", text)


def words_of_verb(words: list[str]) -> list[str]:
    """Words that choose what helps: of a verb, and of a job where it is `run NAME`; it must be
    there.
    """
    name = chosen(words)
    assert name, f"uuv {' '.join(words)}: no such verb"
    if (
        name == "run"
        and len(words) > 1
        and (words[1] in JOBS.names() or words[1].endswith(".toml"))
    ):
        return words[:2]
    return name.split()


def test_commands_of_the_documents_are_true(script, verb):
    commands = [command for document in DOCUMENTS for command in commands_in(document)]
    helps: dict[str, str] = {}  # by script
    assert commands_in(README), "the README must tell a newcomer what to run"
    assert len(commands) > len(commands_in(README)), "docs/ must tell how its figures are made"
    for command in commands:
        words = shlex.split(command, comments=True)
        if words[0] == "uuv":
            program, *options = words
        else:
            assert words[1] in ("run", "sync"), command
            if words[1] == "sync":
                continue
            program, *options = without_uv_options(words[2:])
        if program == "uuv":
            if not options or options[0].startswith("-"):
                continue
            if "--task" in options or (options[0] == "run" and ":" in options[1]):
                continue  # a task or a job of the reader's own has options of its own
            chooses = words_of_verb(options)
            program = " ".join(["uuv", *chooses])
            if program not in helps:
                helps[program] = verb(*chooses, "--help").stdout
                assert helps[program].startswith(f"usage: uuv {chooses[0]}"), command
        elif not program.endswith(".py"):
            assert shutil.which(program, path=str(Path(sys.executable).parent)), command
            continue
        elif program.startswith("scripts/experiments/environments/") and not find_spec(
            "dm_control"
        ):
            continue  # which they are about; it has no packages for Python 3.13
        elif program not in helps:
            assert (ROOT / program).is_file(), f"{command}: no such script"
            ran = script(
                program.removeprefix("scripts/").removesuffix(".py").replace("/", "."), "--help"
            )
            assert ran.returncode == 0, ran.stderr
            helps[program] = ran.stdout
        for option in (word.partition("=")[0] for word in options if re.match(r"--[a-z]", word)):
            assert re.search(rf"(?<![\w-]){option}(?![\w-])", helps[program]), (
                f"{command}: {option} is not in --help"
            )


def test_verbs_of_the_documents_and_sources_are_there():
    sources = [path for name in ("uuv", *ROOMS, "scripts") for path in (ROOT / name).rglob("*.py")]
    texts = {path: verbs_in(path) for path in [*DOCUMENTS, ROOT / "CONTRIBUTING.md", *sources]}
    no_verbs = ("VERB", "-", "{", "...")  # placeholders, options of `uuv` itself
    commands = [
        (path.name, text)
        for path, lines in texts.items()
        for text in lines
        if not text.startswith(no_verbs)
    ]
    assert len(commands) > 40
    assert [(page, text) for page, text in commands if not chosen(text.split())] == []


def test_ci_runs_what_a_newcomer_is_told_to():
    tests = [command for command in commands_in(README) if " pytest" in command] or [
        "./uvw run pytest"
    ]
    ci = ROOT / ".ci" / "run"
    assert os.access(ci, os.X_OK)
    assert any(line.endswith(f" {tests[0]}") for line in ci.read_text().splitlines())


def test_the_workflow_runs_on_all_packages_that_ci_knows():
    (names,) = re.findall(
        r"^OTHERS=\((.+)\)", (ROOT / ".ci" / "run").read_text(), flags=re.MULTILINE
    )
    jobs = yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yml").read_text())["jobs"]
    options = [job["options"] for job in jobs["check"]["strategy"]["matrix"]["include"]]
    assert options == ["", *(f"--on {name}" for name in names.split())]


@pytest.mark.skipif(os.name != "posix", reason="uvw is for a POSIX shell")
def test_uvw_parses_and_is_executable():
    uvw = ROOT / "uvw"
    assert os.access(uvw, os.X_OK)
    subprocess.run(["sh", "-n", uvw], check=True)


def test_lock_names_public_registries_only():
    hosts = set(re.findall(r"https?://([^/\"]+)", (ROOT / "uv.lock").read_text()))
    assert hosts == {"pypi.org", "files.pythonhosted.org"}
