"""The metrics port: its answers, and its bounds on idle connections."""

import contextlib
import resource
import socket
import threading
from pathlib import Path

import pytest

from armgate.daemon.metrics import http_server as module
from armgate.daemon.metrics.http_server import MetricsServer

PATIENCE = 20.0


@pytest.fixture
def port(monkeypatch):
    monkeypatch.setattr(module, "_RATE", 200.0)  # each connection has 40 ms before newer ones close it
    served = MetricsServer(lambda: b"page\n", "text/plain")
    yield served.open(0)
    served.close()
    assert not served._thread.is_alive()


def response_to(port, request):
    """Return the whole answer to a request."""
    with socket.create_connection(("127.0.0.1", port), PATIENCE) as sock:
        sock.sendall(request)
        return b"".join(iter(lambda: sock.recv(65536), b""))


def metrics_or_nothing(port):
    """Return the answer to a request; empty if newer connections have closed this one."""
    try:
        return get(port)
    except ConnectionError:
        return b""


def get(port, path="/metrics", host="localhost:7412"):
    return response_to(port, f"GET {path} HTTP/1.1\r\nHost: {host}\r\n\r\n".encode())


@pytest.mark.parametrize("path", ["/", "/metrics", "/metrics?x=1"])
@pytest.mark.parametrize("host", ["127.0.0.1:7412", "localhost", "[::1]:7412"])
def test_the_page(port, path, host):
    head, _, body = get(port, path, host).partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 200 OK\r\n")
    assert b"Content-Length: 5" in head
    assert body == b"page\n"


@pytest.mark.parametrize(
    ("request_", "status"),
    [
        (b"POST /metrics HTTP/1.1\r\n\r\n", b"405"),
        (b"GET /secret HTTP/1.1\r\n\r\n", b"404"),
        (b"GET /metrics HTTP/1.1\r\nHost: evil.example\r\n\r\n", b"403"),
        (b"\xff\x00garbage\r\n\r\n", b"405"),
        (b"\r\n\r\n", b"405"),
        (b"x" * 20_000, b"405"),
        (b"HEAD / HTTP/1.0\n\n", b"200"),
    ],
)
def test_other_requests(port, request_, status):
    assert response_to(port, request_).split()[1] == status


def test_a_thousand_idle_connections_block_no_request_and_cost_no_threads_or_descriptors(port):
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (min(hard, 4096), hard))
    idle = []
    try:
        before = threading.active_count()
        for _ in range(1020):
            sock = socket.socket()
            sock.setblocking(False)
            sock.connect_ex(("127.0.0.1", port))
            idle.append(sock)
        # A busy machine may need longer than 40 ms.
        assert any(b"200 OK" in metrics_or_nothing(port) for _ in range(8))
        assert threading.active_count() == before
        open_ = len(list(Path("/proc/self/fd").iterdir())) - len(idle)
        assert open_ < 200
    finally:
        for sock in idle:
            sock.close()
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


def test_a_burst_of_connections_closes_none_before_its_request_arrives(monkeypatch):
    monkeypatch.setattr(module, "_RATE", 0.01)  # after the burst no more connections come while the test runs
    served = MetricsServer(lambda: b"page\n", "text/plain")
    port = served.open(0)
    try:
        with contextlib.ExitStack() as stack:
            first, *_ = [
                stack.enter_context(socket.create_connection(("127.0.0.1", port), PATIENCE))
                for _ in range(module._OPEN + 4)
            ]
            first.sendall(b"GET / HTTP/1.1\r\n\r\n")
            assert b"200 OK" in first.recv(65536)
    finally:
        served.close()


def test_a_connection_without_a_request_is_closed_in_time(port, monkeypatch):
    monkeypatch.setattr(module, "_TIMEOUT", 0.1)
    with socket.create_connection(("127.0.0.1", port), PATIENCE) as sock:
        assert sock.recv(1) == b""


def test_a_port_in_use_is_an_error(port):
    with pytest.raises(OSError, match="in use"):
        MetricsServer(lambda: b"", "").open(port)
