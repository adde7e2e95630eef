"""Access to a viewer's page: host names, origins, the secret, framing."""

import base64
import contextlib
import http.client
import socket

import pytest
from websockets import Headers
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from armgate.apps.view.access import Access, RefusedError, parse_names, url_of
from armgate.apps.view.serving import Place, page_server

NAMES = parse_names(["robots.example", "lab.example:8443"])
ACCESS = Access("robots.lan", NAMES, secret="s3cret")


def check(host, origin=None, path="/?token=s3cret", access=ACCESS, local="127.0.0.1", **more):
    headers = Headers()
    for value in [host] if isinstance(host, str) else host:
        headers["Host"] = value
    if origin is not None:
        headers["Origin"] = origin
    for name, value in more.items():
        headers[name] = value
    access.check(headers, path, local, page=True)


@pytest.mark.parametrize(
    ("host", "origin"),
    [
        ("127.0.0.1:7480", None),
        ("127.0.0.1:7480", "http://127.0.0.1:7480"),
        ("LOCALHOST:7480", "http://localhost:7480"),
        ("localhost", "http://localhost"),
        ("[::1]:7480", "http://[::1]:7480"),
        ("localhost:8080", "http://localhost:8080"),  # an SSH tunnel
        ("robots.lan:7480", "http://robots.lan:7480"),  # --host robots.lan
        ("192.0.2.7:7480", "http://192.0.2.7:7480"),  # the address at which the request arrives
        ("127.0.0.1:7480", "https://robots.example"),  # a proxy that replaces Host
        ("robots.example", "https://robots.example"),  # a proxy that keeps it
        ("robots.example:443", "https://robots.example"),
        ("lab.example", "https://lab.example:8443"),
        ("lab.example:8443", "https://lab.example:8443"),
    ],
)
def test_own_hosts_and_origins_are_allowed(host, origin):
    check(host, origin, local="192.0.2.7")


@pytest.mark.parametrize(
    "host",
    [
        "evil.example", "evil.example:7480", "localhost.evil.example", "127.0.0.1.evil.example", "192.0.2.8",
        "robots.example.evil.example", "0.0.0.0:7480", "", "localhost:99999", "localhost:7480:1", "a b",
        "evil.example#localhost", "localhost@evil.example", (), ("localhost", "localhost"),
        ("localhost", "evil.example"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("origin", [None, "own"])
def test_a_foreign_host_is_refused_even_with_the_secret(host, origin):
    with pytest.raises(RefusedError, match=r"(?i)host"):
        check(host, origin and f"http://{host}", local="192.0.2.7")


@pytest.mark.parametrize(
    "origin",
    [
        "https://evil.example", "null", "", "file://", "http://localhost:7480", "http://127.0.0.1:7481",
        "http://127.0.0.1", "https://127.0.0.1:7480.evil.example", "ftp://127.0.0.1:7480",
        "https://robots.example:444", "https://lab.example", "http://127.0.0.1:7480/", "http://a@127.0.0.1:7480",
    ],
)  # fmt: skip
def test_the_page_of_another_origin_is_refused_and_the_text_names_the_option(origin):
    with pytest.raises(RefusedError, match="--host-name NAME"):
        check("127.0.0.1:7480", origin)


@pytest.mark.parametrize("path", ["/", "/?token=", "/?token=s3cre", "/?x=s3cret", "/?token=s3cret%20"])
@pytest.mark.parametrize(
    "cookie", ["", f"{ACCESS.cookie}=", f"{ACCESS.cookie}=s3cre", "armgate-view-7480=s3cret", "s3cret"]
)
def test_without_the_secret_nothing_is_served(path, cookie):
    with pytest.raises(RefusedError, match="open the address that armgate view printed"):
        check("127.0.0.1:7480", path=path, Cookie=cookie)


def test_the_secret_may_come_in_a_cookie():
    check("127.0.0.1:7480", path="/", Cookie=f"a=b; {ACCESS.cookie}=s3cret")


def test_secrets_differ_from_start_to_start_and_are_not_shown():
    one, two = Access(), Access()
    assert one.secret != two.secret
    assert len(one.secret) >= 43
    assert one.secret not in repr(one)


def test_a_ticket_opens_the_page_once(port):
    path = f"/?{ACCESS.query(once=True)}"
    assert ACCESS.secret not in path
    # A refused websocket request does not use up the ticket.
    assert "403" in upgrade(port, f"127.0.0.1:{port}", f"http://127.0.0.1:{port}", path)
    answer, _ = get(port, path)
    assert (answer.status, ACCESS.secret in answer.headers["Set-Cookie"]) == (302, True)
    assert get(port, path)[0].status == 403


@pytest.mark.parametrize(
    ("host", "url"),
    [
        ("127.0.0.1", "http://127.0.0.1:1/?token=s3cret"),
        ("0.0.0.0", "http://127.0.0.1:1/?token=s3cret"),
        ("::", "http://[::1]:1/?token=s3cret"),
        ("::1", "http://[::1]:1/?token=s3cret"),
        ("robots.lan", "http://robots.lan:1/?token=s3cret"),
    ],
)
def test_the_printed_address_can_be_opened(host, url):
    assert url_of(host, 1, ACCESS.query()) == url


@pytest.mark.parametrize("name", ["https://robots.example", "", "a b", "robots.example:port"])
def test_a_malformed_name_is_refused(name):
    with pytest.raises(ValueError, match=name or "^$"):
        parse_names([name])


# --- the server -------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def port():
    with page_server(Place("127.0.0.1", 0, ACCESS)) as server:
        yield server.get_port()


def get(port, path, **headers):
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer, body


def upgrade(port, host, origin, path="/?token=s3cret"):
    """Return the status line of a websocket request."""
    with socket.create_connection(("127.0.0.1", port), timeout=30) as wire:
        key = base64.b64encode(bytes(16)).decode()
        lines = [f"GET {path} HTTP/1.1", f"Host: {host}", "Upgrade: websocket", "Connection: Upgrade"]
        lines += [f"Sec-WebSocket-Key: {key}", "Sec-WebSocket-Version: 13", f"Origin: {origin}", "", ""]
        wire.sendall("\r\n".join(lines).encode())
        return wire.recv(400).split(b"\r\n")[0].decode()


def test_a_rebound_name_gets_no_page_and_no_websocket(port):
    answer, body = get(port, "/?token=s3cret", Host=f"evil.example:{port}")
    assert (answer.status, b"evil.example is not allowed" in body) == (403, True)
    assert "403" in upgrade(port, f"evil.example:{port}", f"http://evil.example:{port}")
    assert "101" in upgrade(port, f"127.0.0.1:{port}", f"http://127.0.0.1:{port}")


def test_the_name_of_a_reverse_proxy_is_allowed(port):
    for host in (f"127.0.0.1:{port}", "robots.example", "robots.example:443"):
        assert "101" in upgrade(port, host, "https://robots.example")
    assert "403" in upgrade(port, f"127.0.0.1:{port}", "https://other.example")


def test_the_token_moves_from_the_address_into_a_cookie(port):
    answer, body = get(port, "/?token=s3cret&darkMode=")
    assert (answer.status, answer.headers["Location"], body) == (302, "?darkMode=", b"")
    cookie = answer.headers["Set-Cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Lax" in cookie
    answer, body = get(port, "/", Cookie=cookie.partition(";")[0])
    assert (answer.status, b"<html" in body) == (200, True)
    assert get(port, "/")[0].status == 403


def test_viewers_at_one_address_keep_their_own_cookies(port):
    """Check two viewers of one host: browsers send the cookies of a host to all its ports."""
    with page_server(Place("127.0.0.1", 0, Access(secret="0ther"))) as other:
        pages = [(port, "s3cret"), (other.get_port(), "0ther")]
        kept = {}
        for at, secret in pages:
            answer, _ = get(at, f"/?token={secret}", Host="127.0.0.1:7480", Cookie=jar(kept))
            for cookie in answer.headers.get_all("Set-Cookie"):
                name, _, value = cookie.partition(";")[0].partition("=")
                kept[name] = value
        assert [get(at, "/", Host="127.0.0.1:7480", Cookie=jar(kept))[0].status for at, _ in pages] == [
            200,
            200,
        ]


def jar(cookies):
    return "; ".join(f"{name}={value}" for name, value in cookies.items())


def test_cookies_of_many_old_viewers_are_removed_and_no_others():
    old = [Access().cookie for _ in range(20)]
    headers = Headers(Cookie=jar(dict.fromkeys(["a", *old, ACCESS.cookie], "x")))
    first, *ended = ACCESS.cookies(headers)
    assert first.startswith(f"{ACCESS.cookie}=s3cret;")
    assert ended == [f"{name}=; Path=/; Max-Age=0" for name in old[:4]]


@pytest.mark.parametrize("path", ["/?token=s3cret", "/", "/none?token=s3cret"])
def test_no_site_may_frame_or_read_a_response(port, path):
    headers = get(port, path)[0].headers
    assert headers["X-Frame-Options"] == "DENY"
    assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
    assert "connect-src 'self'" in headers["Content-Security-Policy"]
    assert headers["Referrer-Policy"] == "no-referrer"
    assert headers["Cache-Control"] == "no-store"


def test_a_program_with_the_token_is_served_and_one_without_is_not(port):
    from viser import __version__

    how = {"subprotocols": [f"viser-v{__version__}"]}
    with connect(f"ws://127.0.0.1:{port}/?token=s3cret", **how) as wire:
        assert wire.recv(timeout=30)
    with pytest.raises(InvalidStatus, match="403"):
        connect(f"ws://127.0.0.1:{port}", **how)


def test_the_oldest_idle_connection_is_closed_for_a_new_one(port, monkeypatch):
    monkeypatch.setattr("armgate.apps.view.guarded_server.MOST_WAITING", 4)
    idle = [socket.create_connection(("127.0.0.1", port), timeout=20) for _ in range(6)]
    for oldest in idle[:2]:
        with contextlib.suppress(ConnectionResetError):
            assert oldest.recv(1) == b""
    for newest in idle[3:]:
        newest.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        assert newest.recv(12) == b"HTTP/1.1 403"
    for sock in idle:
        sock.close()
