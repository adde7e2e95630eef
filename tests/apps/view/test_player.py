"""A recording as a source: its position, its states, and files that are refused."""

import pytest

from armgate.apps.view.command import recorded
from armgate.apps.view.player import Player
from armgate.recording import DamagedError, ForeignError, NewerFormatError, TruncatedError
from armgate.recording.scan import scan
from support import records

PERIOD = 0.012


@pytest.fixture
def player(tmp_path, clock):
    records.write(tmp_path)
    return Player(tmp_path, clock)


def shown(player):
    """Return the tick that is shown."""
    return player.newest().entries[0].tick


def test_the_player_shows_the_values_at_a_moment(player):
    assert player.length == pytest.approx(99 * PERIOD)
    assert shown(player) == 0
    for tick in (50, 7, 98):
        player.seek((tick + 0.5) * PERIOD)
        state = player.newest()
        assert state.entries[0].q == (0.001 * tick,)
        assert state.signals["s"].value == (float(tick),)
        assert player.newest() is state  # while paused, the recording is not read again
    player.seek(1e9)
    assert player.time == player.length
    assert shown(player) == 99
    player.seek(-1.0)
    assert player.time == 0.0
    assert player.problem is None


def test_the_player_advances_during_playback_and_stops_at_the_end(player, clock):
    player.seek(10 * PERIOD)
    clock.time += 5.0
    assert player.time == pytest.approx(10 * PERIOD)
    player.play(True)
    assert player.playing
    clock.time += 20 * PERIOD + 1e-6
    assert shown(player) == 30
    player.set_speed(0.5)
    clock.time += 20 * PERIOD
    assert shown(player) == 40
    player.play(False)
    clock.time += 5.0
    assert shown(player) == 40
    player.play(True)
    clock.time += 1e3
    assert shown(player) == 99
    assert not player.playing
    player.play(True)  # from the beginning again
    assert player.time == 0.0
    assert player.playing


def test_the_player_describes_the_time_of_the_recording(player):
    player.seek(0.5)
    assert "0.5 of 1.2 s" in player.describe(player.newest())
    assert "recorded 2023-11-1" in player.describe(player.newest())


def test_a_file_that_is_not_a_recording_is_refused_with_a_reason(tmp_path):
    with pytest.raises(ForeignError, match="no such file or folder"):
        Player(tmp_path / "nothing")
    with pytest.raises(ForeignError, match="holds no recording"):
        Player(tmp_path)
    (tmp_path / "notes.mcap").write_text("milk, bread")
    with pytest.raises(ForeignError):
        Player(tmp_path / "notes.mcap")
    for name, error, how in (
        ("broken", TruncatedError, {"close": False}),
        ("later", NewerFormatError, {"format": 99}),
        ("empty", DamagedError, {"ticks": ()}),
    ):
        (tmp_path / name).mkdir()
        records.write(tmp_path / name, **how)
        with pytest.raises(error):
            Player(tmp_path / name)


def test_an_asset_that_is_missing_is_named(player):
    with pytest.raises(DamagedError, match="does not hold 111111111111…, which its description names"):
        player.asset("1" * 64)


def test_an_asset_with_a_wrong_hash_is_named(player):
    name = player.description.robots[0].urdf.hash
    player._recording.header.assets[name] = "Infinity"  # valid base64
    with pytest.raises(
        DamagedError, match=f"holds other content as {name[:12]}…, which its description names"
    ):
        player.asset(name)


def test_damage_during_playback_is_reported_as_a_problem(tmp_path, clock):
    file = records.write(tmp_path)
    player = Player(tmp_path, clock)
    assert shown(player) == 0
    data, chunk = bytearray(file.read_bytes()), scan(file).chunks[6]
    data[chunk.offset + chunk.length // 2] ^= 0xFF
    file.write_bytes(data)
    for tick in range(99):
        player.seek(tick * PERIOD)
        player.newest()
    assert "recording-0001.mcap" in player.problem


@pytest.mark.parametrize(
    ("source", "answer"),
    [
        ("127.0.0.1:7411", False),
        ("[::1]:7411", False),
        ("cell.example:7411", False),
        ("unix:/run/armgate/cell.sock", False),
        ("runs/today", True),
        ("recording-0001.mcap", True),
        (".", True),
    ],
)
def test_a_source_is_an_address_or_a_recording(source, answer):
    assert recorded(source) is answer
