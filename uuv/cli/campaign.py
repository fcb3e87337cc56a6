"""`uuv campaign FILE`: runs a scenario many times with drawn parameters, or resumes that."""

import shlex
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import Positional, arg

from uuv.cli.carry_out import METRICS, Assignments, run_job, values_of
from uuv.cli.json_output import file_alone
from uuv.experiment.options import HarnessOptions, at_least
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import shown
from uuv.sim.runs.command_line import RunOptions
from uuv.start import parse

if TYPE_CHECKING:
    from uuv.campaigns.campaign import Campaign, CampaignRun
    from uuv.experiment import Row


@dataclass(kw_only=True)
class CampaignOptions(HarnessOptions):
    """Run or resume a campaign."""

    file: Annotated[Positional[Path], arg(metavar="FILE", help="Campaign file (TOML).")]
    seed: int | None = None
    """Seed instead of that in the file."""
    cases: int | None = None
    """Number of cases instead of that in the file."""
    set: Assignments = ()
    """KEY=VALUE for the same value in all runs, VALUE in TOML; the other draws stay, so that
    runs can be compared."""
    drawn: Path | None = None
    """Run the drawn cases in this file (JSON) instead of drawing: their values by dotted key."""
    write_drawn: Path | None = None
    """Write the drawn cases to this file, in the format of --drawn, and run nothing."""
    trust: bool = False
    """Also run the code MODULE:ATTRIBUTE that the file or its base names; code named on this
    command line needs no permission."""
    only: int | None = None
    """Carry out only the run of this number, if its row is missing."""
    version: str = ""
    """With --replay: the run in this version of the file's [versions]; with --only: this version
    in addition to the run without it."""
    replay: int | None = None
    """Repeat the run of this number with full recording, in a folder of its own; its trajectory is
    the same to the bit."""
    json: bool = False
    """Print metrics.json alone: of the campaign, with --replay of the run."""
    page: bool = False
    """Run nothing: summarise the existing rows, also during a campaign, and also if other code
    made them."""

    def __post_init__(self) -> None:
        super().__post_init__()
        at_least(self, cases=1, only=0, replay=0)
        if (self.only is not None) + (self.replay is not None) + self.page > 1:
            raise ConfigurationError("--only, --replay and --page: give only one of them")
        if self.version and self.only is None and self.replay is None:
            raise ConfigurationError("--version: only with --only or --replay")
        if self.drawn is not None and self.seed is not None:
            raise ConfigurationError(
                "--drawn and --seed: give only one of them; the cases of a file are drawn already"
            )


def main(verb: str, args: Sequence[str]) -> int:
    """Runs or resumes the campaign, or replays one of its runs; returns the exit code."""
    del verb
    started = time.perf_counter()
    options = parse(CampaignOptions, args)
    work = partial(campaign, options, started)
    return file_alone(work, METRICS) if options.json else work()


def campaign(options: CampaignOptions, started: float) -> int:
    """Runs or resumes the campaign, or replays one of its runs; returns the exit code.

    Args:
        options: Options of the command line.
        started: [s] time.perf_counter() at the start of the command.

    Raises:
        UuvError: The file or an option is wrong, or the folder cannot be used.
    """
    from uuv.campaigns.campaign import EXPERIMENT, read_campaign, read_drawn
    from uuv.experiment.drawn_cases import write_cases
    from uuv.inputs import check_inputs

    # The campaign, with the values typed on the command line.
    settings = values_of(options.set)
    described = read_campaign(options.file, settings, trust=options.trust)
    changed = {
        name: option for name in ("seed", "cases") if (option := getattr(options, name)) is not None
    }
    described = replace(described, **changed)
    typed = [f"--{name} {value}" for name, value in changed.items()]
    typed += ["--trust"] if options.trust else []
    typed += ["--set", *map(shlex.quote, settings)] if settings else []

    # Its cases.
    drawn = described.drawn()
    if options.drawn is not None:
        typed.append(f"--drawn {shlex.quote(str(options.drawn))}")
        drawn = read_drawn(options.drawn, described, settings)[: options.cases]
    if options.write_drawn is not None:
        write_cases(options.write_drawn, EXPERIMENT, drawn)
        return 0

    # Its runs: repeat one, carry out one alone, or all.
    runs = described.all_runs(drawn)
    if options.replay is not None:
        return replay(one_of(runs, options.replay, options.version), described, options, started)
    if not options.page:
        check_inputs(runs[0].scenario())
    if options.only is not None:
        versions = dict.fromkeys(("", options.version))
        runs = [one_of(runs, options.only, version) for version in versions]
    return carry_out(runs, described, options, " ".join((shlex.quote(str(options.file)), *typed)))


def replay(
    run: "CampaignRun", described: "Campaign", options: CampaignOptions, started: float
) -> int:
    """Repeats a run with all its output; returns the exit code."""
    folder = f"case_{run.case:04d}" + f"_{run.version}".rstrip("_").replace(" ", "_")
    scenario = replace(run.scenario(), name=f"{described.name}/{folder}")
    which = f", case {run.case} of {described.name}"
    return run_job(scenario, RunOptions(out=options.out), started, which)


def carry_out(
    runs: "list[CampaignRun]", described: "Campaign", options: CampaignOptions, file: str
) -> int:
    """Carries out missing runs, or none with --page, and summarises; returns the exit code.

    Args:
        runs: Runs of the campaign.
        described: The campaign.
        options: Options of the command line.
        file: Its file, and the options that change it, for the replay commands.
    """
    from uuv.campaigns.campaign_report import summarise
    from uuv.campaigns.campaign_rows import crashed_row, one_run
    from uuv.experiment import Study

    study = Study(
        cases=runs,
        run_one=one_run,
        summarise=partial(summarise, campaign=described, file=file),
        failed=crashed_row,
        line=line,
    )
    title = f"Campaign {described.name}"
    if options.page:
        return study.sum_up(described.name, options, title)
    return study.carry_out(described.name, options, title, described.limits)


def one_of(runs: "list[CampaignRun]", case: int, version: str) -> "CampaignRun":
    """The run with a number in a version; the version "" is the campaign without a version.

    Raises:
        ConfigurationError: There is no such run.
    """
    versions = dict.fromkeys(run.version for run in runs)
    if version not in versions:
        known = ", ".join(filter(None, versions)) or "none"
        raise ConfigurationError(f"--version: allowed {known}, got {shown(version)}")
    numbers = [run.case for run in runs if run.version == version]
    if case not in numbers:
        raise ConfigurationError(f"case: allowed 0 to {max(numbers)}, got {case}")
    return next(run for run in runs if run.version == version and run.case == case)


def line(row: "Row") -> str:
    """Line about a run that did not finish its work; empty for others and for versions."""
    from uuv.campaigns.run_outcome import DONE

    if row["ended"] == DONE or row["version"]:
        return ""
    return f"case {row['case']:4d}  {row['ended']}: {row['code']}"
