"""Cell as a participant of a world sees it: the session of the SDK, without bytes."""

from collections.abc import Iterable
from typing import Any, TypeVar

from pydantic import ValidationError

from armgate.client.asset import Download
from armgate.client.base import CellBase
from armgate.client.session import Session, build
from armgate.protocol import ErrorCode, LocalProtocolError
from armgate.protocol import messages as m
from armgate.world import WorldClient

A = TypeVar("A", bound=m.Answer)


class WorldCell(CellBase):
    """Cell as a participant of a world sees it; a `ProgramCell`, and the connection of `SharedSignals`.

    Args:
        client: The participant.
    """

    def __init__(self, client: WorldClient) -> None:
        self._sender = Sender(client)
        session = Session(sender=self._sender)
        super().__init__(session, timeout=0.0, patience=0.0)
        session.take(client.welcome)
        self.description = self.ask(m.Describe(), m.Description)

    def urdf(self, robot: str) -> str:
        """Return the URDF of a robot."""
        name = self.robot(robot).urdf.hash
        if name not in self._assets:
            download = Download(name)
            while (data := download.take(self.ask(build(m.Asset, **download.request()), m.Chunk))) is None:
                pass
            self._assets[name] = data
        return self._assets[name].decode()

    def signal(self, name: str, value: Iterable[float] | float, *, more: bool = False) -> None:
        """Share a number or a short vector; ``more`` has no effect.

        Raises:
            Refused: An earlier signal was refused.
        """
        self._session.signal(name, value)

    def ask(self, request: m.Request, kind: type[A]) -> A:
        """Send a request, and return its answer.

        Raises:
            Refused: The answer is an error.
        """
        number, _ = self._session.ask(request)
        self._receive()
        answer = self._session.pending.answer(number, kind)
        assert answer is not None  # a participant asks only while it is not done with the step
        return answer

    def _receive(self) -> None:
        for message in self._sender.client.take():
            self._session.take(message)

    def connect(self, client: WorldClient) -> None:
        """Continue as the client of another world, after a copy."""
        self._sender.client = client


class Sender:
    """Sending side of the SDK's session in a world.

    Attributes:
        client: Client that sends; a copy has none until it is set.
    """

    def __init__(self, client: WorldClient) -> None:
        self.client = client

    def __getstate__(self) -> dict[str, object]:
        """Return no state: the client belongs to its world."""
        return {}

    def send(self, message: Any) -> bytes:
        """Send a message as an object; a command is validated first, as a daemon does."""
        kind = type(message)  # much faster than isinstance for these classes, and this runs for each message
        if kind is m.Bye:
            self.client.leave()
        else:
            self.client.send(_valid(message) if kind is m.Command else message)
        return b""


def _valid(command: m.Command) -> m.Command:
    # All other fields come from messages of the world and from the session.
    if len(command.dq) <= m.MAX_JOINTS and {float}.issuperset(map(type, command.dq)):
        return command
    try:
        return m.Command(**command.__dict__)
    except ValidationError as error:
        problem = error.errors()[0]
        where = ".".join(map(str, problem["loc"]))
        raise LocalProtocolError(
            ErrorCode.INVALID_MESSAGE, f"command: {where}: {problem['msg']}", about="command"
        ) from None
