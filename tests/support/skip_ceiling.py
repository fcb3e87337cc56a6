"""A pytest plug-in: `--most-skipped N` prints skips by count and reason, and fails if there are
more than N.
"""

from collections import Counter

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.getgroup("skips").addoption(
        "--most-skipped",
        type=int,
        metavar="N",
        help="print skips by count and reason; fail if there are more than N",
    )


def pytest_configure(config: pytest.Config) -> None:
    most = config.option.most_skipped
    # xdist's workers report to the process that judges
    if most is not None and not hasattr(config, "workerinput"):
        config.pluginmanager.register(SkipCeiling(most))


class SkipCeiling:
    """Counts skips by reason.

    A file that is skipped as a whole counts once, since nobody knows what it holds.
    """

    def __init__(self, most: int) -> None:
        self.most = most
        self.reasons: Counter[str] = Counter()

    @property
    def exceeded(self) -> bool:
        return self.reasons.total() > self.most

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.skipped and not hasattr(report, "wasxfail"):
            self.reasons[reason_of(report)] += 1

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        if report.skipped:
            self.reasons[f"{reason_of(report)} (whole file {report.nodeid})"] += 1

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if self.exceeded and session.exitstatus == pytest.ExitCode.OK:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        verdict = "more than" if self.exceeded else "at most"
        terminalreporter.section(
            f"skipped: {self.reasons.total()}, {verdict} {self.most}", red=self.exceeded
        )
        for reason, count in self.reasons.most_common():
            terminalreporter.line(f"{count:5d}  {reason}")


def reason_of(report: pytest.TestReport | pytest.CollectReport) -> str:
    """Why a test or a file was skipped."""
    reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
    return reason.removeprefix("Skipped: ")
