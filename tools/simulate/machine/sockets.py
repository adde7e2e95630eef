"""Simulated stream sockets: TCP with windows, delays and resets, and Unix sockets.

A socket sends through a `Pipe`, which plays the part of both kernels in one direction: it keeps what is not
sent or not acknowledged yet, sends as much as the window of the receiver permits, and delivers it in order.
"""

import errno
import os
import selectors
import socket
import struct
from collections import deque
from typing import Any, ClassVar, Self
from zlib import crc32

from tools.simulate.machine.machine import Machine, Process
from tools.simulate.machine.network import Address, Network

_NOT_SENT = 16 * 1024
"""Bytes that a socket takes before they can be sent."""

_SEGMENT = 32 * 1024
_CONNECT_RETRY_NS = 1_000_000_000
_TCP_INFO = struct.Struct("=8B24I")
_WINDOW_AT = 228
_UNIX_BUFFER = 48 * 1024


def _error(number: int) -> OSError:
    return OSError(number, os.strerror(number))


class Pipe:
    """One direction of a connection.

    Args:
        network: The network.
        source: Sending socket.
        target: Receiving socket.
    """

    def __init__(self, network: Network, source: "SimulatedSocket", target: "SimulatedSocket") -> None:
        self._network, self._machine = network, network.machine
        self.source, self.target = source, target
        self.local = source.family == socket.AF_UNIX
        limits = network.conditions
        self.room = _UNIX_BUFFER if self.local else limits.send_buffer
        self.window = self.capacity = _UNIX_BUFFER if self.local else limits.window
        self.unsent = bytearray()
        self.in_flight = 0
        self.received = bytearray()
        self.ending = self.ended = False
        self._sent_end = False
        self._last_arrival = 0
        self.last_sent = self.last_acknowledged = self._machine.now

    @property
    def writable(self) -> bool:
        """True if the kernel takes more data."""
        return len(self.unsent) < _NOT_SENT and len(self.unsent) + self.in_flight < self.room

    def write(self, data: bytes) -> int:
        """Take data to send; return the number of bytes taken."""
        count = min(len(data), self.room - len(self.unsent) - self.in_flight)
        if count <= 0:
            raise BlockingIOError(errno.EAGAIN, "full")
        if count > 1 and self._network.random.random() < self._network.conditions.partial_write:
            count = self._network.random.randint(1, count - 1)
        self.unsent += data[:count]
        self._machine.trace(
            "send", self.source.process.name, self.target.process.name, count, crc32(data[:count])
        )
        self.pump()
        return count

    def end(self) -> None:
        """Send the end of the stream after all data."""
        self.ending = True
        self.pump()

    def read(self, most: int) -> bytes:
        """Return received data; empty at the end of the stream."""
        if not self.received:
            if self.ended:
                return b""
            raise BlockingIOError(errno.EAGAIN, "empty")
        count = min(most, len(self.received))
        if count > 1 and self._network.random.random() < self._network.conditions.partial_read:
            count = self._network.random.randint(1, count)
        data = bytes(self.received[:count])
        del self.received[:count]
        self._announce()
        return data

    def pump(self) -> None:
        """Send what the window permits."""
        while self.unsent and (count := min(self.window, len(self.unsent), _SEGMENT)) > 0:
            data = bytes(self.unsent[:count])
            del self.unsent[:count]
            self.in_flight += count
            self.window -= count
            self.last_sent = self._machine.now
            self._machine.at(self._arrival(), lambda data=data: self._arrive(data))  # type: ignore[misc]
        if self.ending and not self.unsent and not self._sent_end:
            self._sent_end = True
            self._machine.at(self._arrival(), self._arrive_end)

    def reset(self) -> None:
        """Send a reset: the receiver's connection breaks."""
        self._machine.at(self._arrival(), self.target.broken)

    def _arrival(self) -> int:
        at = self._network.arrival(self.source.host, self.target.host, self.local)
        self._last_arrival = max(at, self._last_arrival)
        return self._last_arrival

    def _arrive(self, data: bytes) -> None:
        if self.target.closed:
            self._back(self.source.broken)
            return
        self.received += data
        self.target.received_at = self._machine.now
        self.target.changed()
        count = len(data)
        self._back(lambda: self._acknowledge(count))

    def _arrive_end(self) -> None:
        if self.target.closed:
            self._back(self.source.broken)
        self.ended = True
        self.target.changed()

    def _back(self, event: Any) -> None:
        at = self._network.arrival(self.target.host, self.source.host, self.local)
        self._machine.at(at, event)

    def _acknowledge(self, count: int) -> None:
        self.in_flight -= count
        self.last_acknowledged = self._machine.now
        self._open()

    def _announce(self) -> None:
        """Announce the window anew once it has opened by half."""
        if 2 * self.window <= self.capacity:
            self._back(self._open)

    def _open(self) -> None:
        self.window = max(0, self.capacity - len(self.received) - self.in_flight)
        self.pump()
        self.source.changed()


class SimulatedSocket:
    """Stream socket of the process that makes it.

    Attributes:
        network: The network, set while a simulation runs.
        received_at: Time at which data last arrived, ns.
    """

    network: ClassVar[Network]

    def __init__(
        self,
        family: int = socket.AF_INET,
        type: int = socket.SOCK_STREAM,  # noqa: A002 (the name that sockets give it)
        proto: int = 0,
        fileno: None = None,
    ) -> None:
        process = self.network.machine.current
        assert process is not None, "a socket outside of a process"
        self.family, self.type, self.proto = family, socket.SOCK_STREAM, proto
        self._open_in(process)
        self._name: Address = ("0.0.0.0", 0) if family == socket.AF_INET else ""  # noqa: S104
        self._peer: Address | None = None
        self._queue: deque[SimulatedSocket] | None = None
        self._backlog = 0
        self._out: Pipe | None = None
        self._in: Pipe | None = None
        self._failure = 0
        self._connecting = self._blocking = False
        self._blocking = True
        self.closed = False

    def _open_in(self, process: Process) -> None:
        self.process, self.host = process, process.host
        self._number = self.network.descriptor()
        self.received_at = self.network.machine.now
        process.sockets[self._number] = self
        process.loop.selector.files[self._number] = self
        self.network.sockets[self._number] = self

    # --- readiness -----------------------------------------------------------------------------------------

    def ready(self) -> int:
        """Return the events that a selector reports."""
        if self.closed:
            return 0
        if self._queue is not None:
            return selectors.EVENT_READ if self._queue else 0
        if self._failure:
            return selectors.EVENT_READ | selectors.EVENT_WRITE
        if self._in is None or self._out is None:
            return 0
        events = selectors.EVENT_READ if self._in.received or self._in.ended else 0
        return events | (selectors.EVENT_WRITE if self._out.writable else 0)

    @property
    def peer(self) -> "SimulatedSocket | None":
        """The other end of the connection."""
        return None if self._out is None else self._out.target

    @property
    def usable(self) -> bool:
        """True unless the socket was closed or its connection broken, or closing has begun."""
        return not (self.closed or self._failure or (self._out is not None and self._out.ending))

    def changed(self) -> None:
        """Make the selector check this socket again."""
        if not self.closed:
            self.process.poke()

    def broken(self) -> None:
        """Process a reset of the connection."""
        if not self.closed and not self._failure:
            self._failure = errno.ECONNRESET
            self.changed()

    def _check(self) -> None:
        if self.closed:
            raise _error(errno.EBADF)
        if self._failure:
            raise _error(self._failure)

    # --- methods of sockets --------------------------------------------------------------------------------

    def fileno(self) -> int:
        """Return the descriptor."""
        return -1 if self.closed else self._number

    def setblocking(self, flag: bool) -> None:
        """Choose whether calls wait; simulated calls never do."""
        self._blocking = flag

    def gettimeout(self) -> float | None:
        """Return the timeout."""
        return None if self._blocking else 0.0

    def setsockopt(self, *_: Any) -> None:
        """Set an option."""
        if self._failure or self.closed:
            raise _error(errno.EINVAL)

    def getsockopt(self, level: int, option: int, size: int = 0) -> Any:
        """Return an option."""
        match level, option:
            case socket.SOL_SOCKET, socket.SO_ERROR:
                failure, self._failure = self._failure, 0
                return failure
            case socket.SOL_SOCKET, socket.SO_PEERCRED:
                return struct.pack("3i", 1, os.getuid(), os.getgid())
            case socket.IPPROTO_TCP, socket.TCP_INFO:
                return self._tcp_info()[:size]
        return 0

    def _tcp_info(self) -> bytes:
        assert self._out is not None
        assert self._in is not None
        now = self.network.machine.now
        unreachable = self.network.blocked(self.host, self._out.target.host)
        if not unreachable and not self._out.in_flight:
            self._out.last_acknowledged = max(self._out.last_acknowledged, now - 10_000_000_000)
        values = [0] * 32
        values[3] = int(unreachable)
        values[8 + 4] = self._out.in_flight
        values[8 + 9] = (now - self._out.last_sent) // 1_000_000
        values[8 + 12] = (now - self._out.last_acknowledged) // 1_000_000
        head = _TCP_INFO.pack(*values)
        return head.ljust(_WINDOW_AT, b"\0") + struct.pack("=I", self._out.window)

    def bind(self, address: Address) -> None:
        """Bind to an address."""
        if self.family == socket.AF_INET:
            host, port = address[0], int(address[1])
            address = host, port or self.network.port()
        if address in self.network.listeners:
            raise _error(errno.EADDRINUSE)
        self._name = address

    def listen(self, backlog: int = 128) -> None:
        """Listen."""
        if self._queue is None:
            self._queue = deque()
        self._backlog = backlog
        self.network.listeners[self._name] = self

    def accept(self) -> tuple["SimulatedSocket", Address]:
        """Return a connection that waits."""
        self._check()
        if not self._queue:
            raise BlockingIOError(errno.EAGAIN, "no connection")
        taken = self._queue.popleft()
        self.changed()
        return taken, taken.getpeername()

    def connect(self, address: Address) -> None:
        """Connect; a TCP connection is established later."""
        self._check()
        if self.family == socket.AF_UNIX:
            listener = self.network.listeners.get(address)
            if listener is None:
                raise _error(errno.ENOENT)
            if not self._blocking and len(listener._queue or ()) > listener._backlog:
                raise BlockingIOError(errno.EAGAIN, "full")
            self._pair(listener, address)
            return
        self._name = self.host, self.network.port()
        address = address[0], int(address[1])
        self._peer = address
        self._send_syn(address)
        raise BlockingIOError(errno.EINPROGRESS, "in progress")

    def _send_syn(self, address: Address) -> None:
        at = self.network.arrival(self.host, str(address[0]), local=False)
        self.network.machine.at(at, lambda: self._arrive_at_listener(address))

    def _arrive_at_listener(self, address: Address) -> None:
        if self.closed:
            return
        listener = self.network.listeners.get(address)
        if listener is None:
            self._failure = errno.ECONNREFUSED
            self.changed()
        elif len(listener._queue or ()) > listener._backlog:
            self.network.machine.after(_CONNECT_RETRY_NS, lambda: self._send_syn(address))
        else:
            self._pair(listener, address)

    def _pair(self, listener: "SimulatedSocket", address: Address) -> None:
        """Make the other end of a new connection, which waits in the queue of the listener."""
        other = object.__new__(SimulatedSocket)
        other.family, other.type, other.proto = self.family, self.type, listener.proto
        other._open_in(listener.process)
        other._name, other._peer, other._queue, other._failure = address, self._name, None, 0
        other._connecting, other._blocking, other.closed = False, True, False
        self._peer = address
        self._out, other._out = Pipe(self.network, self, other), Pipe(self.network, other, self)
        self._in, other._in = other._out, self._out
        assert listener._queue is not None
        listener._queue.append(other)
        listener.changed()
        self.changed()

    def getsockname(self) -> Address:
        """Return the own address."""
        return self._name

    def getpeername(self) -> Address:
        """Return the address of the peer."""
        if self._peer is None:
            raise _error(errno.ENOTCONN)
        return self._peer

    def send(self, data: Any, flags: int = 0) -> int:
        """Send data; return the number of bytes taken."""
        self._check()
        if self._out is None or self._out.ending:
            raise _error(errno.EPIPE)
        return self._out.write(bytes(data))

    def sendmsg(self, buffers: Any) -> int:
        """Send the data of several buffers."""
        return self.send(b"".join(bytes(one) for one in buffers))

    def recv(self, size: int, flags: int = 0) -> bytes:
        """Receive data."""
        self._check()
        if self._in is None:
            raise _error(errno.ENOTCONN)
        return self._in.read(size)

    def recv_into(self, buffer: Any, nbytes: int = 0, flags: int = 0) -> int:
        """Receive data into a buffer."""
        data = self.recv(nbytes or len(buffer))
        buffer[: len(data)] = data
        return len(data)

    def shutdown(self, how: int) -> None:
        """Send the end of the stream."""
        self._check()
        if self._out is None:
            raise _error(errno.ENOTCONN)
        if how in (socket.SHUT_WR, socket.SHUT_RDWR):
            self._out.end()

    def close(self) -> None:
        """Close the socket; unread data reset the connection."""
        if self.closed:
            return
        self.closed = True
        self.process.sockets.pop(self._number, None)
        self.process.loop.selector.files.pop(self._number, None)
        self.network.sockets.pop(self._number, None)
        if self._queue is not None:
            self.network.listeners.pop(self._name, None)
            for waiting in self._queue:
                waiting.close()
        if self._in is not None and self._out is not None:
            if self._in.received:
                self._out.reset()
            else:
                self._out.end()

    def detach(self) -> int:
        """Refuse: descriptors are not passed on."""
        raise _error(errno.ENOTSUP)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class SimulatedTimer:
    """Kernel timer of the process that makes it, in place of `armgate.emulator.timer.Timer`."""

    def __init__(self) -> None:
        machine = SimulatedSocket.network.machine
        assert machine.current is not None
        self._machine: Machine = machine
        self._process = machine.current
        self._number = SimulatedSocket.network.descriptor()
        self._process.loop.selector.files[self._number] = self
        self._process.sockets[self._number] = self  # closed with the process
        self._deadline: int | None = None
        self.closed = False

    def ready(self) -> int:
        """Return the events that a selector reports."""
        due = self._deadline is not None and self._machine.now >= self._deadline
        return selectors.EVENT_READ if due else 0

    def fileno(self) -> int:
        """Return the descriptor."""
        return self._number

    def arm(self, deadline_ns: int) -> None:
        """Set the deadline, ns."""
        self._deadline = deadline_ns
        self._machine.at(deadline_ns, self._due)

    def _due(self) -> None:
        if not self.closed:
            self._process.poke()

    def expired(self) -> bool:
        """Return True if the deadline has passed since the timer was armed."""
        if not self.ready():
            return False
        self._deadline = None
        return True

    def close(self) -> None:
        """Close the descriptor."""
        self.closed = True
        self._process.sockets.pop(self._number, None)
        self._process.loop.selector.files.pop(self._number, None)
