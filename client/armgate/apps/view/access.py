"""Access to the viewer's page: allowed host names, allowed origins, and the secret of this start.

A browser lets the page of any site send requests to this machine. DNS rebinding goes further: an attacker
makes the name of a site resolve to this machine, so that the site's page has the same origin as ours. Hence a
request must name an allowed host, come from an allowed origin, and carry the secret of the printed address.
"""

import ipaddress
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from hashlib import sha256
from hmac import compare_digest
from secrets import token_urlsafe
from typing import Protocol
from urllib.parse import parse_qsl, urlencode

_HOST = re.compile(r"(\[[0-9A-Fa-f:.]+\]|[0-9A-Za-z_.-]{1,253})(?::([0-9]{1,5}))?")
_PORTS = {"http": 80, "https": 443}
_TOKEN = "token"  # noqa: S105  (the name of the query parameter)
_COOKIE = "armgate-view-"
_OTHERS = 16
"""Largest number of cookies of other viewers that are kept; all must fit into the header of a request."""
_PROXY = "--host-name NAME, with the name in the address bar (NAME:PORT if the port is not 80 or 443)"

HEADERS = {
    "Cache-Control": "no-store",
    # viser's page is one file with scripts, workers and WebAssembly in it; nothing is fetched from elsewhere.
    "Content-Security-Policy": (
        "default-src 'self' 'unsafe-inline' 'unsafe-eval' data: blob:; connect-src 'self' data: blob:; "
        "frame-ancestors 'none'; base-uri 'none'; form-action 'none'; object-src 'none'"
    ),
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}
"""Headers of every response: no other site may frame the page, and the page connects to this server only."""


class Headers(Protocol):
    """The headers of a request."""

    def get_all(self, key: str, /) -> list[str]:
        """Return all values of a header."""


class RefusedError(Exception):
    """Refusal of a request with status 403; the text gives the reason and the remedy."""


@dataclass(frozen=True, slots=True)
class Address:
    """Host name in lower case, and its port if the text has one."""

    host: str
    port: int | None

    @classmethod
    def parse(cls, text: str) -> "Address | None":
        """Return the address in ``HOST`` or ``HOST:PORT``; None for any other text."""
        match = _HOST.fullmatch(text)
        if match is None or (match[2] and int(match[2]) > 65535):
            return None
        return cls(match[1].strip("[]").lower().rstrip("."), int(match[2]) if match[2] else None)

    def with_port_of(self, scheme: str) -> "Address":
        """Return this address with the scheme's default port if it has none."""
        return Address(self.host, _PORTS[scheme] if self.port is None else self.port)


@dataclass(frozen=True)
class Access:
    """Rules for the requests to one viewer.

    Attributes:
        host: Name or address on which the page is served.
        names: Additional names under which browsers reach the page.
        secret: Secret of this start.
    """

    host: str = "localhost"
    names: tuple[Address, ...] = ()
    secret: str = field(default_factory=token_urlsafe, repr=False)
    _tickets: set[str] = field(default_factory=set, repr=False)

    @property
    def cookie(self) -> str:
        """Name of the cookie that holds the secret.

        Cookies ignore ports: viewers that a browser reaches at the same address, for example through two SSH
        tunnels, need different names.
        """
        return f"{_COOKIE}{sha256(self.secret.encode()).hexdigest()[:16]}"

    def check(self, headers: Headers, path: str, local: str, *, page: bool) -> None:
        """Check a request for the page or for its websocket.

        Args:
            headers: Headers of the request.
            path: Path and query of the request.
            local: IP address of this machine at which the request arrived.
            page: False for a websocket, for which a ticket is not valid.

        Raises:
            RefusedError: The request must be refused.
        """
        host = self._host(headers, local)
        self._check_origin(headers, host)
        token = self.has_token(path) if page else self._has_secret(path)
        if not (token or self._is_secret(_cookies(headers).get(self.cookie, ""))):
            raise RefusedError(
                "open the address that armgate view printed: it contains the token of this start"
            )

    def has_token(self, path: str) -> bool:
        """Return True if the query of a path contains the secret or a ticket."""
        return self._has_secret(path) or not self._tickets.isdisjoint(_tokens(path))

    def cookies(self, headers: Headers) -> list[str]:
        """Return the cookies to set for a request with the token: the secret, and deletions of old ones."""
        others = [name for name in _cookies(headers) if name.startswith(_COOKIE) and name != self.cookie]
        ended = [f"{name}=; Path=/; Max-Age=0" for name in others[:-_OTHERS]]
        return [f"{self.cookie}={self.secret}; Path=/; HttpOnly; SameSite=Lax", *ended]

    def use_up(self, path: str) -> None:
        """Invalidate the tickets in a path."""
        self._tickets.difference_update(_tokens(path))

    def query(self, *, once: bool = False) -> str:
        """Return the query for the page's address; with ``once``, a ticket that opens the page one time."""
        if not once:
            return urlencode({_TOKEN: self.secret})
        ticket = token_urlsafe()
        self._tickets.add(ticket)
        return urlencode({_TOKEN: ticket})

    def _has_secret(self, path: str) -> bool:
        return any(map(self._is_secret, _tokens(path)))

    def _is_secret(self, value: str) -> bool:
        return compare_digest(value.encode(errors="surrogateescape"), self.secret.encode())

    def _host(self, headers: Headers, local: str) -> Address:
        given = headers.get_all("Host")
        host = Address.parse(given[0]) if len(given) == 1 else None
        if host is None:
            raise RefusedError("expected one Host header with HOST or HOST:PORT")
        names = {self.host.lower(), *(name.host for name in self.names)}
        if not (host.host in names or is_local(host.host, local)):
            text = f"the host name {host.host} is not allowed; if this name is yours or your reverse proxy's"
            raise RefusedError(f"{text}, start the viewer with {_PROXY}")
        return host

    def _check_origin(self, headers: Headers, host: Address) -> None:
        """Check the origin: a browser sends one with each websocket, other programs send none."""
        given = headers.get_all("Origin")
        if not given:
            return
        scheme, _, rest = given[0].partition("://")
        origin = Address.parse(rest) if len(given) == 1 and scheme in _PORTS else None
        allowed = {known.with_port_of(scheme) for known in (host, *self.names)} if origin else set()
        if origin is None or origin.with_port_of(scheme) not in allowed:
            text = f"the page of {given[0][:100]!a} is not the viewer's own; behind a reverse proxy"
            raise RefusedError(f"{text}, start the viewer with {_PROXY}")


def without_token(path: str) -> str:
    """Return a relative address of the same page without the secret."""
    return "?" + urlencode([(key, value) for key, value in _query(path) if key != _TOKEN])


def parse_names(names: Iterable[str]) -> tuple[Address, ...]:
    """Return the addresses of configured names.

    Raises:
        ValueError: One of them is not a host name; the text is that name.
    """
    found = {name: Address.parse(name) for name in names}
    for name, address in found.items():
        if address is None:
            raise ValueError(name)
    return tuple(address for address in found.values() if address is not None)


def is_local(host: str, local: str) -> bool:
    """Return True if a host is this machine: a loopback name, or the address at which the request arrived."""
    if host == "localhost":
        return True
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return False
    return address.is_loopback or _plain(address) == _plain(ipaddress.ip_address(local.partition("%")[0]))


def _plain(
    address: ipaddress.IPv4Address | ipaddress.IPv6Address,
) -> ipaddress.IPv4Address | ipaddress.IPv6Address:
    """Return an IPv4-mapped IPv6 address as IPv4: the two kinds of sockets report it differently."""
    return getattr(address, "ipv4_mapped", None) or address


def _query(path: str) -> list[tuple[str, str]]:
    return parse_qsl(path.partition("?")[2], keep_blank_values=True)


def _tokens(path: str) -> list[str]:
    return [value for key, value in _query(path) if key == _TOKEN]


def _cookies(headers: Headers) -> Mapping[str, str]:
    pairs = (pair.strip().partition("=") for line in headers.get_all("Cookie") for pair in line.split(";"))
    return {name: value for name, _, value in pairs}


def url_of(host: str, port: int, query: str) -> str:
    """Return the address of the page.

    A wildcard address is replaced by the loopback address, which can be opened on this machine.
    """
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        shown = host
    else:
        wild = {4: "127.0.0.1", 6: "::1"}[address.version] if address.is_unspecified else host
        shown = f"[{wild}]" if address.version == 6 else wild
    return f"http://{shown}:{port}/?{query}"
