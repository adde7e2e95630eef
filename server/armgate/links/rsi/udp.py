"""A UDP socket for a KRC's telegrams."""

import socket

from armgate.links.rsi.setup import Address


def bound(address: Address) -> socket.socket:
    """A socket on an address; it never blocks.

    Raises:
        OSError: It cannot be listened on; says which, and what was expected.
    """
    try:
        family, kind, _, _, found = socket.getaddrinfo(*address, type=socket.SOCK_DGRAM)[0]
        own = socket.socket(family, kind)
    except OSError as error:
        raise _said(address, error) from error
    try:
        own.setblocking(False)
        own.bind(found)
    except OSError as error:
        own.close()
        raise _said(address, error) from error
    return own


def _said(address: Address, error: OSError) -> OSError:
    text = f"{error.strerror}; expected an address of this machine, and a port that nobody else listens on"
    return OSError(error.errno, text, f"UDP {address[0]}:{address[1]}")
