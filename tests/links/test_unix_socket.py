"""The robot server's default socket is in a private folder, and no symbolic link is followed."""

import os
import stat

import pytest

from armgate.links.robot_server.unix_socket import SocketError, default_path, listen


@pytest.fixture
def runtime(tmp_path, monkeypatch):
    """Return a folder into which all users may write."""
    folder = tmp_path / "tmp"
    folder.mkdir()
    folder.chmod(0o1777)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))
    return folder


def closed(listening):
    for one in listening:
        one.close()


def test_the_folder_is_made_for_this_user_only(runtime):
    path = default_path("cell")
    closed(listen(path))
    assert path.parent.parent == runtime
    assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    closed(listen(path))  # an existing folder is used again


@pytest.mark.parametrize("mode", [0o755, 0o777, 0o770, 0o701])
def test_a_folder_that_others_can_use_is_refused(runtime, mode):
    folder = default_path("cell").parent
    folder.mkdir()
    folder.chmod(mode)
    with pytest.raises(SocketError, match="mode 0700"):
        listen(default_path("cell"))


def test_a_link_or_a_file_in_the_place_of_the_folder_is_refused(runtime, tmp_path):
    folder, other = default_path("cell").parent, tmp_path / "other"
    other.mkdir(mode=0o700)
    folder.symlink_to(other)
    with pytest.raises(SocketError, match="expected a folder"):
        listen(default_path("cell"))
    folder.unlink()
    folder.write_text("")
    with pytest.raises(SocketError, match=r"cannot make|expected a folder"):
        listen(default_path("cell"))
    assert list(other.iterdir()) == []


def test_a_folder_of_another_user_is_refused(runtime, monkeypatch):
    monkeypatch.setattr(os, "getuid", lambda: 12345)
    default_path("cell").parent.mkdir(mode=0o700)
    with pytest.raises(SocketError, match="folder of this user"):
        listen(default_path("cell"))


def test_a_lock_that_is_a_link_is_not_followed(tmp_path):
    target = tmp_path / "precious"
    target.write_text("precious")
    target.chmod(0o644)
    (tmp_path / "robots.sock.lock").symlink_to(target)
    with pytest.raises(SocketError, match="symbolic link"):
        listen(tmp_path / "robots.sock")
    assert (target.read_text(), stat.S_IMODE(target.stat().st_mode)) == ("precious", 0o644)
    (tmp_path / "robots.sock.lock").unlink()
    (tmp_path / "robots.sock.lock").symlink_to(tmp_path / "new")
    with pytest.raises(SocketError, match="symbolic link"):
        listen(tmp_path / "robots.sock")
    assert not (tmp_path / "new").exists()


def test_a_lock_that_is_a_pipe_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "robots.sock.lock")
    with pytest.raises(SocketError):
        listen(tmp_path / "robots.sock")
