"""Addresses of a daemon: ``HOST:PORT``, an IPv6 host in brackets, or ``unix:PATH``."""

from armgate.client.errors import BadArgument

DEFAULT_PORT = 7411


def parse_address(text: str) -> tuple[str, int]:
    """Return host and port of ``HOST:PORT`` or ``[IPV6]:PORT``.

    Raises:
        BadArgument: The address has another form; the text states what is wrong.
    """
    host, colon, port = text.rpartition(":")
    if not colon or "]" in port:
        raise BadArgument(f"address {text!r}: no port; expected HOST:PORT, e.g. 127.0.0.1:{DEFAULT_PORT}")
    bracketed = host.startswith("[") and host.endswith("]")
    if ":" in host and not bracketed:
        raise BadArgument(f"address {text!r}: write an IPv6 host in brackets, e.g. [::1]:{DEFAULT_PORT}")
    host = host[1:-1] if bracketed else host
    if not host:
        raise BadArgument(f"address {text!r}: no host; expected HOST:PORT, e.g. 127.0.0.1:{DEFAULT_PORT}")
    if not (port.isascii() and port.isdigit() and 1 <= int(port) <= 65535):
        raise BadArgument(f"address {text!r}: port {port!r}; expected a number from 1 to 65535")
    return host, int(port)


def socket_path(address: str) -> str | None:
    """Return the path of ``unix:PATH``; None for another form of address.

    Raises:
        BadArgument: The path is empty.
    """
    kind, colon, path = address.partition(":")
    if kind != "unix" or not colon:
        return None
    if not path:
        raise BadArgument(f"address {address!r}: no path; expected unix:PATH, e.g. unix:/run/cell.sock")
    return path
