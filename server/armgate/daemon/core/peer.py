"""What the core sees of a session."""

from dataclasses import dataclass
from typing import Protocol, TypeVar

from armgate.protocol import RemoteProtocolError
from armgate.protocol.messages import Answer, Message, Request, Role, State

A = TypeVar("A", bound=Answer)


@dataclass(frozen=True, slots=True)
class Subscription:
    """Which states a session wants: at every n-th tick of these robots, with these fields of the entries."""

    every: int
    robots: frozenset[str]
    fields: tuple[str, ...]

    def wants(self, robot: str, tick: int) -> bool:
        """Whether the state at this tick is among them."""
        return robot in self.robots and tick % self.every == 0


@dataclass(frozen=True, slots=True)
class Encoded:
    """A state with its frame: encoded once, sent to many."""

    state: State
    frame: bytes


class Peer(Protocol):
    """One client after its hello."""

    id: str
    name: str
    role: Role
    identity: str
    """The token or address that limits and turns count by."""
    robots: frozenset[str] | None
    """The robots that it may command, None: all."""
    subscription: Subscription | None

    @property
    def capabilities(self) -> frozenset[str]:
        """The capabilities that it named in its hello."""

    @property
    def token_name(self) -> str | None:
        """Name of its token, None without one."""

    @property
    def known_as(self) -> str | None:
        """Name of its token, or ``uid N`` on the Unix socket; None if only its name is known."""

    @property
    def address(self) -> str:
        """Where it connects from."""

    def expel(self, error: RemoteProtocolError) -> None:
        """End the session at once; its client is told why."""

    def say(self, message: Message, frame: bytes | None = None) -> None:
        """Send a message that may not be dropped; its frame is given if it is encoded already."""

    def show(self, *states: Encoded) -> None:
        """Send states, each in place of an older one of the same robot that still waits."""

    def drop_states(self) -> None:
        """Drop the states that wait: they belong to a subscription that has ended."""

    def hold(self) -> None:
        """Let states, and what of answers may wait, wait until as many `let_go` followed: they go as one."""

    def let_go(self) -> None:
        """The opposite of `hold`."""

    def flush(self) -> None:
        """Write what waits because of `hold`, though it is held on."""

    def end(self, message: Message) -> None:
        """Send a last message and close."""


def answer(model: type[A], request: Request | None, **fields: object) -> A:
    """An answer to ``request``, or to nobody; its ``re`` is only set where there is an id to repeat."""
    if request is not None and request.id is not None:
        fields["re"] = request.id
    return model.model_validate(fields)
