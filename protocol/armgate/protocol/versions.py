"""Supported versions of the protocol (``DIALECTS``), and the choice of one for a connection (``choose``).

The program behind a connection uses one form of each message, the newest. The connection translates older
forms by the dialect of its version, so a server can support several versions at once.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from armgate.protocol.errors import ErrorCode, RemoteProtocolError
from armgate.protocol.messages import Catalogue, Message


@dataclass(frozen=True, eq=False)
class Dialect:
    """Messages of one version.

    Attributes:
        version: Number of the version.
        client: Models of the client's messages by ``type``, in the form of the wire.
        server: Models of the server's messages by ``type``, in the form of the wire.
        inward: Conversion from the wire's form to the program's; may raise a ``RemoteProtocolError``. None if
            both forms are the same.
        outward: Conversion from the program's form to the wire's; None if both forms are the same. It returns
            None if this version lacks the message, which is then not sent. Hello, welcome, error and bye are
            the same in every version.
    """

    version: int
    client: Mapping[str, type[Message]]
    server: Mapping[str, type[Message]]
    inward: Callable[[Message], Message] | None = None
    outward: Callable[[Message], Message | None] | None = None


DIALECTS: tuple[Dialect, ...] = (Dialect(1, Catalogue.client, Catalogue.server),)
"""All supported versions, ascending."""

VERSIONS: tuple[int, ...] = tuple(dialect.version for dialect in DIALECTS)


def choose(server: Iterable[int], client: Iterable[int]) -> int:
    """Return the highest version that both sides list.

    Raises:
        RemoteProtocolError: Fatal ``version``: no version in common; the text names both lists.
    """
    mine, theirs = set(server), set(client)
    common = mine & theirs
    if not common:
        text = f"no version in common: the server supports {_listed(mine)}, the client {_listed(theirs)}"
        raise RemoteProtocolError(ErrorCode.VERSION, text, about="hello")
    return max(common)


def check_choice(chosen: int, server: Iterable[int], client: Iterable[int], sent: Iterable[int]) -> None:
    """Check, for a client, that a welcome chose the highest common version from the list that was sent.

    Raises:
        RemoteProtocolError: Fatal ``version``: the lists were changed in transit, or the choice is not the
            highest common version.
    """
    if set(client) != set(sent):
        text = f"the server received the versions {_listed(client)}; this client sent {_listed(sent)}"
        raise RemoteProtocolError(ErrorCode.VERSION, text, about="welcome")
    if (best := choose(server, sent)) != chosen:
        text = f"the server chose version {chosen}; both sides support {best}"
        raise RemoteProtocolError(ErrorCode.VERSION, text, about="welcome")


def _listed(versions: Iterable[int]) -> str:
    return "[" + ", ".join(str(version) for version in sorted(versions)) + "]"
