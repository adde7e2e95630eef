"""Fixtures of the campaigns: `odd`, the module of programs, belongs to one test's folder at a time."""

import sys

import pytest


@pytest.fixture(autouse=True)
def _forget_odd(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", list(sys.path))
    sys.modules.pop("odd", None)
