"""A controller behind links that lose, delay and bundle its commands: force and end of the work.

The work controller stands behind a link in simulated time, with the frames of `uuv serve udp`: what
a real link does to them in real time this one does exactly, and as fast as the computer can. Until
the torque sensors are tared the controller is built in, which is faster.
"""

from uuv.start import run_scenario  # isort: skip

import heapq
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from uuv import jobs
from uuv.assembly import Assembly, assemble
from uuv.controllers.safety.safety_wrapper import SafetyWrapper
from uuv.experiment import Page, column, experiment, stat
from uuv.pace import WallClock
from uuv.runner import run
from uuv.serve import client
from uuv.serve.client import Packet
from uuv.serve.own_controller import OwnController
from uuv.serve.remote_controller import UdpController
from uuv.sim.interfaces.messages import Command, Reference, StateEstimate, WorkState
from uuv.sim.interfaces.protocols import Controller
from uuv.sim.interfaces.spatial import one_of
from uuv.sim.interfaces.streams import Streams

PERIOD = 0.002  # [s] of the commands
LATE = 0.05  # [s]
SHARE = 0.01  # of the commands that are lost, and of those that come twice
EVERY = 2.0  # [s] between two bursts
JOB = "clean-barrel"
BEGIN = 53.0  # [s] some seconds before the torque sensors are tared


@dataclass(frozen=True, kw_only=True)
class Link:
    """What happens to commands on their way."""

    delay: float = 0.0  # [s] of each
    jitter: float = 0.0  # [s] of delay beyond it, drawn for each
    lost: float = 0.0  # share that does not arrive
    doubled: float = 0.0  # share that arrives twice
    burst: float = 0.0  # [s] at a time, in which commands wait, to arrive together
    killed: WorkState | None = None  # state at whose end the client is gone

    def arrivals(self, time: float, rng: np.random.Generator) -> list[float]:
        """Times [s] at which a command of a time [s] arrives."""
        if rng.random() < self.lost:
            return []
        if time % EVERY < self.burst:
            time += self.burst - time % EVERY

        times = [time + self.delay + self.jitter * rng.random()]
        return 2 * times if rng.random() < self.doubled else times


LINKS = {
    "in time": Link(),
    "lost, doubled": Link(lost=SHARE, doubled=SHARE),
    "late": Link(delay=LATE),
    "late, jitter": Link(delay=0.6 * LATE, jitter=0.4 * LATE),
    "late, lost, doubled": Link(delay=LATE, lost=SHARE, doubled=SHARE),
    "bursts": Link(burst=LATE),
    "killed": Link(killed=WorkState.PRESS),
}


class SimulatedLink:
    """Link between a simulation and a client, both of which wait for nothing but simulated time."""

    port = 0

    def __init__(
        self, answer: Callable[[Packet], bytes], link: Link, rng: np.random.Generator
    ) -> None:
        """Connect a client.

        Args:
            answer: Frame of the client's command, by the measurement.
            link: What happens to it.
            rng: Draws of that.
        """
        self.peer: tuple[str, int] | None = ("simulated", 0)
        self.time = 0.0  # [s] simulated
        self._answer = answer
        self._link = link
        self._rng = rng
        self._pressed = False
        self._gone = False
        self._coming: list[tuple[float, int, bytes]] = []  # time, number, frame
        self._number = 0

    def begin(self, time: float) -> None:
        """Set the simulated time [s]."""
        self.time = time

    def clock(self) -> float:
        """Simulated time [s]."""
        return self.time

    def send(self, data: bytes) -> bool:
        """Give a frame to the client, whose answer is on its way at once."""
        frame = client.unpack(data)
        state = list(WorkState)[int(frame.state)] if frame.kind == client.MEASURED else None
        self._pressed |= state is not None and state is self._link.killed
        self._gone |= self._pressed and state is not self._link.killed
        if state is None or self._gone:
            return True

        # Nothing happens to the first frame, before the run.
        command = self._answer(frame)
        link = Link() if frame.flag(client.START) else self._link
        for time in link.arrivals(self.time, self._rng):
            self._number += 1
            heapq.heappush(self._coming, (time, self._number, command))
        return True

    def receive(self, patience: float = 0.0) -> bytes | None:
        """Next command; None: none within `patience` [s] simulated."""
        end = self.time + patience
        if self._coming and self._coming[0][0] <= end:
            arrived, _, command = heapq.heappop(self._coming)
            self.time = max(self.time, arrived)
            return command

        self.time = end
        return None

    def answer_there(self) -> None:
        """There is one client."""

    def interrupts(self, silence: float) -> bool:
        """There is one client."""
        del silence
        return False


def behind(
    assembly: Assembly,
    answer: Callable[[Packet], bytes],
    link: Link,
    *,
    period: float = PERIOD,
    seed: int = 0,
    begin: float = 0.0,
) -> tuple[Assembly, UdpController]:
    """An assembly whose controller is behind a link, and that controller.

    Args:
        assembly: Of the run.
        answer: Frame of the client's command, by the measurement.
        link: What happens to it.
        period: [s] between commands.
        seed: Of the link's draws.
        begin: [s] time until which the assembly's own controller goes on; 0: not at all.
    """
    connected = SimulatedLink(answer, link, Streams(seed)["link"])
    pace = WallClock(1.0, clock=connected.clock)
    believed = assembly.own

    # The safety wrapper is with the vehicle.
    remote = UdpController(connected, believed.vehicle, period=period, pace=pace)
    controller: Controller = remote
    if begin > 0.0:
        wrapped: Any = assembly.parts.controller
        controller = FromTime(wrapped.controller, remote, begin, connected.begin)
    parts = replace(assembly.parts, controller=SafetyWrapper(controller, believed.model))
    return replace(assembly, loop=replace(assembly.loop, parts=parts)), remote


def own_answer(job: str) -> Callable[[Packet], bytes]:
    """Answers of the project's own controller."""
    controller = OwnController(job)
    return lambda frame: client.answer(frame, **controller.answer(frame))


class FromTime:
    """A controller that another one follows at a time (`uuv.sim.interfaces.protocols`)."""

    def __init__(
        self, first: Controller, later: Controller, begin: float, begun: Callable[[float], None]
    ) -> None:
        """Set up both.

        Args:
            first: From the start.
            later: Its follower.
            begin: [s] time from which on.
            begun: Takes that time before the follower's first step.
        """
        self.period = first.period
        self._first = first
        self._later = later
        self._begin = begin
        self._begun = begun
        self._states: list[Any] = []  # of the first, and then of the later

    def init(self, estimate: StateEstimate) -> None:
        """Begin with the first."""
        self._states = [self._first.init(estimate)]

    def step(
        self, state: None, estimate: StateEstimate, reference: Reference
    ) -> tuple[None, Command]:
        """Step of the present one."""
        controller = self._first
        if estimate.time >= self._begin:
            controller = self._later
            if len(self._states) == 1:
                self._begun(estimate.time)
                self._states.append(controller.init(estimate))

        self._states[-1], command = controller.step(self._states[-1], estimate, reference)
        return state, command


@dataclass(frozen=True, kw_only=True)
class LinkCase:
    """One run behind a link."""

    link: str
    """What happens to commands on their way."""
    seed: int

    def __post_init__(self) -> None:
        """Raise ConfigurationError for a link that there is not."""
        one_of(self.link, tuple(LINKS), "--link")


@dataclass(frozen=True, kw_only=True)
class LinkRow:
    """How the work went."""

    ended: str = column("ended")
    note: str = column("note")
    age: float = column("oldest command", "ms", digits=0, factor=1e3)
    error: float | None = column("force, RMS error", "N", digits=2, default=None)
    share: float | None = column("peak over the set force", digits=3, default=None)


@experiment(
    "udp_links",
    seeds=3,
    vary={"link": tuple(LINKS)},
    paired=True,
    quick={"runs": 1, "link": ("late",)},
)
def udp_links(case: LinkCase) -> LinkRow:
    """Cleans a barrel with the controller behind a link."""
    scenario = jobs.clean_barrel(quick=True, sensor="survey", seed=case.seed)
    answer = own_answer(JOB)
    assembly, remote = behind(
        assemble(scenario), answer, LINKS[case.link], seed=case.seed, begin=BEGIN
    )
    done = run(assembly)

    # How it ended.
    recording = done.recording
    final = recording.final
    largest = float(recording["set_force"].scalar.max())
    peak = float(recording["contact_most"].scalar.max())
    return LinkRow(
        ended="done" if final.state is WorkState.DONE else str(final.abort or final.state),
        note=final.note,
        age=remote.traffic.oldest_s,
        error=done.assessment.metrics["contact"]["force_error_rms_n"],
        share=peak / largest if largest > 0.0 else None,
    )


udp_links.page = Page().table(
    "Links",
    by="link",
    columns=[
        stat("count", "link", "runs"),
        stat("count", lambda row: row["ended"] == "done", "done"),
        stat("largest", "age"),
        stat("largest", "error"),
        stat("largest", "share"),
    ],
)


if __name__ == "__main__":
    run_scenario(udp_links.main)
