"""The key that signs recordings."""

import sys

import pytest

from armgate.recorder.signer import SignerError, load_signer


def test_without_cryptography_the_error_names_the_command_that_installs_it(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "cryptography.exceptions", None)
    with pytest.raises(SignerError, match=r"in a checkout of armgate: pip install '\.\[sign\]'"):
        load_signer(tmp_path / "key")
