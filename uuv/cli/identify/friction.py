"""`uuv identify friction`: runs the job identify-friction."""

import time
from collections.abc import Sequence

from uuv import jobs
from uuv.cli.run_job import EveryJob, run
from uuv.jobs.command_line import options_class

FrictionVerb = options_class(jobs.identify_friction, EveryJob)


def main(verb: str, args: Sequence[str]) -> int:
    """Runs the identification; returns the exit code."""
    del verb
    return run(jobs.identify_friction, args, time.perf_counter())
