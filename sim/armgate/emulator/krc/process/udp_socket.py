"""UDP socket of a virtual KRC, with the kernel's arrival time of each datagram."""

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
"""Largest number of datagrams that are read in a cycle; further ones wait."""


@dataclass(frozen=True, slots=True)
class Peer:
    """Address of the PC.

    Attributes:
        family: Address family.
        address: Host and port for sockets.
    """

    family: socket.AddressFamily
    address: tuple[str, int]

    @classmethod
    def resolve(cls, host: str, port: int) -> "Peer":
        """Return the first address of a host.

        Raises:
            KrcError: The host is unknown.
        """
        try:
            found = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)
        except OSError as error:
            raise KrcError(f"there is no host {host!r}: {error.strerror}") from error
        family, _, _, _, address = found[0]
        return cls(family, (str(address[0]), port))


@dataclass(frozen=True, slots=True)
class Datagram:
    """Received datagram.

    Attributes:
        data: Content.
        stranger: Its source, if that is not the PC.
    """

    data: bytes
    stranger: str | None


class UdpSocket:
    """Socket of one RSI run.

    The kernel stamps each datagram on arrival, so a reply does not count as late if this process reads it
    late. Linux begins to do so a moment after the first socket of the machine asks for it. A datagram that
    arrives before that is as old as its reading.

    Args:
        peer: Address of the PC.
        port: Port of the KRC; 0: any free one.

    Raises:
        KrcError: The port is not free.
    """

    def __init__(self, peer: Peer, port: int = 0) -> None:
        self._peer = peer
        self._socket = socket.socket(peer.family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        try:
            self._socket.bind(("", port))
        except OSError as error:
            self._socket.close()
            raise KrcError(f"cannot send from port {port}: {error.strerror}") from error

    @property
    def port(self) -> int:
        """Port of the KRC."""
        return int(self._socket.getsockname()[1])

    def send(self, data: bytes) -> None:
        """Send a telegram to the PC.

        Raises:
            OSError: The network does not accept it.
        """
        self._socket.sendto(data, self._peer.address)

    def receive(self) -> Iterator[tuple[Datagram, int]]:
        """Yield the datagrams since the last call, each with its age now, ns."""
        for _ in range(_AT_ONCE):
            try:
                data, ancillary, _, source = self._socket.recvmsg(_LONGEST, socket.CMSG_SPACE(_TIMESPEC.size))
            except BlockingIOError:
                return
            except ConnectionError:  # an earlier telegram reached no listener
                continue
            stranger = None if source[:2] == self._peer.address else f"{source[0]}:{source[1]}"
            yield Datagram(data, stranger), _age(ancillary)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def _age(ancillary: list[tuple[int, int, bytes]]) -> int:
    for level, kind, data in ancillary:
        if (level, kind) == (socket.SOL_SOCKET, _SO_TIMESTAMPNS) and len(data) == _TIMESPEC.size:
            seconds, ns = _TIMESPEC.unpack(data)
            return max(time.time_ns() - (int(seconds) * _NS + int(ns)), 0)
    return 0
