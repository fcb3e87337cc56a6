"""A UDP socket that answers each datagram, until a signal or a bound ends it.

It listens on this machine alone unless another address is asked for. Datagrams are data: their
size is bounded, and nothing in them is executed.
"""

import contextlib
import ipaddress
import math
import socket
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from uuv.sim.interfaces.errors import ConfigurationError

LOOPBACK = "127.0.0.1"
_LARGEST = 65_507  # [bytes] of a datagram's content
_SILENCE = 2.0  # [s] of a peer after which another may take over
_PATIENCE = 0.2  # [s] after which a signal is looked for


@dataclass(slots=True)
class Endpoint:
    """A bound socket, and the address that it answers to."""

    bound: socket.socket
    peer: tuple[str, int] | None = None  # that is answered
    sender: tuple[str, int] | None = None  # of the last datagram
    heard: float = -math.inf  # [s] time.monotonic() at which the peer was last understood

    @property
    def port(self) -> int:
        """Port that it listens on."""
        return int(self.bound.getsockname()[1])

    def receive(self, patience: float = _PATIENCE) -> bytes | None:
        """Next datagram; None: none within `patience` [s]."""
        self.bound.settimeout(patience)

        try:
            data, self.sender = self.bound.recvfrom(_LARGEST)
        except (TimeoutError, BlockingIOError):
            return None
        except ConnectionError:  # the peer of the last answer is gone; others may come
            return None

        return data

    def answer_there(self) -> None:
        """Answer from now on to where the last datagram came from: it was understood."""
        self.peer = self.sender
        self.heard = time.monotonic()

    def interrupts(self, silence: float) -> bool:
        """Whether the last datagram is of another than the peer, who spoke within `silence` [s]."""
        return self.sender != self.peer and time.monotonic() - self.heard < silence

    def send(self, data: bytes) -> bool:
        """Send to the peer; False: there is none, or no way there."""
        if self.peer is None:
            return False
        try:
            self.bound.sendto(data, self.peer)
        except OSError:
            return False
        return True


@contextlib.contextmanager
def listening(port: int, address: str = LOOPBACK) -> Iterator[Endpoint]:
    """A socket bound to a port of this machine; port 0: any that is free.

    Raises:
        ConfigurationError: No port or address, or it is in use.
    """
    if not 0 <= port <= 65_535:
        raise ConfigurationError(f"port: must be 0 to 65535, got {port}")
    try:
        family = socket.AF_INET6 if ipaddress.ip_address(address).version == 6 else socket.AF_INET
    except ValueError as error:
        raise ConfigurationError(
            f"listen: must be an IP address of this machine, got {address!r}"
        ) from error

    # Closed at the end, whatever happens.
    with socket.socket(family, socket.SOCK_DGRAM) as bound:
        try:
            bound.bind((address, port))

        except OSError as error:
            raise ConfigurationError(
                f"port {port}: cannot listen on {address} ({error.strerror or error})"
            ) from error
        yield Endpoint(bound)


def answer_all(
    endpoint: Endpoint, reply: Callable[[bytes, bool], bytes], ended: Callable[[], bool]
) -> None:
    """Answer datagrams until `ended` is true.

    Args:
        endpoint: Bound socket.
        reply: Answer to a datagram, empty for none, and whether it interrupts the peer's.
        ended: Asked between two datagrams.
    """
    while not ended():
        datagram = endpoint.receive()
        if datagram is not None and (content := reply(datagram, endpoint.interrupts(_SILENCE))):
            endpoint.answer_there()
            endpoint.send(content)
