"""Door of the benchmark: a controller that asks an entry in a process of its own.

The entry's process is a fresh interpreter. It gets a `Briefing`, then estimates and set points, and nothing else. A
crash, a silence beyond the limits or a wrong answer raises `EntryError` in the simulation.
"""

import os
import pickle
import socket
import struct
import subprocess
import sys
import tempfile
import time
from multiprocessing.connection import Connection
from typing import Any, Self

from models.vehicle import Vehicle
from scenarios.contact_benchmark.wire import FAILED, READY, Briefing, CommandCodec, EntryError, EstimateCodec
from sim.interfaces.errors import one_line
from sim.interfaces.messages import Command, Reference, StateEstimate
from sim.interfaces.spatial import finite_number

START_LIMIT = 180.0  # [s] wall, to import and make the entry
STEP_LIMIT = 60.0  # [s] wall, to answer one estimate; a machine with more work than cores makes every entry slow
RUN_LIMIT = 1800.0  # [s] wall, to answer all estimates of a run
_MODULE = "scenarios.contact_benchmark.entry_process"
_FAREWELL = 5.0  # [s] wall, for a process that has closed its connection to end
_TAIL = 4096  # bytes of the entry's output that are read for its last line


class RemoteController:
    """Controller that runs in a process of its own (`sim.interfaces.protocols.Controller`); a context manager.

    The state of the entry stays in its process; one `init` and the steps after it make one run.
    """

    def __init__(self, briefing: Briefing, *, step_limit: float = STEP_LIMIT, run_limit: float = RUN_LIMIT) -> None:
        """Start the process and brief the entry.

        Args:
            briefing: What the entry is told.
            step_limit: [s] wall time to answer one estimate.
            run_limit: [s] wall time to answer all estimates.

        Raises:
            EntryError: The entry cannot be made.
        """
        vehicle = Vehicle.of(briefing.model)
        self._codec = CommandCodec(len(vehicle.joints), len(vehicle.thruster_names))
        self._estimates = EstimateCodec(len(vehicle.joints))
        self._step_limit, self._run_limit = step_limit, run_limit
        self._reference: Reference | None = None
        self.steps, self.waited, self.longest = 0, 0.0, 0.0  # number, [s] in all, [s] longest
        number, name = tempfile.mkstemp()
        self._output = os.fdopen(number, "w+b")
        os.unlink(name)  # it lives until it is closed
        here, there = socket.socketpair()
        with there:
            self._process = subprocess.Popen(
                [sys.executable, "-m", _MODULE, str(there.fileno())],
                pass_fds=[there.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=self._output,
                stderr=subprocess.STDOUT,
                env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            )
        self._socket, self._limit = here, 0.0  # [s] that an answer is waited for, set in the socket; 0: not set yet
        self._connection = Connection(os.dup(here.fileno()))
        try:
            self.period = self._period(self._ready(self._ask(briefing, START_LIMIT)))
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends the entry's process."""
        self._connection.close()
        self._socket.close()
        self._process.kill()
        self._process.wait()
        self._output.close()

    def init(self, estimate: StateEstimate) -> None:
        """The entry's state at the first estimate, which stays with the entry. Raises EntryError."""
        self._ready(self._ask(estimate, START_LIMIT))  # it may compile its code here

    def step(self, state: None, estimate: StateEstimate, reference: Reference) -> tuple[None, Command]:
        """The entry's command for the estimate.

        Raises:
            EntryError: It crashed, was silent for too long, or answered what is no command.
        """
        changed = None if reference is self._reference else reference
        self._reference = reference
        began = time.perf_counter()
        message = self._estimates.encode(estimate, changed)
        reply = self._told(message, START_LIMIT if self.steps == 0 else self._step_limit)
        took = time.perf_counter() - began
        if self.steps:  # the first step loads compiled code
            self.waited, self.longest = self.waited + took, max(self.longest, took)
        self.steps += 1
        if self.waited > self._run_limit:
            raise EntryError(f"the entry took more than {self._run_limit:g} s for its steps")
        return state, self._codec.decode(reply, estimate.time)

    def _ask(self, message: Any, limit: float) -> bytes:
        """The reply to a message that is pickled."""
        return self._told(pickle.dumps(message, pickle.HIGHEST_PROTOCOL), limit)

    def _told(self, message: bytes, limit: float) -> bytes:
        """The reply to a message."""
        if limit != self._limit:
            seconds = int(limit)
            wait = struct.pack("ll", seconds, int(1e6 * (limit - seconds)))
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, wait)
            self._limit = limit
        try:
            self._connection.send_bytes(message)
            reply = self._connection.recv_bytes()
        except BlockingIOError as error:
            raise EntryError(f"the entry gave no answer for {limit:g} s") from error
        except (OSError, EOFError) as error:
            raise EntryError(f"the entry's process ended{self._last_words()}") from error
        if reply[:1] == FAILED:
            raise EntryError(f"the entry raised {one_line(reply[1:].decode(errors='replace'))}")
        return reply

    @staticmethod
    def _ready(reply: bytes) -> str:
        """Text of a reply that says ready."""
        if reply[:1] != READY:
            raise EntryError("the entry answered before it was asked")
        return reply[1:].decode(errors="replace")

    @staticmethod
    def _period(told: str) -> float:
        """Period [s] that the entry states."""
        try:
            return finite_number(float(told), "period [s]", above=0.0)
        except ValueError as error:
            raise EntryError(f"the entry stated no period: {one_line(told)}") from error

    def _last_words(self) -> str:
        """Exit code and last line of output of the entry's process."""
        try:
            code = self._process.wait(_FAREWELL)
        except subprocess.TimeoutExpired:
            return " the connection, and still runs"
        size = self._output.seek(0, os.SEEK_END)
        self._output.seek(max(0, size - _TAIL))
        lines = self._output.read().decode(errors="replace").strip().splitlines()
        return f" with code {code}" + (f": {one_line(lines[-1])}" if lines else "")
