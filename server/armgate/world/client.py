"""Client of a world: sends and receives messages as objects, without sockets and without encoding."""

from collections.abc import Callable, Sequence
from typing import TypeVar, overload

from armgate.protocol import ErrorCode, RemoteProtocolError
from armgate.protocol import messages as m
from armgate.world.interfaces import REQUESTS, ClientRequest
from armgate.world.mailbox import Mailbox

M = TypeVar("M", bound=m.Message)

Handle = Callable[[Mailbox, ClientRequest], None]
"""Function that processes a request of a client."""


class SessionEndedError(Exception):
    """Request of a client whose session has ended."""


class WorldClient:
    """Client of a `World`; `World.join` makes it.

    A message that is sent is processed at once, as far as lock-step permits: commands are decided at the end
    of the step, and messages of a participant that is done with the step belong to the next one. Messages are
    not validated again: build them with their constructors, which check them.

    Attributes:
        welcome: Answer to the hello of the client.

    Args:
        mailbox: Receives the messages for the client.
        welcome: Answer to its hello.
        handle: Processes a request.
    """

    def __init__(self, mailbox: Mailbox, welcome: m.Welcome, handle: Handle) -> None:
        self.welcome = welcome
        self._mailbox = mailbox
        self._handle = handle
        self._id = 0

    @property
    def name(self) -> str:
        """Name of the client."""
        return self._mailbox.client.name

    @property
    def session(self) -> str:
        """Id of its session."""
        return self._mailbox.client.id

    @property
    def ended(self) -> bool:
        """True if its session has ended: it left, was closed after an error, or was ended by an operator."""
        return self._mailbox.closed

    def send(self, *messages: ClientRequest) -> None:
        """Send messages, in order; errors arrive as messages.

        Raises:
            SessionEndedError: The session has ended.
            ValueError: A message is not a request of a client.
        """
        for message in messages:
            if type(message) not in REQUESTS:
                text = "not a request of a client; join sends the hello, and leave the bye"
                raise ValueError(f"{message.type}: {text}")
            if self._mailbox.closed:
                raise SessionEndedError(f"{message.type}: the session of {self.name} has ended; join again")
            self._handle(self._mailbox, message)

    def request(self, message: ClientRequest) -> m.Message:
        """Send a request with an id, and return its answer; other messages stay in order.

        Raises:
            RemoteProtocolError: The answer is an error.
            SessionEndedError: The session has ended.
            ValueError: The message has no answer, or it waits for the next step.
        """
        if not isinstance(message, m.Request):
            raise ValueError(f"{message.type} is not a request with an answer; use send and take")
        self._id += 1
        numbered = message.model_copy(update={"id": self._id})
        self.send(numbered)
        for index, found in enumerate(self._mailbox.received):
            if getattr(found, "re", None) == numbered.id:
                del self._mailbox.received[index]
                return _answer(found)
        raise ValueError(
            f"{message.type}: {self.name} is done with this step; the answer follows in the next"
        )

    @overload
    def take(self) -> list[m.Message]: ...

    @overload
    def take(self, model: type[M]) -> list[M]: ...

    def take(self, model: type[m.Message] = m.Message) -> Sequence[m.Message]:
        """Remove and return the received messages of a model, in order; by default all."""
        received = self._mailbox.received
        if model is m.Message:
            self._mailbox.received = []
            return received
        found = [message for message in received if isinstance(message, model)]
        self._mailbox.received = [message for message in received if not isinstance(message, model)]
        return found

    def leave(self) -> None:
        """End the session with a bye: its leases end, and its robots play their plans to rest."""
        if not self.ended:
            self._mailbox.leave()
            self._mailbox.close(m.Bye())


def _answer(message: m.Message) -> m.Message:
    if isinstance(message, m.Error):
        raise RemoteProtocolError(ErrorCode(message.code), message.text, about=message.about, re=message.re)
    return message
