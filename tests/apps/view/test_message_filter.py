"""Messages of pages: no page can disable a control for others, or make the viewer's memory grow."""

import contextlib
import os
import time

import msgspec
import pytest
import viser
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from armgate.apps.view import guarded_server as guard_module
from armgate.apps.view.access import Access
from armgate.apps.view.message_filter import LARGEST, MessageFilter, ViolationError
from armgate.apps.view.serving import Place, page_server

CAMERA = {
    "type": "ViewerCameraMessage", "wxyz": [1, 0, 0, 0], "position": [0, 0, 1.5], "fov": 1.0, "near": 0.1,
    "far": 100, "image_height": 480, "image_width": 640, "look_at": [0, 0, 0], "up_direction": [0, 0, 1],
}  # fmt: skip
packed = msgspec.msgpack.encode


class Controls:
    """Server with one control of each kind on its page."""

    def __init__(self, server, access):
        self.server, self.access, self.pressed = server, access, []
        self.button = server.gui.add_button("STOP")
        self.slider = server.gui.add_slider("Zoom", 0.5, 2.0, 0.05, 1.0)
        self.box = server.gui.add_checkbox("Frustum", True)
        self.choice = server.gui.add_dropdown("Speed", ("1 ×", "2 ×"))
        self.gizmo = server.scene.add_transform_controls("/drive/A")

        async def pressed(_event):
            self.pressed.append(time.monotonic())

        self.button.on_click(pressed)

    def value(self, control, value, **updates):
        uuid = getattr(self, control)._impl.uuid
        return {"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value} | updates}

    def page(self, **how):
        address = f"ws://127.0.0.1:{self.server.get_port()}/?{self.access.query()}"
        return connect(
            address, subprotocols=[f"viser-v{viser.__version__}"], max_size=None, close_timeout=0.2, **how
        )

    def until(self, condition):
        end = time.monotonic() + 30
        while not condition():
            assert time.monotonic() < end
            time.sleep(0.01)

    def stops(self, page):
        """Press STOP on a page, and wait for its effect."""
        before = len(self.pressed)
        page.send(packed(self.value("button", True)))
        self.until(lambda: len(self.pressed) > before)


@pytest.fixture(scope="module")
def controls():
    access = Access()
    with page_server(Place("127.0.0.1", 0, access)) as server:
        yield Controls(server, access)


@pytest.fixture
def page(controls):
    with controls.page() as page:
        page.send(packed(CAMERA))
        controls.until(controls.server.get_clients)
        yield page


def closing_code(page):
    """Read until the page is closed."""
    with contextlib.suppress(ConnectionClosed):
        while True:
            page.recv(timeout=30)
    return page.close_code


GIZMO = {"name": "/drive/A", "owner": ""}


def moved(**more):
    place = {"wxyz": [1, 0, 0, 0], "position": [0, 0.5, 1]}
    return {"type": "TransformControlsUpdateMessage", **GIZMO, **place, **more}


def test_messages_of_our_page_are_admitted(controls):
    inbound = MessageFilter(controls.server)
    for kind, value in (("button", True), ("slider", 1.5), ("slider", 2), ("box", False), ("choice", "2 ×")):
        assert inbound.admits(packed(controls.value(kind, value)))
    assert inbound.admits(packed(CAMERA))
    assert inbound.admits(packed(moved()))
    for kind in ("Start", "End"):
        assert inbound.admits(packed({"type": f"TransformControlsDrag{kind}Message", **GIZMO}))


def test_values_that_no_control_can_have_are_ignored(controls):
    inbound = MessageFilter(controls.server)
    gone = controls.value("button", True) | {"uuid": "removed-a-moment-ago"}
    wrong_values = [
        controls.value("slider", value) for value in (0.4, 2.1, 1e300, float("nan"), float("inf"))
    ]
    places = [moved(position=[0, 0, 1e9]), moved(wxyz=[0, 0, 0, 0]), moved(name="/drive/B")]
    places += [moved(position=[0, 0, float("nan")]), moved(wxyz=[float("nan")] * 4)]
    for message in [gone, *wrong_values, *places, CAMERA | {"fov": float("nan")}]:
        assert not inbound.admits(packed(message))


FOREIGN = (
    "GuiButtonHoldMessage", "GuiFormSubmitMessage", "GuiFormDirtyMessage", "FileTransferStartUpload",
    "FileTransferPart", "CommandTriggerMessage", "ShareUrlRequest", "ShareUrlDisconnect",
    "RunJavascriptMessage", "GuiRemoveMessage", "SceneNodeUpdateMessage", "SceneNodeClickMessage",
    "SceneNodeDragMessage",
    "ScenePointerMessage", "GetRenderResponseMessage", "LocalStorageGetItemResponseMessage", "None", "",
)  # fmt: skip


@pytest.mark.parametrize("kind", FOREIGN)
def test_other_messages_are_refused(controls, kind):
    with pytest.raises(ViolationError, match="unexpected message"):
        MessageFilter(controls.server).admits(packed({"type": kind, "uuid": controls.button._impl.uuid}))


def test_malformed_messages_are_refused(controls):
    inbound, value = MessageFilter(controls.server), controls.value
    deep = b"\x91" * 10000 + b"\xc0"
    kinds = [
        b"",
        b"\xc1",
        b"\x93\x01",
        deep,
        b"\x81\xa4type" + deep,
        packed([1]),
        packed({1: 2}),
        packed({}),
        "text",
    ]
    values = [
        value("button", False), value("button", 1), value("button", True, update_cb=[]),
        value("button", True, removed=True), value("box", "x"), value("box", 1), value("choice", "8 ×"),
        value("choice", ["1 ×"]), value("slider", "1"), value("slider", True), value("slider", None),
        value("slider", [1.0]), value("box", True) | {"updates": {}}, value("box", True) | {"updates": []},
        value("box", True) | {"updates": {"sync_cb": None}}, value("button", True) | {"uuid": 1},
        value("box", True) | {"uuid": "u" * 5000}, moved(position=[0, 0]), moved(position="abc"),
        moved(wxyz=[1, 0, 0, "0"]), moved(name=["/drive/A"]), moved(owner=None), CAMERA | {"wxyz": 1},
        CAMERA | {"more": "text"}, {"type": ["GuiUpdateMessage"]},
    ]  # fmt: skip
    for message in [*kinds, *map(packed, values)]:
        with pytest.raises(ViolationError):
            inbound.admits(message)


def test_messages_that_viser_cannot_read_are_refused(controls):
    inbound = MessageFilter(controls.server)
    held = {"type": "TransformControlsDragStartMessage", **GIZMO}
    whole = [CAMERA, controls.value("button", True), moved(), held]
    for message in whole:
        assert inbound.admits(packed(message))
        for name in message.keys() - {"owner"}:
            with pytest.raises(ViolationError):
                inbound.admits(packed({key: value for key, value in message.items() if key != name}))
        with pytest.raises(ViolationError, match="unexpected fields"):
            inbound.admits(packed(message | {"more": 1}))


@pytest.mark.parametrize(
    "attack",
    [
        lambda controls: controls.value("button", True, update_cb=[]),
        lambda controls: controls.value("button", True) | {"updates": {"removed": True}},
        lambda controls: {
            "type": "FileTransferStartUpload", "source_component_uuid": controls.button._impl.uuid,
            "transfer_uuid": "t", "filename": "f", "mime_type": "m", "part_count": 9, "size_bytes": 1 << 40,
        },
        lambda _: {"type": "ShareUrlRequest"},
    ],
)  # fmt: skip
def test_a_page_that_attacks_is_closed_and_stop_still_works_for_others(controls, page, attack):
    with controls.page() as bad:
        bad.send(packed(attack(controls)))
        assert closing_code(bad) == 1008
    controls.stops(page)
    assert not controls.server.gui._current_file_upload_states


def test_a_large_message_closes_its_page_only(controls, page):
    with controls.page() as bad:
        bad.send(bytes(LARGEST + 1))
        assert closing_code(bad) == 1009
    controls.stops(page)


def test_a_flood_is_slowed_down_to_a_rate(controls, page):
    began, before = time.monotonic(), len(controls.pressed)
    with controls.page() as bad:
        bad.send(packed(CAMERA))
        count = int(guard_module.BURST + 0.5 * guard_module.RATE)
        for _ in range(count):
            bad.send(packed(controls.value("button", True)))
        controls.until(lambda: len(controls.pressed) >= before + count)
        assert time.monotonic() - began >= 0.5
        controls.stops(page)


def test_more_pages_than_allowed_get_a_reason(controls, monkeypatch):
    monkeypatch.setattr(guard_module, "MOST_PAGES", 2)
    controls.until(lambda: not controls.server._websock_server._live_connections)
    with contextlib.ExitStack() as stack:
        for _ in range(2):
            stack.enter_context(controls.page()).recv(timeout=30)
        with pytest.raises(InvalidStatus, match="503"):
            controls.page()


def test_a_page_that_receives_nothing_is_closed(controls, page, monkeypatch):
    monkeypatch.setattr(guard_module, "STALLED", 0.3)
    with controls.page(max_queue=1) as bad:  # reads at most one message ahead
        bad.send(packed(CAMERA))
        controls.until(lambda: len(controls.server.get_clients()) == 2)
        client = max(controls.server.get_clients().values(), key=lambda client: client.client_id)
        for number in range(400):
            client.add_notification(f"{number}", os.urandom(50_000).hex())
        controls.until(lambda: len(controls.server.get_clients()) == 1)
    controls.stops(page)
