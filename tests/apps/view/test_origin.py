"""Who may speak to a viewer's page server."""

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from armgate.apps.view.origin import foreign
from armgate.apps.view.serving import page_server


@pytest.mark.parametrize(
    ("origin", "answer"),
    [
        (None, False),
        ("http://127.0.0.1:7480", False),
        ("http://localhost:7480", True),
        ("https://evil.example", True),
        ("null", True),
    ],
)
def test_a_page_of_another_site_is_foreign(origin, answer):
    headers = {"Host": "127.0.0.1:7480"} | ({} if origin is None else {"Origin": origin})
    assert foreign(headers) is answer


def test_no_page_gets_a_tunnel_to_the_internet(monkeypatch):
    from viser import _messages, _viser

    asked = []
    monkeypatch.setattr(_viser, "ViserTunnel", lambda *how, **more: asked.append(how))
    with page_server("127.0.0.1", 0) as server:
        handlers = server._websock_server._incoming_handlers[_messages.ShareUrlRequest]
        assert handlers
        for handler in handlers:
            handler(0, _messages.ShareUrlRequest())
        server._thread_executor.shutdown(wait=True)
    assert asked == []


def test_the_server_refuses_it():
    from viser import __version__

    with page_server("127.0.0.1", 0) as server:
        address = f"127.0.0.1:{server.get_port()}"
        how = {"subprotocols": [f"viser-v{__version__}"]}
        with connect(f"ws://{address}", origin=f"http://{address}", **how) as wire:
            assert wire.recv(timeout=30)
        with pytest.raises(InvalidStatus, match="403"):
            connect(f"ws://{address}", origin="https://evil.example", **how)
