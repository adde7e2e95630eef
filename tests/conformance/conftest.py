"""Fixture that runs a daemon in this event loop, and the kit's cases against it."""

from contextlib import asynccontextmanager
from functools import cache
from pathlib import Path

import pytest

from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.conformance.case import select_cases
from armgate.conformance.runner import Runner
from armgate.conformance.target import Target, query_server
from support import daemons

CONFIGS = Path(__file__).parents[2] / "configs"
TIMEOUT = 20.0


@cache
def cell(*files):
    """Return a cell, built once."""
    return build_cell(load_config([CONFIGS / file for file in files]))


@asynccontextmanager
async def serving(*files, build=cell, **more):
    """Run a daemon and yield its port; ``more`` are further arguments of ``Daemon``, such as its dialects."""
    async with daemons.serving(build(*files), **more) as port:
        yield port


@asynccontextmanager
async def another(*files, **more):
    """Run another daemon with these files and yield its host and port."""
    async with serving(*files, **more) as port:
        yield "127.0.0.1", port


class Kit:
    """Runner of cases against a daemon in this event loop."""

    async def results(self, *ids, within=None, files=("conformance.yaml",), participants=()):
        """Return the results of cases, by id."""
        async with serving(*files) as port:
            target = Target(
                "127.0.0.1", port, base_timeout=within or 10.0, start_another=lambda: another(*files)
            )
            server = await query_server(target, None, participants)
            return {r.case.id: r async for r in Runner(target, server).run(select_cases(list(ids)))}


@pytest.fixture
def kit():
    return Kit()
