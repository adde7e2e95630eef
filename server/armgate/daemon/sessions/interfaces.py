"""Interfaces between the parts of a connection."""

import asyncio
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Protocol

from armgate.daemon.core.interfaces import Batch
from armgate.daemon.sessions.scheduler import Work
from armgate.protocol import Refusal
from armgate.protocol import messages as m

if TYPE_CHECKING:
    from armgate.daemon.sessions.session import Session


class SessionHost(Protocol):
    """The object to which sessions report; called by `Session`."""

    @property
    def serving(self) -> bool:
        """True if requests of clients are processed."""

    def opened(self, session: "Session") -> None:
        """Process a new connection."""

    def hello(self, session: "Session", hello: m.Hello) -> None:
        """Process a hello: answer with welcome or a fatal error."""

    def left(self, session: "Session", reason: str) -> None:
        """Process the end of a session by a bye or the loss of its connection; called once."""

    def closed(self, session: "Session") -> None:
        """Process the end of a connection; nothing is called for it afterwards."""

    def privileged(self, session: "Session") -> bool:
        """Return True if the session is served first: it holds a robot, or is an operator by token."""

    def failed(self, error: BaseException) -> None:
        """Process a defect of the daemon."""


class ConnectionProtocol(asyncio.BaseProtocol, ABC):
    """The asyncio protocol of one connection; made by the listener."""

    @abstractmethod
    def evict(self) -> None:
        """Close the connection to make room for another one: no hello came."""

    @abstractmethod
    def serve(self, work: Work) -> None:
        """Do work of this connection in its turn."""


class ReadSession(Protocol):
    """The session on whose behalf a client is read; called by `Reader`."""

    @property
    def identity(self) -> str:
        """Token, or address without one, by which turns count."""

    @property
    def greeted(self) -> bool:
        """True if the client has been welcomed."""

    @property
    def closing(self) -> bool:
        """True if no more messages are received."""

    @property
    def privileged(self) -> bool:
        """True if the session is served before all others."""

    def batch(self) -> Batch:
        """Hold back answers, so that the answers to what is read in one turn are written together."""

    def receive(self, item: m.Message | Refusal) -> None:
        """Process a message, or bytes that are no message; never raises."""

    def finish_stream(self) -> None:
        """Process the end of the client's stream, before which everything has been received."""
