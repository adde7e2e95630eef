"""Addresses of a daemon: valid forms, and errors for others."""

import pytest

from armgate.client import BadArgument, parse_address
from armgate.client.address import socket_path


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("127.0.0.1:7411", ("127.0.0.1", 7411)),
        ("localhost:1", ("localhost", 1)),
        ("cell.example.org:65535", ("cell.example.org", 65535)),
        ("[::1]:7411", ("::1", 7411)),
    ],
)
def test_valid_addresses(text, expected):
    assert parse_address(text) == expected


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("", "no port"),
        ("localhost", "no port"),
        ("[::1]", "no port"),
        (":7411", "no host"),
        ("[]:7411", "no host"),
        ("::1:7411", "in brackets"),
        ("a:b:7411", "in brackets"),
        ("localhost:", "expected a number from 1 to 65535"),
        ("localhost:0", "expected a number from 1 to 65535"),
        ("localhost:65536", "expected a number from 1 to 65535"),
        ("localhost:-1", "expected a number from 1 to 65535"),
        ("localhost:http", "expected a number from 1 to 65535"),
        ("localhost:²", "expected a number from 1 to 65535"),
    ],
)
def test_invalid_addresses_are_explained(text, fault):
    with pytest.raises(BadArgument, match=fault):
        parse_address(text)
    with pytest.raises(ValueError, match="address"):
        parse_address(text)


def test_path_of_a_unix_socket():
    assert socket_path("unix:/run/cell.sock") == "/run/cell.sock"
    assert socket_path("unix:here.sock") == "here.sock"
    assert socket_path("127.0.0.1:7411") is None
    with pytest.raises(BadArgument, match="expected unix:PATH"):
        socket_path("unix:")
