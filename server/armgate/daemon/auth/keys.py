"""Certificates, tokens and users of a daemon, loaded as they are configured."""

import ssl
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from armgate.cell.config import CellConfig, ServerConfig
from armgate.daemon.auth.address import is_loopback
from armgate.daemon.auth.tls import server_context
from armgate.daemon.auth.tokens import Tokens, read
from armgate.daemon.auth.unix_socket import uids
from armgate.protocol.messages import Role


class InsecureError(Exception):
    """Configuration in which clients could connect without authentication; no robot was moved."""

    exit_code = 2


@dataclass(frozen=True, slots=True)
class Keys:
    """Certificates, tokens and users of a daemon; by default none, and every client is accepted.

    Attributes:
        tls: Encrypts connections; None: they are not encrypted.
        tokens: Tokens that are accepted; None: clients need no token.
        reread: Reads the tokens from their file again; None: they never change.
        users: Roles of the users of this machine by their id, on the Unix socket.
        socket: Path of the Unix socket; None: there is none.
        reread_tls: Makes ``tls`` from the files again; None: the certificates never change.
    """

    tls: ssl.SSLContext | None = None
    tokens: Tokens | None = None
    reread: Callable[[], Tokens] | None = None
    users: Mapping[int, Role] = field(default_factory=dict)
    socket: Path | None = None
    reread_tls: Callable[[], ssl.SSLContext] | None = None

    @property
    def tcp(self) -> bool:
        """True if the daemon listens on TCP; False if only the Unix socket can authenticate clients."""
        return self.socket is None or self.tokens is not None


def load_keys(config: CellConfig, *, login_required: bool) -> Keys:
    """Load certificates, tokens and users.

    Args:
        config: The cell's configuration.
        login_required: True if every client must be authenticated.

    Raises:
        InsecureError: The configuration would let clients connect that cannot be authenticated.
        TokenError: The tokens cannot be used.
        TlsError: A certificate or key cannot be used.
        UnixSocketError: This machine has no user of a configured name.
    """
    server = config.server
    _check_secure(server, login_required)
    tls = None if server.tls is None else _context(config)
    reread = (
        None if server.tokens is None else partial(read, config.file(("server", "tokens"), server.tokens))
    )
    local = server.socket
    return Keys(
        tls=tls,
        tokens=None if reread is None else reread(),
        reread=reread,
        users={} if local is None else uids(local.users),
        socket=None if local is None else config.file(("server", "socket", "path"), local.path),
        reread_tls=None if tls is None else partial(_context, config),
    )


def _check_secure(server: ServerConfig, login_required: bool) -> None:
    missing = [key for key in ("tls", "tokens") if getattr(server, key) is None]
    if missing and not is_loopback(server.host):
        raise InsecureError(
            f"refusing to listen on {server.host}: without TLS and tokens every client that reaches that "
            "address could command the robots or eavesdrop; configure "
            f"server.{' and server.'.join(missing)} (docs/security.md), or listen on 127.0.0.1 and use a "
            "tunnel (ssh -L)"
        )
    if login_required and server.tokens is None and server.socket is None:
        raise InsecureError(
            "--require-login: without tokens every user of this machine could command the robots; configure "
            "server.tokens or server.socket (docs/security.md)"
        )


def _context(config: CellConfig) -> ssl.SSLContext:
    tls = config.server.tls
    assert tls is not None
    base = ("server", "tls")
    return server_context(
        config.file((*base, "certificate"), tls.certificate),
        config.file((*base, "key"), tls.key),
        None if tls.client_ca is None else config.file((*base, "client_ca"), tls.client_ca),
    )
