"""A job whose controller is another process: what `uuv serve udp` runs."""

import math
from dataclasses import replace
from typing import TextIO

from uuv.assembly import Assembly
from uuv.command import command
from uuv.controllers.safety.safety_wrapper import SafetyWrapper
from uuv.pace import WallClock
from uuv.scenario import Scenario
from uuv.serve.datagrams import Endpoint
from uuv.serve.remote_controller import UdpController, await_client
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.runs.command_line import RunOptions

SLOWEST = 100.0  # [Hz] rate of commands
FASTEST = 500.0  # [Hz]


def run_remote(
    scenario: Scenario,
    options: RunOptions,
    endpoint: Endpoint,
    started: float,
    *,
    rate: float = FASTEST,
    counts: TextIO | None = None,
) -> int:
    """Run a scenario with progress on screen, its controller behind a socket; the exit code.

    Args:
        scenario: What to run.
        options: Of the run; its pace is that of the exchange, none: lockstep.
        endpoint: Bound socket.
        started: [s] time.perf_counter() at the start of the command.
        rate: [Hz] of the commands, in simulated time.
        counts: Where the counts of frames and the lateness are printed at the end; None: standard
            output.

    Raises:
        UuvError: The rate is out of bounds, no client came, or the work could not begin.
    """
    if not (math.isfinite(rate) and SLOWEST <= rate <= FASTEST):
        raise ConfigurationError(f"rate [Hz]: must be {SLOWEST:g} to {FASTEST:g}, got {rate:g}")

    pace = None if options.pace is None else WallClock(options.pace)
    remotes: list[UdpController] = []

    def with_remote(assembly: Assembly) -> Assembly:
        believed = assembly.own
        remote = UdpController(endpoint, believed.vehicle, period=1.0 / rate, pace=pace)
        remotes.append(remote)
        parts = replace(assembly.parts, controller=SafetyWrapper(remote, believed.model))
        return replace(assembly, loop=replace(assembly.loop, parts=parts))

    def refused(reason: str) -> None:
        print(f"refused: {reason}", file=counts, flush=True)

    await_client(endpoint, refused=refused)  # here, where Ctrl-C ends the command at once
    try:
        return command(
            scenario,
            replace(options, pace=None),
            started,
            ", controller over UDP",
            changed=with_remote,
        )
    finally:
        for remote in remotes:
            remote.close()
            print(f"frames: {remote.traffic.summary()}", file=counts)
        if pace is not None:
            print(pace.summary(), file=counts)
