"""Sessions of other clients: operators list them, and end one of them."""

from collections.abc import Mapping, Sequence
from itertools import islice

from armgate.protocol import ErrorCode, RemoteProtocolError
from armgate.protocol import messages as m
from armgate.world.interfaces import EventLog, Peer
from armgate.world.lease_changes import Leasing
from armgate.world.to_protocol import answer


def list_sessions(
    peers: Mapping[str, Peer], leasing: Leasing, robots: Sequence[str]
) -> tuple[m.SessionInfo, ...]:
    """Return at most as many sessions as an answer may hold; robots are listed in the order given."""
    return tuple(_session(peer, leasing, robots) for peer in islice(peers.values(), m.MAX_SESSIONS))


def _session(peer: Peer, leasing: Leasing, robots: Sequence[str]) -> m.SessionInfo:
    client = peer.client
    held = leasing.held_by(client.id)
    return m.SessionInfo(
        session=client.id,
        name=client.name,
        role=client.role,
        token=client.token,
        address=client.address,
        robots=tuple(robot for robot in robots if robot in held),
    )


def kick(peers: Mapping[str, Peer], operator: Peer, request: m.Kick, log: EventLog) -> None:
    """End a session on behalf of an operator.

    Raises:
        RemoteProtocolError: ``unknown_session``.
    """
    other = peers.get(request.session)
    if other is None:
        text = f"no session {request.session}; `sessions` lists those that exist"
        raise RemoteProtocolError(ErrorCode.UNKNOWN_SESSION, text, about="kick")
    by, reason = operator.client.name, request.reason
    log.warning("kicked", session=other.client.id, name=other.client.name, by=by, reason=reason)
    operator.send(answer(m.Kicked, request, session=other.client.id))
    text = f"{by} ended this session" + (f": {reason}" if reason else "")
    other.expel(RemoteProtocolError(ErrorCode.KICKED, text))
