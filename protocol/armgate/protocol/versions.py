"""Which versions of the protocol are spoken (``DIALECTS``), and which one on a connection (``choose``).

The program behind a connection knows messages in one form, the newest. What an older version says otherwise
is translated at the connection, by its dialect; so a server speaks several at once without knowing it.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from armgate.protocol.errors import ErrorCode, RemoteProtocolError
from armgate.protocol.messages import Catalogue, Message


def unchanged(message: Message) -> Message:
    """The message itself: both forms are the same."""
    return message


@dataclass(frozen=True, eq=False)
class Dialect:
    """What is said in one version.

    Attributes:
        version: Its number.
        client: The models of what clients say, by ``type``, as they stand on the wire.
        server: The same for the server.
        inward: From the wire's form to the program's; may raise a ``RemoteProtocolError``.
        outward: From the program's form to the wire's; None: this version has no word for it, nothing is
            said. Hello, welcome, error and bye are the same in every version.
    """

    version: int
    client: Mapping[str, type[Message]]
    server: Mapping[str, type[Message]]
    inward: Callable[[Message], Message] = unchanged
    outward: Callable[[Message], Message | None] = unchanged


DIALECTS: tuple[Dialect, ...] = (Dialect(1, Catalogue.client, Catalogue.server),)
"""All that this build speaks, in ascending order."""

VERSIONS: tuple[int, ...] = tuple(dialect.version for dialect in DIALECTS)


def choose(server: Iterable[int], client: Iterable[int]) -> int:
    """The highest version that both sides list.

    Raises:
        RemoteProtocolError: Fatal ``version``: they have none in common; the text names both lists.
    """
    mine, theirs = set(server), set(client)
    common = mine & theirs
    if not common:
        text = f"no version in common: the server speaks {_listed(mine)}, the client {_listed(theirs)}"
        raise RemoteProtocolError(ErrorCode.VERSION, text, about="hello")
    return max(common)


def check_choice(chosen: int, server: Iterable[int], client: Iterable[int], sent: Iterable[int]) -> None:
    """The client's look at a welcome: was the highest common version chosen, from the list that it sent?

    Raises:
        RemoteProtocolError: Fatal ``version``: the lists were changed on the way, or the choice is not the
        highest.
    """
    if set(client) != set(sent):
        text = f"the server saw the versions {_listed(client)}, sent were {_listed(sent)}"
        raise RemoteProtocolError(ErrorCode.VERSION, text, about="welcome")
    if (best := choose(server, sent)) != chosen:
        text = f"the server chose version {chosen} where both speak {best}"
        raise RemoteProtocolError(ErrorCode.VERSION, text, about="welcome")


def _listed(versions: Iterable[int]) -> str:
    return "[" + ", ".join(str(version) for version in sorted(versions)) + "]"
