"""Failures of a viewer: a wrong token, a refused connection, two operators at once."""

import asyncio
import subprocess
import threading

import pytest

from armgate.apps.view.live import Live, in_words
from armgate.client import connect

from .conftest import ARMGATE, CONFIG, process


def run(*arguments):
    return subprocess.run(
        [*ARMGATE, *map(str, arguments)], capture_output=True, text=True, timeout=60, check=False
    )


@pytest.fixture
def secured(tmp_path):
    """Run a daemon that requires tokens; write a controller's token."""
    file, overlay = tmp_path / "tokens", tmp_path / "server.yaml"
    made = run("token", "--role", "controller", "--robots", "FR", "--file", file)
    assert made.returncode == 0, made.stderr
    overlay.write_text(f"armgate: 1\nserver: {{tokens: {file}}}\n")
    (tmp_path / "right").write_text(made.stdout.strip().splitlines()[-1])
    (tmp_path / "right").chmod(0o600)
    with process("serve", CONFIG, overlay, "--port", "0", prints="armgate: listening on ") as (address, _):
        yield address


def test_a_wrong_token_shows_no_cell_and_is_reported(secured, tmp_path):
    (tmp_path / "wrong").write_text("armgate_wrong\n")
    (tmp_path / "wrong").chmod(0o600)
    ended = run("view", secured, "--port", "0", "--token-file", tmp_path / "wrong")
    assert ended.returncode == 1
    assert "unauthorized" in ended.stderr
    assert "view at" not in ended.stdout
    assert "armgate_wrong" not in ended.stderr + ended.stdout


def test_a_controller_token_does_not_grant_the_operator_role(secured, tmp_path):
    ended = run("view", secured, "--port", "0", "--role", "operator", "--token-file", tmp_path / "right")
    assert ended.returncode == 1
    assert "use a valid token for this role" in ended.stderr
    view = ("view", secured, "--port", "0", "--role", "controller", "--token-file", tmp_path / "right")
    with process(*view, prints="armgate: view at "):
        pass


def test_a_refused_connection_is_reported():
    ended = run("view", "127.0.0.1:9", "--port", "0")
    assert ended.returncode == 1
    assert "armgate serve" in ended.stderr
    assert "Traceback" not in ended.stderr


def test_two_operators_that_stop_and_reset_at_once_both_get_responses(address):
    login = {"token": None, "tls": None}
    with Live(address, "one", "operator", login) as one, Live(address, "two", "operator", login) as two:
        begin, outcomes = threading.Barrier(2), []

        def press(live, first, then):
            for _ in range(15):
                begin.wait()
                outcomes.append(asyncio.run(in_words(first(live))))
                outcomes.append(asyncio.run(in_words(then(live))))

        def stop(live):
            return live.stop("pressed")

        def reset(live):
            return live.reset()

        threads = [
            threading.Thread(target=press, args=(one, stop, reset)),
            threading.Thread(target=press, args=(two, reset, stop)),
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert len(outcomes) == 60
        assert all(text for _, text in outcomes)
        # The cell may now be stopped or not. Another operator can stop it and reset every stop.
        with connect(address, name="observer", role="operator") as cell:
            stopped = cell.stop(reason="the end").stop
            states = cell.states()
            state = next(s for s in states if all(stopped in (entry.stops or ()) for entry in s.entries))
            assert all(entry.holder is None for entry in state.entries)
            for stop_id in sorted({stop for entry in state.entries for stop in entry.stops}):
                cell.reset(stop_id)
            next(state for state in states if not any(entry.stops for entry in state.entries))
