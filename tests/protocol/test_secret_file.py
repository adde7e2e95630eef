"""Owner and permissions of files with secrets."""

import os
from pathlib import Path

import pytest

from armgate.client import BadArgument, read_token, tls_context
from armgate.protocol import secret_file as module
from armgate.protocol.secret_file import SecretFileError, check_secret_file, read_secret_file

ME = os.geteuid()


class Found:
    """Result of ``stat``, faked."""

    def __init__(self, mode, owner):
        self.st_mode, self.st_uid = 0o100000 | mode, owner


@pytest.mark.parametrize(
    ("user", "mode", "owner", "told"),
    [
        (1000, 0o600, 1000, None),
        (1000, 0o400, 1000, None),
        (1000, 0o640, 1000, "can read"),
        (1000, 0o604, 1000, "can read"),
        (1000, 0o620, 1000, "can read"),
        (1000, 0o640, 0, None),
        (1000, 0o644, 0, "can read"),
        (1000, 0o660, 0, "can read"),
        (1000, 0o600, 1001, "belongs to user 1001"),
        (0, 0o600, 1001, "belongs to user 1001"),
        (0, 0o640, 0, "can read"),
    ],
)
def test_owner_and_mode_of_a_secret_file(tmp_path, monkeypatch, user, mode, owner, told):
    monkeypatch.setattr(module.os, "geteuid", lambda: user)
    if told is None:
        module._check(tmp_path, Found(mode, owner))
    else:
        with pytest.raises(SecretFileError, match=told):
            module._check(tmp_path, Found(mode, owner))


def test_a_file_that_others_can_read_is_refused_with_a_remedy(tmp_path):
    file = tmp_path / "secret"
    file.write_text("armgate_x\n")
    file.chmod(0o644)
    for read in (check_secret_file, read_secret_file):
        with pytest.raises(SecretFileError, match=rf"mode 0644\); run: chmod 600 {file}"):
            read(file)
    with pytest.raises(BadArgument, match="chmod 600"):
        read_token(file)
    with pytest.raises(BadArgument, match="chmod 600"):
        tls_context(None, file, file)
    file.chmod(0o600)
    check_secret_file(file)
    assert read_secret_file(file) == "armgate_x\n"
    assert read_token(file) == "armgate_x"


@pytest.mark.parametrize("text", ["", "two words", "x" * 257])
def test_a_file_without_exactly_one_token_is_refused(tmp_path, text):
    file = tmp_path / "token"
    file.write_text(text)
    file.chmod(0o600)
    with pytest.raises(BadArgument, match="expected one token"):
        read_token(file)
    with pytest.raises(BadArgument, match="No such file"):
        read_token(tmp_path / "none")


def test_a_device_without_an_end_is_refused():
    with pytest.raises(SecretFileError, match="/dev/zero: more than 1048576 characters; expected a file"):
        read_secret_file(Path("/dev/zero"))
