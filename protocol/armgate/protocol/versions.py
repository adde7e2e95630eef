"""Which version of the protocol is spoken: ``VERSIONS`` (mine), ``choose`` (the highest in common)."""

from collections.abc import Iterable

from armgate.protocol.errors import ErrorCode, RemoteProtocolError

VERSIONS: tuple[int, ...] = (1,)


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
