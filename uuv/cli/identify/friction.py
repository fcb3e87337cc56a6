"""`uuv identify friction`: the job identify-friction by the name of what it does."""

import time
from collections.abc import Sequence

from uuv import jobs
from uuv.cli.job_command_line import options_class
from uuv.cli.run_job import run

FrictionVerb = options_class(jobs.identify_friction)


def main(verb: str, args: Sequence[str]) -> int:
    """Runs the identification; returns the exit code."""
    del verb
    return run(jobs.identify_friction, args, time.perf_counter())
