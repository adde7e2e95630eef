"""Damaged and hostile recordings: one clear error or a result, never a traceback; bounded memory and time."""

import os

import pytest

from .damage import TOOLS, Content, tried, whole

COUNT = int(os.environ.get("DAMAGED", "48"))


@pytest.fixture(scope="module")
def content(tmp_path_factory):
    return Content(whole(tmp_path_factory.mktemp("whole")))


@pytest.mark.slow
@pytest.mark.parametrize("share", range(4))
def test_every_tool_reads_or_rejects_damaged_recordings(content, share):
    for seed in range(share, COUNT, 4):
        tools = TOOLS if seed % 8 == 0 else TOOLS[:-1]
        assert tried(content, seed, tools) == []
