"""The KRC's UDP socket: its port, and when each datagram really arrived."""

import socket
import struct
import time
from collections.abc import Iterator
from dataclasses import dataclass

from armgate.emulator.krc.errors import KrcError

_SO_TIMESTAMPNS = 35
_TIMESPEC = struct.Struct("qq")
_NS = 1_000_000_000
_LONGEST = 65536
_AT_ONCE = 256
"""So many datagrams are read in a cycle; the rest waits."""


@dataclass(frozen=True, slots=True)
class Peer:
    """Where the PC is.

    Attributes:
        family: Of its address.
        address: As sockets take it.
    """

    family: socket.AddressFamily
    address: tuple[str, int]

    @classmethod
    def resolve(cls, host: str, port: int) -> "Peer":
        """The first address of a host.

        Raises:
            KrcError: There is none.
        """
        try:
            found = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)
        except OSError as error:
            raise KrcError(f"there is no host {host!r}: {error.strerror}") from error
        family, _, _, _, address = found[0]
        return cls(family, (str(address[0]), port))


@dataclass(frozen=True, slots=True)
class Datagram:
    """What arrived.

    Attributes:
        data: Its bytes.
        stranger: Its source, if that is not the PC.
    """

    data: bytes
    stranger: str | None


class Port:
    """A socket of one RSI run.

    The kernel stamps each datagram when it arrives, so that a reply does not become late because this process
    was late to read it.

    Args:
        peer: Where the PC is.
        number: Which port; 0: any that is free.

    Raises:
        KrcError: The port is not free.
    """

    def __init__(self, peer: Peer, number: int = 0) -> None:
        self._peer = peer
        self._socket = socket.socket(peer.family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        try:
            self._socket.bind(("", number))
        except OSError as error:
            self._socket.close()
            raise KrcError(f"cannot send from port {number}: {error.strerror}") from error

    @property
    def number(self) -> int:
        """Its port."""
        return int(self._socket.getsockname()[1])

    def send(self, data: bytes) -> None:
        """To the PC.

        Raises:
            OSError: The network does not take it.
        """
        self._socket.sendto(data, self._peer.address)

    def receive(self) -> Iterator[tuple[Datagram, int]]:
        """What has arrived since the last time, each with its age now, ns."""
        for _ in range(_AT_ONCE):
            try:
                data, ancillary, _, source = self._socket.recvmsg(_LONGEST, socket.CMSG_SPACE(_TIMESPEC.size))
            except BlockingIOError:
                return
            except ConnectionError:  # an earlier telegram found nobody
                continue
            stranger = None if source[:2] == self._peer.address else f"{source[0]}:{source[1]}"
            yield Datagram(data, stranger), _age(ancillary)

    def close(self) -> None:
        """Give it back."""
        self._socket.close()


def _age(ancillary: list[tuple[int, int, bytes]]) -> int:
    for level, kind, data in ancillary:
        if (level, kind) == (socket.SOL_SOCKET, _SO_TIMESTAMPNS) and len(data) == _TIMESPEC.size:
            seconds, ns = _TIMESPEC.unpack(data)
            return max(time.time_ns() - (int(seconds) * _NS + int(ns)), 0)
    return 0
