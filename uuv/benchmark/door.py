"""Interface of the benchmark to an entry: controller and estimator that call the entry in a
separate process.

The entry's process is a fresh interpreter. It gets a `Briefing`, then estimates and set points, and
nothing else, except that an entry with an estimator also gets the measurements. The arguments,
environment and working folder of the process contain no information about the case. A crash, no
reply within the limits, or a wrong reply raises `EntryError` in the simulation.
"""

import ctypes
import os
import pickle
import socket
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any, Self

from uuv.benchmark.wire import (
    FAILED,
    LOADED,
    MEASURED,
    READY,
    START_CONTROLLER,
    START_ESTIMATOR,
    Briefing,
    CommandCodec,
    EntryError,
    EstimateCodec,
)
from uuv.experiment.loaded_code import told_by_another
from uuv.models.vehicle import Vehicle
from uuv.sim.interfaces.documents import parsed_json
from uuv.sim.interfaces.errors import one_line
from uuv.sim.interfaces.messages import Command, Measurement, Reference, StateEstimate
from uuv.sim.interfaces.spatial import finite_number
from uuv.sim.interfaces.tables import TableReader

START_LIMIT = 180.0  # [s] wall time to import and make the entry
# [s] wall time to answer one estimate; on a machine with more work than cores every entry is slow
STEP_LIMIT = 60.0
RUN_LIMIT = 1800.0  # [s] wall time to answer all estimates of a run
_MODULE = "uuv.benchmark.entry_process"
# environment variables that the entry's process gets
_KEPT = ("PATH", "HOME", "LANG", "LC_ALL", "TMPDIR", "XDG_CACHE_HOME", "LD_LIBRARY_PATH")
# and the prefixes of further variables, for kernels and threads
_KEPT_GROUPS = ("UUV_", "NUMBA_", "OMP_", "OPENBLAS_", "MKL_")
_PR_SET_DUMPABLE = 4  # option of Linux's prctl
_FAREWELL = 5.0  # [s] wall time for a process that has closed its connection to end
_TAIL = 4096  # [bytes] end of the entry's output that is read for its last line


class EntryProcess:
    """Process of an entry, with one connection for controller and estimator; a context manager."""

    def __init__(
        self, briefing: Briefing, *, step_limit: float = STEP_LIMIT, run_limit: float = RUN_LIMIT
    ) -> None:
        """Start the process and brief the entry.

        Args:
            briefing: Briefing of the entry.
            step_limit: [s] wall time for one answer.
            run_limit: [s] wall time for all answers.

        Raises:
            EntryError: The entry cannot be made.
        """
        self.vehicle = Vehicle.of(briefing.model)
        self._step_limit = step_limit
        self._run_limit = run_limit
        # number of answers, [s] in all, [s] longest
        self.steps = 0
        self.waited = 0.0
        self.longest = 0.0

        number, name = tempfile.mkstemp()
        self._output = os.fdopen(number, "w+b")
        os.unlink(name)  # the connection stays open until it is closed here
        close_memory()
        # an empty working folder, since the folder of the benchmark contains its files
        self._folder = tempfile.TemporaryDirectory(prefix="entry_")

        # After the briefing the process states its periods.
        parent, child = socket.socketpair()
        with child:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-m", _MODULE, str(child.fileno())],
                pass_fds=[child.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=self._output,
                stderr=subprocess.STDOUT,
                cwd=self._folder.name,
                env=_environment(),
            )
        # [s] present timeout of the socket; 0: not set yet
        self._socket = parent
        self._limit = 0.0
        self._connection = Connection(os.dup(parent.fileno()))

        try:
            stated = self._ready(self._reply(_pickled(briefing), START_LIMIT)).partition(" ")
            self.controller_period = self._period(stated[0])
            # [s] period of the estimator; None: the entry has none
            self.estimator_period = self._period(stated[2]) if briefing.estimator else None
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the entry's process."""
        self._connection.close()
        self._socket.close()
        self._process.kill()
        self._process.wait()
        self._output.close()
        self._folder.cleanup()

    def start(self, message: bytes) -> None:
        """Let the entry make a state, which stays in its process. Raises EntryError."""
        self._ready(self._reply(message, START_LIMIT))  # the entry may compile its code here

    def answer(self, message: bytes, *, first: bool) -> bytes:
        """Reply of the entry at a tick.

        Args:
            message: Measurements, or estimate and set points.
            first: Whether the message is the first of its kind. The entry then loads compiled code,
                and the time is not counted.

        Raises:
            EntryError: The entry crashed, or did not reply in time.
        """
        began = time.perf_counter()
        reply = self._reply(message, START_LIMIT if first else self._step_limit)
        took = time.perf_counter() - began

        self.steps += 1
        if not first:
            self.waited, self.longest = self.waited + took, max(self.longest, took)

        if self.waited > self._run_limit:
            raise EntryError(f"the entry took more than {self._run_limit:g} s for its steps")
        return reply

    def _reply(self, message: bytes, limit: float) -> bytes:
        """Reply to a message."""
        if limit != self._limit:
            seconds = int(limit)
            wait = struct.pack("ll", seconds, int(1e6 * (limit - seconds)))
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, wait)
            self._limit = limit

        try:
            self._connection.send_bytes(message)
            reply = self._connection.recv_bytes()
            while reply[:1] == LOADED:
                told_by_another(_digests(reply[1:]))
                reply = self._connection.recv_bytes()
        except BlockingIOError as error:
            raise EntryError(f"no reply of the entry for {limit:g} s") from error
        except (OSError, EOFError) as error:
            raise EntryError(f"the entry's process ended{self._last_words()}") from error

        if reply[:1] == FAILED:
            raise EntryError(f"the entry raised {one_line(reply[1:].decode(errors='replace'))}")
        return reply

    @staticmethod
    def _ready(reply: bytes) -> str:
        """Text of a reply with which the entry reports that it is ready."""
        if reply[:1] != READY:
            raise EntryError("the entry replied before the request")
        return reply[1:].decode(errors="replace")

    @staticmethod
    def _period(stated: str) -> float:
        """Period [s] that the entry states."""
        try:
            return finite_number(float(stated), "period [s]", above=0.0)
        except ValueError as error:
            raise EntryError(f"the entry stated no valid period: {one_line(stated)}") from error

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


class RemoteController:
    """Controller of an entry (`protocols.Controller`); its state stays in the entry's process."""

    def __init__(self, process: EntryProcess) -> None:
        vehicle = process.vehicle
        self._process = process
        self.period = process.controller_period
        self._commands = CommandCodec(len(vehicle.joints), len(vehicle.thruster_names))
        self._estimates = EstimateCodec(len(vehicle.joints))
        self._reference: Reference | None = None

    def init(self, estimate: StateEstimate) -> None:
        """The entry's state at the first estimate. Raises EntryError."""
        self._reference = None
        self._process.start(START_CONTROLLER + _pickled(estimate))

    def step(
        self, state: None, estimate: StateEstimate, reference: Reference
    ) -> tuple[None, Command]:
        """The entry's command for the estimate.

        Raises:
            EntryError: The entry crashed, did not reply in time, or its reply is not a command.
        """
        first = self._reference is None
        changed = None if reference is self._reference else reference

        self._reference = reference
        reply = self._process.answer(self._estimates.encode(estimate, changed), first=first)
        return state, self._commands.decode(reply, estimate.time)


class RemoteEstimator:
    """Estimator of an entry (`protocols.Estimator`); its state stays in the entry's process."""

    def __init__(self, process: EntryProcess) -> None:
        """Take a process whose briefing names an estimator.

        Raises:
            EntryError: The entry has no estimator.
        """
        if process.estimator_period is None:
            raise EntryError("the entry has no estimator")
        self._process = process
        self.period = process.estimator_period
        self._estimates = EstimateCodec(len(process.vehicle.joints))
        self._first = True

    def init(self, first: Sequence[Measurement]) -> None:
        """The entry's state from the first measurements. Raises EntryError."""
        self._first = True
        self._process.start(START_ESTIMATOR + _pickled(list(first)))

    def step(self, state: None, measurements: Sequence[Measurement]) -> tuple[None, StateEstimate]:
        """The entry's estimate from the measurements that arrived since the last step.

        Raises:
            EntryError: The entry crashed, did not reply in time, or its reply is not an estimate.
        """
        reply = self._process.answer(MEASURED + _pickled(list(measurements)), first=self._first)
        self._first = False
        return state, self._estimates.decode_reply(reply)


def close_memory() -> None:
    """Deny other processes of the same user access to memory, environment and files of this process
    (Linux only).

    The superuser still has access, and everyone can read the command line, which must not name a
    case.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_DUMPABLE, 0, 0, 0, 0)


def _environment() -> dict[str, str]:
    """Environment of an entry: paths of programs, libraries and modules, and settings of
    threads.
    """
    passed = {
        name: value
        for name, value in os.environ.items()
        if name in _KEPT or name.startswith(_KEPT_GROUPS)
    }
    return {**passed, "PYTHONPATH": os.pathsep.join(map(os.path.abspath, filter(None, sys.path)))}


def _digests(message: bytes) -> Mapping[str, str]:
    """Digests of files, by name, that an entry's process has reported."""
    try:
        files = parsed_json(message.decode(), "digests")
        return TableReader().made(_Digests, {"files": files}).files
    except ValueError as error:  # an error of the text's encoding, or of its content
        raise EntryError("the entry replied before the request") from error


@dataclass(frozen=True, slots=True)
class _Digests:
    """Report of an entry's process about its code."""

    files: Mapping[str, str]  # digests by name


def _pickled(message: Any) -> bytes:
    return pickle.dumps(message, pickle.HIGHEST_PROTOCOL)
