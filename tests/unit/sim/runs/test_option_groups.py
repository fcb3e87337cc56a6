"""Options are shown in groups, with what their class says of them, and parsed as without groups."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import ClassVar

import pytest
import tyro

from uuv.jobs import Job, clean_barrel, clean_pile, insert_sampler, sample_seabed
from uuv.jobs.command_line import options_class
from uuv.sim.runs.option_groups import cli


@pytest.mark.parametrize(
    "job", [clean_barrel, clean_pile, insert_sampler, sample_seabed], ids=lambda job: job.name
)
def test_same_options_as_without_groups(job: Job, capsys: pytest.CaptureFixture[str]):
    kind = options_class(job)
    args = ["--seed", "3", "--current", "0", "0.2", "0", "--no-record", "--out", "there"]
    assert cli(kind, args) == tyro.cli(kind, args=args)
    assert cli(kind, []) == kind()
    with pytest.raises(SystemExit):
        cli(kind, ["--help"])
    output = capsys.readouterr().out
    for title in ("water options", "output options", "vehicle options", "job options"):
        assert title in output
    for option in fields(kind):
        assert option.name.replace("_", "-") in output
    assert "Steady current [m/s], world axes" in " ".join(output.replace("│", " ").split())


@dataclass(kw_only=True)
class Base:
    """A base."""

    groups: ClassVar[Mapping[str, str]] = {"place": "where"}

    where: Path | None = None
    """A place."""


@dataclass(kw_only=True)
class Derived(Base):
    """Does it."""

    what: str
    """What it does."""
    often: int = 2
    """How often."""
    where: Path | None = Path("here")


def test_a_default_of_a_derived_class_stays(capsys: pytest.CaptureFixture[str]):
    assert cli(Derived, ["--what", "it"]) == Derived(what="it")
    assert cli(Derived, ["--what", "it", "--where", "there"]) == Derived(
        what="it", where=Path("there")
    )
    with pytest.raises(SystemExit):
        cli(Derived, ["--help"])
    output = capsys.readouterr().out
    assert "A place. (default: here)" in output
    assert output.index("How often.") < output.index("place options")
