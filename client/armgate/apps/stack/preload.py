"""Libraries that the fork server's children share; importing this module loads them."""

import importlib

from armgate.apps.cli import commands
from armgate.cell.compilation import announced
from armgate.control.compiled import prepare

LIBRARIES = ("msgpack", "pydantic", "pinocchio", "coal", "fcl", "yaml", "asyncio", "ssl")
OURS = (
    "armgate.apps.follow.program", "armgate.apps.lead.drive", "armgate.client", "armgate.cell.cell",
    "armgate.monitor.offline",
)  # fmt: skip

for name in (*LIBRARIES, *OURS):
    importlib.import_module(name)
for name in ("serve", "follow", "lead", "monitor"):
    commands()[name].load()
with announced():
    prepare()
