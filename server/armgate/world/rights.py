"""Roles: the requests that a client may send."""

from armgate.protocol import ErrorCode, RemoteProtocolError
from armgate.protocol import messages as m
from armgate.world.interfaces import Client, ClientRequest

_ALL: frozenset[m.Role] = frozenset({"observer", "controller", "operator"})
_CONTROLLERS: frozenset[m.Role] = frozenset({"controller", "operator"})
_OPERATORS: frozenset[m.Role] = frozenset({"operator"})

RIGHTS: dict[type[m.Message], frozenset[m.Role]] = {
    m.Describe: _ALL,
    m.Asset: _ALL,
    m.Subscribe: _ALL,
    m.Ping: _ALL,
    m.Stop: _ALL,
    # The gate refuses a command without a lease. Every command that can be read gets a verdict.
    m.Command: _ALL,
    m.Pass: _ALL,
    m.Acquire: _CONTROLLERS,
    m.Release: _CONTROLLERS,
    m.Signal: _CONTROLLERS,
    m.Reset: _OPERATORS,
    m.Sessions: _OPERATORS,
    m.Kick: _OPERATORS,
}
"""Roles that may send each request. Only operators may take over a lease; the lease machine checks that."""


def check_rights(client: Client, request: ClientRequest) -> None:
    """Check that a client may send a request.

    Raises:
        RemoteProtocolError: ``forbidden``, because of its role or its token.
    """
    allowed = RIGHTS[type(request)]
    if client.role not in allowed:
        text = f"{request.type} is not allowed as {client.role}; connect as {' or '.join(sorted(allowed))}"
        raise RemoteProtocolError(ErrorCode.FORBIDDEN, text, about=request.type)
    if isinstance(request, m.Acquire) and client.robots is not None and request.robot not in client.robots:
        text = f"acquire: your token does not allow {request.robot}; use a token that names this robot"
        raise RemoteProtocolError(ErrorCode.FORBIDDEN, text, about="acquire")
