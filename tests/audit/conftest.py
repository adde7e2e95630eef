"""Recorded run for all tests that only read it."""

import asyncio

import pytest

from support.cells import arms_yaml
from support.clients import Process


@pytest.fixture(scope="session")
def one_run(tmp_path_factory):
    """Return the folder of a run in which no robot moves."""
    folder = tmp_path_factory.mktemp("one_run")

    async def serve():
        file = folder / "arms.yaml"
        file.write_text(arms_yaml())
        async with Process.serving(file, "--record", folder / "run") as daemon:
            daemon.signal()
            status, _ = await daemon.end()
        assert status == 0
        return folder / "run"

    return asyncio.run(serve())
