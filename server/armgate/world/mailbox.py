"""Mailbox: the receiving end of a client in this process, which keeps messages as objects."""

from collections.abc import Callable
from types import TracebackType

from armgate.protocol import RemoteProtocolError
from armgate.protocol import messages as m
from armgate.world.interfaces import Client, Encoded, Peer


class Mailbox(Peer):
    """`Peer` that keeps the messages for its client until they are taken.

    Attributes:
        received: Messages that were not taken yet, in order.
        closed: True if the session has ended: nothing more is received.

    Args:
        client: The client.
        leave: Called with the mailbox when its session ends.
    """

    def __init__(self, client: Client, leave: Callable[["Mailbox"], None]) -> None:
        self._client = client
        self._leave = leave
        self._left = False
        self.received: list[m.Message] = []
        self.closed = False

    @property
    def client(self) -> Client:
        """The client."""
        return self._client

    def send(self, message: m.Message, frame: bytes | None = None) -> None:
        """Keep a message; ``frame`` is not used."""
        if not self.closed:
            self.received.append(message)

    def send_states(self, *states: Encoded) -> None:
        """Keep states; they are not encoded."""
        if not self.closed:
            self.received.extend(state.state for state in states)

    def keep_states(self) -> None:
        """Do nothing: a mailbox keeps every state."""

    def drop_states(self) -> None:
        """Do nothing: no state waits to be written."""

    def batch(self) -> "NoBatch":
        """Return a batch that holds nothing back: messages wait here until they are taken."""
        return NoBatch()

    def close(self, message: m.Message) -> None:
        """Keep a last message; the session leaves at the next call of `leave`."""
        self.send(message)
        self.closed = True

    def expel(self, error: RemoteProtocolError) -> None:
        """Keep an error as the last message, and end the session at once."""
        self.close(error.message())
        self.leave()

    def leave(self) -> None:
        """Report the end of the session, unless that was done before."""
        if not self._left:
            self._left = True
            self._leave(self)


class NoBatch:
    """Batch that holds nothing back."""

    def close(self) -> None:
        """Do nothing."""

    def flush(self) -> None:
        """Do nothing."""

    def __enter__(self) -> "NoBatch":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Do nothing."""
